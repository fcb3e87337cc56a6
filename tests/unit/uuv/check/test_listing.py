"""A hull that no thrusters turn in pitch: its list by statics, by simulation, and the verdicts."""

import mujoco
import numpy as np
import pytest

from uuv.check.check import check_vehicle
from uuv.check.hover import hover, rigid
from uuv.check.statics import listing_of, strongest_current
from uuv.controllers.hull.allocation import MOST_LIST, undriven_axes
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.sim import hydrodynamics as water
from uuv.tasks.surface_work import work_bounds

HEIGHT = 0.05  # [m] of the centre of buoyancy above that of mass


def six_vectored(ahead: float) -> mujoco.MjSpec:
    """Hull whose weight lies `ahead` [m] of its buoyancy, neutral, six thrusters."""
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><worldbody><body name="hull"><freejoint/>
        <inertial pos="{ahead} 0 {-HEIGHT}" mass="30" diaginertia="0.9 1.2 1.4"/>
        <geom type="box" size=".3 .2 .15" mass="0"/></body></worldbody></mujoco>"""
    )
    box = hydrodynamics.box((0.6, 0.4, 0.3))
    hydrodynamics.attach(
        spec,
        {
            "hull": hydrodynamics.BodyHydrodynamics(
                volume=30.0 / 1025.0,
                added_mass=box.added_mass,
                quadratic_damping=box.quadratic_damping,
                linear_damping=np.array([10.0, 10.0, 10.0, 5.0, 5.0, 5.0]),
            )
        },
        1025.0,
    )
    push = np.sqrt(0.5)
    layout = [
        ((x, y, 0), (push, -np.sign(x * y) * push, 0)) for x in (0.3, -0.3) for y in (0.2, -0.2)
    ]
    layout += [((0, y, 0), (0, 0, 1)) for y in (0.2, -0.2)]
    for i, (place, axis) in enumerate(layout):
        spec.body("hull").add_site(name=f"s{i}", pos=place)
        site = mujoco.mjtTrn.mjTRN_SITE
        spec.add_actuator(name=f"t{i}", trntype=site, target=f"s{i}", gear=[*axis, 0, 0, 0])
    kind = thrusters.Thruster(forward=60.0, reverse=60.0, time_constant=0.1)
    thrusters.attach(spec, {f"t{i}": kind for i in range(6)})
    return spec


@pytest.mark.parametrize("ahead", [0.0, 0.005, 0.014])
def test_the_list_is_that_of_the_moment_over_w_h(ahead: float, within) -> None:
    model = water.compile(six_vectored(ahead))
    listing = listing_of(model, Vehicle.of(model), np.zeros(0))
    assert listing is not None
    assert listing.axes == ("pitch",)
    weight = 30.0 * 9.81
    within("moment [N m]", listing.moment - weight * ahead, 1e-9)
    within("righting [N m/rad]", listing.righting - weight * HEIGHT, 1e-9)
    within("list [rad]", listing.angle - np.arctan(ahead / HEIGHT), 1e-9)

    # The hull under control comes to rest there.
    kept = hover(model)
    assert kept.drift < 0.02
    within("tilt in the simulation [rad]", kept.tilt - listing.angle, 0.01)


def test_a_list_beyond_twenty_degrees_is_refused_with_its_figure() -> None:
    verdict = check_vehicle(six_vectored(0.02), jobs=("hover",)).verdict("hover")
    assert (verdict.promised, verdict.code) == (False, "list")
    assert verdict.figure == pytest.approx(np.degrees(np.arctan(0.4)))
    assert "at most 20 deg" in verdict.said

    check = check_vehicle(six_vectored(0.005), jobs=("hover",))
    assert check.verdict("hover").promised
    listing = "no thruster drives pitch: 1.5 N m against W h = 14.7 N m/rad"
    assert listing in check.verdict("hover").said
    finding = check.found("thruster-rank")
    assert finding is not None
    assert (finding.level, finding.figure) == ("doubt", 5.0)


def test_all_axes_driven_list_nowhere() -> None:
    model = water.compile(vehicle_spec("uuv_puma"))
    vehicle = Vehicle.of(model)
    assert listing_of(model, vehicle, np.array(vehicle.q_home)) is None


def test_an_arm_in_a_closed_loop_is_named_and_hovers_held() -> None:
    spec = vehicle_spec("uuv_puma")
    spec.body("link3").add_site(name="crank", pos=[0.0, 0.05, 0.0])
    spec.body("hull").add_site(name="pivot", pos=[0.3, 0.0, -0.3])
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1="crank",
        name2="pivot",
    )
    check = check_vehicle(spec, jobs=("hover", "barrel-longitudinal"))
    finding = check.found("closed-loop")
    assert finding is not None
    assert "connect of crank and pivot" in finding.said
    assert check.verdict("hover").promised
    assert check.verdict("barrel-longitudinal").code == "closed-loop"

    model = spec.compile()
    held = rigid(spec, model)
    assert (model.nv, held.nv) == (13, 6)  # the spring of its pad is held too


def test_a_run_of_such_a_hull_may_list_as_far_as_the_check_allows() -> None:
    sound = OwnVehicle.of(vehicle_spec("uuv_puma"))
    assert work_bounds(sound).heel == work_bounds(sound).tilt
    spec = vehicle_spec("uuv_puma")
    for site in [site for site in spec.sites if "heave" in site.name]:
        site.pos[1] = 0.0  # none beside the middle: nothing drives roll
    own = OwnVehicle.of(spec)
    assert undriven_axes(own.vehicle.thruster_wrench) == ("roll",)
    assert work_bounds(own).heel == MOST_LIST
    assert work_bounds(own).tilt == work_bounds(sound).tilt


def test_a_hull_without_an_arm_hovers_with_its_closed_loop_held() -> None:
    """A flap on the hull, held at its other end by a weld: a loop, and no arm's base."""
    spec = vehicle_spec("bluerov2_heavy")
    flap = spec.body("hull").add_body(name="flap", pos=[0.1, 0.0, 0.1])
    flap.add_joint(name="flap", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 1.0, 0.0])
    flap.add_geom(size=[0.02, 0.02, 0.02], mass=0.01)
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="flap", name2="hull"
    )
    check = check_vehicle(spec, jobs=("hover",))
    finding = check.found("closed-loop")
    assert finding is not None
    assert "weld of flap and hull" in finding.said
    assert check.verdict("hover").promised


def test_a_current_acts_along_the_hulls_axes_whatever_its_heading_at_home() -> None:
    """Drag ahead and abeam differ; a hull drawn with another heading has the same ones."""
    speeds = []
    for quat in ([1.0, 0.0, 0.0, 0.0], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]):
        spec = six_vectored(0.0)
        spec.body("hull").quat = quat
        model = water.compile(spec)
        speeds.append([strongest_current(model, Vehicle.of(model), i, 40.0) for i in range(2)])
    assert speeds[0][0] > 1.1 * speeds[0][1]
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-9)

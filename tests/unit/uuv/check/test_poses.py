"""A promise at drawn poses of the object is a share, with the worst of those that pass."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from uuv.assembly import assemble
from uuv.check.check import check_vehicle
from uuv.check.checked_jobs import check_options
from uuv.check.conditions import Conditions
from uuv.check.findings import JobVerdict
from uuv.check.hover import hover
from uuv.check.jobs import of_poses, pushes_with_friction
from uuv.check.preflight import preflight
from uuv.check.remedies import Change, changes_for
from uuv.cli.vehicles import check_vehicle as command
from uuv.jobs import clean_barrel, clean_pile
from uuv.models.naming import CAMERA_SITE
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.water.cylinder_wake import wake_behind
from uuv.tasks.start_place import clearance


def verdict(code: str, figure: float) -> JobVerdict:
    said = f"{code} {figure}"
    return JobVerdict(job="pile", promised=code == "ok", code=code, said=said, figure=figure)


def test_most_poses_must_pass_and_the_commonest_reason_is_told() -> None:
    good = [verdict("ok", 0.8), *(verdict("ok", 0.3 + 0.01 * i) for i in range(18))]
    promise = of_poses([*good, verdict("start", 0.06)])
    assert (promise.promised, promise.code, promise.share) == (True, "ok", 0.95)
    assert promise.figure == 0.3
    assert promise.said == ("19 of 20 poses; worst: ok 0.3; 1 refused for start: start 0.06")

    bad = [verdict("reach", 0.2), verdict("start", 0.06), verdict("start", 0.09)]
    refused = of_poses([*good[:17], *bad])
    assert (refused.promised, refused.code, refused.share) == (False, "start", 0.85)
    assert refused.said.endswith("2 refused for start: start 0.06")
    assert of_poses(bad).said == "0 of 3 poses; 2 refused for start: start 0.06"
    assert of_poses(bad[:1]) == bad[0]  # one pose is told as it is


def test_each_seed_draws_another_pose() -> None:
    two = Conditions(poses=2)
    drawn = check_vehicle("uuv_puma", jobs=("barrel-longitudinal",), conditions=two).verdict(
        "barrel-longitudinal"
    )
    assert drawn.share == 1.0
    assert drawn.figure is not None
    assert drawn.said.startswith("2 of 2 poses; worst: margin")


def test_a_number_of_poses_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="--poses: must be at least 1, got 0"):
        command.main("check", ["uuv_puma", "--poses", "0"])


def low_camera(above: float) -> mujoco.MjSpec:
    """The default vehicle, its camera so high that it starts low."""
    spec = vehicle_spec("uuv_puma")
    spec.site(CAMERA_SITE).pos = np.array([0.9, 0.0, above])
    return spec


def test_a_start_has_room_for_what_moves_while_the_vehicle_settles() -> None:
    """One that is only just clear of the seabed is refused; the run starts at the same pose."""
    swing = hover(hydrodynamics.compile(vehicle_spec("uuv_puma")), (0.15, 0.0, 0.0)).swing
    assert 0.002 < swing < 0.2

    # The pose of a run with this seed, and how far it is from the seabed.
    scenario = replace(clean_barrel(), seed=3)
    made = assemble(scenario)
    vehicle = Vehicle.of(made.plant.model)
    far = clearance(made.plant.model, vehicle, made.X_WB)
    assert far.distance == np.inf
    high = float(np.array(vehicle_spec("uuv_puma").site(CAMERA_SITE).pos)[2])
    places = {}
    for above in (high + 1.0, high + 1.1):
        drawn = scenario.task.place(
            scenario, OwnVehicle.of(low_camera(above)), np.random.default_rng(3)
        )
        scene = drawn.scene(low_camera(above)).compile()
        places[above] = clearance(scene, Vehicle.of(scene), drawn.X_WB)
    (first, one), (second, other) = places.items()
    assert one.distance - other.distance == pytest.approx(second - first, abs=1e-6)
    assert "'seabed' with" in str(one)

    # Just clear, and clear by more than it moves.
    just = first + one.distance - 0.3 * swing
    roomy = first + one.distance - 2.0 * swing - 0.06
    for above, code in ((just, "start"), (roomy, "ok")):
        verdict = check_vehicle(
            low_camera(above), jobs=("barrel-longitudinal",), conditions=Conditions(poses=1, seed=3)
        ).verdict("barrel-longitudinal")
        assert verdict.code == code, verdict.said
    assert "feasible with --range" not in verdict.said


def test_a_refusal_names_an_option_that_passes() -> None:
    """And that option does pass; where none does, those that were tried are named."""
    strong = Conditions(poses=1, current=(0.0, 0.0, 0.75))
    (job,) = jobs = ("barrel-longitudinal",)
    refused = check_vehicle("uuv_puma", jobs=jobs, conditions=strong).verdict(job)
    assert not refused.promised
    word, *values = refused.remedy.split()
    assert word == "--current"
    assert refused.said.endswith(f"; feasible with {refused.remedy} at the 1 pose tried")
    x, y, z = map(float, values)
    slower = Conditions(poses=1, current=(x, y, z))
    assert check_vehicle("uuv_puma", jobs=jobs, conditions=slower).verdict(job).promised

    # What is tried for an arm that does not reach a pile: of each option the smallest change first.
    scenario = clean_pile(vehicle="uuv_puma", forces=(40.0,))
    length, arc, forces = changes_for("reach", "pile", scenario)
    assert length[0] == Change(word="length", value=0.4)
    largest = [changes[-1].typed for changes in (length, arc, forces)]
    assert largest == ["--length 0.1", "--arc 40", "--forces 8"]
    assert list(changes_for("view", "pile", scenario)) == []


def test_options_reach_the_jobs_and_what_none_takes_is_refused() -> None:
    """The object's job takes the place of the others; the margin is at the stated force."""
    conditions = Conditions(poses=1, forces=(40.0,), current=(0.0, 0.1, 0.0), object="valve")
    verdict = check_vehicle("uuv_puma", jobs=("object",), conditions=conditions).verdict("object")
    assert "at 40 N in 0.10 m/s" in verdict.said
    for args, message in (
        (
            ["--jobs", "hover", "--speed", "0.1"],
            "--speed: must be an option of one of the jobs hover",
        ),
        (["--object", "nope"], "unknown object 'nope'"),
        (["--speed", "-1"], r"task.speed \[m/s\]: must be finite, >= 0.0001"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            command.main("check", ["uuv_puma", *args])


def within_the_seabed() -> mujoco.MjSpec:
    """A vehicle whose start lies in the seabed."""
    return low_camera(1.6)


def blind() -> mujoco.MjSpec:
    """A vehicle whose camera looks at its own arm."""
    spec = vehicle_spec("uuv_puma")
    spec.site(CAMERA_SITE).pos = np.array(spec.site(CAMERA_SITE).pos) - [0.7, 0.0, 0.0]
    return spec


def test_what_the_check_refuses_runs_unchecked_and_the_metrics_say_so() -> None:
    """A start in the seabed, a blocked camera: refused with the option that runs them."""
    low = clean_barrel(vehicle=f"{__name__}:{within_the_seabed.__name__}")
    with pytest.raises(ConfigurationError, match="m deep in 'seabed' with"):
        assemble(low)
    unchecked = replace(low, vehicle=replace(low.vehicle, unchecked=True))
    assert "m deep in 'seabed' with" in assemble(unchecked).refused

    model = OwnVehicle.of(blind())
    with pytest.raises(ConfigurationError, match=r"the work was not started: .*--unchecked"):
        preflight(clean_barrel(), model)
    before = preflight(clean_barrel(unchecked=True), model)
    (line,) = before.lines
    assert re.match(r"not checked: \d+% of the camera's view is blocked", line)


def test_friction_is_the_same_share_of_the_push_in_all_directions() -> None:
    forces = pushes_with_friction(50.0)
    assert forces[:, 2] == pytest.approx(np.full(len(forces), -50.0))
    assert np.linalg.norm(forces[:, :2], axis=1) == pytest.approx(np.full(len(forces), 30.0))
    assert np.ptp(forces, axis=0) == pytest.approx([60.0, 60.0, 0.0])


def test_conditions_that_no_job_takes_are_refused_from_python_too() -> None:
    flow = wake_behind(np.array([0.2, 0.0, 0.0]), np.eye(4), np.array([[-0.5] * 3, [0.5] * 3]))
    for conditions, word in ((Conditions(speed=0.1), "speed"), (Conditions(flow=flow), "flow")):
        with pytest.raises(ConfigurationError, match=f"{word}: must be an option of one of the"):
            check_vehicle("uuv_puma", jobs=("hover",), conditions=conditions)
    check_options(("hover", "pile"), Conditions(flow=flow))

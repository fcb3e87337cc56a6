"""The check of a vehicle: ten broken ones, each told by a code and a figure, and the verdicts on
jobs.
"""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from io import StringIO

import mujoco
import numpy as np
import pytest
from rich.console import Console

from uuv.check.check import check_vehicle
from uuv.check.conditions import Conditions
from uuv.check.doubts import inertia_doubts
from uuv.check.findings import JobVerdict, VehicleCheck
from uuv.check.hovering import rest_of
from uuv.check.preflight import Preflight, preflight
from uuv.check.table import print_check
from uuv.cli.vehicles import check_vehicle as command
from uuv.jobs import clean_barrel
from uuv.models import hydrodynamics
from uuv.models.naming import CAMERA_SITE, HULL_BODY, TIP_SITE
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.sim import hydrodynamics as hydrodynamics_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import quat_wxyz_from_rotation, rotation_from_z

# with the tool that each carries
VEHICLES = {"uuv_puma": None, "bluerov2_heavy_alpha5": "small_pad"}
G = 9.81
ONE = Conditions(poses=1)


@pytest.fixture(scope="module")
def sound() -> dict[str, mujoco.MjSpec]:
    """Specs of the sound vehicles, to be copied."""
    return {name: vehicle_spec(name, tool) for name, tool in VEHICLES.items()}


def nothing(spec: mujoco.MjSpec) -> None:
    del spec


def no_keyframe(spec: mujoco.MjSpec) -> None:
    for key in list(spec.keys):
        spec.delete(key)


def five_kilograms_heavy(spec: mujoco.MjSpec) -> None:
    spec.body(HULL_BODY).mass += 5.0


def thruster_reversed(spec: mujoco.MjSpec) -> None:
    first = next(actuator for actuator in spec.actuators if actuator.name.startswith("thruster_"))
    first.gear = -np.array(first.gear)


def arm_too_weak(spec: mujoco.MjSpec) -> None:
    shoulder = next(actuator for actuator in spec.actuators if actuator.name == "joint2")
    shoulder.ctrlrange = 0.1 * np.array(shoulder.ctrlrange)


def no_tip(spec: mujoco.MjSpec) -> None:
    spec.delete(spec.site(TIP_SITE))


def inertia_missing(spec: mujoco.MjSpec) -> None:
    link = spec.site(TIP_SITE).parent
    link.explicitinertial = False
    link.mass = 0.0
    link.inertia = [0.0] * 3
    link.fullinertia = [np.nan] * 6


def inertia_of_a_marble(spec: mujoco.MjSpec) -> None:
    spec.body(HULL_BODY).fullinertia = [np.nan] * 6
    spec.body(HULL_BODY).inertia = [1e-3] * 3


def litres_for_cubic_metres(spec: mujoco.MjSpec) -> None:
    hull = hydrodynamics.attached(spec)[HULL_BODY]
    hydrodynamics.attach(spec, {HULL_BODY: replace(hull, volume=1000.0 * hull.volume)})


def axis_flipped(spec: mujoco.MjSpec) -> None:
    spec.joint("joint3").axis = -np.array(spec.joint("joint3").axis)


def camera_on_the_hull(spec: mujoco.MjSpec) -> None:
    site = spec.site(CAMERA_SITE)
    site.quat = quat_wxyz_from_rotation(rotation_from_z([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    site.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def step_too_long(spec: mujoco.MjSpec) -> None:
    spec.option.timestep = 0.15


# Per vehicle: the figure, where it follows from what was broken; else None.
BROKEN: list[tuple[Callable[[mujoco.MjSpec], None], str, str, float | None]] = [
    (no_keyframe, "computed-home", "clear of the hull", None),
    (five_kilograms_heavy, "trim", "too heavy by 49 N (5.0 kg)", -5.0 * G),
    (thruster_reversed, "thruster-against-pair", "pushes against its mirror image", None),
    (arm_too_weak, "arm-weak", "joint2 is the limit", None),
    (no_tip, "contract", "no site named 'tip'", None),
    (inertia_missing, "inertia", "moves and has no mass or inertia", None),
    (inertia_of_a_marble, "inertia", "hull: 0.001 kg m^2 and", None),
    (litres_for_cubic_metres, "density", "outside 30 to 20000; check volume [m^3]", None),
    (axis_flipped, "axis-flipped", "joint joint3: its axis may be reversed", None),
    (camera_on_the_hull, "camera-blocked", "mostly by hull", None),
    (step_too_long, "timestep", "timestep 0.15 s times the rate of the drag", None),
]


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize(
    ("breaks", "code", "said", "figure"), BROKEN, ids=[row[0].__name__ for row in BROKEN]
)
def test_a_broken_vehicle_is_told_by_code_and_figure(
    vehicle: str,
    breaks: Callable[[mujoco.MjSpec], None],
    code: str,
    said: str,
    figure: float | None,
    sound: dict[str, mujoco.MjSpec],
) -> None:
    spec = sound[vehicle].copy()
    breaks(spec)
    finding = check_vehicle(spec, jobs=()).found(code)
    assert finding is not None
    assert said in finding.said
    if figure is not None:
        assert finding.figure == pytest.approx(figure, rel=1e-2)


def judged(spec: mujoco.MjSpec, job: str) -> JobVerdict:
    """Verdict on a job at one pose of its object."""
    return check_vehicle(spec, jobs=(job,), conditions=ONE).verdict(job)


def codes(check: VehicleCheck) -> set[str]:
    return {finding.code for finding in check.findings if finding.level != "note"}


@pytest.mark.parametrize(
    ("vehicle", "known"), [("uuv_puma", set()), ("bluerov2_heavy_alpha5", {"arm-weak"})]
)
def test_a_sound_vehicle_has_no_such_finding(
    vehicle: str, known: set[str], sound: dict[str, mujoco.MjSpec]
) -> None:
    assert codes(check_vehicle(sound[vehicle], jobs=())) <= known


def test_figures_follow_from_what_was_broken(sound: dict[str, mujoco.MjSpec]) -> None:
    """The reversed thruster costs its share of thrust; a drive too weak for the arm's own weight is
    full of it.
    """
    reversed_, weak = (sound["uuv_puma"].copy() for _ in range(2))
    thruster_reversed(reversed_)
    finding = check_vehicle(reversed_, jobs=()).found("thruster-against-pair")
    assert finding is not None
    # both at the lesser thrust, that of one astern
    assert finding.figure == pytest.approx(2 * 220.0, rel=1e-3)
    assert "reversed 600 N" in finding.said
    arm_too_weak(weak)
    loaded = check_vehicle(weak, jobs=()).found("joint-load")
    assert loaded is not None
    assert loaded.figure is not None
    assert loaded.figure > 1.0


def test_principal_inertias_obey_the_triangle() -> None:
    spec = mujoco.MjSpec.from_string(
        '<mujoco><compiler balanceinertia="false"/><worldbody><body name="b"><freejoint/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1.9"/><geom size="1.5" '
        'mass="0"/></body></worldbody></mujoco>'
    )
    model = spec.compile()
    assert not list(inertia_doubts(model))
    model.body_inertia[1] = [1.0, 1.0, 2.5]  # as a file cannot say it: MuJoCo's compiler refuses it
    assert [finding.code for finding in inertia_doubts(model)] == ["inertia"]


@pytest.mark.parametrize(
    ("breaks", "job", "code"),
    [
        (no_keyframe, "barrel-longitudinal", "ok"),
        (arm_too_weak, "barrel-longitudinal", "force"),
        (camera_on_the_hull, "barrel-longitudinal", "view"),
        (no_tip, "barrel-longitudinal", "contract"),
        (step_too_long, "hover", "timestep"),
        (nothing, "seabed-core", "ok"),
        (nothing, "pile", "reach"),  # the arm hangs under the hull
    ],
)
def test_verdicts_name_what_decides(
    breaks: Callable[[mujoco.MjSpec], None], job: str, code: str, sound: dict[str, mujoco.MjSpec]
) -> None:
    spec = sound["uuv_puma"].copy()
    breaks(spec)
    verdict = judged(spec, job)
    assert (verdict.code, verdict.promised) == (code, code == "ok")
    assert re.search(r"\d", verdict.said.replace("joint2", "")) or code == "contract"


def test_what_begins_or_hovers_badly_is_refused(sound: dict[str, mujoco.MjSpec]) -> None:
    """Each by its own figure: the step, weight taken away, a start in the seabed."""
    late, light, low = (sound["uuv_puma"].copy() for _ in range(3))
    late.option.timestep = 0.003
    light.body(HULL_BODY).gravcomp = 1.0
    low.site(CAMERA_SITE).pos = np.array([0.9, 0.0, 1.6])
    for spec, code, words in (
        (late, "timestep", 'set the model\'s <option timestep="0.002"/>'),
        (light, "gravcomp", "gravcomp cancels the weight of hull"),
        (low, "start", "m deep in 'seabed' with"),
    ):
        verdict = judged(spec, "barrel-longitudinal")
        assert (verdict.code, verdict.promised) == (code, False), verdict.said
        assert words in verdict.said


def test_a_hull_that_swings_about_its_place_is_no_base_for_work(
    sound: dict[str, mujoco.MjSpec],
) -> None:
    """Without the tool's weight the small vehicle balances on its thrusters' least thrust; 3 m/s
    carry it away.
    """
    still, gone = (
        hydrodynamics_of.compile(vehicle_spec("bluerov2_heavy_alpha5", None)) for _ in range(2)
    )
    swings = rest_of("tap", still, (0.0, 0.0, 0.0)).refusal
    assert swings is not None
    assert (swings.code, swings.promised) == ("rest", False)
    assert "(limit 0.02)" in swings.said
    away = rest_of("tap", gone, (0.0, 3.0, 0.0)).refusal
    assert away is not None
    assert away.code == "hover"
    steady = hydrodynamics_of.compile(sound["uuv_puma"].copy())
    assert rest_of("tap", steady, (0.15, 0.0, 0.0)).refusal is None


def test_water_of_welded_links_counts_as_one(sound: dict[str, mujoco.MjSpec]) -> None:
    spec = sound["uuv_puma"].copy()
    hull = spec.body(HULL_BODY)
    hull.mass -= 40.0
    ballast = hull.add_body(
        name="ballast", mass=40.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True
    )
    ballast.add_geom(size=[0.1, 0.1, 0.1], mass=0.0)
    assert not codes(check_vehicle(spec, jobs=())) & {"no-water", "density"}


def test_a_fault_refuses_jobs(sound: dict[str, mujoco.MjSpec]) -> None:
    """A servo refuses those of the arm alone, a direction without thrust too; preflight says the
    same.
    """
    servo, five = (sound["uuv_puma"].copy() for _ in range(2))
    next(actuator for actuator in servo.actuators if actuator.name == "joint2").gear[0] = 2.0
    five.delete(next(actuator for actuator in five.actuators if actuator.name == "thruster_sway"))
    for spec, code in ((servo, "motor"), (five, "thruster-rank")):
        verdict = judged(spec, "barrel-longitudinal")
        assert (verdict.promised, verdict.code) == (False, code)
        with pytest.raises(ConfigurationError, match=r"the work was not started: .* uuv check"):
            preflight(clean_barrel(), OwnVehicle.of(spec))
    assert check_vehicle(servo, jobs=("hover",)).verdict("hover").promised
    with pytest.raises(ConfigurationError, match="hammer"):
        check_vehicle(sound["uuv_puma"], tool="hammer", jobs=())


def test_a_joint_without_its_rotor_is_named(sound: dict[str, mujoco.MjSpec]) -> None:
    spec = sound["uuv_puma"].copy()
    spec.joint("joint6").armature = 0.0
    next(actuator for actuator in spec.actuators if actuator.name == "joint6").ctrlrange = [
        -300.0,
        300.0,
    ]
    finding = check_vehicle(spec, jobs=()).found("light-joint")
    assert finding is not None
    model = hydrodynamics_of.compile(spec)
    inertia = float(model.dof_M0[model.joint("joint6").dofadr[0]])
    assert finding.figure == pytest.approx(300.0 * 0.002 / inertia)


def test_thrusters_that_span_five_directions_are_named(sound: dict[str, mujoco.MjSpec]) -> None:
    spec = sound["uuv_puma"].copy()
    spec.delete(next(actuator for actuator in spec.actuators if actuator.name == "thruster_sway"))
    check = check_vehicle(spec, jobs=("hover",))
    finding = check.found("thruster-rank")
    assert finding is not None
    assert finding.figure == 5.0
    assert "sway" in finding.said
    assert not check.verdict("hover").promised


def test_hover_of_eight_thrusters_is_promised(sound: dict[str, mujoco.MjSpec]) -> None:
    check = check_vehicle(sound["bluerov2_heavy_alpha5"], jobs=("hover-current",))
    verdict = check.verdict("hover-current")
    assert verdict.promised
    assert verdict.figure is not None
    assert verdict.figure < 0.05
    assert any(figure.said.startswith("8, rank 6 of 6") for figure in check.figures)


def test_the_command_prints_a_screen_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main("check", ["uuv_puma", "--jobs", "barrel-longitudinal", "--poses", "2"]) == 0
    output = capsys.readouterr().out
    assert len(output.splitlines()) < 30
    assert "feasible" in output
    assert command.main("check", ["bluerov2_heavy_alpha5", "--jobs", "tap", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["sound"] is False
    assert document["jobs"][0]["code"] == "parts"
    assert "--tool small_pad" in document["jobs"][0]["said"]
    with pytest.raises(ConfigurationError, match=r"no job 'hovr'.*did you mean hover"):
        check_vehicle("uuv_puma", jobs=("hovr",))


def test_findings_are_printed_with_their_codes(sound: dict[str, mujoco.MjSpec]) -> None:
    spec = sound["uuv_puma"].copy()
    five_kilograms_heavy(spec)
    output = StringIO()
    print_check(check_vehicle(spec, jobs=()), Console(width=120, file=output))
    assert "too heavy by 49 N" in output.getvalue()


def test_a_job_far_beyond_a_vehicle_is_not_begun(sound: dict[str, mujoco.MjSpec]) -> None:
    """And one that is beyond `ready` alone is begun with a line about it, a sound one without."""
    job = clean_barrel()
    vehicle = OwnVehicle.of(sound["uuv_puma"].copy())
    assert preflight(job, vehicle) == Preflight()
    weak = sound["uuv_puma"].copy()
    arm_too_weak(weak)
    with pytest.raises(
        ConfigurationError,
        match=r"tip force is 0 N in the ready posture \(joint2\), the set force is 90 N",
    ):
        preflight(job, OwnVehicle.of(weak))
    blind = sound["uuv_puma"].copy()
    camera_on_the_hull(blind)
    with pytest.raises(
        ConfigurationError,
        match="68% of the camera's view is blocked by the vehicle itself, mostly by hull",
    ):
        preflight(job, OwnVehicle.of(blind))
    small = OwnVehicle.of(sound["bluerov2_heavy_alpha5"].copy())
    (message,) = preflight(
        clean_barrel(vehicle="bluerov2_heavy_alpha5", forces=(80.0,)), small
    ).lines
    assert re.fullmatch(
        r"doubtful: the set force of 80 N needs \d+% of a thruster's limit .*; "
        r"uuv check finds a set force that passes",
        message,
    )
    with pytest.raises(
        ConfigurationError, match="the tool's spring bottoms out at 100 N, the set force is 110 N"
    ):
        preflight(clean_barrel(vehicle="bluerov2_heavy_alpha5", forces=(110.0,)), small)


def test_gravity_that_points_up_is_said(sound: dict[str, mujoco.MjSpec]) -> None:
    spec = sound["uuv_puma"].copy()
    spec.option.gravity = [0.0, 0.0, G]
    finding = check_vehicle(spec, jobs=()).found("gravity")
    assert finding is not None
    assert (finding.figure, "forward-starboard-down" in finding.said) == (G, True)


def test_commands_behind_a_check_say_what_stays_the_same() -> None:
    """Insertion and seabed work bring their own tool and force."""
    jobs = [
        JobVerdict(job=job, promised=True, code="ok", said="")
        for job in ("pile", "insertion", "seabed-core")
    ]
    output = StringIO()
    print_check(VehicleCheck(vehicle="rov", jobs=tuple(jobs)), Console(width=200, file=output))
    text = output.getvalue()
    assert "with the same options: uuv run clean-pile\n" in text
    assert (
        "with the same options but --tool and --forces: uuv run insert-sampler, sample-seabed\n"
        in text
    )

"""Writes a working part of your own, with a test: `uuv new job|task|controller|... NAME`.

`uuv new mapping FILE` writes the first mapping of a vehicle's file.
"""

import keyword
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uuv.catalogue import CHECKOUT
from uuv.cli.vehicles.new_mapping import new_mapping
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import parse
from uuv.sim.runs.saving import write_whole


@dataclass(frozen=True, slots=True)
class Skeleton:
    """Texts of a part, of its test and of a command that uses it, with NAME for the name."""

    part: str
    test: str
    use: str


CONTROLLER = Skeleton(
    part='''"""Controller NAME: the project's controller with another force law."""

from uuv.controllers.arm.position_force import ForceDisplacement
from uuv.controllers.whole_body.work_controller import WorkController


class ForceLaw(ForceDisplacement):
    """Displacement of the tool along its axis from the force error: an integrator."""

    gain = 4e-4  # [m/(N s)]

    def step(self, state, set_force, felt, servo_compliance, dt):
        """Displacement [m] into the surface; `set_force` and `felt` [N], `dt` [s]."""
        state.k += self.gain * (set_force - felt) * dt
        return state.k


def NAME(model, *, water_error=0.0):
    """The controller for the believed vehicle `model`.

    `water_error` is the relative error of its added masses and drags.
    """
    return WorkController(model, force_law=ForceLaw(), water_error=water_error)
''',
    test="""from dataclasses import replace

from uuv import jobs, run


def test_the_main_job_is_done():
    scenario = jobs.clean_barrel(seed=0, quick=True)
    control = replace(scenario.control, controller="NAME:NAME")
    ran = run(replace(scenario, control=control))
    contact = ran.assessment.metrics["contact"]
    assert ran.recording.final.state == "done"
    assert contact["lost_s"] == 0.0
    # [N] the bound of an accepted run; the default law stays below 3
    assert contact["force_error_max_n"] < 9.0
""",
    use="uuv run clean-barrel --quick --controller NAME:NAME",
)
VEHICLE = Skeleton(
    part='''"""Vehicle NAME: the project's vehicle with a heavier hull, trimmed again."""

from uuv import models
from uuv.models import hydrodynamics


def NAME():
    """The vehicle as an MjSpec with hydrodynamic data; `uuv check NAME:NAME` checks it.

    For an MJCF of your own use mujoco.MjSpec.from_file("my.xml"), `hydrodynamics.attach` for the
    coefficients of each body, `uuv.models.water.thrusters.attach` for the thrusters.
    """
    spec = models.load("uuv_puma")
    hull = spec.body("hull")
    hull.mass = float(hull.mass) + 20.0  # [kg]

    # Neutrally buoyant and level again, with the arm folded.
    folded = spec.key("home").qpos
    hydrodynamics.trim(spec, "hull", metacentric_height=0.06, qpos=folded)
    return spec
''',
    test="""import numpy as np
from uuv.check.check import check_vehicle
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics

from NAME import NAME


def test_it_has_what_jobs_of_the_arm_need():
    model = hydrodynamics.compile(NAME())
    assert {part.state for part in check_vehicle(NAME(), jobs=()).parts} == {"there"}
    assert len(Vehicle.of(model).joint_names) == 6


def test_it_is_heavier_than_the_original():
    from uuv import models

    compiled = [hydrodynamics.compile(spec) for spec in (NAME(), models.load("uuv_puma"))]
    heavier, original = [float(np.sum(model.body_mass)) for model in compiled]
    assert heavier - original > 19.0
""",
    use="uuv run clean-barrel --quick --vehicle NAME:NAME",
)
OBJECT = Skeleton(
    part='''"""Object NAME: a pipe on two feet, and a tool path along its top."""

import numpy as np
import trimesh
from uuv.models.objects.target_model import TargetModel
from uuv.perception.toolpath.path_shapes import laid_on, line

RADIUS, LENGTH = 0.16, 0.9  # [m] of the pipe


def NAME():
    """The object in its frame T: x along the pipe, z up.

    From a file: TargetModel.from_file("part.stl", scale=0.001).
    """
    ends = [[-0.5 * LENGTH, 0.0, 0.0], [0.5 * LENGTH, 0.0, 0.0]]
    parts = [trimesh.creation.cylinder(RADIUS, segment=ends, sections=96)]
    for x in (-0.35, 0.3):
        foot = trimesh.creation.box((0.08, 0.3, 0.3))
        parts.append(foot.apply_translation((x, 0.0, -0.25)))
    mesh = trimesh.util.concatenate(parts)
    vertices, triangles = np.array(mesh.vertices), np.array(mesh.faces)
    pipe = TargetModel(name="NAME", vertices=vertices, triangles=triangles)

    over = line([-0.2, 0.0, RADIUS], [0.2, 0.0, RADIUS])
    return pipe.with_path("top", laid_on(pipe, over, [0.0, 0.0, -1.0]))  # projected from above
''',
    test="""import mujoco
import numpy as np
from uuv.perception import Scan, SensorModel, identify
from uuv.sim.interfaces.spatial import exp_so3, pose
from uuv.sim.sensors.depth_camera import DepthCamera, Optics

from NAME import NAME


def test_its_path_lies_on_it():
    path = NAME().path("top")
    assert np.allclose(path.p[:, 2], 0.16, atol=1e-3)
    assert np.allclose(path.a, [0.0, 0.0, -1.0], atol=0.02)  # the pipe has facets


def test_it_is_found_in_a_depth_frame():
    target, spec = NAME(), mujoco.MjSpec()
    # The camera S is at the origin, z ahead.
    X_ST = pose(exp_so3([2.2, 0.4, 0.3]), [0.05, -0.02, 1.4])
    target.add_to(spec, X_ST)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera = DepthCamera(model, "world", np.eye(4), optics=Optics())
    _, image = camera.step(camera.init(np.random.default_rng(0)), data)

    found = identify(Scan.from_depth(image), target, approach=[0.0, 0.0, 1.4], sensor=SensorModel())
    assert found.accepted, found.reason
    off, turned = target.symmetry.error(found.X_sensor_target, X_ST)  # [m], [rad]
    assert off < 0.005
    assert turned < 0.02
""",
    use="uuv run clean-object --object NAME:NAME",
)
SENSOR = Skeleton(
    part='''"""Sensor NAME: the depth camera with twice the noise, and its model for perception."""

from uuv.models.naming import HULL_BODY
from uuv.perception import SensorModel
from uuv.sim.sensors.depth_camera import DepthCamera, Optics
from uuv.sim.sensors.stereo_noise import StereoNoise

DISPARITY = 0.5  # [px] standard deviation


def NAME(model, X_BS):
    """The sensor at `X_BS` (4, 4) on the hull of the compiled world `model`, and its model.

    A sensor of another kind has `period` and `delay` [s], `init(rng) -> state` and
    `step(state, truth) -> (state, measurement)` (uuv.sim.interfaces.protocols.Sensor).
    """
    optics, noise = Optics(), StereoNoise(disparity_sigma=DISPARITY)
    camera = DepthCamera(model, HULL_BODY, X_BS, optics=optics, noise=noise)
    return camera, SensorModel(focal=optics.focal, disparity_sigma=DISPARITY)
''',
    test="""from dataclasses import replace

from uuv import assemble, jobs, run


def test_the_barrel_is_found_with_it():
    scenario = jobs.clean_barrel(seed=0, quick=True)
    sensing = replace(scenario.sensing, sensor="NAME:NAME")
    built = assemble(replace(scenario, sensing=sensing))
    targets = run(built, longest=8.0).recording.targets
    assert targets
    assert targets[0].accepted, targets[0].reason
""",
    use="uuv run clean-barrel --quick --sensor NAME:NAME",
)
TASK = Skeleton(
    part='''"""Task NAME: the hovering vehicle draws a circle with its tool, in free water."""

from dataclasses import dataclass, field

import numpy as np
from uuv.outcome import NoFigures
from uuv.scenario import PlacedTask, Task
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.interfaces.messages import Reference, WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.spatial import pose

UNFOLD, TURN = 6.0, 10.0  # [s] to the ready posture, and once around
BOUND = 0.01  # [m] of the tip from the circle


@dataclass(frozen=True, kw_only=True)
class Circle(Task):
    """Its fields are keys of a scenario file, and options by `option`: --radius 0.05."""

    radius: float = option(0.08, "Radius of the circle [m].")

    def place(self, scenario, own, rng):
        """The task for this vehicle; `rng` is for random draws."""
        return PlacedCircle(radius=self.radius, own=own.at_work())


@dataclass(kw_only=True)
class PlacedCircle(PlacedTask):
    """Plan, scene and assessment of the task."""

    title = "Circle in free water"
    X_WB = pose(p=[0.0, 0.0, -2.0])  # pose that the hull holds
    radius: float
    own: object
    period: float = field(default=0.01, init=False)  # [s] of the plan

    def scene(self, vehicle):
        """Nothing but the vehicle."""
        return vehicle

    def planner(self):
        """The planner: an object with `period`, `init` and `step`."""
        return self

    def init(self, estimate):
        """State of the plan: its start time [s], and the joint angles then [rad]."""
        return estimate.time, estimate.q

    def step(self, state, estimate, target, last):
        """Set points now: joint angles while the arm unfolds, then a pose of the tool."""
        began, folded = state
        time, vehicle = estimate.time - began, self.own.vehicle
        still, way = np.zeros(3), vehicle.q_ready - folded
        s = min(1.0, time / UNFOLD)
        phase, X_WG, v_WG_W = WorkState.CLOSE_IN, None, still
        if time > UNFOLD:
            phase = WorkState.WORK if time < UNFOLD + TURN else WorkState.DONE
            angle = 2.0 * np.pi * min(1.0, (time - UNFOLD) / TURN)
            rate = 2.0 * np.pi / TURN if phase is WorkState.WORK else 0.0
            X_WG = self.X_WB @ vehicle.X_BA @ self.own.chain.forward(vehicle.q_ready)
            X_WG[:3, 3] += self.radius * np.array([0.0, np.sin(angle), np.cos(angle) - 1.0])
            v_WG_W = self.radius * rate * np.array([0.0, np.cos(angle), -np.sin(angle)])
        return state, Reference(
            time=estimate.time,
            state=phase,
            X_WB=self.X_WB,
            v_WB_W=still,
            X_WG=X_WG,
            v_WG_W=v_WG_W,
            w_WG_W=still,
            q=folded + s**3 * (10.0 - 15.0 * s + 6.0 * s * s) * way,
            qd=30.0 * (s * (1.0 - s)) ** 2 / UNFOLD * way,
            set_force=0.0,
            force_control=False,
            tare=False,
            scan=False,
            path_s=0.0,
        )

    def assess(self, ran, seed):
        """Assessment by the truth: distance of the tip from the circle, after the first second."""
        recording = ran.recording
        work = np.flatnonzero(recording.within(WorkState.WORK))[500:]
        p, p_command = (recording[name].value[work] for name in ("p_pad", "p_command"))
        off = np.linalg.norm(p - p_command, axis=1)
        check = Requirement(
            name="tip from the circle, peak",
            value=float(off.max()) if work.size else None,
            bound=BOUND,
            unit="mm",
            scale=1e3,
        )
        return Assessment.of(recording, NoFigures(), [check], seed=seed, wall_s=ran.wall_s)
''',
    test="""from dataclasses import replace

from uuv import jobs, run

from NAME import Circle


def test_the_circle_is_drawn():
    ran = run(replace(jobs.open_water(seed=0), task=Circle(radius=0.05)))
    assert ran.assessment.accepted, ran.assessment.failed
""",
    use="uuv run open-water --task NAME:Circle --radius 0.05",
)
JOB = Skeleton(
    part='''"""Job NAME: a rock is swept from side to side with a set force."""

from dataclasses import replace

from uuv import Scenario, jobs


@jobs.job
def NAME(*, width: float = 0.2) -> Scenario:
    """Sweep a rock from side to side.

    Args:
        width: Width of the sweep over the middle of the rock [m].
    """
    line = (0.0, -0.5 * width, 0.0, 0.5 * width)  # [m] both ends, from above
    scenario = jobs.clean_object(object="rock", line=line, forces=(60.0,))
    return replace(scenario, name="NAME")
''',
    test="""from uuv import run

from NAME import NAME


def test_the_rock_is_swept():
    ran = run(NAME(width=0.15, seed=2, current=(0.1, 0.0, 0.0)))
    assert ran.assessment.accepted, ran.assessment.failed
""",
    use="uuv run NAME:NAME --width 0.15 --seed 2",
)
TOOL = Skeleton(
    part='''"""Tool NAME: the library's pad with a wider dome."""

from dataclasses import replace

from uuv.models.tools.tools import TOOLS


def NAME():
    """The tool, of a class of `uuv.models.tools` such as Head or Gripper, lengths in metres."""
    return replace(TOOLS.load("pad"), radius=0.08)
''',
    test="""from uuv.own_vehicle import vehicle_spec

from NAME import NAME


def test_the_vehicle_carries_it():
    pad = vehicle_spec("uuv_puma", tool="NAME:NAME").compile().geom("pad")
    assert abs(pad.size[0] - NAME().radius) < 1e-9
""",
    use="uuv run clean-barrel --quick --tool NAME:NAME",
)
PERTURBATION = Skeleton(
    part='''"""Perturbation NAME: viscous friction of the gears rises at a given time."""

from dataclasses import dataclass, replace

from uuv import Perturbation


class WornPlant:
    """The plant with other joint damping from a given time on; each run has a new one."""

    def __init__(self, plant, factor, at):
        self.plant, self.timestep = plant, plant.timestep
        self.factor, self.at, self.worn = factor, at, False

    def observe(self):
        """The truth; the sensors take the friction from it."""
        return self.plant.observe()

    def step(self, command):
        """One step; the model's own damping changes once."""
        if not self.worn and command.time >= self.at:
            vehicle = self.plant.vehicle
            self.plant.model.dof_damping[vehicle.dof] *= self.factor
            self.worn = True
        self.plant.step(command)


@dataclass(frozen=True, kw_only=True)
class Worn(Perturbation):
    """Viscous friction of all gears times `factor` from `at` [s] on."""

    factor: float = 1.3
    at: float = 20.0  # [s]

    def on_loop(self, loop):
        """The loop around the worn plant."""
        return replace(loop, plant=WornPlant(loop.plant, self.factor, self.at))
''',
    test="""from dataclasses import replace

from uuv import assemble, jobs, run

from NAME import Worn


def test_the_gears_are_worn_from_the_moment_on():
    scenario = jobs.open_water(seed=0, seconds=2.0)
    built = assemble(replace(scenario, perturbations=(Worn(factor=2.0, at=1.0),)))
    before = built.plant.truth.joint_damping.copy()
    run(built, longest=2.0)
    assert (built.plant.truth.joint_damping == 2.0 * before).all()
""",
    use="uuv run clean-barrel --quick --set perturbations.NAME:Worn.factor=2.0",
)
SKELETONS = {
    "tool": TOOL,
    "perturbation": PERTURBATION,
    "job": JOB,
    "controller": CONTROLLER,
    "vehicle": VEHICLE,
    "object": OBJECT,
    "sensor": SENSOR,
    "task": TASK,
}
MAPPING = "mapping"
KINDS = (*SKELETONS, MAPPING)


@dataclass(kw_only=True)
class NewOptions:
    """Write a working part, NAME.py and test_NAME.py, here; or the mapping of a vehicle's file."""

    kind: Annotated[Positional[str], arg(metavar="KIND", help=f"One of {', '.join(KINDS)}.")]
    name: Annotated[
        Positional[str],
        arg(
            metavar="NAME",
            help="Name of the module, in lower case; for a mapping, the vehicle's file.",
        ),
    ]


def main(verb: str, args: Sequence[str]) -> int:
    """Writes NAME.py and test_NAME.py here; returns the exit code."""
    del verb
    options = parse(NewOptions, args)
    kind, name = options.kind, options.name

    if kind == MAPPING:
        return new_mapping(Path(name))
    if kind not in SKELETONS:
        known = ", ".join(KINDS)
        raise ConfigurationError(
            f"KIND: must be one of {known}, got {kind!r}{did_you_mean(kind, KINDS)}"
        )

    if (
        not name.isidentifier()
        or keyword.iskeyword(name)
        or name.startswith("test_")
        or name != name.lower()
    ):
        raise ConfigurationError(
            f"NAME: must be a module's name in lower case, such as my_{kind}, got {name!r}"
        )

    _refuse_taken(name)
    written = write(kind, name, Path())
    use = SKELETONS[kind].use.replace("NAME", name)
    by = _wrapper()
    print(
        f"written: {', '.join(map(str, written))}\n\ntry:   {by}{use}\ntest:  {by}python -m "
        f"pytest {written[1]}"
    )
    return 0


def _refuse_taken(name: str) -> None:
    """Refuse the name of an installed module, which the new one would hide."""
    if name not in sys.stdlib_module_names and (Path(f"{name}.py").exists() or not _known(name)):
        return  # a file here is refused where it would be written
    raise ConfigurationError(f"NAME: must not be that of an installed module, got {name!r}")


def _known(name: str) -> bool:
    """True if there is a module of that name."""
    try:
        return find_spec(name) is not None
    except ValueError:  # one that is loaded without a spec
        return True


def _wrapper() -> str:
    """Prefix of commands: the wrapper in a clone, empty for an installed wheel."""
    uvw = CHECKOUT / "uvw"
    if not uvw.is_file():
        return ""
    return "./uvw run " if Path.cwd() == CHECKOUT else f"{shlex.quote(str(uvw))} run "


def write(kind: str, name: str, folder: Path) -> tuple[Path, Path]:
    """Writes part and test to `folder`, and returns their paths.

    Raises:
        ConfigurationError: One of the files exists already, or cannot be written.
    """
    skeleton = SKELETONS[kind]
    files = (folder / f"{name}.py", folder / f"test_{name}.py")

    for file in files:
        if file.exists():
            raise ConfigurationError(f"{file} exists already; choose another name")

    for file, text in zip(files, (skeleton.part, skeleton.test), strict=True):
        write_whole(file, text.replace("NAME", name))
    return files

"""Scenario: description of a run, as a Python value and, in `scenario_file`, as a TOML file.

A `Task` describes the work to be done. Placed at a site that was drawn from the seed, it becomes a
`PlacedTask`.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from uuv.controllers.ik.method import Method as IkMethod
from uuv.methods import FORCE_LAWS, AblatedMethod, ForceSource, PublishedMethod
from uuv.models.water.battery import Battery
from uuv.outcome import CloudRecorder, NoFigures, Pictures, RunResult
from uuv.perturbations.perturbation import Perturbation
from uuv.sensors.arm_camera import ArmCameraSetup
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import folder_name
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import (
    Controller,
    Estimator,
    Planner,
    Sensor,
    TargetFinder,
    TargetFollower,
)
from uuv.sim.interfaces.spatial import Array, finite_number, shown, whole_number
from uuv.sim.loop.rollout import Observer
from uuv.site import Site

# a task is described, and refused, without loading the kernels of the code that carries it out
if TYPE_CHECKING:
    import mujoco
    from rich.table import Table

    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.sim.evaluation.assessment import Assessment
    from uuv.sim.loop.recording import Recorder

P = TypeVar("P", bound=Perturbation)
T = TypeVar("T", bound="Task")
INPUTS_FILE = "inputs.csv"  # file in the folder of a run that an operator drove
KEYBOARD = "keyboard"  # inputs of an operator that are given during the run
GAMEPAD = "gamepad"  # the same, by a joystick device
LIVE = (KEYBOARD, GAMEPAD)
LONGEST = 400.0  # [s] default limit of the simulated time of a run
_MOST_LOOKS = 40  # number of frame intervals after which the wait for a scan times out
_NOT_FOLLOWED = "sensing.follow: this task has no object that it could follow"


@dataclass(frozen=True, kw_only=True)
class VehicleSetup:
    """The real vehicle."""

    vehicle: str = option(
        "uuv_puma",
        "A name of `uuv list vehicles`, a file with the named parts, MJCF, URDF, xacro or "
        "SDF (docs/own_vehicle.md), or MODULE:FUNCTION.",
        group="vehicle",
    )
    arm_errors: int | None = option(
        None,
        "Seed of an arm built 2 mm and 0.3 deg wrong in every joint, unknown to the controller.",
        group="vehicle",
        everywhere=False,
    )
    tool: str | None = option(
        None,
        "Tool on the arm's tip: a name of `uuv list tools`, or MODULE:FUNCTION; default: the "
        "vehicle's own, or the one that the job needs.",
        group="vehicle",
    )
    parts: str | None = option(
        None,
        "File that maps the model's names to those of the contract; default: NAME.parts.yaml "
        "beside the vehicle's file.",
        group="vehicle",
    )
    unchecked: bool = option(
        False,
        "Run also what the check of the vehicle refuses; metrics.json and the report say so.",
        group="vehicle",
    )
    battery: Battery | None = None  # of the thrusters; None: each has its constant voltage

    def __post_init__(self) -> None:
        if self.arm_errors is not None:
            whole_number(self.arm_errors, "vehicle.arm_errors")


@dataclass(frozen=True, kw_only=True)
class Belief:
    """Differences of the vehicle's model of itself from the nominal model."""

    # relative error that all its added masses and drag coefficients have in common
    water_error: float = 0.15
    calibrated: bool = option(
        False,
        "Calibrate the arm first: four points touched with a hand's noise of 0.1 mm, one known "
        "distance.",
        group="control",
        everywhere=False,
    )
    arm: str | None = option(
        None,
        "File of the controller's arm model: arm.yaml of uuv calibrate.",
        group="control",
        everywhere=False,
    )

    def __post_init__(self) -> None:
        finite_number(self.water_error, "belief.water_error")
        if self.calibrated and self.arm is not None:
            raise ConfigurationError("belief.calibrated and belief.arm: give only one of the two")


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """Sensors by name, and the noise of those that a campaign varies."""

    sensor: str = option(
        "camera",
        "Sensor for identification: camera, sonar, survey (the object's pose is known, and "
        "neither it nor growth and dents are identified), a registered name, or MODULE:FUNCTION.",
        group="sensing",
        everywhere=False,
    )
    looks: int = option(
        1,
        "Successive depth frames, or pings, whose median the tool path is planned on; 16 where "
        "growth or dents are possible.",
        group="sensing",
        everywhere=False,
    )
    follow: bool = option(
        False,
        "Follow the object by further depth frames while the vehicle scans it, and report if it "
        "moves.",
        group="sensing",
        everywhere=False,
    )
    dead_beams: tuple[int, ...] = option(
        (), "Beams of the Doppler log, 1 to 4, that return no echo.", everywhere=False
    )
    vision_period: float = 0.1  # [s]
    vision_delay: float = 0.1  # [s]
    vision_noise: float = 2e-3  # [m]
    torque_noise: float = 0.01  # share of the reading
    torque_bias: float = 0.5  # [N m] uniform between minus and plus this value
    arm_camera: ArmCameraSetup | None = option(
        None,
        "A small stereo camera beside the tool, which measures the motion of the tool over the "
        "surface for navigation.",
        group="sensing",
        everywhere=False,
    )

    def __post_init__(self) -> None:
        whole_number(self.looks, "sensing.looks", least=1, most=_MOST_LOOKS)

        for name in (
            "vision_period",
            "vision_delay",
            "vision_noise",
            "torque_noise",
            "torque_bias",
        ):
            finite_number(getattr(self, name), f"sensing.{name}", least=0.0)

    def proprioception(self) -> list[Sensor]:
        """Encoders, torque sensors, IMU, DVL and vision of a drifting hull."""
        from uuv.sim.sensors import proprioception

        # Vision is the only sensor whose period and delay a scenario sets.
        return [
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(noise=self.torque_noise, bias=self.torque_bias),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(
                period=self.vision_period, delay=self.vision_delay, noise=self.vision_noise
            ),
        ]


@dataclass(frozen=True, kw_only=True)
class Operator:
    """An operator in place of the planner (`uuv drive`)."""

    inputs: str  # file of inputs (docs/your_tools.md), or one of LIVE
    delay: float = 0.0  # [s] delay between operator and vehicle

    def __post_init__(self) -> None:
        finite_number(self.delay, "control.operator.delay [s]", least=0.0, most=1.0)


@dataclass(frozen=True, kw_only=True)
class Control:
    """Controller by name, its inverse kinematics, and methods left out (ablation)."""

    controller: str = option(
        "work", "Controller: work, a registered name, or MODULE:CLASS.", group="control"
    )
    without: tuple[AblatedMethod, ...] = option(
        (), "Controller methods to leave out (ablation).", group="control", everywhere=False
    )
    ik: IkMethod = option(
        "hybrid",
        "Inverse kinematics that tracks the tool pose: hybrid, or a method of [Danilov 2021], "
        "jacobian_free or plain.",
        group="control",
        everywhere=False,
    )
    published: tuple[PublishedMethod, ...] = option(
        (),
        "Methods as in [Konoplin 2022], in place of the default ones: tip-force, identification, "
        f"and one of {', '.join(FORCE_LAWS)}.",
        group="control",
        everywhere=False,
    )
    force_from: ForceSource = option(
        "sensors",
        "Source of the contact force: sensors of the joint torques, or motors: motor torques, by a "
        "load observer.",
        group="control",
    )
    elastic_gears: bool = False  # the softer joint servo for gears that twist under load
    operator: Operator | None = None  # operator who drives the vehicle; None: the task's planner

    def __post_init__(self) -> None:
        laws = [law for law in FORCE_LAWS if law in self.published]
        if len(laws) + ("force-control" in self.without) > 1:
            raise ConfigurationError(
                f"control.without force-control, control.published {', '.join(FORCE_LAWS)}: give "
                "only one of them"
            )
        if self.force_from == "motors" and "tip-force" in self.published:
            raise ConfigurationError(
                "control.force_from motors and control.published tip-force: give only one of them; "
                "the published formula reads torque sensors"
            )


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """Base of tasks. The parameters of a task are keys of a scenario file."""

    spares: ClassVar[Collection[str]] = ()  # named parts of the vehicle that the task does not need
    schema: ClassVar[str] = "metrics"  # JSON Schema of metrics.json, in sim/schemas
    # True if a camera or a sonar looks at the site, which needs a ray caster
    looks: ClassVar[bool] = False
    # keywords of a scenario's further options that the task uses
    heeds: ClassVar[Collection[str]] = ()

    @property
    def tool(self) -> str | None:
        """Tool that the task needs, which replaces a tool of another shape; None: the vehicle's
        own.
        """
        return None

    def check_inputs(self, scenario: "Scenario") -> None:
        """Refuse an unsuitable object, and unknown names and files, before anything is compiled.

        The method calls nothing compiled. A task that follows an object overrides it; other tasks
        extend it.

        Raises:
            ConfigurationError: The message names the input, the allowed values and the given one.
        """
        if scenario.sensing.follow:
            raise ConfigurationError(_NOT_FOLLOWED)

        # Options that only some tasks use would be without effect.
        for word in ("sensor", "looks"):
            choice = getattr(scenario.sensing, word)
            if word not in self.heeds and choice != getattr(Sensing, word):
                raise ConfigurationError(
                    f"sensing.{word}: {type(self).__name__} does not use it; leave it out, got "
                    f"{shown(choice)}"
                )

    def least_seconds(self, scenario: "Scenario") -> float:
        """Shortest time [s] of the requested work; 0 if it is unknown."""
        del scenario
        return 0.0

    @abstractmethod
    def place(
        self, scenario: "Scenario", own: "OwnVehicle", rng: np.random.Generator
    ) -> "PlacedTask":
        """The task at its site.

        Args:
            scenario: The whole scenario.
            own: The vehicle's model of itself.
            rng: Draws the site and its coarse detection.

        Raises:
            UuvError: A number is out of range, or the vehicle is not suitable for the task.
        """


class PlacedTask(ABC):
    """Base of tasks at a drawn site: scene, planner, assessment.

    Only plant and evaluation get the truth about the site.
    """

    # states of the work; a run that reaches none of these counts as refused
    begun: ClassVar[tuple[WorkState, ...]] = (WorkState.WORK,)
    # True: the hull starts at `X_WB`, without an error of position and heading
    exact_start: ClassVar[bool] = False

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time of a run."""
        return LONGEST

    @property
    def stands(self) -> bool:
        """True if the pressed tool stops on its path, which tells navigation how the hull moves."""
        return False

    @property
    @abstractmethod
    def title(self) -> str:
        """Title of log and report."""

    @property
    @abstractmethod
    def X_WB(self) -> Array:
        """Pose (4, 4) of the hull at the beginning of the work, without the error of the start."""

    @property
    def bounds(self) -> Bounds | None:
        """Bounds of force and path, drawn in log and report; None if there are none."""
        return None

    @abstractmethod
    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Add the site to the spec of the true vehicle, in place, and return it."""

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """Sensors that see the site, and perception's model of them; None: the default model."""
        return [], None

    def estimator(self, navigation: Estimator) -> Estimator:
        """Estimator of the vehicle's state, around `navigation`."""
        return navigation

    def finder(self, sensor: "SensorModel | None", seed: int) -> TargetFinder | None:
        """Finder of the object; `seed` is the seed of its random sampling."""
        return None

    def follower(self, sensor: "SensorModel | None") -> TargetFollower:
        """Tracker of the object while the vehicle looks at it.

        Raises:
            ConfigurationError: This task has no object to follow.
        """
        del sensor
        raise ConfigurationError(_NOT_FOLLOWED)

    @abstractmethod
    def planner(self) -> Planner:
        """Planner of the task."""

    def controller(self) -> Controller | None:
        """Controller of a test rig, which replaces the scenario's; None: the controller of the
        scenario.
        """
        return None

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment of a run by the truth; by default, that the run ended in DONE without
        collision.
        """
        from uuv.sim.evaluation.assessment import Assessment

        return Assessment.of(ran.recording, NoFigures(), [], seed=seed, wall_s=ran.wall_s)

    def pictures(self, ran: RunResult) -> Pictures:
        """Figures of the report."""
        return ()

    def tables(self) -> "Iterable[Table]":
        """Tables for the terminal in addition to that of the metrics, after the assessment."""
        return ()

    def observers(self) -> tuple[Observer, ...]:
        """Observers of the loop whose results the assessment needs."""
        return ()

    def write_files(self, folder: Path) -> tuple[Path, ...]:
        """Write further files of the task, besides report and metrics, to `folder`, and return
        them.
        """
        return ()

    def story(self, recorder: "Recorder", log: Any) -> Observer:
        """Observer that adds clouds to recording and log."""
        return CloudRecorder(recorder, log)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Description of a run: site, task, vehicle, belief, sensing, control, perturbations, seeds."""

    name: str  # name of the folder of results
    task: Task
    # seed of everything except the perturbations
    seed: int = option(
        0, "Seed of everything random: where the object lies, the noise of the sensors, the gusts."
    )
    site: Site = field(default_factory=Site)
    vehicle: VehicleSetup = field(default_factory=VehicleSetup)
    belief: Belief = field(default_factory=Belief)
    sensing: Sensing = field(default_factory=Sensing)
    control: Control = field(default_factory=Control)
    perturbations: tuple[Perturbation, ...] = ()  # applied in this order
    perturbation_seed: int = 0

    def __post_init__(self) -> None:
        folder_name(self.name, "name")
        whole_number(self.seed, "seed")
        whole_number(self.perturbation_seed, "perturbation_seed")

    def task_of(self, kind: type[T]) -> T:
        """The task, which must be of this kind.

        Raises:
            ConfigurationError: The task is of another kind.
        """
        if isinstance(self.task, kind):
            return self.task

        wrong = type(self.task).__name__
        raise ConfigurationError(f"scenario {self.name!r}: needs {kind.__name__}, has {wrong}")

    def perturbation(self, kind: type[P]) -> P:
        """The first perturbation of that kind.

        Raises:
            ConfigurationError: There is no such perturbation.
        """
        for perturbation in self.perturbations:
            if isinstance(perturbation, kind):
                return perturbation

        raise ConfigurationError(
            f"scenario {self.name!r}: must have a perturbation {kind.__name__}"
        )

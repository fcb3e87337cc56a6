"""Task: description of what is to be done, and `PlacedTask`: the same at a site that was drawn from the seed."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from models.registry import Registry
from sim.evaluation.metrics import Assessment, Bounds
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import WorkState
from sim.interfaces.protocols import Controller, Estimator, Planner, Sensor, TargetFinder, TargetFollower
from sim.interfaces.spatial import Array, exp_so3, finite_number, pose
from sim.loop.rollout import Moment, Observer

if TYPE_CHECKING:  # a task is described, and refused, without the kernels of what carries it out
    from matplotlib.figure import Figure
    from rich.table import Table

    from perception.clouds.scan import SensorModel
    from scenarios.own_vehicle import OwnVehicle
    from scenarios.scenario import Scenario
    from sim.loop.recording import Recorder, Recording
    from sim.plant.soil_contact import SoilForce

Pictures = Iterable[tuple[str, str, "Figure"]]  # title, caption, figure
_NOT_FOLLOWED = "--follow: this task has no object that it could follow"
_FARTHEST = 1e3  # [m] largest scan range, far beyond any sensor here


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """Recording, last moment and wall time of a run."""

    recording: "Recording"
    last: Moment
    wall_s: float
    part_by_part: str = ""  # why every tick was taken part by part; empty: compiled ticks where nothing slow was due


@dataclass(frozen=True, slots=True)
class NoFigures:
    """Metrics of a task that adds none to those of every run."""


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """What is to be done; the base of all tasks. Its fields are keys of a scenario's file."""

    spares: ClassVar[Collection[str]] = ()  # named parts of the vehicle that it does without
    looks: ClassVar[bool] = False  # a camera or a sonar looks at the site, which takes a ray caster

    @property
    def tool(self) -> str | None:
        """Tool that the task needs, in place of one of another shape; None: the vehicle's own."""
        return None

    def check_inputs(self, scenario: "Scenario") -> None:
        """Refuses an object that is none for it, and names and files that there are not, before anything is compiled.

        Calls nothing compiled. A task that follows an object overrides it, others add to it.

        Raises:
            ConfigurationError: Which one, what is allowed, and what was given.
        """
        if scenario.sensing.follow:
            raise ConfigurationError(_NOT_FOLLOWED)

    def least_seconds(self, scenario: "Scenario") -> float:
        """Time [s] that the work itself takes at least, as it is asked for; 0 where nothing says so."""
        del scenario
        return 0.0

    @abstractmethod
    def place(self, scenario: "Scenario", own: "OwnVehicle", rng: np.random.Generator) -> "PlacedTask":
        """The task at its site.

        Args:
            scenario: The whole description.
            own: The vehicle's model of itself.
            rng: Draws the site and its coarse detection.

        Raises:
            UuvError: A number is out of range, or the vehicle is not fit for the task.
        """


LONGEST = 400.0  # [s] simulated, default limit of a run


class PlacedTask(ABC):
    """A task at its site. The truth about the site goes to plant and evaluation only."""

    begun: ClassVar[tuple[WorkState, ...]] = (WorkState.WORK,)  # a run in none of these states counts as refused
    exact_start: ClassVar[bool] = False  # True: the hull starts at `X_WB`, without an error of place and heading

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
        """Pose (4, 4) of the hull at which the work begins, but for the start's error."""

    @property
    def bounds(self) -> Bounds | None:
        """Bounds of force and path, drawn in log and report; None: it has none."""
        return None

    @property
    def soil(self) -> "SoilForce | None":
        """Soil that acts on the tool."""
        return None

    @abstractmethod
    def scene(self, vehicle: mujoco.MjSpec) -> mujoco.MjSpec:
        """Adds the site to the spec of the true vehicle, in place, and returns it."""

    def sensors(self, model: mujoco.MjModel) -> "tuple[list[Sensor], SensorModel | None]":
        """Sensors that see the site, and the model that perception has of them; None: its default."""
        return [], None

    def estimator(self, navigation: Estimator) -> Estimator:
        """Estimator of the vehicle's state, around `navigation`."""
        return navigation

    def finder(self, sensor: "SensorModel | None", seed: int) -> TargetFinder | None:
        """Finder of the object; `seed` is that of its random sampling."""
        return None

    def follower(self, sensor: "SensorModel | None") -> TargetFollower:
        """Follower of the object while the vehicle looks at it.

        Raises:
            ConfigurationError: This task follows nothing.
        """
        del sensor
        raise ConfigurationError(_NOT_FOLLOWED)

    @abstractmethod
    def planner(self) -> Planner:
        """Planner of the task."""

    def controller(self) -> Controller | None:
        """Controller of a test rig, in place of that of the scenario; None: that of the scenario."""
        return None

    def assess(self, ran: RunResult, seed: int) -> Assessment:
        """Assessment of a run against the truth; here, that it ended well."""
        return Assessment.of(ran.recording, NoFigures(), [], seed=seed, wall_s=ran.wall_s)

    def pictures(self, ran: RunResult) -> Pictures:
        """Figures of the report."""
        return ()

    def tables(self) -> "Iterable[Table]":
        """Tables for the terminal beside that of the metrics, once the run is assessed."""
        return ()

    def observers(self) -> tuple[Observer, ...]:
        """Observers of the loop whose results the assessment needs."""
        return ()

    def write_files(self, folder: Path) -> tuple[Path, ...]:
        """Write what the task leaves beside report and metrics to `folder`; returns the files."""
        return ()

    def story(self, recorder: "Recorder", log: Any) -> Observer:
        """Observer that adds clouds to recording and log."""
        return CloudRecorder(recorder, log)


class CloudRecorder:
    """Observer that adds the clouds of each identification to recording and log."""

    slow_ticks = ()

    def __init__(self, recorder: "Recorder", log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        """Adds the clouds, in W, if the moment has an identification."""
        if moment.frame is None:
            return
        from perception.target_finder import FinderState

        if not isinstance(moment.found, FinderState) or moment.found.last is None:
            return
        for name in ("cloud", "model_before", "model_after"):
            points_W = moment.found.in_world(getattr(moment.found.last, name))
            self._recorder.add_cloud(name, points_W)
            if self._log is not None:
                self._log.log_cloud(name, points_W, moment.truth.time)


def object_of(scenario: "Scenario", kind: type[Any]) -> Any:
    """The site's object, which must be of a kind.

    Raises:
        ConfigurationError: It is of another kind.
    """
    found = scenario.site.object
    if not isinstance(found, kind):
        raise ConfigurationError(
            f"task {type(scenario.task).__name__}: needs a {kind.__name__} at the site, got {type(found).__name__}"
        )
    return found


def scan_pose(X_BC: Array, approach_W: Array, scan_range: float) -> Array:
    """Level hull pose (4, 4) in W from which the camera sees the coarse position from the scan range.

    The camera looks towards +x of W, or down, or up.

    Args:
        X_BC: (4, 4) pose of the camera on the hull.
        approach_W: (3,) [m] coarse position of the object.
        scan_range: [m] distance along the camera's axis.

    Raises:
        ConfigurationError: The scan range is out of range.
    """
    finite_number(scan_range, "--range [m]", above=0.0, most=_FARTHEST)
    R_WB = exp_so3([0.0, 0.0, -np.arctan2(X_BC[1, 2], X_BC[0, 2])])
    return pose(R_WB, approach_W - R_WB @ (X_BC[:3, 3] + scan_range * X_BC[:3, 2]))


@cache
def registry() -> Registry[Task]:
    """All tasks, those of other packages included."""
    kinds = {
        "SurfaceWork": "scenarios.tasks.surface_work:SurfaceWorkTask",
        "Tapping": "scenarios.tasks.tapping:TappingTask",
        "Insertion": "scenarios.tasks.insertion:InsertionTask",
        "Inspection": "scenarios.tasks.inspection:InspectionTask",
        "SeabedSampling": "scenarios.tasks.seabed_sampling:SeabedSamplingTask",
        "GearIdentification": "scenarios.arm_identification.friction_run:GearIdentificationTask",
    }
    return Registry("task", kinds)

"""Surface work: a tool is pressed on an object, or held above it, along a path."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.settings import SurfaceSettings, settings_of
from uuv.kinds import SURVEY
from uuv.models.site import scenes
from uuv.models.site.sliding_contact import let_tool_slide
from uuv.outcome import Pictures, RunResult
from uuv.scenario import LONGEST, PlacedTask, Scenario, Task
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.options import DEGREE, option
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, finite_number, shown
from uuv.site import Workpiece
from uuv.tasks.approach import object_of, scan_pose
from uuv.tasks.work_time import WorkTime

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.planning.hull_placement import PathStanding
    from uuv.controllers.tasks.surface_work import SurfaceTaskConfig, SurfaceWork
    from uuv.controllers.tasks.task import TaskPlanner
    from uuv.models.objects.targets import TargetModel
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.finding.object_tracker import FoundObjectFollower
    from uuv.perception.finding.surveyed_object import SurveyedObjectFinder
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.sim.evaluation.assessment import Assessment
    from uuv.sim.evaluation.metrics import AskedWork
    from uuv.sim.evaluation.surface.tool_errors import TrueObject

TAP_FORCE, TAPPED = 40.0, (0.0, 0.06, 0.12)  # [N] to tap with, [m] along a path
_ARRIVAL = 150.0  # [s] simulated from the start to the contact, and off again, with another look
_ROOM = 1.5  # limit of the simulated time over what the work needs


@dataclass(frozen=True, kw_only=True)
class ToolTurn:
    """Rotation about the tool axis of a tool that is not round."""

    angle: float = option(
        0.0,
        "Angle [deg] of the tool's x axis from the path, about the tool axis, that a tool which is "
        "not round keeps; default: the tool is round.",
        group="work",
        word="turn",
        unit=DEGREE,
        closed=None,
    )
    blend: float = option(
        0.0,
        "Length [m] of the path over which a tool that is not round turns at a corner, pressing "
        "on; at least 0.04.",
        group="work",
    )
    dwell: bool = option(
        False,
        "A tool that is not round stops at a corner and turns there, pressing on, in place of a "
        "turn along the path.",
        group="work",
    )

    def __post_init__(self) -> None:
        finite_number(self.angle, "task.turn.angle [rad]", least=-np.pi, most=np.pi)
        finite_number(self.blend, "task.turn.blend [m]", least=0.0, most=1.0)
        if self.dwell and self.blend:
            both = f"task.turn.dwell and task.turn.blend {self.blend:g}"
            raise ConfigurationError(f"{both}: give only one of the two")


@dataclass(frozen=True, kw_only=True)
class SurfaceWorkTask(SurfaceSettings, Task):
    """Press a tool along a path of an object with set forces."""

    looks: ClassVar[bool] = True
    heeds: ClassVar[Collection[str]] = (
        *("length", "line"),
        *("arm_errors", "calibrated", "arm"),
        *("sensor", "looks", "follow", "arm_camera"),
        *("without", "ik", "published"),
    )
    path: str | None = option(None, "Name of a path on the object; default: first.", group="object")
    turn: ToolTurn | None = None  # of a tool that is not round; None: it is round
    range: float = option(1.25, "Range from camera to object at the scan [m].", group="work")

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses an object without surface, a path that it lacks, and contradictory options."""
        workpiece: Workpiece = object_of(scenario, Workpiece)
        self._check_stops(scenario)
        _check_survey(scenario)
        if scenario.sensing.follow:
            check_follows(scenario)
        self.time(*workpiece.target(self.path), self.force_rate).check()

    def least_seconds(self, scenario: Scenario) -> float:
        """Time [s] along the path at the set speed."""
        workpiece: Workpiece = object_of(scenario, Workpiece)
        return self.time(*workpiece.target(self.path), self.force_rate).seconds

    def time(self, target: "TargetModel", path: str, force_rate: float) -> WorkTime:
        """The timed work on a path of the object, with a rate [N/s] of the set force."""
        p = np.asarray(target.path(path).p)
        return WorkTime(
            length=float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum()),
            speed=self.speed,
            forces=self.forces if self.contactless is None else (),
            force_rate=force_rate,
        )

    def _check_stops(self, scenario: Scenario) -> None:
        """Refuses stops for navigation that add no information."""
        if self.promise.stops is None:
            return

        for excluded, why in (
            (
                scenario.sensing.arm_camera is not None,
                "sensing.arm_camera, which measures more than stops do",
            ),
            (self.contactless is not None, "task.contactless, where no contact holds the tool"),
            (
                "fusion" in scenario.control.without,
                "control.without fusion, where no filter takes their measurements",
            ),
        ):
            if excluded:
                raise ConfigurationError(f"task.promise.stops and {why}: give only one of the two")

    def place(
        self, scenario: Scenario, own: "OwnVehicle", rng: np.random.Generator
    ) -> "PlacedSurfaceWork":
        """The work on the site's object; draws its pose, its coarse detection, growth and dents."""
        from uuv.sim.evaluation.surface.tool_errors import TrueObject

        self._check_stops(scenario)
        workpiece: Workpiece = object_of(scenario, Workpiece)
        target, path = workpiece.target(self.path)
        if self.turn is not None:
            turned = target.path(path).turned(
                self.turn.angle, self.turn.blend, dwell=self.turn.dwell
            )
            target = target.with_path(path, turned)

        X_WT = scenario.site.pose(rng)
        approach_W, orientation_W = coarse_detection(X_WT, rng)
        true_model = workpiece.as_it_is(target, path, rng)

        placed = PlacedSurfaceWork(
            scenario=scenario,
            own=own,
            task=self,
            target=target,
            approach_W=approach_W,
            orientation_W=orientation_W,
            truth=TrueObject(
                model=true_model,
                path=path,
                X_WT=X_WT,
                contactless=self.contactless,
                deformed=true_model is not target,
            ),
        )

        # a small arm's force changes more slowly
        self.time(target, path, placed.job().force_rate).check()
        return placed


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedSurfaceWork(PlacedTask):
    """Surface work at its site."""

    scenario: Scenario
    own: "OwnVehicle"
    task: SurfaceWorkTask
    target: "TargetModel"  # as the vehicle knows it
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) its coarse orientation
    truth: "TrueObject"

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"Cleaning the {self.target.name}, {self.truth.path} path, seed {self.scenario.seed}"

    @property
    def stands(self) -> bool:
        """True if the tool stops on its path."""
        return self.task.promise.stops is not None

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time: the time for views, path and stops, with a margin."""
        from uuv.perception.toolpath.path_planner import PACE

        stops = self.task.promise.stops
        work = self.task.time(self.target, self.truth.path, self.job().force_rate)
        working = work.slowed(PACE).seconds  # as on a surface that deviates

        if stops is not None:
            standing = (
                stops.settle + stops.patience + stops.lasting + 2.0 * FollowLimits().pace_time
            )
            working *= 1.0 + standing / stops.every
        return max(LONGEST, _ROOM * (_ARRIVAL + self.scenario.sensing.looks + working))

    @property
    def X_WB(self) -> Array:
        """Scan pose of the hull."""
        return scan_pose(self.own.X_BC, self.approach_W, self.task.range)

    @property
    def bounds(self) -> Bounds:
        """Bounds of work by this vehicle."""
        return work_bounds(self.own)

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds the true object, on which the tool slides, and flat seabed."""
        scene = scenes.work_site(vehicle, self.truth.model, self.truth.X_WT)
        let_tool_slide(scene, speed=self.task.speed, force=min(self.task.forces))
        return scene

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """The camera, sonar, survey or registered sensor."""
        from uuv.components.contact_parts import exteroceptive_sensor

        sensor, seen_as = exteroceptive_sensor(self.scenario.sensing.sensor, model, self.own.X_BC)
        return [sensor], seen_as

    def finder(
        self, sensor: "SensorModel | None", seed: int
    ) -> "KnownObjectFinder | SurveyedObjectFinder":
        """Finder of the clean object."""
        from uuv.perception.finding.surveyed_object import SurveyedObjectFinder
        from uuv.perception.finding.target_finder import KnownObjectFinder, PublishedFinder

        if self.scenario.sensing.sensor == SURVEY:
            return SurveyedObjectFinder(self.target, self.truth.path)

        kind = (
            PublishedFinder
            if "identification" in self.scenario.control.published
            else KnownObjectFinder
        )
        return kind(
            self.target,
            self.truth.path,
            self.approach_W,
            self.orientation_W,
            sensor=sensor,
            tool_radius=self.own.tool_radius,
            looks=self.scenario.sensing.looks,
            seed=seed,
        )

    def follower(self, sensor: "SensorModel | None") -> "FoundObjectFollower":
        """Follower of the clean object."""
        from uuv.perception.finding.object_tracker import FoundObjectFollower

        check_follows(self.scenario)
        return FoundObjectFollower(self.target, sensor=sensor)

    def job(self) -> "SurfaceTaskConfig":
        """Forces and limits of the work, for the arm's size."""
        from uuv.controllers.tasks.arrival import ArrivalLimits
        from uuv.controllers.tasks.hull_phases import EscapeLimits
        from uuv.controllers.tasks.surface_work import SurfaceTaskConfig

        size = self.own.at_work().size
        task = self.task
        # A lighter hull is pushed away sooner; a rate that is not the default was chosen for it.
        usual_rate = task.force_rate == SurfaceSettings.force_rate
        scaled = {
            "force_rate": size**2 * task.force_rate if usual_rate else task.force_rate,
            "approach": task.approach.of_size(size),
        }
        return SurfaceTaskConfig(
            **(settings_of(SurfaceSettings, task) | scaled),
            unchecked=self.scenario.vehicle.unchecked,
            force_control="force-control" not in self.scenario.control.without,
            arrival=ArrivalLimits.of_size(size),
            escape=EscapeLimits.of_size(size),
        )

    @property
    def standing(self) -> "PathStanding":
        """Chooses the hull's place from which the path is within reach."""
        return self._work().stand

    def planner(self) -> "TaskPlanner":
        """Planner of the work."""
        return self._work()

    def _work(self) -> "SurfaceWork":
        from uuv.controllers.hull.thrust_margin import ThrustMargin
        from uuv.controllers.tasks.surface_work import SurfaceWork

        return SurfaceWork(
            self.own.at_work(),
            self.target,
            self.job(),
            X_WB_scan=self.X_WB,
            floor=scenes.seabed_height(self.target, self.truth.X_WT),  # the charted depth there
            holding=ThrustMargin.of(self.own.model),
        )

    @property
    def asked(self) -> "AskedWork":
        """What the assessment has to find figures of."""
        from uuv.sim.evaluation.metrics import AskedWork

        forces = () if self.task.contactless is not None else self.task.forces
        return AskedWork(forces=forces, speed=self.task.speed)

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true object."""
        from uuv.perception.finding.target_finder import FinderState
        from uuv.sim.evaluation.metrics import assess

        state = ran.last.found
        identification = state.last if isinstance(state, FinderState) else None
        return assess(
            ran.recording,
            self.truth,
            seed=seed,
            wall_s=ran.wall_s,
            identification_s=identification.duration_s if identification is not None else None,
            bounds=self.bounds,
            asked=self.asked,
        )

    def pictures(self, ran: RunResult) -> Pictures:
        """Picture of the object as identified."""
        from uuv.sim.reporting.report_figures import object_as_found

        return object_as_found(ran.recording, self.truth)


def work_bounds(believed: "OwnVehicle") -> Bounds:
    """Usual bounds, of the force by the arm's size, and of the tilt by its number of joints.

    A hull that weight and buoyancy alone right in roll or pitch may list.
    """
    from uuv.controllers.hull.allocation import MOST_LIST, undriven_axes
    from uuv.controllers.planning.arm_margins import TILT
    from uuv.controllers.planning.arm_size import FULL

    known = believed.at_work()
    usual = Bounds()

    # An arm of fewer joints lets its tool lean.
    tilt = usual.tilt if known.chain.n >= FULL else TILT
    lists = bool(undriven_axes(believed.vehicle.thruster_wrench))
    return Bounds(
        force_error_rms=known.size * usual.force_error_rms,
        force_error_max=known.size * usual.force_error_max,
        tilt=tilt,
        heel=MOST_LIST if lists else tilt,
    )


def _check_survey(scenario: Scenario) -> None:
    """Refuses options of a search for an object whose pose is known."""
    if scenario.sensing.sensor != SURVEY:
        return
    looks = scenario.sensing.looks
    if looks != 1:
        raise ConfigurationError(
            f"sensing.sensor {SURVEY}: the object is not identified; leave out sensing.looks, got "
            f"{looks}"
        )
    if "identification" in scenario.control.published:
        both = f"sensing.sensor {SURVEY} and control.published identification"
        raise ConfigurationError(f"{both}: give only one of the two")


def check_follows(scenario: Scenario) -> None:
    """Refuses to follow an object without depth frames."""
    if scenario.sensing.sensor != "camera":
        raise ConfigurationError(
            f"sensing.follow: takes depth frames; the sensor is {shown(scenario.sensing.sensor)}, "
            "not camera"
        )


def first_force(scenario: Scenario) -> float:
    """First set force [N] of a scenario of surface work."""
    return scenario.task_of(SurfaceWorkTask).forces[0]

"""Move of a plug: out of one receptacle of a panel, into the other."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.controllers.tasks.settings import PlugSettings, settings_of
from uuv.models.naming import HULL_BODY
from uuv.models.site.plugged_panel import RECEPTACLES, PluggedPanel
from uuv.outcome import RunResult
from uuv.scenario import PlacedTask, Scenario, Task
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.evaluation.handling.plug_metrics import FeltPlug, TrueMove, assess_move
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import Estimator, Sensor
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.loop.rollout import Moment, Observer
from uuv.site import PlugBoard
from uuv.tasks.approach import object_of, scan_pose

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.tasks.grasping.plugging import PlugJob, PlugMoving
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.sim.evaluation.assessment import Assessment


@dataclass(frozen=True, kw_only=True)
class MovePlugTask(PlugSettings, Task):
    """Move a plug out of one receptacle into another."""

    schema: ClassVar[str] = "plug"
    looks: ClassVar[bool] = True
    range: float = option(1.25, "Range from camera to panel at the scan [m].", group="work")

    @property
    def tool(self) -> str:
        """Driven jaws."""
        return "gripper"

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses an object that is no panel with a plug."""
        super().check_inputs(scenario)
        object_of(scenario, PlugBoard)

    def place(
        self, scenario: Scenario, own: "OwnVehicle", rng: np.random.Generator
    ) -> "PlacedMove":
        """The move at the site's panel; draws its pose and its coarse detection."""
        from uuv.controllers.tasks.grasping.plugging import PlugJob, check_forces
        from uuv.models.tools.jaw_shape import JawShape

        site: PlugBoard = object_of(scenario, PlugBoard)
        panel = site.shape()
        job = PlugJob(**settings_of(PlugSettings, self))
        check_forces(job, JawShape.of(own.model))

        X_WT = scenario.site.pose(rng)
        center = pose(p=panel.target.center)
        approach_W, orientation_W = coarse_detection(X_WT @ center, rng)
        return PlacedMove(
            scenario=scenario,
            vehicle=own,
            task=self,
            job=job,
            site=site,
            panel=panel,
            X_WT=X_WT,
            approach_W=approach_W,
            orientation_W=orientation_W,
        )


@dataclass(slots=True, eq=False)
class ReceptacleWatch:
    """Observer of the true forces on the receptacles, and of the pull that the vehicle felt."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    slow_ticks: tuple[int, ...] = (5,)  # between two rows

    def observe(self, moment: Moment) -> None:
        """Keeps a row."""
        if moment.tick % self.slow_ticks[0]:
            return
        force = moment.truth.receptacles.force
        if not len(force):
            return
        contact = moment.command.contact
        felt = -contact.normal if contact.known else np.nan
        self.rows.append((moment.truth.time, *force.ravel().tolist(), float(felt)))

    def felt(self, first: int) -> FeltPlug:
        """The forces as arrays; `first` is the row of the receptacle of the start."""
        table = np.array(self.rows).reshape(-1, 2 + 3 * len(RECEPTACLES))
        forces = table[:, 1:-1].reshape(len(table), -1, 3)
        return FeltPlug(
            time=table[:, 0], first=forces[:, first], second=forces[:, 1 - first], felt=table[:, -1]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedMove(PlacedTask):
    """A plug's move at its site."""

    begun: ClassVar[tuple[WorkState, ...]] = (WorkState.APPROACH,)
    scenario: Scenario
    vehicle: "OwnVehicle"
    task: MovePlugTask
    job: "PlugJob"
    site: PlugBoard
    panel: PluggedPanel
    X_WT: Array  # (4, 4) true pose
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) its coarse orientation
    watch: ReceptacleWatch = field(default_factory=ReceptacleWatch)

    @property
    def title(self) -> str:
        """Title of log and report."""
        ends = f"{self.panel.start} to {self.panel.end}"
        return f"A plug from receptacle {ends}, seed {self.scenario.seed}"

    @property
    def X_WB(self) -> Array:
        """Scan pose of the hull."""
        return scan_pose(self.vehicle.X_BC, self.approach_W, self.task.range)

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds panel, plug and flat seabed."""
        from uuv.models.site import plug_site

        return plug_site.plug_site(vehicle, self.panel, self.X_WT, self.site.seat())

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """The depth camera, and the readings of the gripper's drive."""
        from uuv.sim.sensors.depth_camera import DepthCamera
        from uuv.sim.sensors.jaws import JawSensor

        return [DepthCamera(model, HULL_BODY, self.vehicle.X_BC), JawSensor()], None

    def estimator(self, navigation: Estimator) -> Estimator:
        """Navigation with the gripper's readings."""
        from uuv.perception.navigation.jaw_readings import JawReadings

        return JawReadings(navigation)

    def finder(self, sensor: "SensorModel | None", seed: int) -> "KnownObjectFinder":
        """Finder of the panel, with the plug in its receptacle."""
        from uuv.perception.finding.target_finder import KnownObjectFinder

        return KnownObjectFinder(
            self.panel.target, None, self.approach_W, self.orientation_W, sensor=sensor, seed=seed
        )

    def planner(self) -> "PlugMoving":
        """Planner of the move."""
        from uuv.controllers.hull.thrust_margin import ThrustMargin
        from uuv.controllers.tasks.grasping.plugging import PlugMoving
        from uuv.models.hydrodynamics import water_density
        from uuv.models.tools.jaw_shape import JawShape

        return PlugMoving(
            self.vehicle.at_work(),
            self.panel,
            self.job,
            JawShape.of(self.vehicle.model),
            X_WB_scan=self.X_WB,
            water=water_density(self.vehicle.model),
            holding=ThrustMargin.of(self.vehicle.model),
        )

    @property
    def truth(self) -> TrueMove:
        """What is asked for."""
        return TrueMove(
            X_WT=self.X_WT,
            way_T=self.panel.way,
            center_T=self.panel.center,
            first=RECEPTACLES.index(self.panel.start),
            pull=self.task.pull,
            push=self.task.push,
            grip=self.task.grip,
            stuck=self.site.stuck,
        )

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true plug."""
        truth = self.truth
        felt = self.watch.felt(truth.first)
        return assess_move(ran.recording, truth, felt, seed=seed, wall_s=ran.wall_s)

    def observers(self) -> tuple[Observer, ...]:
        """The reader of the forces."""
        return (self.watch,)

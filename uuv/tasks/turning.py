"""Turn of a valve: by its lever, or by a T-bar about the tool's axis."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.controllers.tasks.settings import TurnSettings, settings_of
from uuv.models.naming import HULL_BODY
from uuv.models.site import valve_site
from uuv.models.site.turned_valve import BAR, QUARTER, TurnedValve
from uuv.outcome import Pictures, RunResult
from uuv.scenario import LONGEST, PlacedTask, Scenario, Task
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.evaluation.handling.turn_metrics import FeltHandle, TrueTurn, assess_turn
from uuv.sim.interfaces.messages import TurnReference, WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.loop.rollout import Moment, Observer
from uuv.site import HandValve
from uuv.tasks.approach import object_of, scan_pose

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.tasks.grasping.turning import TurnJob, ValveTurning
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.sim.evaluation.assessment import Assessment


@dataclass(frozen=True, kw_only=True)
class TurnValveTask(TurnSettings, Task):
    """Turn a valve by a quarter with a set moment."""

    schema: ClassVar[str] = "turn"
    looks: ClassVar[bool] = True
    range: float = option(1.25, "Range from camera to valve at the scan [m].", group="work")

    @property
    def tool(self) -> str:
        """A socket for handles."""
        return "handle_socket"

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses an object that is no valve with a handle."""
        super().check_inputs(scenario)
        object_of(scenario, HandValve)

    def least_seconds(self, scenario: Scenario) -> float:
        """Time [s] of a quarter at the set speed."""
        del scenario
        return QUARTER / self.speed

    def place(
        self, scenario: Scenario, own: "OwnVehicle", rng: np.random.Generator
    ) -> "PlacedTurn":
        """The turn at the site's valve; draws its pose and its coarse detection."""
        from uuv.controllers.tasks.grasping.turning import TurnJob, check_moment

        site: HandValve = object_of(scenario, HandValve)
        valve = site.shape()
        job = TurnJob(**settings_of(TurnSettings, self))
        check_moment(job, valve, float(own.vehicle.torque_limits[-1]))

        X_WT = scenario.site.pose(rng)
        center = pose(p=valve.target.center)
        approach_W, orientation_W = coarse_detection(X_WT @ center, rng)
        return PlacedTurn(
            scenario=scenario,
            vehicle=own,
            task=self,
            job=job,
            site=site,
            valve=valve,
            X_WT=X_WT,
            approach_W=approach_W,
            orientation_W=orientation_W,
        )


@dataclass(slots=True, eq=False)
class HandleWatch:
    """Observer of the true handle, and of what the vehicle felt of it."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    slow_ticks: tuple[int, ...] = (5,)  # between two rows

    def observe(self, moment: Moment) -> None:
        """Keeps a row while the handle is in the tool, and its end."""
        handle = moment.truth.handle
        if moment.tick % self.slow_ticks[0] or not len(handle.angle):
            return

        reference = moment.reference
        felt = reference.handle if isinstance(reference, TurnReference) else None
        self.rows.append(
            (
                moment.truth.time,
                np.nan if felt is None else felt.angle,
                0.0 if felt is None else felt.moment,
                float(handle.moment[0]),
                float(handle.angle[0]),
                float(felt is not None and reference.state is WorkState.WORK),
            )
        )

    def felt(self) -> FeltHandle:
        """What was felt, as arrays."""
        table = np.array(self.rows).reshape(-1, 6).T
        time, angle, moment, true_moment, true_angle, work = table
        return FeltHandle(
            time=time,
            angle=angle,
            moment=moment,
            true_moment=true_moment,
            true_angle=true_angle,
            work=work > 0.5,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedTurn(PlacedTask):
    """A valve's turn at its site."""

    begun: ClassVar[tuple[WorkState, ...]] = (WorkState.APPROACH,)
    scenario: Scenario
    vehicle: "OwnVehicle"
    task: TurnValveTask
    job: "TurnJob"
    site: HandValve
    valve: TurnedValve
    X_WT: Array  # (4, 4) true pose
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) its coarse orientation
    watch: HandleWatch = field(default_factory=HandleWatch)

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"A quarter of the valve by its {self.valve.handle}, seed {self.scenario.seed}"

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time, whole; a light valve on a long lever turns slowly."""
        turn = self.job.turn
        more = turn.time(self.valve.lever, self.job.moment) - turn.longest
        return LONGEST + math.ceil(more)

    @property
    def X_WB(self) -> Array:
        """Scan pose of the hull."""
        return scan_pose(self.vehicle.X_BC, self.approach_W, self.task.range)

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds the valve and flat seabed."""
        return valve_site.valve_site(vehicle, self.valve, self.X_WT, self.site.friction())

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """The depth camera."""
        from uuv.sim.sensors.depth_camera import DepthCamera

        return [DepthCamera(model, HULL_BODY, self.vehicle.X_BC)], None

    def finder(self, sensor: "SensorModel | None", seed: int) -> "KnownObjectFinder":
        """Finder of the valve, with its handle at the first stop."""
        from uuv.perception.finding.target_finder import KnownObjectFinder

        return KnownObjectFinder(
            self.valve.target, None, self.approach_W, self.orientation_W, sensor=sensor, seed=seed
        )

    def planner(self) -> "ValveTurning":
        """Planner of the turn."""
        from uuv.controllers.hull.thrust_margin import ThrustMargin
        from uuv.controllers.tasks.grasping.turning import ValveTurning
        from uuv.models.tools.handle_socket import HandleSocket

        play = 0.0 if self.valve.lever else 2.0 * HandleSocket().backlash(BAR[0])
        return ValveTurning(
            self.vehicle.at_work(),
            self.valve,
            self.job,
            X_WB_scan=self.X_WB,
            holding=ThrustMargin.of(self.vehicle.model),
            play=play,
        )

    @property
    def truth(self) -> TrueTurn:
        """What is asked for."""
        return TrueTurn(angle=QUARTER, moment=self.task.moment, stuck=self.site.stuck)

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true handle."""
        felt = self.watch.felt()
        return assess_turn(ran.recording, self.truth, felt, seed=seed, wall_s=ran.wall_s)

    def pictures(self, ran: RunResult) -> Pictures:
        """Moment and angle over time."""
        from uuv.sim.reporting.turn_figures import turn_figures

        del ran
        return turn_figures(self.watch.felt(), self.truth)

    def observers(self) -> tuple[Observer, ...]:
        """The reader of the handle."""
        return (self.watch,)

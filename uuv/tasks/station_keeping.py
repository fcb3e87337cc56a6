"""Station keeping: the hull holds its place in open water, the arm folded."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.random import Generator

from uuv.models.naming import CAMERA_SITE, TOOL_GEOM
from uuv.outcome import NoFigures, RunResult
from uuv.scenario import PlacedTask, Scenario, Task
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import DEGREE, option
from uuv.sim.interfaces.spatial import Array, finite_number, pose
from uuv.site import OpenWater
from uuv.tasks.approach import object_of

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.tasks.task import TaskPlanner
    from uuv.own_vehicle import OwnVehicle
    from uuv.sim.evaluation.assessment import Assessment

LONGEST = 3600.0  # [s] of station keeping
DEPTH = 2.0  # [m] of the hull
_TO_REST = 90.0  # [s] simulated before the hull must be at rest, with the rest at its end


@dataclass(frozen=True, slots=True, kw_only=True)
class StationBounds:
    """Acceptance bounds on the true hull, from the moment at which it has come to rest."""

    drift: float = 0.06  # [m] from its place: as far off as a hull that counts as at rest
    tilt: float = 5.0 * DEGREE  # [rad]


@dataclass(frozen=True, kw_only=True)
class StationKeepingTask(Task):
    """Hold the hull at its place for some time, the arm folded."""

    spares: ClassVar[Collection[str]] = (CAMERA_SITE, TOOL_GEOM)
    heeds: ClassVar[Collection[str]] = ("without", "dead_beams")
    seconds: float = option(30.0, "Duration of station keeping [s].")

    def __post_init__(self) -> None:
        finite_number(self.seconds, "task.seconds [s]", least=1.0, most=LONGEST)

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses a site with an object."""
        super().check_inputs(scenario)
        object_of(scenario, OpenWater)

    def least_seconds(self, scenario: Scenario) -> float:
        """Time [s] of holding."""
        del scenario

        return self.seconds

    def place(
        self, scenario: Scenario, own: "OwnVehicle", rng: Generator
    ) -> "PlacedStationKeeping":
        """The task; nothing is drawn."""
        del rng

        return PlacedStationKeeping(scenario=scenario, own=own, task=self)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedStationKeeping(PlacedTask):
    """Station keeping at its place."""

    scenario: Scenario
    own: "OwnVehicle"
    task: StationKeepingTask

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"Station keeping of {self.scenario.vehicle.vehicle}, seed {self.scenario.seed}"

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time: to come to rest, and to hold."""
        return _TO_REST + self.task.seconds

    @property
    def X_WB(self) -> Array:
        """Pose to hold, DEPTH below the origin."""
        return pose(p=[0.0, 0.0, -DEPTH])

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """The vehicle alone."""
        return vehicle

    def planner(self) -> "TaskPlanner":
        """Rest, then hold."""
        from uuv.controllers.tasks.hull_phases import KeepStation, RestLimits, Settle
        from uuv.controllers.tasks.phase import Hold, PhaseEvent
        from uuv.controllers.tasks.task import TaskPlanner, TaskRow

        # At rest first, as before every job.
        keep = KeepStation(self.task.seconds)
        rows = {
            "settle": TaskRow(Settle(RestLimits()), WorkState.SETTLE, {PhaseEvent.DONE: "keep"}),
            "keep": TaskRow(keep, WorkState.WORK, {PhaseEvent.DONE: "held"}),
            "held": TaskRow(Hold(), WorkState.DONE),
        }
        return TaskPlanner(rows.items(), (), X_WB=self.X_WB, q=np.array(self.own.vehicle.q_home))

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Largest distance from the place and largest tilt of the true hull while it holds."""
        from uuv.sim.evaluation.assessment import Assessment

        work = ran.recording.within(WorkState.WORK)
        p_WB = ran.recording["p_WB"].value[work]
        x, y = ran.recording["quat_WB_wxyz"].value[work, 1:3].T

        # A run that ended before has no figures.
        drift = tilt = None
        if work.any():
            up = 1.0 - 2.0 * (x * x + y * y)  # of the hull's z axis, along that of W
            tilt = float(np.arccos(np.clip(up, -1.0, 1.0)).max())
            drift = float(np.linalg.norm(p_WB - self.X_WB[:3, 3], axis=1).max())

        # Both against their bounds.
        bounds = StationBounds()
        checks = [
            Requirement("hull position error, peak", drift, bounds.drift, "mm", scale=1e3),
            Requirement("tilt of the hull, peak", tilt, bounds.tilt, "deg", scale=1.0 / DEGREE),
        ]
        wall_s = ran.wall_s
        return Assessment.of(ran.recording, NoFigures(), checks, seed=seed, wall_s=wall_s)

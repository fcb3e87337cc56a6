"""Tapping: points of an object are touched in turn, each with a set force for some time."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.models.site import scenes
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import Scenario
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.site import Workpiece
from uuv.tasks.approach import object_of
from uuv.tasks.surface_work import TAP_FORCE, TAPPED, PlacedSurfaceWork, SurfaceWorkTask

if TYPE_CHECKING:
    from uuv.controllers.planning.hull_placement import PathStanding
    from uuv.controllers.tasks.task import TaskPlanner
    from uuv.sim.evaluation.metrics import AskedWork


@dataclass(frozen=True, kw_only=True)
class TappingTask(SurfaceWorkTask):
    """Touch points on a line along a path of an object with the first of the set forces."""

    points: ClassVar[tuple[float, ...]] = TAPPED  # [m] along the path
    hold: ClassVar[float] = 2.0  # [s] at each point
    forces: tuple[float, ...] = (TAP_FORCE,)

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses what tapping does not use, and a path that is shorter than its points."""
        for name in ("contactless", "least"):
            value = getattr(self, name)
            if value != getattr(type(self), name):
                raise ConfigurationError(
                    f"task.{name}: tapping presses at each of its points, got {value:g}"
                )

        super().check_inputs(scenario)
        workpiece: Workpiece = object_of(scenario, Workpiece)
        length = self.time(*workpiece.target(self.path), self.force_rate).length
        if length < self.points[-1]:
            raise ConfigurationError(
                f"task.path: tapping needs a path of {self.points[-1]:g} m, got {length:.3g} m"
            )

    def place(
        self, scenario: Scenario, own: OwnVehicle, rng: np.random.Generator
    ) -> "PlacedTapping":
        """The work on the site's object, made as by `SurfaceWorkTask.place`."""
        placed = super().place(scenario, own, rng)

        return PlacedTapping(
            scenario=scenario,
            own=own,
            task=self,
            target=placed.target,
            approach_W=placed.approach_W,
            orientation_W=placed.orientation_W,
            truth=placed.truth,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedTapping(PlacedSurfaceWork):
    """Tapping at its site."""

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"Tapping the {self.target.name}, {self.truth.path} path, seed {self.scenario.seed}"

    @property
    def bounds(self) -> Bounds:
        """Bounds of the force only, since there is no path."""
        return replace(super().bounds, path_deviation=float("inf"))

    @property
    def asked(self) -> "AskedWork":
        """The force alone: the tool does not move along the surface."""
        return replace(super().asked, speed=None)

    @property
    def standing(self) -> "PathStanding":
        """Chooses the hull's place from which all points are within reach."""
        from uuv.controllers.hull.thrust_margin import ThrustMargin
        from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits

        believed = self.own.at_work()
        job = self.job()

        return PathStanding(
            vehicle=believed.vehicle,
            chain=believed.chain,
            model=self.target,
            hull_box=believed.hull_box,
            limits=StandingLimits(force=max(job.forces), standoff=job.approach.standoff),
            floor=scenes.seabed_height(self.target, self.truth.X_WT),
            holding=ThrustMargin.of(self.own.model),
        )

    def planner(self) -> "TaskPlanner":
        """Planner of the work."""
        from uuv.controllers.tasks.arrival import WorkSite, around
        from uuv.controllers.tasks.tap import tap

        believed = self.own.at_work()
        job = self.job()
        site = WorkSite(
            own=believed,
            X_WB_scan=self.X_WB,
            stand=self.standing,
            around=around(believed, self.target),
        )
        return tap(site, job, TappingTask.points, believed.tip, TappingTask.hold)

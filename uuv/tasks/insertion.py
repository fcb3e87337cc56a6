"""Insertion: a sampler is put into a hole of a subsea manifold, and withdrawn."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.random import Generator

from uuv.controllers.tasks.settings import InsertionSettings, settings_of
from uuv.models.naming import HULL_BODY, TOOL_GEOM, find
from uuv.models.objects.manifold import Hole
from uuv.models.objects.targets import TargetModel
from uuv.models.site import scenes
from uuv.outcome import Pictures, RunResult
from uuv.scenario import PlacedTask, Scenario, Task
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.evaluation.insertion_metrics import AT_THE_HOLE, TrueHole, assess_insertion
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import MILLIMETRE, option
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, pose
from uuv.site import HoleManifold
from uuv.tasks.approach import object_of, scan_pose

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.tasks.insertion import HoleInsertion
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.sim.evaluation.assessment import Assessment


@dataclass(frozen=True, kw_only=True)
class InsertionTask(InsertionSettings, Task):
    """Insert a sampler into a hole of a manifold."""

    schema: ClassVar[str] = "insertion"
    looks: ClassVar[bool] = True
    hole: Literal["a", "b"] = option("a", "Hole of the manifold.")
    error: tuple[float, float] = option(
        (0.0, 0.0),
        "Error added to the identified hole position along the hole's x and y [mm]; search and "
        "compliance must correct it.",
        unit=MILLIMETRE,
    )
    range: float = option(1.25, "Range from camera to manifold at the scan [m].")

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.error)):
            raise ConfigurationError(f"task.error [m]: must be finite, got {self.error}")

    @property
    def tool(self) -> str:
        """The sampler."""
        return "sampler"

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses an object that is not a manifold, and a hole that the manifold does not have."""
        from uuv.models.tools.sampler import SAMPLER

        super().check_inputs(scenario)
        site: HoleManifold = object_of(scenario, HoleManifold)
        site.block(SAMPLER.radius).hole(self.hole)

    def place(self, scenario: Scenario, own: "OwnVehicle", rng: Generator) -> "PlacedInsertion":
        """The insertion at the site's manifold; draws its pose and its coarse detection."""
        import mujoco

        tool = find(own.model, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM)
        if own.model.geom_type[tool] != mujoco.mjtGeom.mjGEOM_CAPSULE:
            name = scenario.vehicle.vehicle
            raise ConfigurationError(
                f"vehicle.vehicle {name!r}: its geom {TOOL_GEOM!r} must be a capsule, the sampler"
            )

        radius = float(own.model.geom_size[tool, 0])
        site: HoleManifold = object_of(scenario, HoleManifold)
        block = site.block(radius)

        X_WT = scenario.site.pose(rng)
        approach_W, orientation_W = coarse_detection(X_WT @ pose(p=block.target.center), rng)
        bore = block.hole(self.hole)

        return PlacedInsertion(
            scenario=scenario,
            vehicle=own,
            task=self,
            target=block.target,
            bore=bore,
            X_WT=X_WT,
            approach_W=approach_W,
            orientation_W=orientation_W,
            truth=TrueHole(
                X_WH=bore.pose(X_WT), radius=bore.radius, tool_radius=radius, depth=self.depth
            ),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedInsertion(PlacedTask):
    """An insertion at its site."""

    begun: ClassVar[tuple[WorkState, ...]] = AT_THE_HOLE
    scenario: Scenario
    vehicle: "OwnVehicle"
    task: InsertionTask
    target: TargetModel
    bore: Hole
    X_WT: Array  # (4, 4) true pose of the manifold
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) its coarse orientation
    truth: TrueHole

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"A sampler into hole {self.task.hole}, seed {self.scenario.seed}"

    @property
    def X_WB(self) -> Array:
        """Scan pose of the hull."""
        return scan_pose(self.vehicle.X_BC, self.approach_W, self.task.range)

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds the manifold and flat seabed."""
        return scenes.work_site(vehicle, self.target, self.X_WT)

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """The depth camera."""
        from uuv.sim.sensors.depth_camera import DepthCamera

        return [DepthCamera(model, HULL_BODY, self.vehicle.X_BC)], None

    def finder(self, sensor: "SensorModel | None", seed: int) -> "KnownObjectFinder":
        """Finder of the manifold."""
        from uuv.perception.finding.target_finder import KnownObjectFinder

        path = f"beside_{self.task.hole}"
        return KnownObjectFinder(self.target, path, self.approach_W, self.orientation_W, seed=seed)

    def planner(self) -> "HoleInsertion":
        """Planner of the insertion."""
        from uuv.controllers.tasks import insertion

        believed = self.vehicle
        task = self.task
        bore = self.bore
        aimed_at = replace(bore, p_T=bore.p_T + bore.pose(np.eye(4))[:3, :3] @ [*task.error, 0.0])
        return insertion.HoleInsertion(
            believed.at_work(),
            self.target,
            aimed_at,
            insertion.InsertionJob(
                **settings_of(InsertionSettings, task),
                inside=insertion.EntryLimits(nose=self.truth.tool_radius),
            ),
            X_WB_scan=self.X_WB,
        )

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true hole."""
        accepted = next(
            (target for target in reversed(ran.recording.targets) if target.accepted), None
        )
        X_WH = None if accepted is None else accepted.X_WT @ self.bore.pose(np.eye(4))
        return assess_insertion(
            ran.recording, self.truth, found_X_WH=X_WH, seed=seed, wall_s=ran.wall_s
        )

    def pictures(self, ran: RunResult) -> Pictures:
        """Forces and depth over time."""
        from uuv.sim.reporting.insertion_figures import insertion_figures

        return insertion_figures(ran.recording, self.truth)

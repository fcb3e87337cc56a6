"""Inspection: orbits around a known object with the camera on it [Konoplin 2019, eq. 6]."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from numpy.random import Generator

from uuv.controllers.tasks.settings import InspectionSettings, settings_of
from uuv.models.meshes import open3d_loader
from uuv.models.naming import HULL_BODY, TOOL_GEOM
from uuv.models.objects.targets import TargetModel
from uuv.models.site import scenes
from uuv.outcome import Pictures, RunResult
from uuv.scenario import LONGEST, PlacedTask, Scenario, Task
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.evaluation.inspection_metrics import (
    InspectionBounds,
    TrueInspection,
    assess_inspection,
)
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, pose, transform_points
from uuv.sim.loop.rollout import Observer
from uuv.site import Workpiece
from uuv.tasks.approach import object_of, scan_pose

if TYPE_CHECKING:
    import mujoco
    from matplotlib.figure import Figure

    from uuv.controllers.tasks.inspection import Inspection, InspectionJob
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.sim.evaluation.assessment import Assessment
    from uuv.sim.loop.recording import Recorder, Recording
    from uuv.tasks.surface_survey import SurfaceSurvey

COVERED = 0.95  # share of what can be seen that a flight which is to cover the object must see
FAR = 5.0  # [m] largest range at which a surface point counts as seen
_COVERED_WITHIN = 2000.0  # [s] limit of a flight over several levels


@dataclass(frozen=True, kw_only=True)
class InspectionTask(InspectionSettings, Task):
    """Fly one orbit, or as many as cover it, around an object."""

    schema: ClassVar[str] = "inspection"
    looks: ClassVar[bool] = True
    spares: ClassVar[Collection[str]] = (TOOL_GEOM,)
    cover: bool = option(False, "Fly further orbits until the visible surface is covered.")
    mesh: bool = option(
        False, "Write mesh.ply, the measured surface and its deviations (extra open3d)."
    )

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses a missing object, and a mesh if Open3D is not installed."""
        super().check_inputs(scenario)
        workpiece: Workpiece = object_of(scenario, Workpiece)
        workpiece.model()
        if self.mesh:
            open3d_loader.load()

    def place(self, scenario: Scenario, own: "OwnVehicle", rng: Generator) -> "PlacedInspection":
        """The flight around the site's object; draws its pose and its coarse detection."""
        from uuv.controllers.tasks.inspection import InspectionJob
        from uuv.tasks.surface_survey import SurfaceSurvey

        workpiece: Workpiece = object_of(scenario, Workpiece)
        target = workpiece.model()
        config = InspectionJob(**settings_of(InspectionSettings, self))

        X_WT = scenario.site.pose(rng)
        approach_W, orientation_W = coarse_detection(X_WT @ pose(p=target.center), rng)
        true_model = workpiece.as_it_is(target, None, rng)

        return PlacedInspection(
            scenario=scenario,
            own=own,
            config=config,
            target=target,
            true_model=true_model,
            X_WT=X_WT,
            approach_W=approach_W,
            orientation_W=orientation_W,
            cover=self.cover,
            survey=SurfaceSurvey(target, scenes.seabed_height(target, X_WT), scenario.seed)
            if self.mesh
            else None,
        )


@dataclass(kw_only=True, eq=False)
class PlacedInspection(PlacedTask):
    """An inspection at its site."""

    scenario: Scenario
    own: "OwnVehicle"
    config: "InspectionJob"
    target: TargetModel  # as the vehicle knows it
    true_model: TargetModel
    X_WT: Array  # (4, 4) true pose
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) its coarse orientation
    cover: bool = False  # further levels
    survey: "SurfaceSurvey | None" = None  # of the surface; None: none
    # tangents of half the camera's fields of view; `sensors` sets it
    half_view: tuple[float, float] = (0.0, 0.0)

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time, longer for several orbits."""
        return _COVERED_WITHIN if self.cover else LONGEST

    @property
    def title(self) -> str:
        """Title of log and report."""
        seed = self.scenario.seed
        distance = self.config.distance
        return f"Inspection of the {self.target.name} from {distance:g} m, seed {seed}"

    @property
    def X_WB(self) -> Array:
        """Scan pose of the hull."""
        return scan_pose(self.own.X_BC, self.approach_W, self.config.distance)

    @property
    def truth(self) -> TrueInspection:
        """Truth for the evaluation, once the camera is made."""
        return TrueInspection(
            target=self.true_model,
            X_WT=self.X_WT,
            X_BC=self.own.X_BC,
            distance=self.config.distance,
            far=FAR,
            half_view=self.half_view,
        )

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds the true object and flat seabed."""
        return scenes.work_site(vehicle, self.true_model, self.X_WT)

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """The depth camera."""
        from uuv.sim.sensors.depth_camera import DepthCamera

        camera = DepthCamera(model, HULL_BODY, self.own.X_BC)
        self.half_view = (camera.K[0, 2] / camera.K[0, 0], camera.K[1, 2] / camera.K[1, 1])
        if self.survey is not None:
            self.survey.look_through(camera)
        return [camera], None

    def finder(self, sensor: "SensorModel | None", seed: int) -> "KnownObjectFinder":
        """Finder of the object."""
        from uuv.perception.finding.target_finder import KnownObjectFinder

        return KnownObjectFinder(self.target, None, self.approach_W, self.orientation_W, seed=seed)

    def planner(self) -> "Inspection":
        """Planner of the orbit."""
        from uuv.controllers.tasks.inspection import Inspection
        from uuv.models.meshes.visibility import View

        believed = self.own
        return Inspection(
            believed.at_work(),
            self.target,
            self.config,
            X_WB_scan=self.X_WB,
            floor=scenes.seabed_height(self.target, self.X_WT),
            view=View(self.half_view, FAR) if self.cover else None,
        )

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true object."""
        from uuv.controllers.planning.hull_path import HullPath
        from uuv.controllers.tasks import inspection

        believed = self.own.at_work()
        vertices_W = transform_points(self.X_WT, self.true_model.vertices)
        passing = HullPath(believed.vehicle, believed.chain, believed.hull_box, vertices_W)
        keep = inspection.Keep(
            passing, scenes.seabed_height(self.true_model, self.X_WT), self.config.clearance
        )
        truth = replace(
            self.truth, allowed=inspection.allowed_cameras(vertices_W, believed.X_BC, keep)
        )
        measured = None if self.survey is None else self.survey.mesh
        bounds = InspectionBounds(coverage=COVERED) if self.cover else None
        return assess_inspection(
            ran.recording, truth, seed=seed, wall_s=ran.wall_s, bounds=bounds, measured=measured
        )

    def pictures(self, ran: RunResult) -> Pictures:
        """Plan view of the hull's path, and the measured surface."""
        yield from orbit_picture(ran.recording, self.truth)
        if self.survey is not None:
            yield from self.survey.pictures()

    def observers(self) -> tuple[Observer, ...]:
        """The survey of the surface."""
        return () if self.survey is None else (self.survey,)

    def write_files(self, folder: Path) -> tuple[Path, ...]:
        """Write mesh.ply."""
        if self.survey is None:
            return ()
        self.survey.write(folder / "mesh.ply")
        return (folder / "mesh.ply",)

    def story(self, recorder: "Recorder", log: Any) -> Observer:
        """Clouds of the identification, and at the end the mesh."""
        from uuv.tasks.surface_survey import SurveyStory

        story = super().story(recorder, log)
        return story if self.survey is None else SurveyStory(story, self.survey, log)


def orbit_picture(
    recording: "Recording", truth: TrueInspection
) -> Iterator[tuple[str, str, "Figure"]]:
    """Plan view of the hull's reference and true path around the object."""
    from matplotlib.figure import Figure

    work = recording.within(WorkState.WORK)
    if not work.any():
        return
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    axes = figure.subplots()
    vertices = transform_points(truth.X_WT, truth.target.vertices)
    axes.triplot(vertices[:, 0], vertices[:, 1], truth.target.triangles, lw=0.2, color="0.5")
    axes.plot(
        *recording["p_WB_reference"].value[work][:, :2].T, "--", lw=1.0, label="hull, reference"
    )
    axes.plot(*recording["p_WB"].value[work][:, :2].T, lw=1.0, label="hull")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.legend(frameon=False, fontsize=9)
    yield "The orbit", "The hull's path around the object, from above.", figure

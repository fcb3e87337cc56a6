"""Seabed sampling: a core is taken, or a box is dragged along the profile between two targets."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from uuv.controllers.tasks.settings import SeabedSettings, settings_of
from uuv.models.naming import CAMERA_SITE, HULL_BODY, TOOL_GEOM, find
from uuv.models.site import scenes
from uuv.models.site.seabed import Seabed
from uuv.models.site.soil import SOILS, Soil, SoilTool, box, core_tube
from uuv.outcome import Pictures, RunResult
from uuv.perception.clouds.point_files import read_cloud, read_targets
from uuv.scenario import PlacedTask, Scenario, Task
from uuv.sim.evaluation.seabed_metrics import TrueGround, assess_seabed_work
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import Estimator, Sensor
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points
from uuv.sim.loop.rollout import Moment
from uuv.site import ALTITUDE, Ground
from uuv.tasks.approach import object_of

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.planning.seabed_height import HeightSearch
    from uuv.controllers.tasks.seabed_work import SeabedJob, SeabedWork
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.seabed.seabed_finder import SeabedFinder
    from uuv.sim.evaluation.assessment import Assessment
    from uuv.sim.loop.recording import Recorder
    from uuv.sim.sensors.sonar import SonarBeams

# [m] from the terrain's middle to the hull during the scan, in W
ABOVE = np.array([0.0, 0.0, ALTITUDE])
HIGHER = (0.8, 1.8)  # [m] further height of the start pose: the vehicle does not know its altitude
AHEAD = 0.5  # [m] distance of the default targets ahead of the hull's middle
APART = 0.3  # [m] distance between the two default targets of a drag
AXES = 0.06  # [m] length of the unit axes in the log
PLANE = 0.5  # [m] length of the normal of the plane from the Doppler log, in the log
# [m] from the sonar: closer echoes are from the vehicle's own arm; less where that folds closer
OWN_ARM = 0.8
_ROOM = 0.1  # [m] beyond the folded arm within which echoes count as its own
LOOKS = 10  # pings for the surface; from a single ping it is 3 to 8 mm off, mostly noise


@dataclass(frozen=True, kw_only=True)
class SeabedSamplingTask(SeabedSettings, Task):
    """Take a core of the seabed, or drag a box through it."""

    schema: ClassVar[str] = "seabed_work"
    looks: ClassVar[bool] = True
    spares: ClassVar[Collection[str]] = (CAMERA_SITE,)
    heeds: ClassVar[Collection[str]] = ("dead_beams",)
    cloud: str | None = option(
        None,
        "Text, PLY or PCD, in the axes of a level hull 2.5 m above the terrain's middle: replaces "
        "the scan, and is judged before the vehicle approaches.",
    )
    targets: str | None = option(
        None,
        "Text file: points B_i above the seabed and a line `z X Y Z` with their direction, in the "
        "same axes; default: ahead of the hull.",
    )

    @property
    def tool(self) -> str:
        """Box or core tube."""
        return "box" if self.drag else "corer"

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses a site without ground, an unknown soil, and files that cannot be read."""
        super().check_inputs(scenario)
        site: Ground = object_of(scenario, Ground)
        SOILS.resolve(site.soil)
        self._targets()
        if self.cloud is not None:
            read_cloud(self.cloud)

    def place(
        self, scenario: Scenario, own: "OwnVehicle", rng: np.random.Generator
    ) -> "PlacedSampling":
        """The work on the site's seabed; draws the terrain, heading and height of the start."""
        from uuv.controllers.tasks.seabed_work import SeabedJob

        site: Ground = object_of(scenario, Ground)
        ground = site.draw(scenario.seed, rng)

        # The scan pose; a start without a cloud is higher, for the coarse approach.
        X_WB = pose(exp_so3([0.0, 0.0, rng.uniform(-np.pi, np.pi)]), ground.center_W + ABOVE)
        higher = pose(p=[0.0, 0.0, rng.uniform(*HIGHER)])
        B_B, up_B = self._targets()

        return PlacedSampling(
            scenario=scenario,
            own=own,
            task=self,
            job=SeabedJob(
                **settings_of(SeabedSettings, self), scans=3 if self.cloud is None else 1
            ),
            ground=ground,
            start=higher @ X_WB if self.cloud is None else X_WB,
            B_W=transform_points(X_WB, B_B),
            up_W=X_WB[:3, :3] @ up_B,
            cloud_W=None if self.cloud is None else transform_points(X_WB, read_cloud(self.cloud)),
            soil=SOILS.load(site.soil),
        )

    def _targets(self) -> tuple[Array, Array]:
        """Targets B (s, 3) [m] and their direction z (3,), in hull axes at the scan pose."""
        if self.targets is None:
            sides = (-0.5 * APART, 0.5 * APART) if self.drag else (0.0,)
            return np.array([[AHEAD, side, 0.0] for side in sides]), np.array([0.0, 0.0, 1.0])
        B, up = read_targets(self.targets)
        if self.drag and len(B) < 2:
            raise ConfigurationError(
                f"task.targets {self.targets}: to drag between needs two points or more, got "
                f"{len(B)}"
            )
        return (B, up) if self.drag else (B[:1], up)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedSampling(PlacedTask):
    """Sampling at its site."""

    begun: ClassVar[tuple[WorkState, ...]] = (WorkState.APPROACH,)
    scenario: Scenario
    own: "OwnVehicle"
    task: SeabedSamplingTask
    job: "SeabedJob"
    ground: Seabed  # true terrain
    start: Array  # (4, 4) pose X_WB
    B_W: Array  # (s, 3) [m] targets
    up_W: Array  # (3,) their direction
    cloud_W: Array | None  # (n, 3) [m] that replaces the scan
    soil: Soil

    @property
    def title(self) -> str:
        """Title of log and report."""
        site: Ground = object_of(self.scenario, Ground)
        work = "Dragged along" if self.task.drag else "A core of"
        return f"{work} a seabed of {site.soil}, {site.terrain}, seed {self.scenario.seed}"

    @property
    def X_WB(self) -> Array:
        """Pose of the hull before the approach."""
        return self.start

    @property
    def truth(self) -> TrueGround:
        """Truth for the evaluation."""
        push = None if self.job.drag else self.job.push
        return TrueGround(
            ground=self.ground, hull_box=self.own.hull_box, push=push, depth=self.job.depth
        )

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds the terrain, and its soil that acts on the tool."""
        from uuv.models.site import soil_bed

        scene = scenes.dig_site(vehicle, self.ground)
        soil_bed.attach(scene, self.ground, self.soil, tool_of(self.own.model))
        return scene

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """Sonar under the bow, slant ranges of the Doppler log."""
        from uuv.sim.sensors.dvl_ranges import DvlBeams, DvlRanges
        from uuv.sim.sensors.sonar import Sonar

        hull = self.own.hull_box
        nearest = own_arm(self.own)
        beams = DvlBeams(limits=(nearest, 50.0), dead=self.scenario.sensing.dead_beams)
        return [
            Sonar(
                model,
                HULL_BODY,
                sonar_on_hull(hull),
                beams=sonar_beams(),
                range_limits=(nearest, 10.0),
            ),
            DvlRanges.on(model, HULL_BODY, dvl_on_hull(hull), beams),
        ], None

    def estimator(self, navigation: Estimator) -> Estimator:
        """Navigation with the plane of the ground."""
        from uuv.perception.navigation.ground_plane import GroundPlaneEstimator

        return GroundPlaneEstimator(navigation)

    def finder(self, sensor: "SensorModel | None", seed: int) -> "SeabedFinder":
        """Finder of the surface."""
        from uuv.perception.seabed.seabed_finder import SeabedFinder

        return SeabedFinder(
            self.B_W, self.up_W, core_depth=self.job.depth, cloud_W=self.cloud_W, looks=LOOKS
        )

    def planner(self) -> "SeabedWork":
        """Planner of the work in the soil."""
        from uuv.controllers.planning.ground_approach import GroundApproach
        from uuv.controllers.tasks.seabed_work import SeabedWork

        believed = self.own
        hull = self.own.hull_box
        return SeabedWork(
            believed.at_work(),
            self.job,
            X_WB_scan=self.start,
            search=height_search(hull, drag=self.job.drag),
            coarse=GroundApproach(height=ALTITUDE, hull_box=hull) if self.cloud_W is None else None,
        )

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true ground."""
        return assess_seabed_work(ran.recording, self.truth, seed=seed, wall_s=ran.wall_s)

    def pictures(self, ran: RunResult) -> Pictures:
        """Depth and force over time."""
        from uuv.sim.reporting.seabed_figures import seabed_figures

        return seabed_figures(ran.recording, self.truth)

    def story(self, recorder: "Recorder", log: Any) -> "SeabedRecorder":
        """Observer of the found seabed."""
        return SeabedRecorder(recorder, log)


def tool_of(model: "mujoco.MjModel") -> SoilTool:
    """Soil model of the vehicle's tool.

    Raises:
        ConfigurationError: The tool's geom is neither core tube nor box.
    """
    import mujoco

    from uuv.models.tools import sampler

    geom = find(model, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM)
    kinds = mujoco.mjtGeom
    size = model.geom_size[geom]
    kind = kinds(int(model.geom_type[geom]))
    if kind == kinds.mjGEOM_BOX:
        return box(2.0 * float(size[1]), 2.0 * float(size[0]), sampler.BOX.wall, sampler.BOX.rake)
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        return core_tube(float(size[0]), sampler.CORER.wall)
    raise ConfigurationError(
        f"vehicle.vehicle: its geom {TOOL_GEOM!r} must be a cylinder or a capsule, the core tube, "
        "or a box that is dragged"
    )


def height_search(hull: Array, *, drag: bool) -> "HeightSearch":
    """Search settings for the hull's height: a box keeps its edge ahead, a tube may turn."""
    from uuv.controllers.planning.seabed_height import HeightSearch

    jets = -float(hull[0, 2])
    return HeightSearch(jets_above=jets, rolls=1) if drag else HeightSearch(jets_above=jets)


def sonar_beams() -> "SonarBeams":
    """Beams of the sonar that looks at the seabed."""
    from uuv.sim.sensors.sonar import SonarBeams

    return SonarBeams(rows=96, columns=96, elevation=np.radians(90.0), azimuth=np.radians(90.0))


def sonar_on_hull(box: Array) -> Array:
    """Pose X_BS (4, 4) of the sonar: under the bow, looking down, x to starboard, y aft."""
    R_BS = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    return pose(R_BS, [box[1, 0] - 0.05, 0.0, box[0, 2] - 0.02])


def dvl_on_hull(hull: Array) -> Array:
    """Position (3,) [m] of the Doppler log in B: under the stern, clear of the folded arm."""
    return np.array([hull[0, 0] + 0.1, 0.0, hull[0, 2] - 0.02])


def own_arm(believed: "OwnVehicle") -> float:
    """Distance [m] from the sonar within which echoes are from the folded arm, at most OWN_ARM."""
    import mujoco

    model, vehicle = believed.model, believed.vehicle
    data = mujoco.MjData(model)
    data.qpos[vehicle.qpos] = vehicle.q_home
    mujoco.mj_kinematics(model, data)
    hull = data.xpos[vehicle.hull], data.xmat[vehicle.hull].reshape(3, 3)

    sonar = hull[0] + hull[1] @ sonar_on_hull(believed.hull_box)[:3, 3]
    carried = [g for g in range(model.ngeom) if model.geom_bodyid[g] not in (0, vehicle.hull)]
    far = np.linalg.norm(data.geom_xpos[carried] - sonar, axis=1) + model.geom_rbound[carried]
    return min(OWN_ARM, float(far.max(initial=0.0)) + _ROOM)


class SeabedRecorder:
    """Observer that adds seabed, coarse and fine, targets and profile to recording and log."""

    slow_ticks = ()

    def __init__(self, recorder: "Recorder", log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        """Adds what the finder has at each new ping."""
        if moment.frame is None:
            return
        from uuv.perception.seabed.seabed_finder import SeabedFinderState

        finder = moment.found
        if not isinstance(finder, SeabedFinderState) or finder.cloud_W is None:
            return

        time = moment.truth.time
        plan = finder.plan
        self._recorder.add_cloud("scan", finder.cloud_W)
        if plan is not None:
            self._recorder.add_cloud("targets", plan.targets.A)
        if self._log is None:
            return

        self._log.log_cloud("scan", finder.cloud_W, time, radius=0.004)
        ground = moment.estimate.ground
        if ground is not None and np.isfinite(ground.p_W).all():
            self._log.log_arrows(
                "coarse_plane", ground.p_W[None], PLANE * ground.normal_W[None], time
            )

        if plan is None:
            return
        self._log.log_mesh("seabed", plan.terrain.vertices, plan.terrain.triangles, time)
        self._log.log_cloud("targets", plan.targets.A, time, radius=0.03)
        if plan.profile is not None:
            T = plan.profile.T
            for name, vectors in (("a", plan.profile.a), ("n", plan.profile.n)):
                self._log.log_arrows(f"profile_{name}", T, AXES * vectors, time)

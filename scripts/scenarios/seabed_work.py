"""Sampling of the seabed: assembly of terrain, soil, sonar and planner, evaluation and trials over many seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from controllers.mkps import Chain
from controllers.planning.ground_approach import GroundApproach
from controllers.planning.seabed_height import HeightSearch
from controllers.tasks.seabed_work import SeabedJob, SeabedWork
from models.naming import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, TOOL_GEOM, find
from models.site import scenes
from models.site.seabed import KINDS, Kind, seabed
from models.site.soil import SOILS, SoilTool, box, core_tube
from models.tools import sampler
from models.vehicles import uuv_puma
from perception.clouds.point_files import read_cloud, read_targets
from perception.navigation.ground_plane import GroundPlaneEstimator
from perception.navigation.strapdown_filter import Navigation
from perception.seabed.seabed_finder import SeabedFinder, SeabedFinderState
from scenarios.campaigns.domain_randomisation import NOMINAL
from scenarios.campaigns.trials import Spread, Trials
from scenarios.contact_parts import checked_vehicle, controller, hull_box, passive_joints
from scenarios.runner import REACTION_TICKS, PreparedRun, rehearse, run_through
from scenarios.study.options import PoolOptions
from sim import hydrodynamics
from sim.evaluation.seabed_metrics import TrueGround, assess_seabed_work, crashed, summary
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, exp_so3, pose, transform_points
from sim.loop.recording import Recorder
from sim.loop.rollout import Moment, Parts
from sim.plant.plant import Plant
from sim.plant.soil_contact import SoilForce
from sim.sensors import proprioception
from sim.sensors.dvl_ranges import DvlBeams, DvlRanges
from sim.sensors.sonar import Sonar, SonarBeams
from sim.water.current import Current

ALTITUDE = 2.5  # [m] height of the hull above the ground during the scan
# [m] The same as a vector in W.
ABOVE = np.array([0.0, 0.0, ALTITUDE])
HIGHER = (0.8, 1.8)  # [m] further height of the start pose: the vehicle does not know its altitude
AHEAD = 0.5  # [m] distance of the default targets ahead of the hull's middle
APART = 0.3  # [m] distance between the two default targets of a drag
HALF = 3.0  # [m] half the side of the terrain
BEAMS = SonarBeams(rows=96, columns=96, elevation=np.radians(90.0), azimuth=np.radians(90.0))
AXES = 0.06  # [m] length of the unit axes in the log
PLANE = 0.5  # [m] length of the normal of the plane from the Doppler log, in the log
OWN_ARM = 0.8  # [m] from the sonar: closer echoes are from the vehicle's own arm
LOOKS = 10  # pings for the surface; from a single ping it is 3 to 8 mm off, mostly noise


@dataclass(frozen=True, slots=True, kw_only=True)
class SeabedSetting:
    """Settings that all trials share."""

    kind: Kind | Literal["any"]  # any: the kinds in turn, by the seed
    soil: str  # of models.site.soil.SOILS
    job: SeabedJob
    cloud: Path | None  # replaces the scan; in axes of a level hull ALTITUDE above the terrain's middle
    targets: Path | None  # file with B_i and z, in the same axes
    dead_beams: tuple[int, ...]  # dead beams of the Doppler log, from 1
    current: tuple[float, float, float]  # [m/s] in W
    gust: float  # [m/s] standard deviation per axis
    without: frozenset[str]  # controller methods to leave out
    vehicle: str
    controller: str  # registered name, or MODULE:CLASS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeabedRun:
    """One assembled run; the truth about the ground goes to plant and evaluation only."""

    ready: PreparedRun
    truth: TrueGround


def prepare(setting: SeabedSetting, seed: int, *, record: bool = False) -> SeabedRun:
    """Assembles one run, drawn from `seed`.

    Args:
        setting: Settings that all trials share.
        seed: Draws the terrain, the start pose, the gusts and the sensor noise.
        record: Keep the arm's reaction wrench on the hull for the report.

    Returns:
        The run, ready to start.

    Raises:
        UuvError: The vehicle lacks a part, a file is unusable, or a number is out of range.
    """
    job, rng = setting.job, np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)] if setting.kind == "any" else setting.kind
    ground = seabed(kind, rng, center_W=rng.uniform(-0.2, 0.2, 3) - ABOVE, half=HALF)
    yaw = rng.uniform(-np.pi, np.pi)
    gusts, loop, start = rng.spawn(3)
    own = with_tool(setting.vehicle, drag=job.drag).compile()
    arm = checked_vehicle(own, but=(CAMERA_SITE,))
    hull = hull_box(own, arm)
    X_WB = pose(exp_so3([0.0, 0.0, yaw]), ground.center_W + ABOVE)
    higher = pose(p=[0.0, 0.0, rng.uniform(*HIGHER)])
    X_WB_start = higher @ X_WB if setting.cloud is None else X_WB
    B_B, up_B = _targets(setting)
    B_W, up_W = transform_points(X_WB, B_B), X_WB[:3, :3] @ up_B
    cloud_W = None if setting.cloud is None else transform_points(X_WB, read_cloud(setting.cloud))

    model = hydrodynamics.compile(scenes.dig_site(with_tool(setting.vehicle, drag=job.drag), ground))
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    plant = Plant(
        model,
        current=Current(setting.current),
        X_WB=X_WB_start @ offset,
        reaction_ticks=REACTION_TICKS if record else 0,
        soil=SoilForce(ground, SOILS.load(setting.soil), tool_of(own)),
    )
    flow = Current(setting.current, gust=setting.gust, timestep=model.opt.timestep, rng=gusts)
    chain = Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=passive_joints(own, arm))
    parts = Parts(
        sensors=[
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(),
            Sonar(model, HULL_BODY, sonar_on_hull(hull), beams=BEAMS, range_limits=(OWN_ARM, 10.0)),
            DvlRanges.on(
                model, HULL_BODY, dvl_on_hull(hull), DvlBeams(limits=(OWN_ARM, 50.0), dead=setting.dead_beams)
            ),
        ],
        estimator=GroundPlaneEstimator(Navigation()),
        finder=SeabedFinder(B_W, up_W, core_depth=job.depth, cloud_W=cloud_W, looks=LOOKS),
        planner=SeabedWork(
            arm,
            chain,
            job,
            X_WB_scan=X_WB_start,
            hull_box=hull,
            search=height_search(hull, drag=job.drag),
            coarse=GroundApproach(height=ALTITUDE, hull_box=hull) if setting.cloud is None else None,
        ),
        controller=controller(setting.controller, own, without=setting.without, water_error=NOMINAL.water_error),
    )
    ready = PreparedRun(
        seed=seed,
        plant=plant,
        parts=parts,
        loop=loop,
        restart=lambda: plant.reset(current=flow, X_WB=X_WB_start @ offset),
    )
    truth = TrueGround(ground=ground, hull_box=hull, push=None if job.drag else job.push, depth=job.depth)
    return SeabedRun(ready=ready, truth=truth)


def run_trials(setting: SeabedSetting, seeds: Sequence[int], options: PoolOptions) -> int:
    """Does one run for each seed and reports the statistics.

    Args:
        setting: Settings that all trials share.
        seeds: Seeds of the trials.
        options: Options of the command.

    Returns:
        The exit code.
    """
    prepare(setting, seeds[0])  # an error in the settings is raised here once, not in every worker
    trials = Trials(one=_one, crashed=crashed, summary=summary, spreads=_SPREADS)
    return trials.carry_out("sample_seabed", setting, seeds, options)


def _one(case: tuple[SeabedSetting, int]) -> Mapping[str, Any]:
    work = prepare(*case)
    rehearse(work.ready)
    ran = run_through(work.ready, Recorder(work.ready.plant.model, full=False))
    return assess_seabed_work(ran.recording, work.truth, seed=case[1], wall_s=ran.wall_s).metrics


_SPREADS: tuple[Spread, ...] = (
    ("target's height, of what is allowed", "target_error_share", "%", 100.0, "max"),
    ("push, worst while held", "push_error_share", "%", 100.0, "max"),
    ("push, peak", "push_max_n", "N", 1.0, "max"),
    ("depth of the core", "depth_m", "mm", 1e3, "min"),
    ("depth error, peak", "depth_error_max_m", "mm", 1e3, "max"),
    ("aside of the profile, peak", "side_max_m", "mm", 1e3, "max"),
    ("depth under the true surface, error, peak", "true_depth_error_max_m", "mm", 1e3, "max"),
    ("the same, RMS", "true_depth_error_rms_m", "mm", 1e3, "max"),
    ("force on the tool, peak", "force_max_n", "N", 1.0, "max"),
    ("hull, rise", "rise_max_m", "mm", 1e3, "max"),
    ("hull, excursion", "excursion_max_m", "mm", 1e3, "max"),
    ("hull over the true ground, least", "ground_gap_m", "mm", 1e3, "min"),
)


def with_tool(vehicle: str, *, drag: bool) -> mujoco.MjSpec:
    """The vehicle's spec: uuv_puma with box or core tube in place of its pad, any other vehicle as it is."""
    return uuv_puma.build("box" if drag else "corer") if vehicle == "uuv_puma" else scenes.vehicle_spec(vehicle)


def tool_of(own: mujoco.MjModel) -> SoilTool:
    """Soil model of the vehicle's tool.

    Raises:
        ConfigurationError: The tool's geom is neither core tube nor box.
    """
    geom = find(own, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM)
    kinds, size = mujoco.mjtGeom, own.geom_size[geom]
    kind = kinds(int(own.geom_type[geom]))
    if kind == kinds.mjGEOM_BOX:
        return box(2.0 * float(size[1]), 2.0 * float(size[0]), sampler.BOX.wall, sampler.BOX.rake)
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        return core_tube(float(size[0]), sampler.CORER.wall)
    raise ConfigurationError(
        f"--vehicle: its geom {TOOL_GEOM!r} must be a cylinder or a capsule, the core tube, or a box that is dragged"
    )


def height_search(hull: Array, *, drag: bool) -> HeightSearch:
    """Search settings for the hull's height: a box keeps its edge ahead, a tube may turn about its axis."""
    jets = -float(hull[0, 2])
    return HeightSearch(jets_above=jets, rolls=1) if drag else HeightSearch(jets_above=jets)


def _targets(setting: SeabedSetting) -> tuple[Array, Array]:
    """Targets B (s, 3) [m] and their direction z (3,), in hull axes at the scan pose."""
    drag = setting.job.drag
    if setting.targets is None:
        sides = (-0.5 * APART, 0.5 * APART) if drag else (0.0,)
        return np.array([[AHEAD, side, 0.0] for side in sides]), np.array([0.0, 0.0, 1.0])
    B, up = read_targets(setting.targets)
    if drag and len(B) < 2:
        raise ConfigurationError(f"--targets {setting.targets}: to drag between needs two points or more, got {len(B)}")
    return (B, up) if drag else (B[:1], up)


def sonar_on_hull(box: Array) -> Array:
    """Pose X_BS (4, 4) of the sonar: under the hull's bow, looking down, x to starboard and y aft."""
    R_BS = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    return pose(R_BS, [box[1, 0] - 0.05, 0.0, box[0, 2] - 0.02])


def dvl_on_hull(hull: Array) -> Array:
    """Position (3,) [m] of the Doppler log in B: under the stern, where the folded arm does not block its beams."""
    return np.array([hull[0, 0] + 0.1, 0.0, hull[0, 2] - 0.02])


class SeabedRecorder:
    """Observer that adds the found seabed, coarse and fine, the targets and the profile to recording and log."""

    def __init__(self, recorder: Recorder, log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        """Adds what the finder has at each new ping."""
        found = moment.found
        if moment.frame is None or not isinstance(found, SeabedFinderState) or found.cloud_W is None:
            return
        time, plan = moment.truth.time, found.plan
        self._recorder.add_cloud("scan", found.cloud_W)
        if plan is not None:
            self._recorder.add_cloud("targets", plan.targets.A)
        if self._log is None:
            return
        self._log.log_cloud("scan", found.cloud_W, time, radius=0.004)
        ground = moment.estimate.ground
        if ground is not None and np.isfinite(ground.p_W).all():
            self._log.log_arrows("coarse_plane", ground.p_W[None], PLANE * ground.normal_W[None], time)
        if plan is None:
            return
        self._log.log_mesh("seabed", plan.terrain.vertices, plan.terrain.triangles, time)
        self._log.log_cloud("targets", plan.targets.A, time, radius=0.03)
        if plan.profile is not None:
            T = plan.profile.T
            for name, vectors in (("a", plan.profile.a), ("n", plan.profile.n)):
                self._log.log_arrows(f"profile_{name}", T, AXES * vectors, time)

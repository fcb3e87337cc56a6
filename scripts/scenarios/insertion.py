"""Insertion of a sampler into a hole: assembly of the parts, run, evaluation and trials over many seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console

from controllers.mkps import Chain
from controllers.tasks.insertion import EntryLimits, HoleInsertion, InsertionJob
from models.naming import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, TOOL_GEOM, find
from models.objects.manifold import manifold
from models.site import scenes
from models.vehicle import pose_in_body
from models.vehicles import uuv_puma
from perception.navigation.strapdown_filter import Navigation
from perception.target_finder import KnownObjectFinder
from scenarios.campaigns.domain_randomisation import NOMINAL
from scenarios.campaigns.trials import Spread, Trials
from scenarios.contact_options import coarse_detection
from scenarios.contact_parts import checked_vehicle, controller, hull_box, passive_joints, scan_pose
from scenarios.runner import REACTION_TICKS, Evaluation, PreparedRun, RunResult, rehearse, run_through, run_with_report
from scenarios.study.options import PoolOptions
from sim import hydrodynamics
from sim.evaluation.insertion_metrics import AT_THE_HOLE, TrueHole, assess_insertion, crashed, summary
from sim.evaluation.metrics import Assessment
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, exp_so3, pose
from sim.loop.recording import Recorder
from sim.loop.rollout import Parts
from sim.plant.plant import Plant
from sim.reporting.insertion_figures import insertion_figures
from sim.runs.command_line import ScenarioOptions
from sim.sensors import proprioception
from sim.sensors.depth_camera import DepthCamera
from sim.water.current import Current

TILT = float(np.radians(5.0))  # [rad] largest tilt of the manifold on the seabed, about x and about y
BOTTOM = 0.02  # [m] by which the hole is deeper than the set depth


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionSetting:
    """Settings that all trials share."""

    hole: str
    clearance: float  # [m] radial
    depth: float  # [m] set depth below the mouth
    chamfer: float  # [m]
    error: tuple[float, float]  # [m] error added to the identified hole along its x and y
    compliance: bool
    scan_range: float  # [m]
    current: tuple[float, float, float]  # [m/s] in W
    gust: float  # [m/s] standard deviation per axis
    vehicle: str
    controller: str  # registered name, or MODULE:CLASS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Insertion:
    """One assembled insertion; the truth about the object goes to plant and evaluation only."""

    ready: PreparedRun
    truth: TrueHole
    X_TH: Array  # (4, 4) the hole in the manifold's frame T


def prepare(setting: InsertionSetting, seed: int, *, record: bool = False) -> Insertion:
    """Assembles one insertion, drawn from `seed`.

    Args:
        setting: Settings that all trials share.
        seed: Draws the manifold's pose, the coarse detection, the gusts and the sensor noise.
        record: Keep the arm's reaction wrench on the hull for the report.

    Returns:
        The insertion, ready to run.

    Raises:
        UuvError: The vehicle lacks a part, its tool is no capsule, or a number is out of range.
    """
    rng = np.random.default_rng(seed)
    own = with_sampler(setting.vehicle).compile()
    arm = checked_vehicle(own)
    tool = find(own, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM)
    if own.geom_type[tool] != mujoco.mjtGeom.mjGEOM_CAPSULE:
        raise ConfigurationError(
            f"--vehicle {setting.vehicle!r}: its geom {TOOL_GEOM!r} must be a capsule, the sampler"
        )
    tool_radius = float(own.geom_size[tool, 0])
    if not setting.clearance > 0.0:
        raise ConfigurationError(f"--clearance: must be > 0 mm, got {1e3 * setting.clearance:g}")
    if not np.all(np.isfinite(setting.error)):
        raise ConfigurationError(f"--error: must be finite, got {setting.error} m")
    block = manifold(tool_radius + setting.clearance, setting.depth + BOTTOM, setting.chamfer)
    bore, target = block.hole(setting.hole), block.target
    lean = exp_so3([*rng.uniform(-TILT, TILT, 2), 0.0])
    X_WT = pose(exp_so3([0.0, 0.0, rng.uniform(-0.6, 0.6)]) @ lean, rng.uniform(-0.2, 0.2, 3) - [0.0, 0.0, 1.5])
    approach, orientation = coarse_detection(X_WT @ pose(p=target.center), rng)
    gusts, loop, start, sampling = rng.spawn(4)

    X_BC = pose_in_body(own, find(own, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), arm.hull)
    X_WB = scan_pose(X_BC, approach, setting.scan_range)
    model = hydrodynamics.compile(scenes.work_site(with_sampler(setting.vehicle), target, X_WT))
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    flow = Current(setting.current, gust=setting.gust, timestep=model.opt.timestep, rng=gusts)
    plant = Plant(
        model, current=Current(setting.current), X_WB=X_WB @ offset, reaction_ticks=REACTION_TICKS if record else 0
    )
    chain = Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=passive_joints(own, arm))
    aimed_at = replace(bore, p_T=bore.p_T + bore.pose(np.eye(4))[:3, :3] @ [*setting.error, 0.0])
    parts = Parts(
        sensors=[
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(),
            DepthCamera(model, HULL_BODY, X_BC),
        ],
        estimator=Navigation(),
        finder=KnownObjectFinder(
            target, f"beside_{setting.hole}", approach, orientation, seed=int(sampling.integers(2**31))
        ),
        planner=HoleInsertion(
            arm,
            chain,
            target,
            aimed_at,
            InsertionJob(depth=setting.depth, compliance=setting.compliance, inside=EntryLimits(nose=tool_radius)),
            X_WB_scan=X_WB,
            hull_box=hull_box(own, arm),
        ),
        controller=controller(setting.controller, own, without=frozenset(), water_error=NOMINAL.water_error),
    )
    truth = TrueHole(X_WH=bore.pose(X_WT), radius=bore.radius, tool_radius=tool_radius, depth=setting.depth)
    ready = PreparedRun(
        seed=seed, plant=plant, parts=parts, loop=loop, restart=lambda: plant.reset(current=flow, X_WB=X_WB @ offset)
    )
    return Insertion(ready=ready, truth=truth, X_TH=bore.pose(np.eye(4)))


def with_sampler(vehicle: str) -> mujoco.MjSpec:
    """The vehicle's spec: uuv_puma with the sampler in place of its pad, any other vehicle as it is."""
    return uuv_puma.build("sampler") if vehicle == "uuv_puma" else scenes.vehicle_spec(vehicle)


def judge(insertion: Insertion, ran: RunResult) -> Assessment:
    """Assessment of an insertion that was run, against the true hole."""
    recording = ran.recording
    found = next((target for target in reversed(recording.targets) if target.accepted), None)
    return assess_insertion(
        recording,
        insertion.truth,
        found_X_WH=None if found is None else found.X_WT @ insertion.X_TH,
        seed=insertion.ready.seed,
        wall_s=ran.wall_s,
    )


def run_and_write(
    setting: InsertionSetting, options: ScenarioOptions, folder: Path, console: Console, started: float
) -> int:
    """Runs one insertion and writes its log, table and report.

    Args:
        setting: Settings of the insertion.
        options: Options of the scenario.
        folder: Folder of results.
        console: Terminal.
        started: [s] time.perf_counter() at the start of the command.

    Returns:
        The exit code.
    """
    insertion = prepare(setting, options.seed, record=options.record)
    judging = Evaluation(
        assess=lambda ran: judge(insertion, ran),
        pictures=lambda ran: insertion_figures(ran.recording, insertion.truth),
        begun=AT_THE_HOLE,
    )
    title = f"A sampler into hole {setting.hole}, seed {options.seed}"
    return run_with_report("insert_sampler", insertion.ready, judging, title, options, folder, console, started)


def run_trials(setting: InsertionSetting, seeds: Sequence[int], options: PoolOptions) -> int:
    """Runs one insertion for each seed and reports the statistics.

    Args:
        setting: Settings that all trials share.
        seeds: Seeds of the trials.
        options: Options of the command.

    Returns:
        The exit code.
    """
    prepare(setting, seeds[0])  # an error in the settings is raised here once, not in every worker
    trials = Trials(one=_one, crashed=crashed, summary=summary, spreads=_SPREADS, also=_searched)
    return trials.carry_out("insert_sampler", setting, seeds, options)


def _one(case: tuple[InsertionSetting, int]) -> Mapping[str, Any]:
    insertion = prepare(*case)
    rehearse(insertion.ready)
    ran = run_through(insertion.ready, Recorder(insertion.ready.plant.model, full=False))
    return judge(insertion, ran).metrics


def _searched(figures: Mapping[str, Any]) -> str:
    return f"; searched in {figures['searched']}"


_SPREADS: tuple[Spread, ...] = (
    ("side force, peak", "side_force_max_n", "N", 1.0, "max"),
    ("axial force, peak", "axial_force_max_n", "N", 1.0, "max"),
    ("depth reached", "depth_m", "mm", 1e3, "min"),
    ("time at the hole", "time_s", "s", 1.0, "max"),
    ("hole as found, off its axis", "found_aside_m", "mm", 1e3, "max"),
    ("hole as found, tilt", "found_tilt_rad", "deg", float(np.degrees(1.0)), "max"),
)

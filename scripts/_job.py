"""Wires the parts of a contact job together, runs it, and writes what came of it. Shared by the scenarios."""

import importlib
import math
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import _deck_calibration
import mujoco
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from controllers import drive
from controllers.mkps import Chain
from controllers.supervisor import Job, SurfaceWork
from models import arm_geometry, scenes
from models.targets import TargetModel
from models.vehicle import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, Vehicle, find, pose_in_body
from perception.navigation import Navigation
from perception.target_finder import FinderState, KnownObjectFinder
from sim import hydrodynamics, sensors
from sim.current import Current
from sim.depth_camera import DepthCamera
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import WorkState
from sim.interfaces.protocols import Controller
from sim.interfaces.spatial import Array, exp_so3, pose
from sim.metrics import Assessment, TrueObject, assess
from sim.plant import PAD_GEOM, Plant
from sim.recording import Recorder
from sim.results_table import results_table
from sim.rollout import Moment, Observer, Parts, rollout
from sim.startup import ScenarioOptions

REHEARSAL = 0.1  # [s] simulated
REACTION_TICKS = 10  # physics steps between measurements of the arm's wrench on the hull, for the report
LONGEST = 400.0  # [s] simulated, whatever happens
WATER_ERROR = 0.15  # share by which the controller's hydrodynamic coefficients are wrong
NOT_ACCEPTED = 1  # exit code


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactJob:
    """What a scenario asks for; the truth about the object is for the plant and the judge alone."""

    scenario: str
    title: str
    target: TargetModel
    path: str
    forces: tuple[float, ...]  # [N]
    speed: float  # [m/s]
    least_share: float  # of the path that must be reached
    X_WT: Array  # (4, 4) true pose of the object
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) coarse orientation
    scan_range: float  # [m]
    vehicle: str
    controller: str  # MODULE:CLASS
    without: frozenset[str]
    arm_errors: int | None  # seed of the errors with which the arm was built; None: none
    calibrated: bool = False  # the controller knows the arm as identified from touches
    arm: Path | None = None  # or as a file says


def run_contact_job(job: ContactJob, options: ScenarioOptions, rng: np.random.Generator, started: float) -> int:
    """Build, run, judge, write. Returns the exit code; raises UuvError where the job could not begin."""
    console = Console()
    if not any(Path(drive.__file__).parent.glob("__pycache__/drive*.nbi")):
        console.print("first start: the inner loops are compiled, once; this takes about half a minute")
    work = Job(
        forces=job.forces, speed=job.speed, least_share=job.least_share,
        force_control="force-control" not in job.without,
    )  # fmt: skip
    truth = TrueObject(model=job.target, path=job.path, X_WT=job.X_WT)
    folder = options.folder(job.scenario)
    believed, built, said = _as_believed_and_built(job)
    if said:
        console.print(said, highlight=False)
    own = believed.compile()  # what the vehicle knows of itself; nothing of the scene
    vehicle = Vehicle.of(own)
    X_BC = pose_in_body(own, find(own, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), vehicle.hull)
    find(own, mujoco.mjtObj.mjOBJ_GEOM, PAD_GEOM)  # what touches with anything else has collided
    X_WB = _scan_pose(X_BC, job)
    model = hydrodynamics.compile(scenes.work_site(built, job.target, job.X_WT))
    gusts, loop, start, sampling = rng.spawn(4)
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    plant = Plant(
        model,
        current=Current(options.current),
        X_WB=X_WB @ offset,
        reaction_ticks=REACTION_TICKS if options.record else 0,
    )
    chain = Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=_undriven(own, vehicle))
    finder = KnownObjectFinder(
        job.target, job.path, job.approach_W, job.orientation_W, seed=int(sampling.integers(2**31))
    )
    parts = Parts(
        sensors=[
            sensors.Encoders(), sensors.JointTorqueSensors(), sensors.Imu(), sensors.Dvl(), sensors.VisionDrift(),
            DepthCamera(model, HULL_BODY, X_BC),
        ],
        estimator=Navigation(),
        finder=finder,
        planner=SurfaceWork(
            vehicle, chain, job.target, work, X_WB_scan=X_WB, hull_box=_hull_box(own, vehicle),
        ),
        controller=_controller(job, own),
    )  # fmt: skip
    recorder = Recorder(model, full=options.record)
    observers: list[Observer] = [recorder]
    log: Any = None
    if options.record or options.view:
        from sim.rerun_log import RerunLog

        log = RerunLog(folder / "run.rrd", model, title=job.title, view=options.view)
        observers.append(log)
    progress = Progress(
        TextColumn("{task.description:<10}"), BarColumn(), TextColumn("{task.fields[note]}"), TimeElapsedColumn(),
        console=console, disable=not sys.stdout.isatty(),
    )  # fmt: skip
    observers += [Clouds(recorder, log), Teller(progress, console)]
    # A short rehearsal loads all compiled code before the clock runs, and lets a bad plug-in fail at once. The parts'
    # state is explicit, so nothing of it is left but in the plant.
    current = Current(options.current, gust=options.gust, timestep=model.opt.timestep, rng=gusts)
    rollout(plant, parts, duration=REHEARSAL, rng=np.random.default_rng(options.seed))
    plant.reset(current=current, X_WB=X_WB @ offset)
    console.print(f"[bold]{job.title}[/bold]  (ready in {time.perf_counter() - started:.1f} s)")
    began = time.perf_counter()
    try:
        with progress:
            last = rollout(plant, parts, duration=LONGEST, rng=loop, observers=observers)
    finally:
        if log is not None:
            log.close()
    wall_s = time.perf_counter() - began
    found = last.found.last
    assessment = assess(
        recorder.recording(), truth, seed=options.seed, wall_s=wall_s,
        identification_s=found.duration_s if found is not None else None,
    )  # fmt: skip
    _write(folder, job, options, truth, assessment, recorder, console)
    if not recorder.recording().within(WorkState.WORK).any():
        raise ConfigurationError(f"the work could not begin: {last.reference.note or f'not within {LONGEST:.0f} s'}")
    return 0 if assessment.accepted else NOT_ACCEPTED


class Clouds:
    """Puts the clouds of each identification into the recording and the log."""

    def __init__(self, recorder: Recorder, log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        if moment.frame is None or not isinstance(moment.found, FinderState) or moment.found.last is None:
            return
        for name in ("cloud", "model_before", "model_after"):
            points_W = moment.found.in_world(getattr(moment.found.last, name))
            self._recorder.add_cloud(name, points_W)
            if self._log is not None:
                self._log.log_cloud(name, points_W, moment.truth.time)


class Teller:
    """Says on screen how far the work is."""

    def __init__(self, progress: Progress, console: Console) -> None:
        self._progress, self._console = progress, console
        self._bar = progress.add_task("", total=1.0, note="")
        self._state: WorkState | None = None

    def observe(self, moment: Moment) -> None:
        reference, truth = moment.reference, moment.truth
        if reference.state is not self._state:
            self._state = reference.state
            note = f"  {reference.note}" if reference.note else ""
            self._console.print(f"{truth.time:7.1f} s  {reference.state}{note}", highlight=False)
        if moment.tick % 250 == 0:
            felt = moment.command.felt_normal
            said = f"{felt:5.1f} N felt" if reference.force and math.isfinite(felt) else ""
            self._progress.update(self._bar, description=str(reference.state), completed=reference.path_s, note=said)


def _as_believed_and_built(job: ContactJob) -> tuple[mujoco.MjSpec, mujoco.MjSpec, str]:
    """The vehicle as its controller knows it, and as it is, alike but for errors of the arm that are asked for; and
    what there is to say of the arm."""
    believed, built = scenes.vehicle_spec(job.vehicle), scenes.vehicle_spec(job.vehicle)
    if job.arm_errors is None and not job.calibrated and job.arm is None:
        return believed, built, ""
    if job.calibrated and job.arm is not None:
        raise ConfigurationError("--calibrated and --arm: one of the two")
    drawn = believed.compile()
    passive = _undriven(drawn, Vehicle.of(drawn))
    arm = true = arm_geometry.read(drawn, ARM_BASE_BODY, TIP_SITE, exclude=passive)
    if job.arm_errors is not None:
        true = arm_geometry.with_errors(arm, np.random.default_rng(job.arm_errors))
        arm_geometry.move(built, arm, true)
    known, said = arm, ""
    if job.calibrated:
        known, said = _deck_calibration.on_deck(arm, true, np.random.default_rng([job.arm_errors or 0, 1]))
    elif job.arm is not None:
        known, said = _deck_calibration.from_file(job.arm, arm)
    if known is not arm:
        arm_geometry.move(believed, arm, known)
    return believed, built, said


def _undriven(model: mujoco.MjModel, vehicle: Vehicle) -> list[str]:
    """Joints beside the arm's own and the hull's: springs, a pad."""
    return [model.joint(j).name for j in range(model.njnt) if j not in vehicle.joints and model.jnt_type[j] != 0]


def _controller(job: ContactJob, own: mujoco.MjModel) -> Controller:
    """The controller named MODULE:CLASS on the vehicle's own model. Raises ConfigurationError if there is none."""
    module, _, name = job.controller.partition(":")
    try:
        kind = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigurationError(f"--controller {job.controller!r}: expected MODULE:CLASS; {error}") from error
    try:
        return kind(own, without=job.without, water_error=WATER_ERROR)
    except TypeError as error:
        raise ConfigurationError(f"--controller {job.controller!r}: cannot be made of a model; {error}") from error


def _scan_pose(X_BC: Array, job: ContactJob) -> Array:
    """Level hull pose from which the camera looks at the coarse position from `scan_range`."""
    if not (np.isfinite(job.scan_range) and job.scan_range > 0.0):
        raise ConfigurationError(f"--range: must be > 0 m, got {job.scan_range}")
    return pose(p=job.approach_W - X_BC[:3, 3] - job.scan_range * X_BC[:3, 2])


def _hull_box(own: mujoco.MjModel, vehicle: Vehicle) -> Array:
    """Corners (2, 3) [m] of the box around the hull's own geoms, hull axes."""
    geoms = [g for g in range(own.ngeom) if own.geom_bodyid[g] == vehicle.hull]
    if not geoms:
        return np.zeros((2, 3))
    centre = np.array([own.geom_pos[g] for g in geoms])
    reach = np.empty_like(centre)
    for row, g in enumerate(geoms):
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, own.geom_quat[g])
        box = own.geom_aabb[g]
        centre[row] += R.reshape(3, 3) @ box[:3]
        reach[row] = np.abs(R.reshape(3, 3)) @ box[3:]
    return np.array([(centre - reach).min(axis=0), (centre + reach).max(axis=0)])


def _write(
    folder: Path,
    job: ContactJob,
    options: ScenarioOptions,
    truth: TrueObject,
    assessment: Assessment,
    recorder: Recorder,
    console: Console,
) -> None:
    """metrics.json, the table, and the report."""
    assessment.write(folder / "metrics.json")
    console.print(results_table(assessment))
    run = assessment.metrics["run"]
    console.print(
        f"{run['simulated_s']:.0f} s simulated in {run['wall_s']:.1f} s, {run['real_time_factor']:.1f} times real time",
        highlight=False,
    )
    verdict = (
        "[green]accepted[/green]" if assessment.accepted else "[red]not accepted[/red]: " + "; ".join(assessment.failed)
    )
    console.print(verdict)
    if options.record:
        from sim.report import write_report

        write_report(
            folder / "report.html", recorder.recording(), truth, assessment, title=job.title, options=asdict(options)
        )
    console.print(f"written to {folder}/", highlight=False)

"""A contact job: its parts wired together as a value, run without a word, or run and written for a scenario."""

import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from _job_parts import Misplacing, believed_and_built, controller, hull_box, scan_pose, undriven
from _variation import NOMINAL, Variation, vary
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from controllers import drive
from controllers.mkps import Chain
from controllers.supervisor import SurfaceWork
from controllers.surface_job import Job
from models import scenes
from models.targets import TargetModel
from models.vehicle import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, Vehicle, find, pose_in_body
from perception.navigation import Navigation
from perception.raw_navigation import RawNavigation
from perception.target_finder import FinderState, KnownObjectFinder
from sim import hydrodynamics, sensors
from sim.current import Current
from sim.depth_camera import DepthCamera
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import WorkState
from sim.interfaces.spatial import Array, exp_so3, pose
from sim.metrics import Assessment, TrueObject, assess
from sim.plant import PAD_GEOM, Plant
from sim.recording import Recorder, Recording
from sim.results_table import results_table
from sim.rollout import Moment, Observer, Parts, rollout
from sim.startup import ScenarioOptions

REHEARSAL = 0.1  # [s] simulated
REACTION_TICKS = 10  # physics steps between measurements of the arm's wrench on the hull, for the report
LONGEST = 400.0  # [s] simulated, whatever happens
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
    force_rate: float = 60.0  # [N/s] at which a set force changes
    contactless: float | None = None  # [m] distance to keep from the surface; None: press with `forces`
    looks: int = 1  # depth frames whose median the path is planned on
    there: TargetModel | None = None  # what really stands there, with the same paths; None: `target`, as it is known


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Built:
    """A job ready to run, once: its streams of random numbers run on."""

    job: ContactJob
    options: ScenarioOptions
    variation: Variation
    plant: Plant
    parts: Parts
    truth: TrueObject
    X_WB: Array  # (4, 4) the hull's first pose
    gusts: np.random.Generator
    noise: np.random.Generator  # of the sensors
    said: str  # of the arm; empty where there is nothing to say
    drawn: Mapping[str, float]  # what was drawn for the variation

    def current(self) -> Current:
        """The current of the job, from its beginning."""
        options = self.options
        return Current(options.current, gust=options.gust, timestep=self.plant.timestep, rng=self.gusts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """What came of a job."""

    job: ContactJob
    recording: Recording
    assessment: Assessment
    last: Moment


def build(job: ContactJob, options: ScenarioOptions, rng: np.random.Generator, variation: Variation = NOMINAL) -> Built:
    """Wire the parts of `job` together. Writes and prints nothing; raises UuvError where the job cannot be."""
    work = Job(
        forces=job.forces, speed=job.speed, least_share=job.least_share, force_rate=job.force_rate,
        force_control="force-control" not in job.without, contactless=job.contactless,
    )  # fmt: skip
    there = job.there or job.target
    truth = TrueObject(model=there, path=job.path, X_WT=job.X_WT, contactless=job.contactless)
    believed, built, said = believed_and_built(
        job.vehicle, arm_errors=job.arm_errors, calibrated=job.calibrated, arm_file=job.arm
    )
    drawn = vary(built, variation)
    own = believed.compile()  # what the vehicle knows of itself; nothing of the scene
    vehicle = Vehicle.of(own)
    X_BC = pose_in_body(own, find(own, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), vehicle.hull)
    find(own, mujoco.mjtObj.mjOBJ_GEOM, PAD_GEOM)  # what touches with anything else has collided
    X_WB = scan_pose(X_BC, job.approach_W, job.scan_range)
    model = hydrodynamics.compile(scenes.work_site(built, there, job.X_WT))
    gusts, noise, start, sampling = rng.spawn(4)
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    plant = Plant(
        model,
        current=Current(options.current),
        X_WB=X_WB @ offset,
        reaction_ticks=REACTION_TICKS if options.record else 0,
    )
    chain = Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=undriven(own, vehicle))
    finder = KnownObjectFinder(
        job.target,
        job.path,
        job.approach_W,
        job.orientation_W,
        looks=job.looks,
        seed=int(sampling.integers(2**31)),
    )
    parts = Parts(
        sensors=[
            sensors.Encoders(),
            sensors.JointTorqueSensors(noise=variation.torque_noise, bias=variation.torque_bias),
            sensors.Imu(),
            sensors.Dvl(),
            sensors.VisionDrift(
                period=variation.vision_period, delay=variation.vision_delay, noise=variation.vision_noise
            ),
            DepthCamera(model, HULL_BODY, X_BC),
        ],
        estimator=RawNavigation() if "fusion" in job.without else Navigation(),
        finder=Misplacing(finder, variation.surface_offset) if variation.surface_offset else finder,
        planner=SurfaceWork(
            vehicle, chain, job.target, work, X_WB_scan=X_WB, hull_box=hull_box(own, vehicle),
            view_B=X_BC[:3, 2], floor=scenes.seabed_height(job.target, job.X_WT),  # the depth there is charted
        ),
        controller=controller(job.controller, own, without=job.without - {"fusion"}, water_error=variation.water_error),
    )  # fmt: skip
    return Built(
        job=job, options=options, variation=variation, plant=plant, parts=parts, truth=truth, X_WB=X_WB @ offset,
        gusts=gusts, noise=noise, said=said, drawn=drawn,
    )  # fmt: skip


def run(
    built: Built, *, recorder: Recorder | None = None, observers: Sequence[Observer] = (), longest: float = LONGEST
) -> Outcome:
    """Run the job to its end, or for `longest` [s] simulated. Writes and prints nothing.

    `recorder` is that of the outcome where it is given; else one is made that keeps what the metrics need. Raises
    UuvError for a motion that blows up, or parts that do not fit together.
    """
    recorder = recorder or Recorder(built.plant.model, full=built.options.record)
    built.plant.reset(current=built.current(), X_WB=built.X_WB)
    began = time.perf_counter()
    last = rollout(built.plant, built.parts, duration=longest, rng=built.noise, observers=[recorder, *observers])
    wall_s = time.perf_counter() - began
    state = last.found
    found = state.last if isinstance(state, FinderState) else None
    recording = recorder.recording()
    assessment = assess(
        recording, built.truth, seed=built.options.seed, wall_s=wall_s,
        identification_s=found.duration_s if found is not None else None,
    )  # fmt: skip
    return Outcome(job=built.job, recording=recording, assessment=assessment, last=last)


def run_contact_job(
    job: ContactJob, options: ScenarioOptions, rng: np.random.Generator, started: float,
    variation: Variation = NOMINAL,
) -> int:  # fmt: skip
    """Build, run, judge, write. Returns the exit code; raises UuvError where the job could not begin."""
    console = Console()
    if not any(Path(drive.__file__).parent.glob("__pycache__/drive*.nbi")):
        console.print("first start: the inner loops are compiled, once; this takes about half a minute")
    folder = options.folder(job.scenario)  # before the work: it may not be possible
    built = build(job, options, rng, variation)
    if built.said:
        console.print(built.said, highlight=False)
    recorder = Recorder(built.plant.model, full=options.record)
    observers: list[Observer] = []
    log: Any = None
    if options.record or options.view:
        from sim.rerun_log import RerunLog

        log = RerunLog(folder / "run.rrd", built.plant.model, title=job.title, view=options.view)
        observers.append(log)
    progress = Progress(
        TextColumn("{task.description:<10}"), BarColumn(), TextColumn("{task.fields[note]}"), TimeElapsedColumn(),
        console=console, disable=not sys.stdout.isatty(),
    )  # fmt: skip
    observers += [Clouds(recorder, log), Teller(progress, console)]
    # A short rehearsal loads all compiled code before the clock runs, and lets a bad plug-in fail at once. The parts'
    # state is explicit, so nothing of it is left but in the plant.
    rollout(built.plant, built.parts, duration=REHEARSAL, rng=np.random.default_rng(options.seed))
    console.print(f"[bold]{job.title}[/bold]  (ready in {time.perf_counter() - started:.1f} s)")
    try:
        with progress:
            outcome = run(built, recorder=recorder, observers=observers)
    finally:
        if log is not None:
            log.close()
    _write(folder, built, outcome, console)
    if not outcome.recording.within(WorkState.WORK).any():
        note = outcome.last.reference.note or f"not within {LONGEST:.0f} s"
        raise ConfigurationError(f"the work could not begin: {note}")
    return 0 if outcome.assessment.accepted else NOT_ACCEPTED


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


def _write(folder: Path, built: Built, outcome: Outcome, console: Console) -> None:
    """metrics.json, the table, and the report."""
    assessment = outcome.assessment
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
    if built.options.record:
        from sim.report import write_report

        write_report(
            folder / "report.html", outcome.recording, built.truth, assessment, title=built.job.title,
            options=asdict(built.options),
        )  # fmt: skip
    console.print(f"written to {folder}/", highlight=False)

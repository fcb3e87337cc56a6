"""Contact job: its specification as a value, its assembly from parts, and its run with or without report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from rich.console import Console

from controllers.hull.thrust_margin import ThrustMargin
from controllers.mkps import Chain
from controllers.tasks.surface_work import SurfaceTaskConfig, SurfaceWork
from models.naming import ARM_BASE_BODY, CAMERA_SITE, TIP_SITE, find
from models.objects.targets import TargetModel
from models.site import scenes
from models.vehicle import pose_in_body
from perception.navigation.raw_navigation import RawNavigation
from perception.navigation.strapdown_filter import Navigation
from perception.target_finder import FinderState, KnownObjectFinder
from scenarios.campaigns.domain_randomisation import NOMINAL, Variation, slide, vary
from scenarios.contact_parts import (
    ShiftedFinder,
    believed_and_built,
    checked_vehicle,
    controller,
    exteroceptive_sensor,
    hull_box,
    passive_joints,
    scan_pose,
    tool_radius,
)
from scenarios.runner import (
    LONGEST,
    REACTION_TICKS,
    Evaluation,
    Pictures,
    PreparedRun,
    RunResult,
    run_through,
    run_with_report,
)
from sim import hydrodynamics
from sim.evaluation.metrics import Assessment, TrueObject, assess
from sim.interfaces import kernel_cache
from sim.interfaces.messages import WorkState
from sim.interfaces.spatial import Array, exp_so3, pose
from sim.loop.recording import Recorder, Recording
from sim.loop.rollout import Moment, Observer, Parts, ticks_per_period
from sim.plant.plant import Plant
from sim.runs.command_line import ScenarioOptions
from sim.sensors import proprioception
from sim.water.current import Current


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactJob:
    """Specification of a contact job; the truth about the object goes to plant and evaluation only."""

    scenario: str
    title: str
    target: TargetModel
    path: str
    forces: tuple[float, ...]  # [N]
    speed: float  # [m/s]
    least_share: float  # share of the path that must be within reach
    X_WT: Array  # (4, 4) true pose of the object
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) coarse orientation
    scan_range: float  # [m]
    vehicle: str
    controller: str  # registered name, or MODULE:CLASS
    without: frozenset[str]
    arm_errors: int | None  # seed of the errors with which the arm was built; None: no errors
    calibrated: bool = False  # the controller's arm model is identified from touches
    arm: Path | None = None  # file of the controller's arm model; excludes `calibrated`
    force_rate: float = 60.0  # [N/s] rate of change of the set force
    contactless: float | None = None  # [m] distance to keep from the surface; None: press with `forces`
    sees_with: str = "camera"  # camera or sonar
    looks: int = 1  # depth frames, or pings, whose median the path is planned on
    there: TargetModel | None = None  # the true object, with the same paths; None: `target`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AssembledJob:
    """An assembled job, to be run once: its random number generators are consumed."""

    job: ContactJob
    options: ScenarioOptions
    variation: Variation
    plant: Plant
    parts: Parts
    truth: TrueObject
    X_WB: Array  # (4, 4) initial pose of the hull
    gusts: np.random.Generator
    noise: np.random.Generator  # of the sensors
    said: str  # line about the arm for the terminal, or empty
    drawn: Mapping[str, float]  # factors drawn for the variation, by name

    def current(self) -> Current:
        """The current of the job from its beginning, with gusts."""
        options = self.options
        return Current(options.current, gust=options.gust, timestep=self.plant.timestep, rng=self.gusts)

    @property
    def ready(self) -> PreparedRun:
        """Plant, parts and restart for the runner."""
        return PreparedRun(
            seed=self.options.seed,
            plant=self.plant,
            parts=self.parts,
            loop=self.noise,
            restart=lambda: self.plant.reset(current=self.current(), X_WB=self.X_WB),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """Result of a job: recording, assessment and last moment."""

    job: ContactJob
    recording: Recording
    assessment: Assessment
    last: Moment


def build(
    job: ContactJob, options: ScenarioOptions, rng: np.random.Generator, variation: Variation = NOMINAL
) -> AssembledJob:
    """Assembles the parts of a job without any output.

    Args:
        job: Specification.
        options: Options of the scenario: seed, current, gusts, recording.
        rng: Parent of the streams for gusts, sensor noise, start pose and sampling.
        variation: Deviations of the plant from the controller's model.

    Returns:
        The assembled job.

    Raises:
        UuvError: The vehicle lacks a part, or a number of the job is out of range.
    """
    work = SurfaceTaskConfig(
        forces=job.forces,
        speed=job.speed,
        least_share=job.least_share,
        force_rate=job.force_rate,
        force_control="force-control" not in job.without,
        contactless=job.contactless,
    )
    there = job.there or job.target
    truth = TrueObject(model=there, path=job.path, X_WT=job.X_WT, contactless=job.contactless)
    believed, built, said = believed_and_built(
        job.vehicle, arm_errors=job.arm_errors, calibrated=job.calibrated, arm_file=job.arm
    )
    timestep = float(built.option.timestep)  # of the loop; a stiff surface needs a shorter timestep of the physics
    drawn = vary(built, variation)
    own = believed.compile()  # the vehicle's model of itself, without the scene
    vehicle = checked_vehicle(own)
    X_BC = pose_in_body(own, find(own, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), vehicle.hull)
    X_WB = scan_pose(X_BC, job.approach_W, job.scan_range)
    scene = scenes.work_site(built, there, job.X_WT)
    if variation.stiffness is not None:
        slide(scene)
    model = hydrodynamics.compile(scene)
    gusts, noise, start, sampling = rng.spawn(4)
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    plant = Plant(
        model,
        current=Current(options.current),
        X_WB=X_WB @ offset,
        reaction_ticks=REACTION_TICKS if options.record else 0,
        substeps=ticks_per_period(timestep, float(model.opt.timestep), "the loop's step"),
    )
    chain = Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=passive_joints(own, vehicle))
    eye, eye_model = exteroceptive_sensor(job.sees_with, model, X_BC)
    finder = KnownObjectFinder(
        job.target,
        job.path,
        job.approach_W,
        job.orientation_W,
        sensor=eye_model,
        tool_radius=tool_radius(own),
        looks=job.looks,
        seed=int(sampling.integers(2**31)),
    )
    parts = Parts(
        sensors=[
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(noise=variation.torque_noise, bias=variation.torque_bias),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(
                period=variation.vision_period, delay=variation.vision_delay, noise=variation.vision_noise
            ),
            eye,
        ],
        estimator=RawNavigation() if "fusion" in job.without else Navigation(),
        finder=ShiftedFinder(finder, variation.surface_offset) if variation.surface_offset else finder,
        planner=SurfaceWork(
            vehicle,
            chain,
            job.target,
            work,
            X_WB_scan=X_WB,
            hull_box=hull_box(own, vehicle),
            view_B=X_BC[:3, 2],
            floor=scenes.seabed_height(job.target, job.X_WT),  # the charted depth there
            holding=ThrustMargin.of(own),
        ),
        controller=controller(job.controller, own, without=job.without - {"fusion"}, water_error=variation.water_error),
    )
    return AssembledJob(
        job=job,
        options=options,
        variation=variation,
        plant=plant,
        parts=parts,
        truth=truth,
        X_WB=X_WB @ offset,
        gusts=gusts,
        noise=noise,
        said=said,
        drawn=drawn,
    )


def run(
    built: AssembledJob,
    *,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    longest: float = LONGEST,
) -> Outcome:
    """Runs an assembled job to its end without any output.

    Args:
        built: The assembled job.
        recorder: Recorder of the outcome; None: one that keeps the series for the metrics.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time.

    Returns:
        Recording, assessment and last moment.

    Raises:
        UuvError: The motion diverges, or the parts are incompatible.
    """
    plant = built.plant
    recorder = recorder or Recorder(plant.model, timestep=plant.timestep, full=built.options.record)
    ran = run_through(built.ready, recorder, observers, longest)
    return Outcome(job=built.job, recording=ran.recording, assessment=judge(built, ran), last=ran.last)


def judge(built: AssembledJob, ran: RunResult) -> Assessment:
    """Assessment of a job that was run, against the true object."""
    state = ran.last.found
    found = state.last if isinstance(state, FinderState) else None
    return assess(
        ran.recording,
        built.truth,
        seed=built.options.seed,
        wall_s=ran.wall_s,
        identification_s=found.duration_s if found is not None else None,
    )


def run_contact_job(
    job: ContactJob, options: ScenarioOptions, rng: np.random.Generator, started: float, variation: Variation = NOMINAL
) -> int:
    """Assembles, runs and assesses a job, and writes its results.

    Args:
        job: Specification.
        options: Options of the scenario.
        rng: Parent of all random streams.
        started: [s] time.perf_counter() at the start of the command.
        variation: Deviations of the plant from the controller's model.

    Returns:
        The exit code.

    Raises:
        UuvError: The job could not begin.
    """
    console = Console()
    if not kernel_cache.is_kept("joint_servo"):
        console.print("first start: the inner loops are compiled, once; this takes a minute or so")
    folder = options.folder(job.scenario)  # before the work: the folder may be unusable
    built = build(job, options, rng, variation)
    if built.said:
        console.print(built.said, highlight=False)

    def pictures(ran: RunResult) -> Pictures:
        from sim.reporting.report_figures import path_figures

        return path_figures(ran.recording, built.truth)

    judging = Evaluation(assess=lambda ran: judge(built, ran), pictures=pictures, begun=(WorkState.WORK,))
    return run_with_report(job.scenario, built.ready, judging, job.title, options, folder, console, started)

"""One run of the contact study: random draw, simulation, figures, and class of failure."""

import traceback
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, cast, get_args

import numpy as np

from uuv.assembly import assemble
from uuv.controllers.planning.promise import StopLimits
from uuv.jobs import clean_barrel
from uuv.methods import Method
from uuv.perturbations.loop import MisplacedSurface
from uuv.perturbations.pad import Pad
from uuv.perturbations.sensing import WanderingVision
from uuv.perturbations.vehicle import Gears, Payload, ThrusterSpread, Water
from uuv.runner import Run, run
from uuv.scenario import Belief, Scenario, Sensing
from uuv.sensors.arm_camera import ArmCameraSetup
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.evaluation.metrics import path_error
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError, UuvError
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import one_of
from uuv.sim.interfaces.streams import Streams
from uuv.sim.loop.recording import Recording
from uuv.tasks.surface_work import SurfaceWorkTask, first_force

PathName = Literal["longitudinal", "transverse"]
PATHS: tuple[PathName, ...] = get_args(PathName)
TICK = 0.002  # [s] loop step; periods and delays are whole multiples of it

KEPT, MISSED, BROKEN, DAMAGED, REFUSED, DIVERGED, CRASHED = (
    "kept",
    "missed",
    "broken off",
    "damage",
    "refused",
    "diverged",
    "crashed",
)
CLASSES = (KEPT, MISSED, BROKEN, REFUSED, DAMAGED, DIVERGED, CRASHED)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyBounds:
    """Bounds that a run must keep, after transients of the force."""

    force_peak: float = 8.0  # [N] peak error
    deviation: float = 0.003  # [m] across the path and along it, each


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Ranges of the random draw: uniform between two values or in +- one, stiffness log-uniform."""

    current: tuple[float, float] = (0.0, 0.4)
    """Speed of the steady current [m/s]."""
    elevation: tuple[float, float] = (-90.0, 90.0)
    """Elevation of the current's direction [deg]; directions are uniform on that part of the
    sphere.
    """
    gust: tuple[float, float] = (0.0, 0.05)
    """Standard deviation of the gusts [m/s] per axis."""
    water: float = 0.3
    """Share in +- by which each added mass and drag of the plant deviates from the controller's
    model.
    """
    payload: float = 0.1
    """Share in +- of the mass of each part of the arm, and of the arm's mass by which the hull's
    ballast is wrong.
    """
    vision_rate: tuple[float, float] = (5.0, 20.0)
    """Rate of the vision measurement [Hz]."""
    vision_delay: tuple[float, float] = (0.05, 0.25)
    """Delay of the vision measurement [s]."""
    vision_noise: tuple[float, float] = (0.001, 0.005)
    """Standard deviation of the vision measurement [m]."""
    vision_wander: float = 0.0
    """Standard deviation of a slow error of the vision measurement [m], correlated over a minute;
    0: none.
    """
    torque_noise: float = 0.01
    """White noise of each torque sensor, share of its reading."""
    torque_bias: float = 0.5
    """Constant error in +- of each torque sensor [N m]."""
    thruster: float = 0.2
    """Share in +- of each thruster's lag and gain."""
    gears: float = 0.3
    """Share in +- by which the friction of each gear, dry and viscous, deviates from the
    controller's model.
    """
    friction: tuple[float, float] = (0.1, 0.6)
    """Friction coefficient between pad and surface."""
    stiffness: tuple[float, float] = (1e4, 1e6)
    """Stiffness of pad and surface in series [N/m]."""
    surface: float = 0.0
    """Distance in +- by which the surface lies off its identified place along the tool [m], besides
    real errors.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            value = np.atleast_1d(getattr(self, field.name))
            if not np.all(np.isfinite(value)) or (len(value) == 2 and value[0] > value[1]):
                raise ConfigurationError(
                    f"--ranges.{field.name}: expected finite numbers that rise, got {value}"
                )
            if field.name != "elevation" and value[0] < 0.0:
                raise ConfigurationError(f"--ranges.{field.name}: must be >= 0, got {value}")
        if (
            not self.stiffness[0] > 0.0
            or not self.vision_rate[0] > 0.0
            or not self.friction[0] > 0.0
        ):
            raise ConfigurationError("--ranges: stiffness, friction and vision rate must be > 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTask:
    """One run to be done; a picklable value for a worker process."""

    study: int  # seed of the study
    run: int
    path: PathName
    without: str = ""  # method to leave out; empty: none
    ranges: Ranges
    quick: bool = False
    arm_camera: ArmCameraSetup | None = None  # camera beside the tool; None: there is none
    stops: StopLimits | None = None  # of the pressed tool on its path; None: it does not stop
    anyway: bool = False  # run a sea whose current is refused once more, without that refusal


def draw(task: RunTask) -> Scenario:
    """Draws the scenario of a run; the same for every ablation.

    Raises:
        ConfigurationError: The path is unknown.
    """
    ranges, streams = task.ranges, Streams(task.study, task.run)

    def between(name: str, low: float, high: float) -> float:
        return streams[name].uniform(low, high)

    # The sea.
    speed = between("current speed", *ranges.current)
    azimuth = between("current azimuth", -np.pi, np.pi)
    rise = between("current rise", *np.sin(np.radians(ranges.elevation)))
    level = np.sqrt(1.0 - rise * rise)
    current = speed * np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])
    gust = between("gust", *ranges.gust)

    # Vehicle, surface and sensors.
    trim_error = between("trim error", -ranges.payload, ranges.payload)
    pad = Pad(
        friction=between("friction", *ranges.friction),
        stiffness=float(np.exp(between("stiffness", *np.log(ranges.stiffness)))),
    )
    surface = MisplacedSurface(offset=between("surface", -ranges.surface, ranges.surface))
    sensing = Sensing(
        vision_period=_ticks(1.0 / between("vision rate", *ranges.vision_rate)),
        vision_delay=_ticks(between("vision delay", *ranges.vision_delay)),
        vision_noise=between("vision noise", *ranges.vision_noise),
        torque_noise=ranges.torque_noise,
        torque_bias=ranges.torque_bias,
        arm_camera=task.arm_camera,
    )
    one_of(task.path, PATHS, "path")
    scenario = clean_barrel(
        seed=int(streams["seed"].integers(2**31)),
        current=tuple(current.tolist()),
        gust=gust,
        quick=task.quick,
        path=task.path,
        without=(cast(Method, task.without),) if task.without else (),
    )
    perturbations = (
        Water(spread=ranges.water),
        Payload(spread=ranges.payload, trim_error=trim_error),
        ThrusterSpread(lag=ranges.thruster, gain=ranges.thruster),
        Gears(spread=ranges.gears),
        pad,
        surface,
        *((WanderingVision(sigma=ranges.vision_wander),) if ranges.vision_wander > 0.0 else ()),
    )
    return replace(
        scenario,
        task=_with(scenario.task_of(SurfaceWorkTask), stops=task.stops),
        belief=Belief(water_error=0.0),
        sensing=sensing,
        perturbations=perturbations,
        perturbation_seed=int(streams["perturbation_seed"].integers(2**31)),
    )


def _with(task: SurfaceWorkTask, **promise: Any) -> SurfaceWorkTask:
    """`task` with other limits of its promise."""
    return replace(task, promise=replace(task.promise, **promise))


def varied(scenario: Scenario) -> dict[str, float | None]:
    """Drawn figures of a run's scenario by name; of those drawn for each part, the seed."""
    pad, surface = scenario.perturbation(Pad), scenario.perturbation(MisplacedSurface)
    site, sensing = scenario.site, scenario.sensing
    return {
        "trim_error": scenario.perturbation(Payload).trim_error,
        "friction": pad.friction,
        "stiffness": pad.stiffness,
        "surface_offset": surface.offset,
        "vision_period": sensing.vision_period,
        "vision_delay": sensing.vision_delay,
        "vision_noise": sensing.vision_noise,
        "gust": site.gust,
        "current": float(np.linalg.norm(site.current)),
        "current_up": float(site.current[2]),
        "variation_seed": scenario.perturbation_seed,
    }


def _ticks(time: float) -> float:
    """The nearest whole multiple of TICK [s], at least one."""
    return max(1, round(time / TICK)) * TICK


def one_run(task: RunTask, bounds: StudyBounds | None = None) -> dict[str, Any]:
    """Draws, simulates and classifies one run; returns its row of the study.

    Errors of the run are caught and classified.

    Raises:
        ConfigurationError: The task itself is invalid.
    """
    scenario, bounds = draw(task), bounds or StudyBounds()
    row, drawn = {**crashed(task, ""), "seed": scenario.seed}, varied(scenario)
    row |= _tried(scenario, bounds, drawn)
    if task.anyway and row["class"] == REFUSED and row["kind"] == AbortCode.CURRENT.value:
        found = _tried(held_anyway(scenario), bounds, {})
        row["anyway"] = f"{found['class']}: {found['kind']}" if found["kind"] else found["class"]
    return {**row, "varied": drawn}


def _tried(
    scenario: Scenario, bounds: StudyBounds, drawn: dict[str, float | None]
) -> dict[str, Any]:
    """Class, kind, detail and figures of one simulated run; what its assembly draws is added to
    `drawn`.
    """
    try:
        built = assemble(scenario)
        drawn |= built.drawn
        outcome = run(built)
    except HydrodynamicsError as error:
        return {"class": DIVERGED, "kind": "motion blew up", "detail": str(error)}
    except UuvError as error:
        return {"class": REFUSED, "kind": type(error).__name__, "detail": str(error)}
    except Exception:
        return {
            "class": CRASHED,
            "kind": "an error of the program",
            "detail": traceback.format_exc()[-2000:],
        }
    figures = figures_of(outcome)
    finite = {
        name: value if value is not None and np.isfinite(value) else None
        for name, value in figures.items()
    }
    return {**classify(outcome, figures, bounds), "figures": finite}


def held_anyway(scenario: Scenario) -> Scenario:
    """`scenario` without the refusal of a current that the thrusters cannot hold."""
    return replace(scenario, task=_with(scenario.task_of(SurfaceWorkTask), most_thrust=np.inf))


def crashed(task: RunTask, reason: str) -> dict[str, Any]:
    """Row of a run that gave no result for `reason`."""
    return {
        "run": task.run,
        "without": task.without,
        "path": task.path,
        "seed": None,
        "varied": {},
        "class": CRASHED,
        "kind": reason,
        "anyway": "",
        "detail": "",
        "missed": [],
        "figures": {},
    }


def figures_of(outcome: Run) -> dict[str, float | None]:
    """Figures of a run in SI units; None where the run ended before it gave one."""
    recording, metrics = outcome.recording, outcome.assessment.metrics
    contact, tool, hull = metrics["contact"], metrics["tool"], metrics["hull"]
    error = path_error(recording)
    rms = {"cross_rms_m": None, "along_rms_m": None}
    if error is not None:
        rms = {
            "cross_rms_m": float(np.sqrt(np.mean(error.lateral**2))),
            "along_rms_m": float(np.sqrt(np.mean(error.along**2))),
        }
    return {
        "force_rms_n": contact["force_error_rms_n"],
        "force_peak_n": contact["force_error_max_n"],
        "lost_s": contact["lost_s"],
        **rms,
        "cross_max_m": tool["cross_track_max_m"],
        "along_max_m": tool["along_track_max_m"],
        "object_deviation_max_m": metrics["path"]["true_deviation_max_m"],
        "estimate_rms_n": metrics["force_estimate"]["normal_error_rms_n"],
        "estimate_vector_rms_n": metrics["force_estimate"]["error_rms_n"],
        "tool_tilt_max_rad": tool["tilt_max_rad"],
        "hull_excursion_max_m": hull["excursion_max_m"],
        "hull_tilt_max_rad": hull["tilt_max_rad"],
        "hull_unfolding_max_m": _unfolding(recording),
        "force_over_set": force_over_set(recording, first_force(outcome.scenario)),
        "collision_s": metrics["run"]["collision_s"],
        "saturated_s": metrics["thrusters"]["saturated_s"],
        "identification_error_m": metrics["identification"]["position_error_m"],
        "promised_chance": None if recording.promise is None else recording.promise.chance,
        "navigation_sigma_m": None
        if recording.promise is None
        else recording.promise.navigation_sigma,
        "object_sigma_m": None if recording.promise is None else recording.promise.object_sigma,
        "simulated_s": recording.duration,
    }


def force_over_set(recording: Recording, first: float) -> float:
    """Greatest ratio of the true normal force to the set force; before the work the set force is
    `first` [N].
    """
    before = np.where(recording.within(WorkState.WORK), 0.0, first)
    set_force = np.maximum(recording["set_force"].scalar, before)
    return float((recording["contact_most"].scalar / np.maximum(set_force, 1.0)).max())


def _unfolding(recording: Recording) -> float | None:
    """Largest distance [m] of the hull from its constant reference while the arm moves to its
    work.
    """
    still = np.append(
        np.all(np.diff(recording["p_WB_reference"].value, axis=0) == 0.0, axis=1), True
    )
    still &= recording.within(WorkState.CLOSE_IN, WorkState.TARE)
    if not still.any():
        return None
    off = recording["p_WB"].value[still] - recording["p_WB_reference"].value[still]
    return float(np.linalg.norm(off, axis=1).max())


def classify(outcome: Run, figures: dict[str, float | None], bounds: StudyBounds) -> dict[str, Any]:
    """Class, kind and detail of a run's outcome, and the bounds that it missed.

    Args:
        outcome: Result of the run.
        figures: Its figures, from `figures_of`.
        bounds: Bounds to keep.
    """
    recording = outcome.recording
    note = recording.final.note
    missed = [
        name
        for name, bound in (
            ("force_peak_n", bounds.force_peak),
            ("cross_max_m", bounds.deviation),
            ("along_max_m", bounds.deviation),
            ("lost_s", 0.0),
        )
        if not within(figures[name], bound)
    ]
    worked = bool(recording.within(WorkState.WORK).any())
    ended = {"missed": missed if worked else [], "detail": note}
    if not all(np.isfinite(value) for value in figures.values() if value is not None):
        return {**ended, "class": DIVERGED, "kind": "a figure is not finite"}
    if (figures["force_over_set"] or 0.0) > DAMAGE:
        return {**ended, "class": DAMAGED, "kind": f"force above {DAMAGE:g} times the set one"}
    if figures["collision_s"]:
        return {**ended, "class": DAMAGED, "kind": "the vehicle touched what it should not"}
    if recording.final.state is not WorkState.DONE:
        touched = bool(recording.within(WorkState.APPROACH, WorkState.PRESS, WorkState.WORK).any())
        kind = "not done in time" if recording.final.abort is None else recording.final.abort.value
        return {**ended, "class": BROKEN if touched else REFUSED, "kind": kind}
    if missed:
        return {**ended, "class": MISSED, "kind": ", ".join(missed)}
    return {**ended, "class": KEPT, "kind": ""}


def within(value: float | None, bound: float) -> bool:
    """True if `value` exists and does not exceed `bound`, up to rounding."""
    return value is not None and value <= bound * (1.0 + 1e-9)

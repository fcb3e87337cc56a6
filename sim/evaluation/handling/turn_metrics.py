"""Metrics of a valve's turn, from its recording, the true handle, and what the vehicle felt.

The moment is that of the tool about the valve's axis while it turns. Its error is that of the felt
moment: the RMS of felt minus true, as a share of the set moment.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

DEGREES = float(np.degrees(1.0))
_MM = 1e3  # [mm/m]
_PERCENT = 100.0  # for a share of 1
_STANDS = 0.85  # share of the set moment from which on a stuck handle resists
_STILL = 1e-3  # [rad] by which a stuck handle turns at most


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnBounds:
    """Acceptance bounds of a turn."""

    angle: float = float(np.radians(2.0))  # [rad] of the handle, at the end
    moment: float = 0.1  # RMS error of the felt moment, as a share of the set one
    peak: float = 1.5  # largest moment, as a share of the set one
    excursion: float = 0.05  # [m] of the hull from its reference
    named: float = 1.0  # [s] in which a stuck valve is named


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueTurn:
    """What was asked for, and whether the valve can turn."""

    angle: float  # [rad] from the handle's start
    moment: float  # [N m] set
    stuck: bool  # the valve does not turn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeltHandle:
    """What the vehicle felt of the handle, over time."""

    time: Array  # (N,) [s]
    angle: Array  # (N,) [rad]; NaN before the tool met the handle
    moment: Array  # (N,) [N m]
    true_moment: Array  # (N,) [N m] at the same times
    true_angle: Array  # (N,) [rad]
    work: np.ndarray  # (N,) mask: while the tool turned the handle


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleMetrics:
    """The handle's angle."""

    asked_rad: float | None
    turned_rad: float | None = metric("True, at the end.")
    error_rad: float | None = metric("Of the true angle at the end.", minimum=0)
    felt_rad: float | None = metric("As the vehicle felt it when the turning ended.")


@dataclass(frozen=True, slots=True, kw_only=True)
class MomentMetrics:
    """Moment of the tool about the valve's axis while it turns."""

    set_n_m: float | None
    mean_n_m: float | None = metric("True.")
    max_n_m: float | None = metric("Largest true one.")
    error_rms: float | None = metric("Of the felt moment, as a share of the set one.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningHullMetrics:
    """The hull while the tool turns the handle."""

    excursion_max_m: float | None = metric("From its reference.", minimum=0)
    force_max_n: float | None = metric("Felt at the tip.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnMetrics:
    """Metrics of a turn."""

    angle: AngleMetrics
    moment: MomentMetrics
    hull: TurningHullMetrics
    named_s: float | None = metric(
        "Time from the first 85 % of the set moment on a stuck handle until it was named."
    )


def schema() -> dict[str, Any]:
    """JSON Schema of the metrics.json of a turn."""
    return run_schema(
        TurnMetrics, "Figures of a valve's turn", "What the job turn-valve writes to metrics.json"
    )


def assess_turn(
    recording: "Recording",
    truth: TrueTurn,
    felt: FeltHandle,
    *,
    seed: int,
    wall_s: float,
    bounds: TurnBounds | None = None,
) -> Assessment:
    """All metrics of a run; one that could not be measured is None and counts as missed.

    Args:
        recording: The run.
        truth: What was asked for.
        felt: What the vehicle felt.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        bounds: Acceptance bounds; default: `TurnBounds()`.

    Returns:
        The assessment.
    """
    bounds = bounds or TurnBounds()
    angle = _angle(truth, felt)
    moment = _moment(truth, felt)
    hull = _hull(recording)
    named = _named(recording, truth, felt)
    metrics = TurnMetrics(angle=angle, moment=moment, hull=hull, named_s=named)

    most = bounds.peak * truth.moment
    checks = [
        Requirement("handle angle, error", angle.error_rad, bounds.angle, "deg", DEGREES),
        Requirement("moment, mean", moment.mean_n_m, None, "N m"),
        Requirement("moment, RMS error", moment.error_rms, bounds.moment, "%", _PERCENT),
        Requirement("moment, peak", moment.max_n_m, most, "N m"),
        Requirement("hull excursion", hull.excursion_max_m, bounds.excursion, "mm", _MM),
    ]
    others: tuple[str, ...] = ()
    if truth.stuck:
        checks[0] = Requirement("stuck valve, time to its name", named, bounds.named, "s")
        others = () if named is not None else ("the stuck valve was not named",)
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s, others=others)


def _angle(truth: TrueTurn, felt: FeltHandle) -> AngleMetrics:
    if not felt.work.any():
        return AngleMetrics(asked_rad=truth.angle, turned_rad=None, error_rad=None, felt_rad=None)

    turned = float(felt.true_angle[-1])
    known = felt.angle[felt.work]
    known = known[np.isfinite(known)]
    return AngleMetrics(
        asked_rad=truth.angle,
        turned_rad=turned,
        error_rad=abs(turned - truth.angle),
        felt_rad=float(known[-1]) if len(known) else None,
    )


def _moment(truth: TrueTurn, felt: FeltHandle) -> MomentMetrics:
    if not felt.work.any():
        return MomentMetrics(set_n_m=truth.moment, mean_n_m=None, max_n_m=None, error_rms=None)

    true = felt.true_moment[felt.work]
    error = felt.moment[felt.work] - true
    return MomentMetrics(
        set_n_m=truth.moment,
        mean_n_m=float(true.mean()),
        max_n_m=float(np.abs(felt.true_moment).max()),
        error_rms=float(np.sqrt(np.mean(error**2)) / truth.moment),
    )


def _hull(recording: "Recording") -> TurningHullMetrics:
    work = recording.within(WorkState.WORK)
    if not work.any():
        return TurningHullMetrics(excursion_max_m=None, force_max_n=None)

    off = recording["p_WB"].value[work] - recording["p_WB_reference"].value[work]
    force = np.linalg.norm(recording["felt_force"].value[work], axis=1)
    return TurningHullMetrics(
        excursion_max_m=float(np.linalg.norm(off, axis=1).max()),
        force_max_n=float(np.nanmax(force)),
    )


def _named(recording: "Recording", truth: TrueTurn, felt: FeltHandle) -> float | None:
    """Time [s] from when the handle stood against the set moment until it was named."""
    aborted = [e for e in recording.events if e.abort is AbortCode.VALVE_STUCK]
    if not aborted or not felt.work.any():
        return None

    # The handle stands after its last motion, and resists from the first firm moment on.
    before = felt.work & (felt.time <= aborted[0].time)
    moves = np.abs(felt.true_angle - felt.true_angle[before][-1]) > _STILL
    moved = np.flatnonzero(before & moves)
    stands = before & (felt.true_moment >= _STANDS * truth.moment)
    stands[: moved[-1] + 1 if len(moved) else 0] = False
    return float(aborted[0].time - felt.time[stands][0]) if stands.any() else None

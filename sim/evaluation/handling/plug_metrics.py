"""Metrics of a plug that is moved, from its recording and the true forces on the receptacles.

Forces are those of all contacts on a receptacle: along its axis, and across it. The plug counts as
seated where its collar is within a bound of the panel, in the other receptacle.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric, unmeasured
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import Array, inverse, pose, rotation_from_quat_wxyz

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

_MM = 1e3  # [mm/m]
_DEGREES = float(np.degrees(1.0))
_STANDS = 0.85  # share of the set pull from which on a stuck plug resists
_AT_PLUG = (WorkState.PRESS, WorkState.WORK, WorkState.SEARCH, WorkState.INSERT, WorkState.RETREAT)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlugBounds:
    """Acceptance bounds of a move."""

    short: float = 0.003  # [m] of the collar above its seat
    aside: float = 0.004  # [m] of the plug from the receptacle's axis
    side_force: float = 40.0  # [N] across the axis of a receptacle, at the peak
    over: float = 1.5  # largest pull and push, as a share of the set ones; and of the grip
    excursion: float = 0.05  # [m] of the hull from its reference
    named: float = 1.0  # [s] in which a stuck plug is named


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueMove:
    """What was asked for, and whether the plug can come out."""

    X_WT: Array  # (4, 4) pose of the panel, and of the plug before it is moved
    way_T: Array  # (3,) [m] from the one receptacle to the other
    center_T: Array  # (3,) [m] middle of the plug at its start
    first: int  # row of the receptacle in which it starts
    pull: float  # [N] set
    push: float  # [N] set
    grip: float  # [N] set force of each finger
    stuck: bool  # it does not come out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeltPlug:
    """True forces on the receptacles over time, and the pull that the vehicle felt."""

    time: Array  # (N,) [s]
    first: Array  # (N, 3) [N] on the receptacle of the start, in its frame, z inwards
    second: Array  # (N, 3) [N] on the other
    felt: Array  # (N,) [N] felt along the tool, positive: the plug resists the pull


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatMetrics:
    """Where the plug ended."""

    seated: bool
    short_m: float | None = metric("Height of the collar above its seat in the other receptacle.")
    aside_m: float | None = metric("From the axis of that receptacle.", minimum=0)
    tilt_rad: float | None = metric("Between the axes of plug and receptacle.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlugForceMetrics:
    """True forces of the plug on the receptacles."""

    pull_set_n: float | None
    pull_max_n: float | None = metric("Largest pull on the first receptacle.", minimum=0)
    pull_felt_n: float | None = metric(
        "Largest pull that the vehicle felt before the plug was out, with the plug's weight."
    )
    push_max_n: float | None = metric("Largest push on the second receptacle.", minimum=0)
    side_max_n: float | None = metric("Largest force across the axis of either.", minimum=0)
    grip_max_n: float | None = metric("Largest of a physics step, of the first pad.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlugHullMetrics:
    """The hull from the closing of the jaws until they let go."""

    excursion_max_m: float | None = metric("From its reference.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlugMetrics:
    """Metrics of a plug that is moved."""

    seat: SeatMetrics
    force: PlugForceMetrics
    hull: PlugHullMetrics
    searched_s: float | None = metric("Time on the search spiral.", minimum=0)
    named_s: float | None = metric(
        "Time from the first 85 % of the set pull on a stuck plug until it was named."
    )


def schema() -> dict[str, Any]:
    """JSON Schema of the metrics.json of a move."""
    return run_schema(
        PlugMetrics, "Figures of a moved plug", "What the job move-plug writes to metrics.json"
    )


def assess_move(
    recording: "Recording",
    truth: TrueMove,
    felt: FeltPlug,
    *,
    seed: int,
    wall_s: float,
    bounds: PlugBounds | None = None,
) -> Assessment:
    """All metrics of a run; one that could not be measured is None and counts as missed.

    Args:
        recording: The run.
        truth: What was asked for.
        felt: Forces over time.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        bounds: Acceptance bounds; default: `PlugBounds()`.

    Returns:
        The assessment.
    """
    bounds = bounds or PlugBounds()
    seat = _seat(recording, truth, bounds)
    force = _force(recording, truth, felt)
    hull = PlugHullMetrics(excursion_max_m=_excursion(recording))
    named = _named(recording, truth, felt)
    searched = float(recording.within(WorkState.SEARCH).sum() * recording.timestep)
    metrics = PlugMetrics(seat=seat, force=force, hull=hull, searched_s=searched, named_s=named)

    # What is asked for.
    over = bounds.over
    checks = [
        Requirement("collar above its seat", seat.short_m, bounds.short, "mm", _MM),
        Requirement("plug beside the axis", seat.aside_m, bounds.aside, "mm", _MM),
        Requirement("side force, peak", force.side_max_n, bounds.side_force, "N"),
        Requirement("pull, peak", force.pull_max_n, over * truth.pull, "N"),
        Requirement("push, peak", force.push_max_n, over * truth.push, "N"),
        Requirement("grip force, peak", force.grip_max_n, over * truth.grip, "N"),
        Requirement("hull excursion", hull.excursion_max_m, bounds.excursion, "mm", _MM),
        Requirement("plug, tilt", seat.tilt_rad, None, "deg", _DEGREES),
    ]
    others: tuple[str, ...] = () if seat.seated else ("the plug is not seated",)

    # A stuck plug has no seat, but a name.
    if truth.stuck:
        checks[:2] = [Requirement("stuck plug, time to its name", named, bounds.named, "s")]
        others = () if named is not None else ("the stuck plug was not named",)
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s, others=others)


def _seat(recording: "Recording", truth: TrueMove, bounds: PlugBounds) -> SeatMetrics:
    """Pose of the plug at the end, from where it would be seated."""
    if "p_WT" not in recording:
        return SeatMetrics(seated=False, short_m=None, aside_m=None, tilt_rad=None)

    # The plug's frame is that of the panel, moved by the way between the receptacles.
    R_WT = rotation_from_quat_wxyz(recording["quat_WT_wxyz"].value[-1])
    moved = inverse(truth.X_WT) @ pose(R_WT, recording["p_WT"].value[-1])
    off = moved[:3, :3] @ truth.center_T + moved[:3, 3] - truth.center_T - truth.way_T

    # Along the axis of the receptacle, and across it.
    short = float(off[2])
    aside = float(np.hypot(off[0], off[1]))
    tilt = float(np.arccos(np.clip(moved[2, 2], -1.0, 1.0)))
    seated = abs(short) <= bounds.short and aside <= bounds.aside
    return SeatMetrics(seated=seated, short_m=short, aside_m=aside, tilt_rad=tilt)


def _force(recording: "Recording", truth: TrueMove, felt: FeltPlug) -> PlugForceMetrics:
    """Peaks of the forces, while the jaws are at the plug."""
    at_plug = recording.within(*_AT_PLUG)
    if not len(felt.time) or not at_plug.any():
        return unmeasured(PlugForceMetrics, pull_set_n=truth.pull)

    # Across the axes of both receptacles, whose frames have z inwards.
    across = np.linalg.norm(np.stack([felt.first, felt.second])[:, :, :2], axis=2)
    return PlugForceMetrics(
        pull_set_n=truth.pull,
        pull_max_n=float(max(0.0, -felt.first[:, 2].min())),
        pull_felt_n=_felt_pull(felt),
        push_max_n=float(max(0.0, felt.second[:, 2].max())),
        side_max_n=float(across.max()),
        grip_max_n=float(recording["contact_most"].scalar[at_plug].max()),
    )


def _felt_pull(felt: FeltPlug) -> float | None:
    """Largest pull [N] that was felt until the plug last touched the first receptacle."""
    touched = np.flatnonzero(felt.first.any(axis=1))
    known = felt.felt[: touched[-1] + 1] if len(touched) else np.zeros(0)
    known = known[np.isfinite(known)]
    return float(known.max()) if len(known) else None


def _excursion(recording: "Recording") -> float | None:
    """Largest distance [m] of the hull from its reference with the jaws at the plug."""
    work = recording.within(WorkState.PRESS, WorkState.WORK, WorkState.SEARCH, WorkState.INSERT)
    if not work.any():
        return None
    off = recording["p_WB"].value[work] - recording["p_WB_reference"].value[work]
    return float(np.linalg.norm(off, axis=1).max())


def _named(recording: "Recording", truth: TrueMove, felt: FeltPlug) -> float | None:
    """Time [s] from when the plug stood against the set pull until it was named."""
    aborted = [e for e in recording.events if e.abort is AbortCode.STUCK]
    if not aborted or not len(felt.time):
        return None

    # From the first moment at which it stands against most of the set pull.
    stands = -felt.first[:, 2] >= _STANDS * truth.pull
    stands &= felt.time <= aborted[0].time
    return float(aborted[0].time - felt.time[stands][0]) if stands.any() else None

"""Error of the true contact force from the set force, and whether each set force was judged."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.evaluation.surface_metrics import ContactMetrics, SegmentMetrics
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from uuv.sim.loop.recording import RecordedSeries, Recording

SETTLING = 1.0  # [s] from the beginning of a change of the set force, excluded from the force error
AFTER_RAMP = 0.5  # [s] from the end of that change, excluded too
JUDGED = 0.5  # [s] of settled work that a set force needs for a figure
LOST_BELOW = 1.0  # [N] true normal force below which contact is lost
RAMP_GAP = 0.1  # [s] of constant set force after which the next change begins a new segment


def unsettled(ramp: float) -> float:
    """Time [s] from the start of a change of the set force, which lasts `ramp` [s], until its error
    counts.
    """
    return max(SETTLING, ramp + AFTER_RAMP)


def force_peak(least: Any, most: Any, set_force: Any) -> Any:
    """Largest error [N] in a step, from its smallest and largest force; arrays (N,) or numbers."""
    return np.maximum(abs(most - set_force), abs(least - set_force))


def is_lost(least: Any) -> Any:
    """True where contact was lost in a step, by the smallest normal force [N] of the step."""
    return least < LOST_BELOW


@dataclass(frozen=True, slots=True, eq=False)
class ForceSteps:
    """Set force over a run as steps: a ramp, then a constant force."""

    part: np.ndarray  # (N,) number of the step of set force that a row belongs to
    force: Array  # (N,) [N] set force of that step, after its ramp
    settled: np.ndarray  # (N,) True in rows whose error counts

    @classmethod
    def of(cls, recording: "RecordedSeries") -> Self:
        """The steps of a run; its error counts within the work state only."""
        time = recording["set_force"].time
        set_force = recording["set_force"].scalar
        changed = np.concatenate([[True], np.diff(set_force) != 0.0])
        last_change = np.maximum.accumulate(np.where(changed, time, -np.inf))

        # A change soon after another belongs to the same ramp.
        begins = changed & (time - np.concatenate([[-np.inf], last_change[:-1]]) > RAMP_GAP)
        part = np.cumsum(begins) - 1
        starts = np.flatnonzero(begins)
        ends = np.append(starts[1:], len(set_force)) - 1
        ramp_ends = last_change[ends]

        since = time[starts][part]
        until = ramp_ends[part]
        settled = (time - since >= SETTLING - 1e-9) & (time - until >= AFTER_RAMP - 1e-9)
        return cls(part, set_force[ends][part], settled & recording.within(WorkState.WORK))


def contact_figures(recording: "Recording") -> ContactMetrics:
    """Error of the true normal force from the set force in the work state, overall and per segment.

    A segment has one set force. The RMS is taken of the means over the loop's steps. Peaks and lost
    contact are evaluated at the physics steps within them. If the reference ramps to a new set
    force, the error is relative to the end of the ramp, and counts from `unsettled` on.
    """
    work = recording.within(WorkState.WORK)
    set_force = recording["set_force"].scalar
    if not work.any() or not set_force[work].any():  # no force was commanded
        return unmeasured(ContactMetrics, segments=[])

    steps = ForceSteps.of(recording)
    dt = recording.timestep
    least = recording["contact_least"].scalar
    lost = is_lost(least) & work
    error = recording["contact_normal"].scalar - steps.force
    peak = force_peak(least, recording["contact_most"].scalar, steps.force)

    def figures(where: np.ndarray) -> dict[str, float | None]:
        e = error[where & steps.settled]
        worst = peak[where & steps.settled]
        return {
            "force_error_rms_n": float(np.sqrt(np.mean(e**2))) if e.size else None,
            "force_error_max_n": float(worst.max()) if e.size else None,
            "lost_s": float((lost & where).sum() * dt),
        }

    segments: list[SegmentMetrics] = []
    for number in np.unique(steps.part[work]):
        where = work & (steps.part == number)
        judged_s = float((where & steps.settled).sum() * dt)
        segments.append(
            SegmentMetrics(
                set_n=float(set_force[where][-1]),
                **figures(where),
                duration_s=float(where.sum() * dt),
                judged_s=judged_s,
                judged=long_enough(judged_s),
            )
        )

    across = np.linalg.norm(tangential(recording, "contact_force")[work], axis=1)
    return ContactMetrics(
        **figures(work),
        tangential_mean_n=float(across.mean()),
        tangential_max_n=float(across.max()),
        segments=segments,
    )


def unjudged_levels(recording: "Recording", forces: Sequence[float]) -> tuple[str, ...]:
    """Set forces that have no figure, one line for each.

    Args:
        recording: The run.
        forces: [N] set forces on consecutive, equally long parts of the path.

    Returns:
        The lines; empty if every set force lasted for JUDGED.
    """
    s = recording["path_s"].scalar
    work = recording.within(WorkState.WORK)
    length = float(s[work].max(initial=0.0))
    if not forces or length == 0.0:
        return ()

    steps = ForceSteps.of(recording)
    part = np.minimum((s / length * len(forces)).astype(int), len(forces) - 1)

    lines = []
    stated = levels(forces)
    for number, level in enumerate(stated, 1):
        on_level = (part >= level.first) & (part < level.end)
        rows = steps.settled & on_level & (np.abs(steps.force - level.force) < 1e-6)
        judged_s = float(rows.sum() * recording.timestep)
        if not long_enough(judged_s):
            which = f"level {number} of {len(stated)}"
            lines.append(
                f"set force of {level.force:g} N, {which}: judged for {judged_s:.2f} s, less than "
                f"{JUDGED:g} s"
            )

    return tuple(lines)


class ForceLevel(NamedTuple):
    """One set force on consecutive parts of a path."""

    force: float  # [N]
    first: int  # number of the first of these parts
    end: int  # number of the part after the last


def levels(forces: Sequence[float]) -> list[ForceLevel]:
    """Set forces on consecutive parts of a path as levels; equal neighbours form one level."""
    starts = [k for k, force in enumerate(forces) if k == 0 or force != forces[k - 1]]
    return [
        ForceLevel(forces[k], k, end)
        for k, end in zip(starts, [*starts[1:], len(forces)], strict=True)
    ]


def tangential(recording: "RecordedSeries", name: str) -> Array:
    """Component (N, 3) [N] of "contact_force" or "felt_force" across the tool axis, in W."""
    force = recording[name].value
    axis = recording["tool_axis"].value
    return force - np.sum(force * axis, axis=1, keepdims=True) * axis


def long_enough(judged_s: float) -> bool:
    """True if a set force that was judged for `judged_s` [s] has a figure."""
    return judged_s >= JUDGED - 1e-9

"""Metrics of an insertion, from its recording and the true pose of the hole.

Side force is the component of the true contact force on the tool across the hole's axis. Axial
force is its component along the axis, against the advance. Both are means over the loop's steps,
from the departure from the stand-off until the return to it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array, checked, inverse

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

AT_THE_HOLE = (
    WorkState.APPROACH,
    WorkState.SEARCH,
    WorkState.INSERT,
    WorkState.WORK,
    WorkState.WITHDRAW,
)
_INSIDE = (WorkState.INSERT, WorkState.WORK, WorkState.WITHDRAW)


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionBounds:
    """Acceptance bounds of an insertion."""

    side_force: float = 20.0  # [N]
    axial_force: float = 40.0  # [N]
    short: float = 0.005  # [m] shortfall of the true depth from the commanded one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueHole:
    """True hole and tool, and the commanded depth."""

    X_WH: Array  # (4, 4) origin in the mouth of the hole, z into the hole
    radius: float  # [m]
    tool_radius: float  # [m]
    depth: float  # [m] commanded

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_WH", checked(self.X_WH, (4, 4), "X_WH"))

    def forces(self, force_W: Array) -> tuple[Array, Array]:
        """Forces (N,) [N] of contacts (N, 3) across the axis, and along it against the advance."""
        force_H = self._in_hole(force_W)
        return np.linalg.norm(force_H[:, :2], axis=1), -force_H[:, 2]

    def tips(self, tip_W: Array) -> Array:
        """Positions (N, 3) [m] in axes of the hole."""
        return self._in_hole(tip_W - self.X_WH[:3, 3])

    def _in_hole(self, v_W: Array) -> Array:
        """Vectors (N, 3) in axes of the hole."""
        rows = self.X_WH[:3, :3]

        # Not a product of matrices, because its rounding depends on the number of rows.
        return v_W[:, :1] * rows[0] + v_W[:, 1:2] * rows[1] + v_W[:, 2:] * rows[2]

    def within_wall(self, tip_H: Array) -> np.ndarray:
        """Mask (N,) of the positions (N, 3) [m], in axes of the hole, that are inside its
        radius.
        """
        return np.linalg.norm(tip_H[:, :2], axis=1) < self.radius


@dataclass(frozen=True, slots=True, kw_only=True)
class HoleMetrics:
    """Error of the identified hole."""

    accepted: bool
    aside_m: float | None = metric(
        "Distance of the identified mouth of the hole from the true axis.", minimum=0
    )
    tilt_rad: float | None = metric(
        "Angle between the identified axis and the true one.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionMetrics:
    """Forces, depth and times at the hole."""

    clearance_m: float | None = metric("Radial clearance between tool and hole.", minimum=0)
    depth_asked_m: float | None = metric(minimum=0)
    depth_m: float | None = metric("Largest true depth of the tip in the bore.", minimum=0)
    side_force_max_n: float | None = metric(
        "Peak of the true contact force across the axis of the hole, from leaving the stand-off "
        "until the return to it.",
        minimum=0,
    )
    side_force_rms_n: float | None = metric(
        "RMS of this force while the tip is in the bore.", minimum=0
    )
    axial_force_max_n: float | None = metric(
        "Peak of the true contact force along the axis, in either direction.", minimum=0
    )
    time_s: float | None = metric(
        "Time from leaving the stand-off until the return to it.", minimum=0
    )
    searched_s: float | None = metric("Share of this time on the search spiral.", minimum=0)
    tip_at_end_m: float | None = metric(
        "True depth at the end; negative if the tip is outside the hole."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionRunMetrics:
    """Metrics of an insertion."""

    identification: HoleMetrics
    insertion: InsertionMetrics


def schema() -> dict[str, Any]:
    """JSON Schema of an insertion's metrics.json."""
    return run_schema(
        InsertionRunMetrics,
        "Figures of an insertion",
        "What insert_sampler.py writes to metrics.json",
    )


def assess_insertion(
    recording: "Recording",
    truth: TrueHole,
    *,
    found_X_WH: Array | None,
    seed: int,
    wall_s: float,
    bounds: InsertionBounds | None = None,
) -> Assessment:
    """All metrics of an insertion.

    Args:
        recording: The run.
        truth: True hole.
        found_X_WH: Identified pose of the hole (4, 4); None if it was not found.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        bounds: Acceptance bounds; default: `InsertionBounds()`.

    Returns:
        The assessment.
    """
    bounds = bounds or InsertionBounds()
    at_hole = recording.within(*AT_THE_HOLE)
    inside = recording.within(*_INSIDE)
    tip_H = truth.tips(recording["p_pad"].value)
    side, axial = truth.forces(recording["contact_force"].value)
    in_bore = inside & (tip_H[:, 2] > 0.0) & truth.within_wall(tip_H)
    depth = float(tip_H[in_bore, 2].max()) if in_bore.any() else 0.0
    out = float(tip_H[-1, 2])

    def peak(values: Array) -> float | None:
        return float(values[at_hole].max()) if at_hole.any() else None

    position, angle = (None, None) if found_X_WH is None else hole_error(found_X_WH, truth.X_WH)

    insertion = InsertionMetrics(
        clearance_m=truth.radius - truth.tool_radius,
        depth_asked_m=truth.depth,
        depth_m=depth,
        side_force_max_n=peak(side),
        side_force_rms_n=float(np.sqrt(np.mean(side[in_bore] ** 2))) if in_bore.any() else None,
        axial_force_max_n=peak(np.abs(axial)),
        time_s=float(at_hole.sum() * recording.timestep),
        searched_s=float(recording.within(WorkState.SEARCH).sum() * recording.timestep),
        tip_at_end_m=out,
    )

    hole = HoleMetrics(accepted=found_X_WH is not None, aside_m=position, tilt_rad=angle)
    metrics = InsertionRunMetrics(identification=hole, insertion=insertion)

    mm = 1e3
    degrees = float(np.degrees(1.0))
    checks = (
        Requirement("hole position error", position, None, "mm", mm),
        Requirement("hole axis error", angle, None, "deg", degrees),
        Requirement("depth reached", depth, None, "mm", mm),
        Requirement("missing depth", truth.depth - depth, bounds.short, "mm", mm),
        Requirement("side force, peak", insertion.side_force_max_n, bounds.side_force, "N"),
        Requirement("side force, RMS in the bore", insertion.side_force_rms_n, None, "N"),
        Requirement("axial force, peak", insertion.axial_force_max_n, bounds.axial_force, "N"),
        Requirement("time at the hole", insertion.time_s, None, "s"),
        Requirement("final depth below the mouth", out, 0.0, "mm", mm),
    )
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s)


def hole_error(X_WH: Array, X_WH_true: Array) -> tuple[float, float]:
    """Distance [m] of an identified hole's mouth from the true axis; angle [rad] of the axes."""
    p = inverse(X_WH_true) @ np.append(X_WH[:3, 3], 1.0)
    z = X_WH[:3, 2]
    z_true = X_WH_true[:3, 2]
    return float(np.hypot(p[0], p[1])), float(
        np.arctan2(np.linalg.norm(np.cross(z, z_true)), z @ z_true)
    )

"""Metrics of an insertion, from its recording and the true pose of the hole.

Side force is the true contact force on the tool across the hole's axis, axial force that against the advance. Both are
means over the loop's steps, from departure from the stand-off until return to it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.evaluation.metrics import Assessment, Requirement, run_schema
from sim.evaluation.statistics import crashed_run, spread, verdicts
from sim.interfaces.messages import WorkState
from sim.interfaces.spatial import Array, checked, inverse, transform_points
from sim.loop.recording import Recording

AT_THE_HOLE = (WorkState.APPROACH, WorkState.SEARCH, WorkState.INSERT, WorkState.WORK, WorkState.WITHDRAW)
SCHEMA = "insertion.schema.json"
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

    X_WH: Array  # (4, 4) origin in its mouth, z into it
    radius: float  # [m]
    tool_radius: float  # [m]
    depth: float  # [m] commanded

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_WH", checked(self.X_WH, (4, 4), "X_WH"))


def schema() -> dict[str, Any]:
    """JSON Schema of an insertion's metrics.json."""
    return run_schema(SCHEMA)


def assess_insertion(
    recording: Recording,
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
    at_hole, inside = recording.within(*AT_THE_HOLE), recording.within(*_INSIDE)
    tip_H = transform_points(inverse(truth.X_WH), recording["p_pad"].value)
    force_H = recording["contact_force"].value @ truth.X_WH[:3, :3]
    side, axial = np.linalg.norm(force_H[:, :2], axis=1), -force_H[:, 2]
    in_bore = inside & (tip_H[:, 2] > 0.0) & (np.linalg.norm(tip_H[:, :2], axis=1) < truth.radius)
    depth = float(tip_H[in_bore, 2].max()) if in_bore.any() else 0.0
    out = float(tip_H[-1, 2])

    def peak(values: Array) -> float | None:
        return float(values[at_hole].max()) if at_hole.any() else None

    position, angle = (None, None) if found_X_WH is None else hole_error(found_X_WH, truth.X_WH)
    metrics = {
        "identification": {"accepted": found_X_WH is not None, "aside_m": position, "tilt_rad": angle},
        "insertion": {
            "clearance_m": truth.radius - truth.tool_radius,
            "depth_asked_m": truth.depth,
            "depth_m": depth,
            "side_force_max_n": peak(side),
            "side_force_rms_n": float(np.sqrt(np.mean(side[in_bore] ** 2))) if in_bore.any() else None,
            "axial_force_max_n": peak(np.abs(axial)),
            "time_s": float(at_hole.sum() * recording.timestep),
            "searched_s": float(recording.within(WorkState.SEARCH).sum() * recording.timestep),
            "tip_at_end_m": out,
        },
    }
    mm, degrees, insertion = 1e3, float(np.degrees(1.0)), metrics["insertion"]
    checks = (
        Requirement("hole as found, off its axis", position, None, "mm", mm),
        Requirement("hole as found, tilt", angle, None, "deg", degrees),
        Requirement("depth reached", depth, None, "mm", mm),
        Requirement("short of the depth asked for", truth.depth - depth, bounds.short, "mm", mm),
        Requirement("side force, peak", insertion["side_force_max_n"], bounds.side_force, "N"),
        Requirement("side force, RMS in the bore", insertion["side_force_rms_n"], None, "N"),
        Requirement("axial force, peak", insertion["axial_force_max_n"], bounds.axial_force, "N"),
        Requirement("time at the hole", insertion["time_s"], None, "s"),
        Requirement("tip at the end, below the mouth", out, 0.0, "mm", mm),
    )
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s)


def hole_error(X_WH: Array, X_WH_true: Array) -> tuple[float, float]:
    """Error of an identified hole: distance of its mouth from the true axis [m], and angle between the axes [rad]."""
    p = inverse(X_WH_true) @ np.append(X_WH[:3, 3], 1.0)
    z, z_true = X_WH[:3, 2], X_WH_true[:3, 2]
    return float(np.hypot(p[0], p[1])), float(np.arctan2(np.linalg.norm(np.cross(z, z_true)), z @ z_true))


def crashed(seed: int, reason: str) -> dict[str, Any]:
    """Metrics of a trial that crashed for `reason`."""
    insertion = (
        "clearance_m",
        "depth_asked_m",
        "depth_m",
        "side_force_max_n",
        "side_force_rms_n",
        "axial_force_max_n",
        "time_s",
        "searched_s",
        "tip_at_end_m",
    )
    return {
        "identification": {"accepted": False, "aside_m": None, "tilt_rad": None},
        "insertion": dict.fromkeys(insertion),
        **crashed_run(seed, reason),
    }


def summary(trials: Sequence[Mapping[str, Any]], bounds: InsertionBounds | None = None) -> dict[str, Any]:
    """Success rate with its interval, distributions, and failures by kind, of many trials."""
    bounds = bounds or InsertionBounds()
    insertions = [trial["insertion"] for trial in trials]
    return {
        **verdicts(trials),
        "side_force_max_n": spread(one["side_force_max_n"] for one in insertions),
        "axial_force_max_n": spread(one["axial_force_max_n"] for one in insertions),
        "depth_m": spread(one["depth_m"] for one in insertions),
        "time_s": spread(one["time_s"] for one in insertions),
        "found_aside_m": spread(trial["identification"]["aside_m"] for trial in trials),
        "found_tilt_rad": spread(trial["identification"]["tilt_rad"] for trial in trials),
        "searched": sum((one["searched_s"] or 0.0) > 0.0 for one in insertions),
        "side_force_bound_n": bounds.side_force,
    }

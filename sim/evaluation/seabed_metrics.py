"""Metrics of work in the seabed, from its recording and the true ground.

Push is the true force of the soil against the tool along the tool's axis, including peaks of the
physics steps. Rise and excursion of the hull are relative to its position when the tool first met
the soil, and count until the tool has left the soil. For a dragged tool, depth and side errors are
relative to the commanded path. The depth of the tool below the true surface, which includes the
error of the scan, is reported separately.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.models.site.seabed import Seabed
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric, unmeasured
from uuv.sim.evaluation.surface.tool_errors import path_error
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Target, WorkState
from uuv.sim.interfaces.spatial import Array, checked, rotation_from_quat_wxyz

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

IN_THE_SOIL = (WorkState.INSERT, WorkState.PRESS, WorkState.WORK, WorkState.WITHDRAW)
_GAP_EVERY = 0.5  # [s] between evaluations of the hull's distance from the ground
_MM = 1e3  # [mm/m]
_PERCENT = 100.0  # [%]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeabedBounds:
    """Acceptance bounds of work in the seabed."""

    # [m] error of a target's height, in addition to the share of its range below
    target: float = 0.01
    # share of a target's range, by which the bound of its height error grows
    target_share: float = 0.005
    push: float = 0.05  # error of the push while it is held, as a share of the set push
    rise: float = 0.02  # [m] of the hull
    depth: float = 0.005  # [m] depth error of a dragged tool
    side: float = 0.003  # [m] lateral error of a dragged tool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueGround:
    """True ground and hull, and the commanded work."""

    ground: Seabed
    hull_box: Array  # (2, 3) [m] corners of the hull in B
    push: float | None  # [N] set push of a core sampler; None for a dragged tool
    depth: float  # [m] set depth of a dragged tool, or depth at which a core sampler is full

    def __post_init__(self) -> None:
        object.__setattr__(self, "hull_box", checked(self.hull_box, (2, 3), "hull_box"))


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetMetrics:
    """Error of the target heights from the true ground."""

    accepted: bool
    target_error_max_m: float | None = metric(
        "Height error of the identified targets against the true surface."
    )
    target_error_share: float | None = metric(
        "Largest height error of a target, divided by its bound, 1 cm + 0.5 % of the range."
    )
    range_m: float | None = metric("Distance from the hull to the farthest target.")


@dataclass(frozen=True, slots=True, kw_only=True)
class CoreMetrics:
    """Push and depth of a core tube."""

    push_set_n: float | None
    push_mean_n: float | None
    push_error_share: float | None = metric(
        "Largest error of the true push while it is held, as a share of the set push."
    )
    push_max_n: float | None
    pull_max_n: float | None = metric("Largest pull on the way out of the soil.")
    depth_m: float | None = metric("Largest depth of the tip below the true surface.")
    held_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DragMetrics:
    """Depth and side errors of a dragged tool."""

    depth_set_m: float | None
    depth_error_max_m: float | None = metric(
        "Largest error from the commanded path, along the tool axis."
    )
    depth_error_rms_m: float | None
    side_max_m: float | None = metric("Largest distance across the commanded path, in the surface.")
    true_depth_error_max_m: float | None = metric(
        "Largest error of the depth below the true surface from the set depth, including the "
        "error of the scan."
    )
    true_depth_error_rms_m: float | None
    force_max_n: float | None
    dragged_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SoilHullMetrics:
    """Motion of the hull since the tool first met the soil, and its distance from the ground."""

    rise_max_m: float | None = metric(
        "Largest rise above its position when the tool first met the soil."
    )
    sink_max_m: float | None
    excursion_max_m: float | None
    ground_gap_m: float | None = metric(
        "Least distance of the hull's box from the true ground, in the whole run."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SeabedMetrics:
    """Metrics of work in the seabed."""

    surface: TargetMetrics
    core: CoreMetrics | None
    drag: DragMetrics | None
    hull: SoilHullMetrics


def schema() -> dict[str, Any]:
    """JSON Schema of the metrics.json of work in the seabed."""
    return run_schema(
        SeabedMetrics,
        "Figures of work in the seabed",
        "What sample_seabed.py writes to metrics.json",
    )


def assess_seabed_work(
    recording: "Recording",
    truth: TrueGround,
    *,
    seed: int,
    wall_s: float,
    bounds: SeabedBounds | None = None,
) -> Assessment:
    """All metrics of a run. A metric that could not be measured is None and counts as missed.

    Args:
        recording: The run.
        truth: True ground and commanded work.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        bounds: Acceptance bounds; default: `SeabedBounds()`.

    Returns:
        The assessment.
    """
    bounds = bounds or SeabedBounds()
    target = recording.targets[-1] if recording.targets else None
    worked = truth.push is not None, recording.within(WorkState.WORK).any()

    surface = _surface(target, truth, bounds)
    core = _core(recording, truth) if worked == (True, True) else None
    drag = _drag(recording, truth) if worked == (False, True) else None
    gap = hull_gap(recording, truth)
    hull = SoilHullMetrics(**hull_in_the_soil(recording), ground_gap_m=gap)
    metrics = SeabedMetrics(surface=surface, core=core, drag=drag, hull=hull)

    of_tool = _core_checks(core, bounds) if truth.push is not None else _drag_checks(drag, bounds)
    checks = (
        Requirement(
            "target height error over limit", surface.target_error_share, 1.0, "%", _PERCENT
        ),
        Requirement("target height error", surface.target_error_max_m, None, "mm", _MM),
        *of_tool,
        Requirement("hull, rise", hull.rise_max_m, bounds.rise, "mm", _MM),
        Requirement("hull, excursion", hull.excursion_max_m, None, "mm", _MM),
        Requirement("hull clearance, minimum", gap, None, "mm", _MM),
    )
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s)


def _core_checks(core: CoreMetrics | None, bounds: SeabedBounds) -> tuple[Requirement, ...]:
    """Requirements of a core sample; none if `core` is None."""
    core = core or unmeasured(CoreMetrics)
    return (
        Requirement("push while held, worst", core.push_error_share, bounds.push, "%", _PERCENT),
        Requirement("push, peak", core.push_max_n, None, "N"),
        Requirement("depth of the core", core.depth_m, None, "mm", _MM),
    )


def _drag_checks(drag: DragMetrics | None, bounds: SeabedBounds) -> tuple[Requirement, ...]:
    """Requirements of a dragged tool; none if `drag` is None."""
    drag = drag or unmeasured(DragMetrics)
    true_error = drag.true_depth_error_max_m
    return (
        Requirement("depth error, peak", drag.depth_error_max_m, bounds.depth, "mm", _MM),
        Requirement("cross-track error, peak", drag.side_max_m, bounds.side, "mm", _MM),
        Requirement("true depth error, peak", true_error, None, "mm", _MM),
        Requirement("force on the tool, peak", drag.force_max_n, None, "N"),
    )


def _surface(target: Target | None, truth: TrueGround, bounds: SeabedBounds) -> TargetMetrics:
    """Error of the identified target heights from the true ground, at the ends of the path."""
    if target is None or target.path is None:
        return unmeasured(TargetMetrics, accepted=target is not None and target.accepted)
    ends = target.path.p[[0, -1]] if truth.push is None else target.path.p[:1]

    off = np.abs(ends[:, 2] - truth.ground.height(ends))
    allowed = bounds.target + bounds.target_share * target.range_m
    return TargetMetrics(
        accepted=target.accepted,
        target_error_max_m=float(off.max()),
        target_error_share=float(off.max() / allowed),
        range_m=float(target.range_m),
    )


def _core(recording: "Recording", truth: TrueGround) -> CoreMetrics:
    push = truth.push
    if push is None:
        raise ConfigurationError("core: no push was set")

    held = recording.within(WorkState.WORK)
    inside = recording.within(*IN_THE_SOIL)
    force = recording["contact_normal"].scalar
    depth = tip_depth(recording, truth.ground)
    least = recording["contact_least"].scalar
    most = recording["contact_most"].scalar
    error = np.maximum(np.abs(most[held] - push), np.abs(least[held] - push)) / push

    return CoreMetrics(
        push_set_n=push,
        push_mean_n=float(force[held].mean()),
        push_error_share=float(error.max()),
        push_max_n=float(most[inside].max()),
        pull_max_n=float(-least[inside].min()),
        depth_m=float(depth[inside].max()),
        held_s=float(held.sum() * recording.timestep),
    )


def _drag(recording: "Recording", truth: TrueGround) -> DragMetrics:
    work = recording.within(WorkState.WORK)
    error = path_error(recording)
    depth = tip_depth(recording, truth.ground)[work]
    force = np.linalg.norm(recording["contact_force"].value[work], axis=1)

    return DragMetrics(
        depth_set_m=truth.depth,
        depth_error_max_m=None if error is None else float(np.abs(error.normal).max()),
        depth_error_rms_m=None if error is None else float(np.sqrt(np.mean(error.normal**2))),
        side_max_m=None if error is None else float(np.abs(error.lateral).max()),
        true_depth_error_max_m=float(np.abs(depth - truth.depth).max()),
        true_depth_error_rms_m=float(np.sqrt(np.mean((depth - truth.depth) ** 2))),
        force_max_n=float(force.max()),
        dragged_s=float(work.sum() * recording.timestep),
    )


def tip_depth(recording: "Recording", ground: Seabed) -> Array:
    """Vertical depth (N,) [m] of the tip below the true surface; NaN outside the terrain."""
    tip = recording["p_pad"].value
    return ground.height(tip) - tip[:, 2]


def hull_in_the_soil(recording: "Recording") -> dict[str, float | None]:
    """Peak rise, sinking and excursion of the hull since the tool first met the soil."""
    inside = recording.within(*IN_THE_SOIL)
    touched = np.flatnonzero(inside & (recording["contact_normal"].scalar != 0.0))
    if not touched.size:
        return {"rise_max_m": None, "sink_max_m": None, "excursion_max_m": None}

    inside[: touched[0]] = False
    moved = recording["p_WB"].value[inside] - recording["p_WB"].value[touched[0]]
    return {
        "rise_max_m": float(moved[:, 2].max()),
        "sink_max_m": float(-moved[:, 2].min()),
        "excursion_max_m": float(np.linalg.norm(moved, axis=1).max()),
    }


def hull_gap(recording: "Recording", truth: TrueGround) -> float:
    """Smallest distance [m] of the hull's box from the true ground during the run; 0 if they
    meet.
    """
    every = max(1, round(_GAP_EVERY / recording.timestep))
    ground = truth.ground.mesh()[0]
    box = truth.hull_box

    least = np.inf
    for p_WB, quat_wxyz in zip(
        recording["p_WB"].value[::every], recording["quat_WB_wxyz"].value[::every], strict=True
    ):
        R_WB = rotation_from_quat_wxyz(quat_wxyz)
        p_B = (ground - p_WB) @ R_WB
        outside = np.maximum(0.0, np.maximum(box[0] - p_B, p_B - box[1]))
        least = min(least, float((outside**2).sum(axis=1).min()))

    return float(np.sqrt(least))

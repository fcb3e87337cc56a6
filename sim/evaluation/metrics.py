"""Metrics of work along a path on an object, from the recording and the true object
(docs/results_earlier.md).

`assess` returns the whole content of `metrics.json`, and lists the metrics that missed their
bounds. If the run ended before a metric could be measured, the metric is None (null in JSON) and
counts as missed.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.evaluation.surface.force_levels import contact_figures, tangential, unjudged_levels
from uuv.sim.evaluation.surface.tool_errors import (
    TrueObject,
    gap_figures,
    tool_figures,
    true_path_deviation,
)
from uuv.sim.evaluation.surface.tool_speed import speed_figures
from uuv.sim.evaluation.surface_metrics import (
    ForceEstimateMetrics,
    HullMetrics,
    IdentificationMetrics,
    JointMetrics,
    MotionMetrics,
    PathMetrics,
    SpeedMetrics,
    SurfaceMetrics,
    ThrusterMetrics,
    UncertaintyMetrics,
)
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from uuv.sim.loop.recording import RecordedSeries, Recording

MM, DEGREES = 1e3, float(np.degrees(1.0))  # of a metre, of a radian
# [rad] of a joint; smaller reversals are the arm's reaction to the motion of the hull
REVERSAL = 0.005


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedWork:
    """Requested work of the tool. A run is accepted only if there are figures for all of it."""

    # [N] set forces on consecutive, equally long parts of the path; empty without contact
    forces: tuple[float, ...] = ()
    speed: float | None = None  # [m/s] along the path; None: the speed is not judged


def schema() -> dict[str, Any]:
    """JSON Schema of metrics.json."""
    return run_schema(SurfaceMetrics, "metrics.json", "Figures of one run of work on an object")


def assess(
    recording: "Recording",
    truth: TrueObject,
    *,
    seed: int,
    wall_s: float,
    identification_s: float | None = None,
    bounds: Bounds | None = None,
    asked: AskedWork | None = None,
) -> Assessment:
    """All metrics of a run along a path on an object.

    Args:
        recording: The run.
        truth: True object and work.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        identification_s: Wall time of the last identification [s].
        bounds: Acceptance bounds; default: `Bounds()`.
        asked: Requested forces and speed. By default the commanded motion is judged as far as it
            went.

    Returns:
        The assessment.
    """
    bounds = bounds or Bounds()
    asked = asked or AskedWork()

    figures = SurfaceMetrics(
        identification=_identification(recording, truth),
        uncertainty=uncertainty_figures(recording, truth),
        motion=motion_figures(recording),
        contact=contact_figures(recording),
        gap=gap_figures(recording, truth),
        tool=tool_figures(recording, truth),
        path=PathMetrics(true_deviation_max_m=true_path_deviation(recording, truth)),
        speed=speed_figures(recording, asked.speed),
        joints=joint_figures(recording),
        force_estimate=force_estimate_figures(recording),
        hull=hull_figures(recording),
        thrusters=ThrusterMetrics(
            saturated_s=float(recording["saturated"].scalar.sum() * recording.timestep)
        ),
    )

    # The commanded path is fixed in W. For an object that can move, the path is judged on the
    # object. For an object at rest, the identification adds its own error.
    position = _position_bound(bounds, figures.identification.range_m)
    on_object = bounds.path_deviation + (0.0 if "p_WT" in recording else position)

    checks = (
        *_of_pose(figures, position),
        *_of_contact(figures, bounds),
        *_of_path(figures, bounds, on_object),
        *_of_speed(figures.speed, bounds, judged=asked.speed is not None),
        *_of_attitude(figures, bounds, twist=truth.model.path(truth.path).keeps_b),
        *_of_hull(figures.hull, bounds),
    )
    others = () if figures.identification.accepted else ("the object was not identified",)
    if recording.final.state is WorkState.DONE:
        others += unjudged_levels(recording, asked.forces)

    return Assessment.of(
        recording,
        figures,
        checks,
        seed=seed,
        wall_s=wall_s,
        identification_s=identification_s,
        others=others,
    )


# --- Figures with their bounds, in the order of the table ---


def _position_bound(bounds: Bounds, range_m: float | None) -> float:
    """Bound [m] of the object's position, which is also one as a share of the range."""
    if range_m is None:
        return bounds.position_error
    return min(bounds.position_error, bounds.position_error_share * range_m)


def _of_pose(figures: SurfaceMetrics, position_bound: float) -> tuple[Requirement, ...]:
    """Requirements of the object's pose."""
    error, sigma = figures.identification, figures.uncertainty
    return (
        Requirement("object position error", error.position_error_m, position_bound, "mm", MM),
        Requirement("object orientation error", error.orientation_error_rad, None, "deg", DEGREES),
        Requirement("sigma of object position", sigma.position_sigma_m, None, "mm", MM),
        Requirement("sigma of object orientation", sigma.rotation_sigma_rad, None, "deg", DEGREES),
        Requirement("sigma of hull position", sigma.navigation_sigma_m, None, "mm", MM),
        Requirement("path success probability", sigma.chance_kept, None, "%", 100.0),
    )


def _of_contact(figures: SurfaceMetrics, bounds: Bounds) -> tuple[Requirement, ...]:
    """Requirements of the force or, for a tool that keeps a distance, of the distance."""
    force, gap = figures.contact, figures.gap
    if gap is None:
        return (
            Requirement("force error, RMS", force.force_error_rms_n, bounds.force_error_rms, "N"),
            Requirement("force error, peak", force.force_error_max_n, bounds.force_error_max, "N"),
            Requirement("contact lost", force.lost_s, bounds.lost, "s"),
        )

    return (
        Requirement("distance error, RMS", gap.error_rms_m, None, "mm", MM),
        Requirement("distance error, peak", gap.error_max_m, bounds.gap_error, "mm", MM),
        Requirement("touched", gap.touched_s, 0.0, "s"),
    )


def _of_path(figures: SurfaceMetrics, bounds: Bounds, on_object: float) -> tuple[Requirement, ...]:
    """Requirements of the path, as commanded and, within `on_object` [m], on the true object."""
    tool, true_deviation = figures.tool, figures.path.true_deviation_max_m
    most = _judged(bounds.path_deviation)
    return (
        Requirement("path deviation, RMS", tool.path_deviation_rms_m, None, "mm", MM),
        Requirement("path deviation, peak", tool.path_deviation_max_m, most, "mm", MM),
        Requirement("path covered", tool.worked_share, None, "%", 100.0),
        Requirement("true path deviation, peak", true_deviation, _judged(on_object), "mm", MM),
    )


def _of_speed(speed: SpeedMetrics, bounds: Bounds, *, judged: bool) -> tuple[Requirement, ...]:
    """Requirements of the tool's speed along its path."""
    error = None if speed.mean is None or not speed.set else abs(speed.mean / speed.set - 1.0)
    off = None if speed.share is None else 1.0 - speed.share

    return (
        Requirement("mean speed error", error, bounds.speed_error if judged else None, "%", 100.0),
        Requirement(
            "path share below the set speed", off, bounds.off_speed if judged else None, "%", 100.0
        ),
    )


def _of_attitude(
    figures: SurfaceMetrics, bounds: Bounds, *, twist: bool
) -> tuple[Requirement, ...]:
    """Requirements of the tool's attitude; `twist`: also about its axis."""
    tool = figures.tool
    tilt = Requirement("tool tilt, peak", tool.tilt_max_rad, _judged(bounds.tilt), "deg", DEGREES)
    if not twist:
        return (tilt,)
    return tilt, Requirement("tool twist, peak", tool.twist_max_rad, bounds.tilt, "deg", DEGREES)


def _of_hull(hull: HullMetrics, bounds: Bounds) -> tuple[Requirement, ...]:
    """Requirements of the hull."""
    return (
        Requirement("hull excursion, peak", hull.excursion_max_m, None, "mm", MM),
        Requirement("hull tilt, peak", hull.tilt_max_rad, _judged(bounds.heel), "deg", DEGREES),
    )


def _judged(bound: float) -> float | None:
    """The bound; None if it is infinite, which means that the figure is not judged."""
    return bound if np.isfinite(bound) else None


# --- Figures ---


def joint_figures(recording: "Recording") -> JointMetrics:
    """Direction reversals of the arm's joints in the work state; None unless fully recorded."""
    if "q" not in recording:
        return unmeasured(JointMetrics)

    q, state = recording["q"], recording["state"]
    rows = np.searchsorted(state.time, q.time)
    work = recording.within(WorkState.WORK)[np.minimum(rows, len(state.time) - 1)]

    return JointMetrics(reversals=int(sum(reversals(angles) for angles in q.value[work].T)))


def reversals(q: Array, hysteresis: float = REVERSAL) -> int:
    """Number of direction reversals of a joint's motion q (N,) [rad] beyond a `hysteresis`."""
    count, way, extreme = 0, 0, q[0] if len(q) else 0.0
    for angle in q:
        if way * (angle - extreme) > 0.0 or (way == 0 and abs(angle - extreme) > hysteresis):
            way = way or (1 if angle > extreme else -1)
            extreme = angle
        elif way and way * (extreme - angle) > hysteresis:
            count, way, extreme = count + 1, -way, angle

    return count


def force_estimate_figures(recording: "Recording") -> ForceEstimateMetrics:
    """Error of the tool force estimated from the joints: as a vector, along and across the tool."""
    work = recording.within(WorkState.WORK)
    vector = (recording["felt_force"].value - recording["contact_force"].value)[work]
    normal = (recording["felt_normal"].scalar - recording["contact_normal"].scalar)[work]
    across = (tangential(recording, "felt_force") - tangential(recording, "contact_force"))[work]

    if not work.any() or not (np.isfinite(vector).all() and np.isfinite(normal).all()):
        return unmeasured(ForceEstimateMetrics)  # a controller may have no estimate of the force

    return ForceEstimateMetrics(
        error_rms_n=float(np.sqrt(np.mean(np.sum(vector**2, axis=1)))),
        normal_error_rms_n=float(np.sqrt(np.mean(normal**2))),
        tangential_error_rms_n=float(np.sqrt(np.mean(np.sum(across**2, axis=1)))),
    )


def hull_motion(recording: "RecordedSeries") -> tuple[Array, Array, Array] | None:
    """Motion of the hull at work since first contact or, without a set force, since the start of
    work.

    A commanded motion of the hull is subtracted. The turn is the whole rotation, yaw included.

    Args:
        recording: The run.

    Returns:
        Times (N,) [s], displacement (N, 3) [m] in W, and turn (N,) [rad]. None if the tool never
        touched, or the run never reached the work state.
    """
    work = recording.within(WorkState.WORK)
    pressed = recording["set_force"].scalar[work].any()
    touching = np.flatnonzero(recording["contact_normal"].scalar > 0.0 if pressed else work)
    if not touching.size or not work.any():
        return None

    first = touching[0]
    quat, p = recording["quat_WB_wxyz"].value, recording["p_WB"].value
    if "p_WB_reference" in recording:
        p = p - recording["p_WB_reference"].value

    # Rotation angle from the chord between the quaternions.
    ahead, behind = quat[work] - quat[first], quat[work] + quat[first]  # q and -q are one rotation
    chord = np.minimum(np.linalg.norm(ahead, axis=1), np.linalg.norm(behind, axis=1))
    turn = 4.0 * np.arcsin(0.5 * chord)  # exact for small angles, unlike the arc cosine

    return recording["p_WB"].time[work], p[work] - p[first], turn


def hull_figures(recording: "Recording") -> HullMetrics:
    """Peak displacement and turn of the hull during the work, from its pose at first contact."""
    motion = hull_motion(recording)
    if motion is None:
        return unmeasured(HullMetrics)
    _, displacement, turn = motion
    return HullMetrics(
        excursion_max_m=float(np.linalg.norm(displacement, axis=1).max()),
        tilt_max_rad=float(turn.max()),
    )


def _identification(recording: "Recording", truth: TrueObject) -> IdentificationMetrics:
    """Error, up to symmetry, of the pose that the work used or, without work, of the last find.

    The verdict refers to the same pose, since a single look may be refused after the mean was
    accepted. Range and check are those of the last find.
    """
    if not recording.targets:
        return unmeasured(IdentificationMetrics, accepted=False, views=0)
    last_target = recording.targets[-1]
    target_in_use = recording.goes_by or last_target
    position, orientation = truth.model.symmetry.error(target_in_use.X_WT, truth.X_WT)

    return IdentificationMetrics(
        position_error_m=_finite(position),
        orientation_error_rad=_finite(orientation),
        range_m=_finite(last_target.range_m),
        check_m=_finite(last_target.check_m),
        accepted=target_in_use.accepted,
        views=len(recording.targets),
    )


def uncertainty_figures(recording: "Recording", truth: TrueObject) -> UncertaintyMetrics:
    """Covariance of the mean of the finds, and its effect on the path; None if it is unknown."""
    target, promise = recording.goes_by, recording.promise
    if target is None or target.covariance is None:
        return unmeasured(UncertaintyMetrics)

    covariance, sigma = target.covariance, target.path_sigma
    position, turn = covariance.held_sigmas
    nearest = truth.model.symmetry.nearest_pose(np.array(truth.X_WT), target.X_WT[:3, :3])

    of_path: dict[str, float | None] = {}
    for i, name in enumerate(("normal", "along", "across")):
        column = None if sigma is None else sigma[:, i]
        of_path[f"path_{name}_max_m"] = None if column is None else _finite(column.max())
        of_path[f"path_{name}_p95_m"] = (
            None if column is None else _finite(np.quantile(column, 0.95, method="higher"))
        )

    return UncertaintyMetrics(
        position_sigma_m=position,
        rotation_sigma_rad=turn,
        free=covariance.free_in_words,
        normalised_error=covariance.normalised_error(target.X_WT, nearest)
        / max(1, covariance.degrees),
        navigation_sigma_m=None if promise is None else promise.navigation_sigma,
        chance_kept=None if promise is None else promise.chance,
        **of_path,
    )


def motion_figures(recording: "Recording") -> MotionMetrics | None:
    """Motion of the object as the follower measured it; None if it measured none."""
    motions = recording.motions
    if not motions:
        return None
    noticed = next((motion.time for motion in motions if motion.moved), None)
    if noticed is None:
        return unmeasured(MotionMetrics, frames=len(motions))
    return MotionMetrics(
        frames=len(motions),
        noticed_s=noticed,
        distance_m=motions[-1].distance,
        distance_sigma_m=motions[-1].distance_sigma,
        turn_rad=motions[-1].turn,
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

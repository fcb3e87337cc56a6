"""Metrics of work along a path on an object, as metrics.json holds them."""

from dataclasses import dataclass

from uuv.sim.evaluation.schemas import metric


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationMetrics:
    """Error of the pose that the work went by, the mean of the finds, and the last of these."""

    position_error_m: float | None = metric(
        "Position error of the pose that the work used, up to the object's symmetry.", minimum=0
    )
    orientation_error_rad: float | None = metric(
        "Rotation error of the pose that the work used, up to the object's symmetry.", minimum=0
    )
    range_m: float | None = metric("Camera to the target's centre.", minimum=0)
    check_m: float | None = metric("The acceptance check's figure.", minimum=0)
    accepted: bool
    views: int = metric(minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyMetrics:
    """Stated uncertainty of the pose that the work went by, mean of the finds, and of its path."""

    position_sigma_m: float | None = metric(
        "Standard deviation of the object's centre, in its least certain observable direction.",
        minimum=0,
    )
    rotation_sigma_rad: float | None = metric(
        "Standard deviation of the rotation, about its least certain observable axis.", minimum=0
    )
    free: str | None = metric("Unobservable motions in W, about the centre.")
    normalised_error: float | None = metric(
        "Normalised estimation error squared (NEES) per degree of freedom: 1 on average if "
        "consistent.",
        minimum=0,
    )
    path_normal_max_m: float | None = metric(
        "Standard deviation of the surface under the path, along its normal: the largest. A turn "
        "about the object's axis of symmetry does not count; null where another free motion "
        "moves the surface.",
        minimum=0,
    )
    path_normal_p95_m: float | None = metric(
        "The same, not exceeded on 95 % of the path.", minimum=0
    )
    path_along_max_m: float | None = metric("The same along the path.", minimum=0)
    path_along_p95_m: float | None = metric(minimum=0)
    path_across_max_m: float | None = metric("The same across the path, in the surface.", minimum=0)
    path_across_p95_m: float | None = metric(minimum=0)
    navigation_sigma_m: float | None = metric(
        "Standard deviation per axis of the estimated hull position, before contact.", minimum=0
    )
    chance_kept: float | None = metric(
        "Probability, predicted before contact, that the tool stays within the tolerance of its "
        "path.",
        minimum=0,
        maximum=1,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionMetrics:
    """Motion of the object while the vehicle looked at it; the last fields None if unnoticed."""

    frames: int = metric("In which it was followed.", minimum=0)
    noticed_s: float | None = metric("Time of the first frame with significant motion.", minimum=0)
    distance_m: float | None = metric(
        "Displacement of its centre from the first frame to the last.", minimum=0
    )
    distance_sigma_m: float | None = metric("Stated standard deviation of that.", minimum=0)
    turn_rad: float | None = metric("Rotation from the first frame to the last.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentMetrics:
    """The same for a stretch with one set force."""

    set_n: float = metric(minimum=0)
    force_error_rms_n: float | None = metric(minimum=0)
    force_error_max_n: float | None = metric(minimum=0)
    lost_s: float | None = metric(minimum=0)
    duration_s: float = metric(minimum=0)
    judged_s: float = metric(
        "Time that the force error is of: settled, after each change of the set force.", minimum=0
    )
    judged: bool = metric("True if that is long enough for a figure.")


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMetrics:
    """Error of the true normal force from the set force in the work state."""

    force_error_rms_n: float | None = metric(
        "True normal force against the set value in the work state, from 1 s after each change "
        "of it has begun, and 0.5 s after it has ended.",
        minimum=0,
    )
    force_error_max_n: float | None = metric(minimum=0)
    lost_s: float | None = metric("Time in the work state with less than 1 N.", minimum=0)
    tangential_mean_n: float | None = metric(
        "True contact force across the tool axis, its length averaged over the work state.",
        minimum=0,
    )
    tangential_max_n: float | None = metric(minimum=0)
    segments: list[SegmentMetrics]


@dataclass(frozen=True, slots=True, kw_only=True)
class GapMetrics:
    """Error of the pad's distance from the true surface, in work without contact."""

    set_m: float = metric("Set distance.", exclusiveMinimum=0)
    error_rms_m: float | None = metric(minimum=0)
    error_max_m: float | None = metric(minimum=0)
    touched_s: float = metric("Time with contact, in any state.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolMetrics:
    """Errors of the true tip from the commanded path, of the tool from the true surface normal."""

    path_deviation_rms_m: float | None = metric(
        "The larger of cross-track and along-track at each instant: true tip against the timed "
        "commanded path.",
        minimum=0,
    )
    path_deviation_max_m: float | None = metric(minimum=0)
    cross_track_rms_m: float | None = metric(minimum=0)
    along_track_rms_m: float | None = metric(minimum=0)
    cross_track_max_m: float | None = metric("In the surface, across the tangent.", minimum=0)
    along_track_max_m: float | None = metric(minimum=0)
    normal_deviation_max_m: float | None = metric(
        "Along the tool axis, where the force decides; no part of path_deviation.", minimum=0
    )
    tilt_max_rad: float | None = metric(
        "Between the tool axis and the true surface normal.", minimum=0
    )
    twist_max_rad: float | None = metric(
        "About the tool axis, between the tool's x axis and the one that the path sets; null for "
        "a round tool.",
        minimum=0,
    )
    speed_mean_m_s: float | None
    worked_share: float | None = metric(
        "Length of the ideal path that was worked, over all of it.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PathMetrics:
    """The worked path against the ideal one, that of the true object."""

    true_deviation_max_m: float | None = metric(
        "True tip from the ideal path on the true object.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedMetrics:
    """Speed of the true tip where the set speed applies: without ramps, slow bends and stops."""

    set: float | None = metric(
        "Set speed along the path [m/s]; null where none is known.", minimum=0
    )
    mean: float | None = metric("Mean speed of the true tip along the path there [m/s].")
    share: float | None = metric(
        "Length of the path below the set speed, over the length travelled.", minimum=0, maximum=1
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JointMetrics:
    """Motion of the arm's joints during the work."""

    reversals: int | None = metric(
        "Changes of a joint's direction, all joints together; null where the run kept no joint "
        "angles.",
        minimum=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceEstimateMetrics:
    """Error of the tool force estimated from the joints."""

    error_rms_n: float | None = metric(
        "Estimated tool force against the true contact force, as vectors, in the work state.",
        minimum=0,
    )
    normal_error_rms_n: float | None = metric(minimum=0)
    tangential_error_rms_n: float | None = metric("Across the tool axis, as vectors.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class HullMetrics:
    """Peak displacement and turn of the hull during the work, from its pose at first contact."""

    excursion_max_m: float | None = metric(
        "From the hull's pose when the tool first touches, over the work state.", minimum=0
    )
    tilt_max_rad: float | None = metric("Whole rotation since then, yaw included.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrusterMetrics:
    """Saturation of the thrusters."""

    saturated_s: float = metric("Time in the whole run with a command at its limit.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceMetrics:
    """Metrics of work along a path on an object."""

    identification: IdentificationMetrics
    uncertainty: UncertaintyMetrics
    motion: MotionMetrics | None = metric(
        "Of the object, while the vehicle looked at it; null if nothing followed it."
    )
    contact: ContactMetrics
    gap: GapMetrics | None = metric(
        "Work without contact: the pad's distance to the true surface; null where the tool pressed."
    )
    tool: ToolMetrics
    path: PathMetrics
    speed: SpeedMetrics
    joints: JointMetrics
    force_estimate: ForceEstimateMetrics
    hull: HullMetrics
    thrusters: ThrusterMetrics

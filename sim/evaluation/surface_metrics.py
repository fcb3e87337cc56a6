"""Metrics of work along a path on an object, as metrics.json holds them."""

from dataclasses import dataclass

from uuv.sim.evaluation.schemas import metric


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationMetrics:
    """Error of the pose that the work used, which is the mean of the finds, and figures of the last
    find.
    """

    position_error_m: float | None = metric(
        "Position error of the pose that the work used, up to the object's symmetry.", minimum=0
    )
    orientation_error_rad: float | None = metric(
        "Rotation error of the pose that the work used, up to the object's symmetry.", minimum=0
    )
    range_m: float | None = metric("Distance from the camera to the target's centre.", minimum=0)
    check_m: float | None = metric("Figure of the acceptance check.", minimum=0)
    accepted: bool
    views: int = metric(minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyMetrics:
    """Stated uncertainty of the pose that the work used, the mean of the finds, and of the path
    there.
    """

    position_sigma_m: float | None = metric(
        "Standard deviation of the object's centre, in its least certain observable direction.",
        minimum=0,
    )
    rotation_sigma_rad: float | None = metric(
        "Standard deviation of the rotation, about its least certain observable axis.", minimum=0
    )
    free: str | None = metric("Unobservable motions in W, about the object's centre.")
    normalised_error: float | None = metric(
        "Normalised estimation error squared (NEES) per degree of freedom: 1 on average if "
        "consistent.",
        minimum=0,
    )
    path_normal_max_m: float | None = metric(
        "Largest standard deviation of the surface under the path, along its normal. A turn about "
        "the object's axis of symmetry does not count; null where another free motion moves the "
        "surface.",
        minimum=0,
    )
    path_normal_p95_m: float | None = metric(
        "The same, as the 95th percentile over the path.", minimum=0
    )
    path_along_max_m: float | None = metric(
        "Largest standard deviation of the surface under the path, along the path.", minimum=0
    )
    path_along_p95_m: float | None = metric(minimum=0)
    path_across_max_m: float | None = metric("The same, across the path in the surface.", minimum=0)
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
    """Measured motion of the object during the approach; the last fields are None if none was
    noticed.
    """

    frames: int = metric("Number of frames in which the object was followed.", minimum=0)
    noticed_s: float | None = metric("Time of the first frame with significant motion.", minimum=0)
    distance_m: float | None = metric(
        "Displacement of the object's centre from the first frame to the last.", minimum=0
    )
    distance_sigma_m: float | None = metric(
        "Stated standard deviation of this displacement.", minimum=0
    )
    turn_rad: float | None = metric("Rotation from the first frame to the last.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentMetrics:
    """Force error on a stretch of the path with one set force."""

    set_n: float = metric(minimum=0)
    force_error_rms_n: float | None = metric(minimum=0)
    force_error_max_n: float | None = metric(minimum=0)
    lost_s: float | None = metric(minimum=0)
    duration_s: float = metric(minimum=0)
    judged_s: float = metric(
        "Settled time, after each change of the set force, that the force error is computed from.",
        minimum=0,
    )
    judged: bool = metric("True if this time is long enough for a figure.")


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMetrics:
    """Error of the true normal force from the set force in the work state."""

    force_error_rms_n: float | None = metric(
        "True normal force against the set value in the work state, from 1 s after each change of "
        "the set value has begun, and 0.5 s after it has ended.",
        minimum=0,
    )
    force_error_max_n: float | None = metric(minimum=0)
    lost_s: float | None = metric(
        "Time in the work state with a normal force below 1 N.", minimum=0
    )
    tangential_mean_n: float | None = metric(
        "Length of the true contact force across the tool axis, averaged over the work state.",
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
    """Errors of the true tip from the commanded path, and of the tool from the true surface
    normal.
    """

    path_deviation_rms_m: float | None = metric(
        "The larger of cross-track and along-track error at each instant, of the true tip from "
        "the timed commanded path.",
        minimum=0,
    )
    path_deviation_max_m: float | None = metric(minimum=0)
    cross_track_rms_m: float | None = metric(minimum=0)
    along_track_rms_m: float | None = metric(minimum=0)
    cross_track_max_m: float | None = metric(
        "Error in the surface, across the tangent of the path.", minimum=0
    )
    along_track_max_m: float | None = metric(minimum=0)
    normal_deviation_max_m: float | None = metric(
        "Error along the tool axis, which follows from the force control and is not part of "
        "path_deviation.",
        minimum=0,
    )
    tilt_max_rad: float | None = metric(
        "Angle between the tool axis and the true surface normal.", minimum=0
    )
    twist_max_rad: float | None = metric(
        "Angle about the tool axis from the path's axis to the tool's x axis; null for a round "
        "tool.",
        minimum=0,
    )
    speed_mean_m_s: float | None
    worked_share: float | None = metric(
        "Worked length of the ideal path over its whole length.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PathMetrics:
    """The worked path compared with the ideal path on the true object."""

    true_deviation_max_m: float | None = metric(
        "Largest distance of the true tip from the ideal path on the true object.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedMetrics:
    """Speed of the true tip while the set speed applies, which excludes ramps, slow bends and
    stops.
    """

    set: float | None = metric("Set speed along the path [m/s]; null if none is known.", minimum=0)
    mean: float | None = metric(
        "Mean speed of the true tip along the path while the set speed applies [m/s]."
    )
    share: float | None = metric(
        "Share of the travelled length at the set speed.", minimum=0, maximum=1
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JointMetrics:
    """Motion of the arm's joints during the work."""

    reversals: int | None = metric(
        "Direction reversals of all joints together; null if the run did not record the joint "
        "angles.",
        minimum=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceEstimateMetrics:
    """Error of the tool force estimated from the joints."""

    error_rms_n: float | None = metric(
        "Error of the estimated tool force from the true contact force, as vectors, in the work "
        "state.",
        minimum=0,
    )
    normal_error_rms_n: float | None = metric(minimum=0)
    tangential_error_rms_n: float | None = metric(
        "Error of the components across the tool axis, as vectors.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HullMetrics:
    """Peak displacement and turn of the hull during the work, from its pose at first contact."""

    excursion_max_m: float | None = metric(
        "Largest distance in the work state from the hull's pose at first contact.", minimum=0
    )
    tilt_max_rad: float | None = metric(
        "Largest angle of the whole rotation since then, yaw included.", minimum=0
    )


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
        "Motion of the object during the approach; null if the object was not followed."
    )
    contact: ContactMetrics
    gap: GapMetrics | None = metric(
        "Distance of the pad from the true surface in work without contact; null if the tool "
        "pressed."
    )
    tool: ToolMetrics
    path: PathMetrics
    speed: SpeedMetrics
    joints: JointMetrics
    force_estimate: ForceEstimateMetrics
    hull: HullMetrics
    thrusters: ThrusterMetrics

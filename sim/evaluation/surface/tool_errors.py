"""Errors of the true tip at work: from its path, from the surface, and of the tool's attitude."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uuv.models.objects.axis_steps import Steps
from uuv.models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.evaluation.surface.mesh_surface import closest_on_curve, surface_of
from uuv.sim.evaluation.surface.tool_speed import STANDSTILL
from uuv.sim.evaluation.surface_metrics import GapMetrics, ToolMetrics
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array, checked, inverse

if TYPE_CHECKING:
    from uuv.sim.loop.recording import RecordedSeries, Recording


TILT_RATE = 50.0  # [Hz] rate at which the surface normal under the tip is evaluated
# [m] along a path to either side of a corner; path points nearer to it do not define the turn
CORNER = PATH_STEP


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueObject:
    """True object and the work on it."""

    model: TargetModel
    path: str  # name of the tool path on it
    X_WT: Array  # (4, 4)
    contactless: float | None = None  # [m] commanded distance from its surface; None: contact work
    # fouling and dents lie between the surface and the paths, which are those of the clean surface
    deformed: bool = False

    def __post_init__(self) -> None:
        self.model.path(self.path)  # raises ConfigurationError if the name is unknown
        object.__setattr__(self, "X_WT", checked(self.X_WT, (4, 4), "X_WT"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathError:
    """Components of the true tip's error from the timed commanded path, in the work state."""

    time: Array  # (N,) [s]
    along: Array  # (N,) [m] signed, along the tangent
    normal: Array  # (N,) [m] signed, along the tool axis: deeper is positive
    lateral: Array  # (N,) [m] signed, along axis x tangent
    deviation: Array  # (N,) [m] the larger of along-track and cross-track error

    @property
    def cross(self) -> Array:
        """Distance (N,) [m] from the path within the surface, without the error along the
        normal.
        """
        return np.abs(self.lateral)


def path_error(recording: "RecordedSeries") -> PathError | None:
    """Error of the tip on its path; None if the tip never moved along a path in the work state."""
    work = recording.within(WorkState.WORK)
    velocity = recording["v_command"].value[work]
    speed = np.linalg.norm(velocity, axis=1)
    moving = np.flatnonzero(speed > STANDSTILL)
    if not moving.size:
        return None

    # At both ends, where the commanded point is at rest, the tangent is that of the nearest motion.
    rows = np.arange(len(speed))
    after = np.clip(np.searchsorted(moving, rows), 0, moving.size - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(rows - moving[before] < moving[after] - rows, moving[before], moving[after])
    nearest = np.where(speed > STANDSTILL, rows, nearest)
    tangent = velocity[nearest] / speed[nearest, None]

    # Error along the tangent, along the tool axis orthogonal to it, and across both.
    error = recording["p_pad"].value[work] - recording["p_command"].value[work]
    axis = recording["tool_axis"].value[work]
    axis = axis - np.sum(axis * tangent, axis=1, keepdims=True) * tangent
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    along = np.sum(error * tangent, axis=1)
    normal = np.sum(error * axis, axis=1)
    lateral = np.sum(error * np.cross(axis, tangent), axis=1)

    return PathError(
        time=recording["p_pad"].time[work],
        along=along,
        normal=normal,
        lateral=lateral,
        deviation=np.maximum(np.abs(along), np.abs(lateral)),
    )


def tool_figures(recording: "Recording", truth: TrueObject) -> ToolMetrics:
    """Errors of the true tip from the commanded path, and of the tool axis from the true normal."""
    error = path_error(recording)
    if error is None:  # a tool that rests on the surface has an attitude but no path
        tilt = tool_tilt(recording, truth)[1]
        return unmeasured(ToolMetrics, tilt_max_rad=float(tilt.max()) if tilt.size else None)

    work = recording.within(WorkState.WORK)
    path = truth.model.path(truth.path)
    whole = np.asarray(path.p)
    arc = _on_ideal_path(recording, truth)[1]

    # the tool was moved to the start of another stretch
    lifted = np.flatnonzero(np.diff(np.flatnonzero(work)) > 1) + 1
    worked = sum(float(np.ptp(stretch)) for stretch in np.split(arc, lifted))
    moving = np.linalg.norm(recording["v_command"].value[work], axis=1) > STANDSTILL

    return ToolMetrics(
        path_deviation_rms_m=float(np.sqrt(np.mean(error.deviation**2))),
        path_deviation_max_m=float(error.deviation.max()),
        cross_track_rms_m=float(np.sqrt(np.mean(error.cross**2))),
        along_track_rms_m=float(np.sqrt(np.mean(error.along**2))),
        cross_track_max_m=float(error.cross.max()),
        along_track_max_m=float(np.abs(error.along).max()),
        normal_deviation_max_m=float(np.abs(error.normal).max()),
        tilt_max_rad=float(tool_tilt(recording, truth)[1].max()),
        twist_max_rad=float(np.abs(tool_twist(recording, truth)[1]).max())
        if path.keeps_b
        else None,
        speed_mean_m_s=worked / float(moving.sum() * recording.timestep),
        worked_share=worked / float(np.linalg.norm(np.diff(whole, axis=0), axis=1).sum()),
    )


def true_path_deviation(recording: "Recording", truth: TrueObject) -> float | None:
    """Largest distance [m] of the true tip at work from the ideal path; None without a path."""
    if path_error(recording) is None:
        return None
    return float(_on_ideal_path(recording, truth)[0].max())


def gap_figures(recording: "Recording", truth: TrueObject) -> GapMetrics | None:
    """Error of the pad's distance from the true surface at work, and contact time in any state.

    None for contact work.
    """
    if truth.contactless is None:
        return None
    touched = float((recording["contact_normal"].scalar > 0.0).sum() * recording.timestep)

    error = None
    if recording.within(WorkState.WORK).any():
        error = tool_gap(recording, truth)[1] - truth.contactless

    return GapMetrics(
        set_m=truth.contactless,
        error_rms_m=None if error is None else float(np.sqrt(np.mean(error**2))),
        error_max_m=None if error is None else float(np.abs(error).max()),
        touched_s=touched,
    )


def tool_gap(recording: "Recording", truth: TrueObject) -> tuple[Array, Array]:
    """Distance of the pad's face from the true surface in the work state; 0 inside the object."""
    time, tip_T, _ = _at_work(recording, truth)
    surface = surface_of(truth.model)
    p_surface, normal = surface.closest(tip_T)
    outside = np.sum((tip_T - p_surface) * normal, axis=1) > 0.0
    return time, np.where(outside, np.linalg.norm(tip_T - p_surface, axis=1), 0.0)


def tool_tilt(recording: "Recording", truth: TrueObject) -> tuple[Array, Array]:
    """Angle between the tool axis and the true inward surface normal, in the work state.

    Args:
        recording: The run.
        truth: True object.

    Returns:
        Times (N,) [s] and angles (N,) [rad].
    """
    time, tip_T, axis = _at_work(recording, truth)
    surface = surface_of(truth.model)
    _, normal = surface.closest(tip_T)
    sine = np.linalg.norm(np.cross(axis, normal), axis=1)
    return time, np.arctan2(sine, -np.sum(axis * normal, axis=1))


def tool_twist(recording: "Recording", truth: TrueObject) -> tuple[Array, Array]:
    """Angle about the tool axis from the path's second axis b to the tool's x axis, at work.

    Args:
        recording: The run.
        truth: True object, whose path gives the axis b at the point of the path nearest to the tip.

    Returns:
        Times (N,) [s] and angles (N,) [rad], right-handed about the tool axis. An angle is the
        smallest of those to the path's points within CORNER of the nearest one: in a corner the
        tool may be turned like either side, or between them.
    """
    from scipy.spatial import cKDTree

    rows = _rows_at_work(recording)
    tip_T, R = _in_object(recording, truth, rows, _path_pose(recording, truth))
    axis_T = _turned_back(R, recording["tool_axis"].value[rows])
    x_T = _turned_back(R, recording["tool_x"].value[rows])

    # Pairs of a row and a point of the path near the tip's point; `first` of each row.
    p, b_at = _finely(truth.model.path(truth.path))
    tree = cKDTree(p)
    near = tree.query_ball_point(p[tree.query(tip_T)[1]], CORNER)
    count = [len(points) for points in near]
    first = np.cumsum([0, *count[:-1]])
    row = np.repeat(np.arange(len(near)), count)
    point = np.concatenate(near).astype(np.int64)

    # Angle from the axis b of each of these points.
    b = b_at[point]
    axis = axis_T[row]
    x = x_T[row]
    flat = b - np.sum(b * axis, axis=1, keepdims=True) * axis
    angle = np.arctan2(np.sum(np.cross(flat, x) * axis, axis=1), np.sum(flat * x, axis=1))

    # The smallest of these angles; 0 if they have both signs.
    least = np.minimum.reduceat(angle, first)
    most = np.maximum.reduceat(angle, first)
    smallest = np.where(np.abs(least) < np.abs(most), least, most)
    smallest[(least < 0.0) & (most > 0.0)] = 0.0

    return recording["tool_x"].time[rows], smallest


def _on_ideal_path(recording: "Recording", truth: TrueObject) -> tuple[Array, Array]:
    """Distances (N,) [m] of the true tip at work from the ideal path, and arc lengths there.

    On a deformed object the ideal path is the path of the clean object, projected onto the true
    surface along its tool axes. The distance then combines the distance from the path across these
    axes and the distance from the true surface.
    """
    rows = np.flatnonzero(recording.within(WorkState.WORK))
    tip_T = _in_object(recording, truth, rows, _path_pose(recording, truth))[0]
    path = truth.model.path(truth.path)
    p = np.asarray(path.p)
    a = np.asarray(path.a)

    # the ideal path of a tool that keeps a distance lies above the surface
    off = truth.contactless or 0.0
    ideal, arc = closest_on_curve(tip_T, p - off * a)
    away = tip_T - ideal
    if not truth.deformed:
        return np.linalg.norm(away, axis=1), arc

    # Distance across the tool axis of the nearest point of the path.
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    axis = np.column_stack([np.interp(arc, way, column) for column in a.T])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    across = np.linalg.norm(away - np.sum(away * axis, axis=1, keepdims=True) * axis, axis=1)

    # Distance from the surface, evaluated at fewer rows.
    time, tip_on_T, _ = _at_work(recording, truth)
    surface = surface_of(truth.model)
    above = np.linalg.norm(tip_on_T - surface.closest(tip_on_T)[0], axis=1) - off
    return np.hypot(across, np.interp(recording["p_pad"].time[rows], time, above)), arc


def _path_pose(recording: "Recording", truth: TrueObject) -> Array:
    """True pose X_WT (4, 4): of those equal by symmetry, the one nearest to the identified pose.

    A rotation of symmetry leaves the object unchanged but moves the path.
    """
    if not recording.targets:
        return np.array(truth.X_WT)
    return truth.model.symmetry.nearest_pose(
        np.array(truth.X_WT), recording.targets[-1].X_WT[:3, :3]
    )


def _finely(path: ModelPath) -> tuple[Array, Array]:
    """Points and second axes of a path, at a tenth of the spacing of its points."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p, axis=0), axis=1))])
    fine = np.linspace(0.0, s[-1], 1 + 10 * (len(s) - 1))

    # Interpolated with the jumps of the axes removed; the jumps are then added again.
    steps = Steps.of(path.a, path.b)
    smooth = steps.taken_out(path.a, path.b)
    p, a, b = (
        np.column_stack([np.interp(fine, s, column) for column in curve.T])
        for curve in (path.p, path.a, smooth)
    )

    return p, steps.put_back(a, b, np.interp(fine, s, np.arange(len(s))))


def _at_work(recording: "Recording", truth: TrueObject) -> tuple[Array, Array, Array]:
    """Times (N,) [s], face of the pad (N, 3) [m] and tool axis (N, 3) in T, at work."""
    rows = _rows_at_work(recording)
    tip_T, R = _in_object(recording, truth, rows, truth.X_WT)
    return recording["p_pad"].time[rows], tip_T, _turned_back(R, recording["tool_axis"].value[rows])


def _in_object(
    recording: "Recording", truth: TrueObject, rows: np.ndarray, X_WT: Array
) -> tuple[Array, Array]:
    """True tip relative to the object, at the object's pose at that time.

    Args:
        recording: The run.
        truth: True object.
        rows: (N,) rows of the series.
        X_WT: (4, 4) pose of the object in `truth`, or one equal to it by symmetry.

    Returns:
        The pad's face (N, 3) [m] in T, and the object's rotation R_WT (N, 3, 3).
    """
    R = np.broadcast_to(X_WT[:3, :3], (len(rows), 3, 3))
    origin = X_WT[:3, 3]
    if "p_WT" in recording:
        from scipy.spatial.transform import Rotation

        moved = Rotation.from_quat(
            recording["quat_WT_wxyz"].value[rows], scalar_first=True
        ).as_matrix()
        same = inverse(truth.X_WT) @ X_WT
        R = moved @ same[:3, :3]
        origin = recording["p_WT"].value[rows] + moved @ same[:3, 3]

    return _turned_back(R, recording["p_pad"].value[rows] - origin), R


def _turned_back(R: Array, vectors: Array) -> Array:
    """R^T v for each row, with R (N, 3, 3) and vectors v (N, 3)."""
    return np.einsum("nji,nj->ni", R, vectors)


def _rows_at_work(recording: "Recording") -> np.ndarray:
    """Rows (N,) of the series in the work state, at TILT_RATE."""
    every = max(1, round(1.0 / (TILT_RATE * recording.timestep)))
    return np.flatnonzero(recording.within(WorkState.WORK))[::every]

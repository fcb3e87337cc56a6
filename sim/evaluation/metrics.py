"""Metrics of work along a path on an object, from the recording and the true object
(docs/results_earlier.md).

`assess` returns the whole content of `metrics.json`, and lists the metrics that missed their
bounds. If the run ended before a metric could be measured, the metric is None (null in JSON) and
counts as missed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.models.objects.axis_steps import Steps
from uuv.models.objects.target_model import PATH_STEP, ModelPath, TargetModel
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.energy_metrics import energy_checks, energy_figures
from uuv.sim.evaluation.force_levels import contact_figures, tangential, unjudged_levels
from uuv.sim.evaluation.mesh_surface import closest_on_curve, surface_of
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import OPTIONAL, EveryRun, RunMetrics, Timings, run_schema
from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.evaluation.surface_metrics import (
    ForceEstimateMetrics,
    GapMetrics,
    HullMetrics,
    IdentificationMetrics,
    JointMetrics,
    MotionMetrics,
    PathMetrics,
    SpeedMetrics,
    SurfaceMetrics,
    ThrusterMetrics,
    ToolMetrics,
    UncertaintyMetrics,
)
from uuv.sim.evaluation.tool_speed import STANDSTILL, speed_figures
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import Array, checked, inverse
from uuv.sim.runs.saving import write_json

if TYPE_CHECKING:
    from uuv.sim.loop.recording import RecordedSeries, Recording

# [rad] of a joint; smaller reversals are the arm's reaction to the motion of the hull
REVERSAL = 0.005
TILT_RATE = 50.0  # [Hz] rate at which the surface normal under the tip is evaluated
# [m] along a path to either side of a corner; path points nearer to it do not define the turn
CORNER = PATH_STEP
INTERRUPTED = "interrupted"  # state of a run that was ended by a signal


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


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedWork:
    """Requested work of the tool. A run is accepted only if there are figures for all of it."""

    # [N] set forces on consecutive, equally long parts of the path; empty without contact
    forces: tuple[float, ...] = ()
    speed: float | None = None  # [m/s] along the path; None: the speed is not judged


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assessment:
    """Metrics of a run compared with the truth, and whether the run is accepted."""

    metrics: Mapping[str, Any]  # as written to metrics.json
    checks: tuple[Requirement, ...]
    failed: tuple[str, ...]  # one line each

    @classmethod
    def of(
        cls,
        recording: "Recording",
        figures: Any,
        checks: Sequence[Requirement],
        *,
        seed: int,
        wall_s: float,
        identification_s: float | None = None,
        others: Iterable[str] = (),
    ) -> "Assessment":
        """Assess a run by its checks. Every run must also be free of collision and end in DONE.

        The metrics consist of `figures`, the metrics that all kinds of run have, and the verdict.
        All values that differ between repetitions are under "timings".

        Args:
            recording: The run.
            figures: Metrics of its kind of work, a dataclass.
            checks: Requirements of its kind of work.
            seed: Seed of the run.
            wall_s: Wall time [s].
            identification_s: Wall time of the last identification [s].
            others: Messages of further failures.

        Returns:
            The assessment.
        """
        # How the run ended: interrupted, at the time limit, or as the work says.
        final = recording.final
        state, note = final.state.value, final.note
        if recording.interrupted:
            note = f"by {recording.interrupted} in state {state} after {recording.duration:.1f} s"
            state = INTERRUPTED

        cut = not recording.interrupted and final.state not in (WorkState.DONE, WorkState.ABORT)
        abort = AbortCode.TIME_LIMIT if cut else final.abort

        run = RunMetrics(
            simulated_s=recording.duration,
            seed=seed,
            state=state,
            note=note,
            abort=None if abort is None else abort.value,
            collision_s=float(recording["collision"].scalar.sum() * recording.timestep),
            trajectory_sha256=recording.digest(),
        )

        timings = Timings(
            wall_s=wall_s,
            real_time_factor=recording.duration / wall_s if wall_s > 0.0 else None,
            identification_s=identification_s,
        )

        # All failures; the cause of the end comes first.
        collision = Requirement("collision", run.collision_s, 0.0, "s")
        failed = [check.failure for check in checks if check.failure]
        if collision.failure:
            first = f": {recording.collided}" if recording.collided else ""
            failed.append(f"{collision.failure}{first}")
        failed += others
        energy = energy_figures(recording)
        checks = (*checks, collision, *energy_checks(energy))

        if recording.interrupted:
            failed.insert(0, f"the run was interrupted {note}")
        elif final.state is WorkState.ABORT and len(recording.events) > 1:
            before = recording.events[-2].state.value
            failed.insert(0, f"the work was aborted in {before} at {final.time:.1f} s: {note}")
        elif final.state is WorkState.ABORT:
            failed.insert(0, f"the run ended in state {state}{f': {note}' if note else ''}")
        elif cut:
            after = f"after {recording.duration:.1f} s, in state {state}"
            failed.insert(
                0, f"the time limit ended the run {after}{f': {note}' if note else ''} (--longest)"
            )

        ended = EveryRun(
            run=run, accepted=not failed, failed=failed, timings=timings, energy=energy
        )
        entries = {**asdict(figures), **asdict(ended)}
        # for two of these fields see `made_by` and `started`
        metrics = {name: e for name, e in entries.items() if e is not None or name not in OPTIONAL}
        return cls(metrics=metrics, checks=checks, failed=tuple(failed))

    @property
    def accepted(self) -> bool:
        """True if nothing failed."""
        return not self.failed

    def made_by(self, provenance: Mapping[str, Any]) -> "Assessment":
        """Copy with `provenance` among the metrics."""
        return self.extended(provenance=dict(provenance))

    def extended(self, **entries: Any) -> "Assessment":
        """Copy with further entries among the metrics, of those that `EveryRun` lists."""
        return replace(self, metrics={**self.metrics, **entries})

    def write(self, file: Path) -> None:
        """Write metrics.json.

        Raises:
            ConfigurationError: The file cannot be written.
        """
        write_json(file, self.metrics)


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
    bounds, asked = bounds or Bounds(), asked or AskedWork()
    identification = _identification(recording, truth)
    uncertainty = uncertainty_figures(recording, truth)
    contact = contact_figures(recording)
    tool = tool_figures(recording, truth)
    hull = hull_figures(recording)
    gap = gap_figures(recording, truth)
    path = PathMetrics(true_deviation_max_m=true_path_deviation(recording, truth))
    speed = speed_figures(recording, asked.speed)

    metrics = SurfaceMetrics(
        identification=identification,
        uncertainty=uncertainty,
        motion=motion_figures(recording),
        contact=contact,
        gap=gap,
        tool=tool,
        path=path,
        speed=speed,
        joints=joint_figures(recording),
        force_estimate=force_estimate_figures(recording),
        hull=hull,
        thrusters=ThrusterMetrics(
            saturated_s=float(recording["saturated"].scalar.sum() * recording.timestep)
        ),
    )

    # Bounds. The position also has one as a share of the range; those of the tool depend on the
    # kind of work.
    range_m = identification.range_m
    position_bound = bounds.position_error
    if range_m is not None:
        position_bound = min(position_bound, bounds.position_error_share * range_m)
    mm, degrees = 1e3, float(np.degrees(1.0))

    if gap is None:
        of_tool = (
            Requirement("force error, RMS", contact.force_error_rms_n, bounds.force_error_rms, "N"),
            Requirement(
                "force error, peak", contact.force_error_max_n, bounds.force_error_max, "N"
            ),
            Requirement("contact lost", contact.lost_s, bounds.lost, "s"),
        )
    else:
        of_tool = (
            Requirement("distance error, RMS", gap.error_rms_m, None, "mm", mm),
            Requirement("distance error, peak", gap.error_max_m, bounds.gap_error, "mm", mm),
            Requirement("touched", gap.touched_s, 0.0, "s"),
        )

    # The commanded path is fixed in W. For an object that can move, the path is judged on the
    # object. For an object at rest, the identification adds its own error.
    on_object = bounds.path_deviation + (0.0 if "p_WT" in recording else position_bound)

    checks = (
        # the object's pose
        Requirement(
            "object position error", identification.position_error_m, position_bound, "mm", mm
        ),
        Requirement(
            "object orientation error", identification.orientation_error_rad, None, "deg", degrees
        ),
        Requirement("sigma of object position", uncertainty.position_sigma_m, None, "mm", mm),
        Requirement(
            "sigma of object orientation", uncertainty.rotation_sigma_rad, None, "deg", degrees
        ),
        Requirement("sigma of hull position", uncertainty.navigation_sigma_m, None, "mm", mm),
        Requirement("path success probability", uncertainty.chance_kept, None, "%", 100.0),
        # the tool: contact or distance, path, speed, attitude
        *of_tool,
        Requirement("path deviation, RMS", tool.path_deviation_rms_m, None, "mm", mm),
        Requirement(
            "path deviation, peak",
            tool.path_deviation_max_m,
            _judged(bounds.path_deviation),
            "mm",
            mm,
        ),
        Requirement("path covered", tool.worked_share, None, "%", 100.0),
        Requirement(
            "true path deviation, peak", path.true_deviation_max_m, _judged(on_object), "mm", mm
        ),
        *_of_speed(speed, bounds, judged=asked.speed is not None),
        Requirement("tool tilt, peak", tool.tilt_max_rad, _judged(bounds.tilt), "deg", degrees),
        *(
            (Requirement("tool twist, peak", tool.twist_max_rad, bounds.tilt, "deg", degrees),)
            if truth.model.path(truth.path).keeps_b
            else ()
        ),
        # the hull
        Requirement("hull excursion, peak", hull.excursion_max_m, None, "mm", mm),
        Requirement("hull tilt, peak", hull.tilt_max_rad, _judged(bounds.heel), "deg", degrees),
    )

    others = () if identification.accepted else ("the object was not identified",)
    if recording.final.state is WorkState.DONE:
        others += unjudged_levels(recording, asked.forces)

    return Assessment.of(
        recording,
        metrics,
        checks,
        seed=seed,
        wall_s=wall_s,
        identification_s=identification_s,
        others=others,
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


def _judged(bound: float) -> float | None:
    """The bound; None if it is infinite, which means that the figure is not judged."""
    return bound if np.isfinite(bound) else None


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
    along, normal = np.sum(error * tangent, axis=1), np.sum(error * axis, axis=1)
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


def _on_ideal_path(recording: "Recording", truth: TrueObject) -> tuple[Array, Array]:
    """Distances (N,) [m] of the true tip at work from the ideal path, and arc lengths there.

    On a deformed object the ideal path is the path of the clean object, projected onto the true
    surface along its tool axes. The distance then combines the distance from the path across these
    axes and the distance from the true surface.
    """
    rows = np.flatnonzero(recording.within(WorkState.WORK))
    tip_T = _in_object(recording, truth, rows, _path_pose(recording, truth))[0]
    path = truth.model.path(truth.path)
    p, a = np.asarray(path.p), np.asarray(path.a)

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
        Times (N,) [s] and angles (N,) [rad], right-handed about the tool axis; the smallest of
        those to the points of
        the path within CORNER of its nearest: in a corner the tool may be turned like either side,
            or as between them.
    """
    rows, X_WT, path = (
        _rows_at_work(recording),
        _path_pose(recording, truth),
        truth.model.path(truth.path),
    )

    tip_T, R = _in_object(recording, truth, rows, X_WT)
    axis, x = (_turned_back(R, recording[name].value[rows]) for name in ("tool_axis", "tool_x"))
    p, b_at = _finely(path)
    from scipy.spatial import cKDTree

    tree = cKDTree(p)
    near = tree.query_ball_point(p[tree.query(tip_T)[1]], CORNER)
    first = np.cumsum([0, *(len(points) for points in near[:-1])])
    row, point = (
        np.repeat(np.arange(len(near)), [len(points) for points in near]),
        np.concatenate(near).astype(np.int64),
    )

    # Angle from the axis b of every point of the path near the tip's point.
    b, axis, x = b_at[point], axis[row], x[row]
    flat = b - np.sum(b * axis, axis=1, keepdims=True) * axis
    angle = np.arctan2(np.sum(np.cross(flat, x) * axis, axis=1), np.sum(flat * x, axis=1))

    # The smallest of these angles; 0 if they have both signs.
    least, most = np.minimum.reduceat(angle, first), np.maximum.reduceat(angle, first)
    angle = np.where(
        (least < 0.0) & (most > 0.0), 0.0, np.where(np.abs(least) < np.abs(most), least, most)
    )

    return recording["tool_x"].time[rows], angle


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
    R, origin = np.broadcast_to(X_WT[:3, :3], (len(rows), 3, 3)), X_WT[:3, 3]
    if "p_WT" in recording:
        from scipy.spatial.transform import Rotation

        moved = Rotation.from_quat(
            recording["quat_WT_wxyz"].value[rows], scalar_first=True
        ).as_matrix()
        same = inverse(truth.X_WT) @ X_WT
        R, origin = moved @ same[:3, :3], recording["p_WT"].value[rows] + moved @ same[:3, 3]

    return _turned_back(R, recording["p_pad"].value[rows] - origin), R


def _turned_back(R: Array, vectors: Array) -> Array:
    """R^T v for each row, with R (N, 3, 3) and vectors v (N, 3)."""
    return np.einsum("nji,nj->ni", R, vectors)


def _rows_at_work(recording: "Recording") -> np.ndarray:
    """Rows (N,) of the series in the work state, at TILT_RATE."""
    every = max(1, round(1.0 / (TILT_RATE * recording.timestep)))
    return np.flatnonzero(recording.within(WorkState.WORK))[::every]


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

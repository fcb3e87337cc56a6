"""Inspection flight: the hull orbits a found object once, at a set distance, with the camera facing it.

The trajectory is laid on the model and carried to the real object by the identified pose [Konoplin 2019, section 2].
Its eq. 6, x'(t) = H + M_r (x(t) + p_1 - H) + p_2, is R x + p with the pose X_WT of the model frame.

On the model the line has a set horizontal distance from the object's outline, as seen from above. It is straight along
the sides of the outline and circular around its corners. The camera moves along it. The hull is level and has the
heading at which the camera faces the outline. A periodic cubic B-spline removes the jumps of curvature.

settle -> scan -> close-in -> work -> done
            any of these -> abort
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, splprep
from scipy.spatial import ConvexHull

from controllers.mkps import Chain
from controllers.planning.hull_path import HullPath
from controllers.planning.trajectories import PoseMove, Progress
from models.objects.targets import TargetModel
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError, ReachError
from sim.interfaces.messages import AbortCode, Command, Reference, StateEstimate, Target, WorkState
from sim.interfaces.spatial import Array, exp_so3, pose, readonly, rotation_from_z, transform_points

_STEP = 0.02  # [m] distance between samples of the line
_SMOOTH = 0.002  # [m] RMS distance of the spline from the line
_LEVEL_VIEW = 0.2  # least horizontal part of the camera's unit axis: facing straight down it sees no side
_CHECKED = 0.1  # [m] distance between the poses whose clearance is tested
_ZERO = readonly(np.zeros(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionJob:
    """Distances, speeds and limits of an inspection."""

    distance: float = 1.4  # [m] camera to outline at half the object's height, along the camera's axis
    clearance: float = 0.3  # [m] least distance of hull and folded arm to object and seabed
    speed: float = 0.15  # [m/s] of the hull
    acceleration: float = 0.05  # [m/s^2] of the hull
    turn_rate: float = 0.1  # [rad/s] of the hull
    settle_speed: float = 0.03  # [m/s] below which the hull counts as at rest, together with
    settle_turn: float = 0.02  # [rad/s]
    settle_time: float = 3.0  # [s] for which it must be at rest
    settle_limit: float = 60.0  # [s] within which that must be reached
    behind: tuple[float, float] = (0.1, 0.25)  # [m] lag of the hull at which progress slows down, and stops
    lost_place: float = 0.8  # [m] position error of the hull above which the inspection ends

    def __post_init__(self) -> None:
        for name in ("distance", "clearance", "speed", "acceleration", "turn_rate", "lost_place"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigurationError(f"inspection {name}: must be > 0, got {value}")
        if not 0.0 < self.behind[0] < self.behind[1] < self.lost_place:
            raise ConfigurationError("inspection: 0 < behind[0] < behind[1] < lost_place [m] must hold")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orbit:
    """Closed line around an object, travelled once, of camera and hull; the last sample equals the first."""

    s: Array  # (N,) [m] arc length of the camera's line
    p_WC: Array  # (N, 3) [m] positions of the camera
    p_WB: Array  # (N, 3) [m] positions of the hull
    yaw: Array  # (N,) [rad] heading of the hull, unwrapped

    def at(self, s: float) -> tuple[Array, Array, Array]:
        """Hull pose X_WB (4, 4) at arc length `s` [m], and its derivatives with respect to s.

        The derivatives are those of the origin (3,) and of the orientation (3,) [rad/m], in W.
        """
        i = int(np.clip(np.searchsorted(self.s, s) - 1, 0, len(self.s) - 2))
        h = self.s[i + 1] - self.s[i]
        share = (s - self.s[i]) / h
        p = (1.0 - share) * self.p_WB[i] + share * self.p_WB[i + 1]
        yaw = (1.0 - share) * self.yaw[i] + share * self.yaw[i + 1]
        turn = np.array([0.0, 0.0, (self.yaw[i + 1] - self.yaw[i]) / h])
        return pose(exp_so3([0.0, 0.0, yaw]), p), (self.p_WB[i + 1] - self.p_WB[i]) / h, turn

    def pace(self, job: InspectionJob) -> Progress:
        """Progress from rest to rest along the orbit, within the job's speed, acceleration and turn rate."""
        way, yaw = (np.gradient(values, self.s, axis=0) for values in (self.p_WB, self.yaw))
        longest = float(np.linalg.norm(way, axis=1).max())
        bend = float(np.linalg.norm(np.gradient(way, self.s, axis=0), axis=1).max())
        half = job.acceleration / np.sqrt(2.0)  # the components along and across the line add up to the limit
        rate = min(job.speed / longest, job.turn_rate / max(float(np.abs(yaw).max()), 1e-9), np.sqrt(half / bend))
        return Progress(float(self.s[-1]), rate, rate * longest / half)


def offset_outline(vertices_T: Array, up_T: Array, distance: float) -> tuple[Array, Array]:
    """Closed horizontal line at a set distance around an object, at half its height, counter-clockwise from above.

    Args:
        vertices_T: (V, 3) [m] vertices of the object in T.
        up_T: (3,) vertical direction in T.
        distance: [m] horizontal distance from the outline.

    Returns:
        The line (N, 3) [m] in T, its last point its first, and the horizontal unit directions (N, 3) to the outline.
    """
    axes = rotation_from_z(up_T, np.eye(3)[int(np.argmin(np.abs(up_T)))]).T
    seen = vertices_T @ axes.T
    outline = seen[ConvexHull(seen[:, :2]).vertices, :2]
    sides = np.roll(outline, -1, axis=0) - outline
    out = np.arctan2(-sides[:, 0], sides[:, 1])  # [rad] direction of each side's outward normal
    points: list[Array] = []
    for corner, side, before, after in zip(outline, sides, np.roll(out, 1), out, strict=True):
        turn = (after - before) % (2.0 * np.pi)
        angles = before + np.linspace(0.0, turn, 1 + math.ceil(turn * distance / _STEP))
        points.append(corner + distance * np.column_stack([np.cos(angles), np.sin(angles)]))
        shares = np.arange(1, math.ceil(np.linalg.norm(side) / _STEP))[:, None] * _STEP / np.linalg.norm(side)
        points.append(points[-1][-1] + shares * side)
    raw = np.vstack(points)
    raw = np.vstack([raw[np.linalg.norm(raw - np.roll(raw, 1, axis=0), axis=1) > 1e-6], raw[:1]])
    (knots, coefficients, degree), _ = splprep(raw.T, per=True, s=len(raw) * _SMOOTH**2)
    curve = BSpline(knots, np.transpose(coefficients), degree)
    length = float(np.linalg.norm(np.diff(raw, axis=0), axis=1).sum())
    u = np.linspace(0.0, 1.0, 1 + math.ceil(length / _STEP))
    line, way = curve(u), curve(u, 1)
    line[-1], way[-1] = line[0], way[0]
    inward = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1, keepdims=True)
    middle = 0.5 * (seen[:, 2].min() + seen[:, 2].max())
    return np.column_stack([line, np.full(len(line), middle)]) @ axes, inward @ axes[:2]


def orbit(target: TargetModel, X_WT: Array, job: InspectionJob, *, X_BC: Array, near_W: Array) -> Orbit:
    """Orbit of a camera on the hull around an object.

    Args:
        target: model of the object.
        X_WT: (4, 4) its pose in W.
        job: distances and limits.
        X_BC: (4, 4) pose of the camera in the hull, z its axis.
        near_W: (3,) [m] the orbit begins where the camera is nearest to this point.

    Returns:
        The orbit in W.

    Raises:
        ConfigurationError: for a camera that faces straight down or up.
    """
    view = X_BC[:3, 2]
    level = float(np.hypot(view[0], view[1]))
    if level < _LEVEL_VIEW:
        raise ConfigurationError("inspection: the camera looks straight down or up, it does not see an object's sides")
    line_T, inward_T = offset_outline(target.vertices, X_WT[:3, :3].T @ np.array([0.0, 0.0, 1.0]), level * job.distance)
    p_WC = transform_points(X_WT, line_T) - [0.0, 0.0, view[2] * job.distance]  # [Konoplin 2019, eq. 6]
    inward_W = inward_T @ X_WT[:3, :3].T
    first = int(np.argmin(np.linalg.norm(p_WC[:-1] - near_W, axis=1)))
    p_WC, inward_W = (np.vstack([np.roll(each[:-1], -first, axis=0), each[first]]) for each in (p_WC, inward_W))
    yaw = np.unwrap(np.arctan2(inward_W[:, 1], inward_W[:, 0]) - np.arctan2(view[1], view[0]))
    lever = X_BC[:3, 3]
    turned = np.column_stack(
        [
            np.cos(yaw) * lever[0] - np.sin(yaw) * lever[1],
            np.sin(yaw) * lever[0] + np.cos(yaw) * lever[1],
            np.full(len(yaw), lever[2]),
        ]
    )
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p_WC, axis=0), axis=1))])
    return Orbit(s=readonly(s), p_WC=readonly(p_WC), p_WB=readonly(p_WC - turned), yaw=readonly(yaw))


@dataclass(slots=True, eq=False)
class InspectionState:
    """State of the inspection."""

    state: WorkState
    since: float  # [s] time at which the state was entered
    X_WB: Array  # (4, 4) hull pose reference
    v_WB_W: Array  # (3,) [m/s] its velocity
    w_WB_W: Array  # (3,) [rad/s] its angular velocity
    quiet_since: float = np.inf  # [s] time since when the hull is at rest; inf: it is not
    orbit: Orbit | None = None
    progress: Progress | None = None  # along the orbit
    move: PoseMove | None = None
    worked: float = 0.0  # [s] time argument of `progress`
    path_s: float = 0.0  # [m] arc length along the orbit
    abort: AbortCode | None = None  # why the inspection was broken off
    reason: str = ""  # the same in a sentence


class Inspection:
    """Planner (`sim.interfaces.protocols.Planner`) that views one known object from all sides, its arm folded."""

    def __init__(
        self,
        vehicle: Vehicle,
        chain: Chain,
        target: TargetModel,
        job: InspectionJob,
        *,
        X_WB_scan: Array,
        hull_box: Array,
        X_BC: Array,
        floor: float = -np.inf,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            vehicle: the vehicle.
            chain: its arm, base to tool.
            target: model of the object.
            job: distances, speeds and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            hull_box: (2, 3) [m] corners of the hull in B.
            X_BC: (4, 4) pose of the camera in the hull.
            floor: [m] height of the seabed in W.
            period: [s] of the planner.
        """
        self.period = period
        self._vehicle, self._chain, self._target, self._job = vehicle, chain, target, job
        self._X_WB_scan, self._hull_box, self._X_BC, self._floor = np.array(X_WB_scan), hull_box, X_BC, floor

    def init(self, estimate: StateEstimate) -> InspectionState:
        """State at the start: settling before the scan."""
        return InspectionState(
            state=WorkState.SETTLE, since=estimate.time, X_WB=self._X_WB_scan, v_WB_W=_ZERO, w_WB_W=_ZERO
        )

    def step(
        self, state: InspectionState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[InspectionState, Reference]:
        """Advance the inspection by one period.

        Args:
            state: state of the inspection, changed in place.
            estimate: estimated state of the vehicle.
            target: newest identification, if any.
            last: the controller's last command; not used.

        Returns:
            The state and the reference for the controller.
        """
        del last
        time = estimate.time
        over = state.state in (WorkState.DONE, WorkState.ABORT)
        off = math.dist(estimate.X_WB[:3, 3].tolist(), state.X_WB[:3, 3].tolist())
        if off > self._job.lost_place and not over:
            self._give_up(state, time, AbortCode.HULL_ADRIFT, f"the hull cannot hold its place: {off:.2f} m off")
        match state.state:
            case WorkState.SETTLE:
                if self._quiet(state, estimate):
                    self._enter(state, WorkState.SCAN, time)
            case WorkState.SCAN:
                self._scan(state, time, target)
            case WorkState.CLOSE_IN:
                self._close_in(state, estimate)
            case WorkState.WORK:
                self._work(state, time, off)
        return state, self._reference(state, time)

    def _enter(self, state: InspectionState, what: WorkState, time: float) -> None:
        """Change to another state, the hull reference at rest."""
        state.state, state.since, state.quiet_since = what, time, np.inf
        state.v_WB_W = state.w_WB_W = _ZERO

    def _give_up(self, state: InspectionState, time: float, code: AbortCode, reason: str) -> None:
        """End the inspection where the vehicle is, for the given reason."""
        state.abort, state.reason = code, reason
        self._enter(state, WorkState.ABORT, time)

    def _quiet(self, state: InspectionState, estimate: StateEstimate) -> bool:
        """True once the hull has been at rest for `settle_time`; gives up after `settle_limit`."""
        job, time = self._job, estimate.time
        moving = float(np.linalg.norm(estimate.v_WB_B)) > job.settle_speed
        if moving or float(np.linalg.norm(estimate.w_WB_B)) > job.settle_turn:
            state.quiet_since = np.inf
        elif not math.isfinite(state.quiet_since):
            state.quiet_since = time
        if time - state.since > job.settle_limit + (state.move.duration if state.move else 0.0):
            said = f"the hull does not come to rest within {job.settle_limit:g} s"
            self._give_up(state, time, AbortCode.HULL_NOT_AT_REST, said)
        return time - state.quiet_since > job.settle_time

    def _scan(self, state: InspectionState, time: float, target: Target | None) -> None:
        """Plan the orbit and the move to its start from the first identification; give up without one."""
        if target is None or target.time < state.since:
            if time - state.since > 5.0:
                self._give_up(state, time, AbortCode.NO_FRAME, "no depth frame arrived within 5 s")
            return
        if not target.accepted:
            self._give_up(state, time, AbortCode.NOT_IDENTIFIED, f"not identified: {target.reason}")
            return
        near_W = transform_points(state.X_WB, self._X_BC[None, :3, 3])[0]
        found = orbit(self._target, target.X_WT, self._job, X_BC=self._X_BC, near_W=near_W)
        X_WB = found.at(0.0)[0]
        move = PoseMove.between(
            time,
            state.X_WB,
            X_WB,
            speed=self._job.speed,
            acceleration=self._job.acceleration,
            turn_rate=self._job.turn_rate,
        )
        try:
            self._check_clear(found, move, target.X_WT)
        except ReachError as error:
            self._give_up(state, time, AbortCode.NO_CLEAR_WAY, str(error))
            return
        self._enter(state, WorkState.CLOSE_IN, time)
        state.orbit, state.progress, state.move = found, found.pace(self._job), move

    def _check_clear(self, found: Orbit, move: PoseMove, X_WT: Array) -> None:
        """Raise ReachError if hull or folded arm would come too near to the object or the seabed."""
        obstacle = transform_points(X_WT, self._target.vertices)
        passing = HullPath(self._vehicle, self._chain, self._hull_box, obstacle)
        ways = {
            "on the way around": [found.at(s)[0] for s in np.arange(0.0, found.s[-1], _CHECKED)],
            "on the way there": [move.at(move.start + share * move.duration)[0] for share in np.linspace(0.0, 1.0, 20)],
        }
        for where, poses in ways.items():
            for X_WB in poses:
                gap, height = passing.gap(X_WB), passing.lowest(X_WB) - self._floor
                if gap < self._job.clearance:
                    raise ReachError(
                        f"{where} the vehicle would come within {gap:.2f} m of the object, {self._job.clearance:g} m "
                        "are to be kept"
                    )
                if height < self._job.clearance:
                    raise ReachError(
                        f"{where} the vehicle would come within {height:.2f} m of the seabed, "
                        f"{self._job.clearance:g} m are to be kept"
                    )

    def _close_in(self, state: InspectionState, estimate: StateEstimate) -> None:
        """Move to the start of the orbit and wait there until the hull is at rest."""
        assert state.move is not None
        state.X_WB, state.v_WB_W = state.move.at(estimate.time)
        if state.move.done(estimate.time) and self._quiet(state, estimate):
            self._enter(state, WorkState.WORK, estimate.time)

    def _work(self, state: InspectionState, time: float, behind: float) -> None:
        """Advance along the orbit, no faster than the hull follows."""
        assert state.orbit is not None
        assert state.progress is not None
        near, far = self._job.behind
        pace = min(max((far - behind) / (far - near), 0.0), 1.0)
        state.worked += pace * self.period
        state.path_s, rate = state.progress.at(state.worked)
        state.X_WB, way, turn = state.orbit.at(state.path_s)
        state.v_WB_W, state.w_WB_W = pace * rate * way, pace * rate * turn
        if state.worked > state.progress.duration:
            self._enter(state, WorkState.DONE, time)

    def _reference(self, state: InspectionState, time: float) -> Reference:
        """Reference for the controller in the present state."""
        n = len(self._vehicle.q_home)
        return Reference(
            time=time,
            state=state.state,
            X_WB=state.X_WB,
            v_WB_W=state.v_WB_W,
            w_WB_W=state.w_WB_W,
            X_WG=None,
            v_WG_W=_ZERO,
            w_WG_W=_ZERO,
            q=np.array(self._vehicle.q_home),
            qd=np.zeros(n),
            force=0.0,
            force_control=False,
            tare=False,
            scan=state.state is WorkState.SCAN,
            path_s=state.path_s,
            abort=state.abort,
            note=state.reason,
        )

"""Inspection flight: the hull goes once around a found object at a set distance and keeps looking at it.

Paper 004, second section: the trajectory is laid on the model and carried to the real object by the pose that was
found, eq. (6): x'(t) = H + M_r (x(t) + p_1 - H) + p_2, which is R x + p with the pose of the model frame, X_WT.

On the model it is the line of a set level distance from its outline, as seen from above: straight along the outline's
sides and round about its corners. Along it goes the camera; the hull is level and turned so that the camera looks
straight at the outline. A periodic cubic B-spline takes away the jumps of curvature.

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
from sim.interfaces.messages import Command, Reference, StateEstimate, Target, WorkState
from sim.interfaces.spatial import Array, exp_so3, pose, readonly, rotation_from_z, transform_points

_STEP = 0.02  # [m] between samples of the line
_SMOOTH = 0.002  # [m] RMS by which the spline may leave it
_LEVEL_VIEW = 0.2  # least level part of the camera's axis: one that looks straight down sees no side
_CHECKED = 0.1  # [m] between the poses at which the hull's clearance is checked
_ZERO = readonly(np.zeros(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionJob:
    """What is to be kept on the way around."""

    distance: float = 1.4  # [m] camera to the object's outline at half its height, along the camera's axis
    clearance: float = 0.3  # [m] hull and folded arm to the object, and to the seabed
    speed: float = 0.15  # [m/s] of the hull
    acceleration: float = 0.05  # [m/s^2]
    turn_rate: float = 0.1  # [rad/s]
    settle_speed: float = 0.03  # [m/s] and
    settle_turn: float = 0.02  # [rad/s] below which the hull counts as quiet,
    settle_time: float = 3.0  # [s] that it must be, within
    settle_limit: float = 60.0  # [s]
    behind: tuple[float, float] = (0.1, 0.25)  # [m] how far the hull is behind where the way slows down, and waits
    lost_place: float = 0.8  # [m] off its place at which it counts as carried away

    def __post_init__(self) -> None:
        for name in ("distance", "clearance", "speed", "acceleration", "turn_rate", "lost_place"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigurationError(f"inspection {name}: must be > 0, got {value}")
        if not 0.0 < self.behind[0] < self.behind[1] < self.lost_place:
            raise ConfigurationError("inspection: 0 < behind[0] < behind[1] < lost_place [m] must hold")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orbit:
    """A closed line around an object, once, as the camera and the hull go; the last sample is the first."""

    s: Array  # (N,) [m] arc length of the camera's way
    p_WC: Array  # (N, 3) [m] the camera
    p_WB: Array  # (N, 3) [m] the hull
    yaw: Array  # (N,) [rad] of the hull, without jumps

    def at(self, s: float) -> tuple[Array, Array, Array]:
        """Hull pose (4, 4) at `s` [m], and its change with s: of the origin (3,), and of the turn (3,) [rad/m]."""
        i = int(np.clip(np.searchsorted(self.s, s) - 1, 0, len(self.s) - 2))
        h = self.s[i + 1] - self.s[i]
        share = (s - self.s[i]) / h
        p = (1.0 - share) * self.p_WB[i] + share * self.p_WB[i + 1]
        yaw = (1.0 - share) * self.yaw[i] + share * self.yaw[i + 1]
        turn = np.array([0.0, 0.0, (self.yaw[i + 1] - self.yaw[i]) / h])
        return pose(exp_so3([0.0, 0.0, yaw]), p), (self.p_WB[i + 1] - self.p_WB[i]) / h, turn

    def pace(self, job: InspectionJob) -> Progress:
        """From rest to rest along it within the job's speed, acceleration and turn rate."""
        way, yaw = (np.gradient(values, self.s, axis=0) for values in (self.p_WB, self.yaw))
        longest = float(np.linalg.norm(way, axis=1).max())
        bend = float(np.linalg.norm(np.gradient(way, self.s, axis=0), axis=1).max())
        half = job.acceleration / np.sqrt(2.0)  # along the way and across it together
        rate = min(job.speed / longest, job.turn_rate / max(float(np.abs(yaw).max()), 1e-9), np.sqrt(half / bend))
        return Progress(float(self.s[-1]), rate, rate * longest / half)


def around(vertices_T: Array, up_T: Array, distance: float) -> tuple[Array, Array]:
    """The closed line (N, 3) [m] of level `distance` [m] around the outline of `vertices_T` (V, 3), its last point its
    first, and the level unit ways (N, 3) to the outline; frame T, `up_T` (3,) the vertical. Counter-clockwise from
    above, at half the object's height.
    """
    axes = rotation_from_z(up_T, np.eye(3)[int(np.argmin(np.abs(up_T)))]).T
    seen = vertices_T @ axes.T
    outline = seen[ConvexHull(seen[:, :2]).vertices, :2]
    sides = np.roll(outline, -1, axis=0) - outline
    out = np.arctan2(-sides[:, 0], sides[:, 1])  # of each side's outward normal
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
    """The line around `target` at `X_WT` (4, 4) for a camera at `X_BC` (4, 4) in the hull, z its axis.

    It begins where the camera is nearest to `near_W` (3,) [m]. Raises ConfigurationError for a camera that looks
    straight down or up.
    """
    view = X_BC[:3, 2]
    level = float(np.hypot(view[0], view[1]))
    if level < _LEVEL_VIEW:
        raise ConfigurationError("inspection: the camera looks straight down or up, it does not see an object's sides")
    line_T, inward_T = around(target.vertices, X_WT[:3, :3].T @ np.array([0.0, 0.0, 1.0]), level * job.distance)
    p_WC = transform_points(X_WT, line_T) - [0.0, 0.0, view[2] * job.distance]  # eq. (6)
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
    """Where the inspection stands."""

    state: WorkState
    since: float  # [s] the state was entered
    X_WB: Array  # (4, 4) hull pose asked for
    v_WB_W: Array  # (3,) [m/s] of it
    w_WB_W: Array  # (3,) [rad/s]
    quiet_since: float = np.inf  # [s]
    orbit: Orbit | None = None
    progress: Progress | None = None  # along the orbit
    move: PoseMove | None = None
    worked: float = 0.0  # [s] along the orbit's law of motion
    path_s: float = 0.0  # [m]
    reason: str = ""  # why it was broken off


class Inspection:
    """Planner (`sim.interfaces.protocols.Planner`) that looks at one known object from all around, its arm folded."""

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
        """Take the vehicle and its arm, the object's model, the job, and where to scan from, (4, 4) in W.

        `hull_box` (2, 3) [m] are the corners of the hull in B, `X_BC` (4, 4) is the camera in it, `floor` [m] the
        height of the seabed in W.
        """
        self.period = period
        self._vehicle, self._chain, self._target, self._job = vehicle, chain, target, job
        self._X_WB_scan, self._hull_box, self._X_BC, self._floor = np.array(X_WB_scan), hull_box, X_BC, floor

    def init(self, estimate: StateEstimate) -> InspectionState:
        return InspectionState(
            state=WorkState.SETTLE, since=estimate.time, X_WB=self._X_WB_scan, v_WB_W=_ZERO, w_WB_W=_ZERO
        )

    def step(
        self, state: InspectionState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[InspectionState, Reference]:
        del last
        time = estimate.time
        over = state.state in (WorkState.DONE, WorkState.ABORT)
        off = math.dist(estimate.X_WB[:3, 3].tolist(), state.X_WB[:3, 3].tolist())
        if off > self._job.lost_place and not over:
            self._give_up(state, time, f"the hull cannot hold its place: {off:.2f} m off")
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
        state.state, state.since, state.quiet_since = what, time, np.inf
        state.v_WB_W = state.w_WB_W = _ZERO

    def _give_up(self, state: InspectionState, time: float, reason: str) -> None:
        state.reason = reason
        self._enter(state, WorkState.ABORT, time)

    def _quiet(self, state: InspectionState, estimate: StateEstimate) -> bool:
        """Whether the hull has been still for long enough; gives up where it never is."""
        job, time = self._job, estimate.time
        moving = float(np.linalg.norm(estimate.v_WB_B)) > job.settle_speed
        if moving or float(np.linalg.norm(estimate.w_WB_B)) > job.settle_turn:
            state.quiet_since = np.inf
        elif not math.isfinite(state.quiet_since):
            state.quiet_since = time
        if time - state.since > job.settle_limit + (state.move.duration if state.move else 0.0):
            self._give_up(state, time, f"the hull does not come to rest within {job.settle_limit:g} s")
        return time - state.quiet_since > job.settle_time

    def _scan(self, state: InspectionState, time: float, target: Target | None) -> None:
        if target is None or target.time < state.since:
            if time - state.since > 5.0:
                self._give_up(state, time, "no depth frame arrived within 5 s")
            return
        if not target.accepted:
            self._give_up(state, time, f"not identified: {target.reason}")
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
            self._give_up(state, time, str(error))
            return
        self._enter(state, WorkState.CLOSE_IN, time)
        state.orbit, state.progress, state.move = found, found.pace(self._job), move

    def _check_clear(self, found: Orbit, move: PoseMove, X_WT: Array) -> None:
        """Raise ReachError where hull or folded arm would come too near to the object or the seabed."""
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
        assert state.move is not None
        state.X_WB, state.v_WB_W = state.move.at(estimate.time)
        if state.move.done(estimate.time) and self._quiet(state, estimate):
            self._enter(state, WorkState.WORK, estimate.time)

    def _work(self, state: InspectionState, time: float, behind: float) -> None:
        """On along the orbit, no faster than the hull follows."""
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
            note=state.reason,
        )

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
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.interpolate import BSpline, splprep
from scipy.spatial import ConvexHull

from controllers.planning.hull_path import HullPath
from controllers.planning.trajectories import PoseMove, Progress
from controllers.planning.work_vehicle import WorkVehicle
from controllers.tasks.arrival import ScanLimits, ScanTarget
from controllers.tasks.hull_phases import HullMotion, MoveHull, RestLimits, Settle
from controllers.tasks.monitors import Monitor, Reaction, adrift
from controllers.tasks.phase import ZERO, Context, Decide, Held, Hold, Outcome, Phase, PhaseEvent, Setpoint
from controllers.tasks.task import TaskPlanner, TaskRow, at_once
from models.objects.targets import TargetModel
from sim.interfaces.errors import ConfigurationError, ReachError
from sim.interfaces.messages import AbortCode, WorkState
from sim.interfaces.spatial import Array, exp_so3, pose, readonly, rotation_from_z, transform_points

_STEP = 0.02  # [m] distance between samples of the line
_SMOOTH = 0.002  # [m] RMS distance of the spline from the line
_LEVEL_VIEW = 0.2  # least horizontal part of the camera's unit axis: facing straight down it sees no side
_CHECKED = 0.1  # [m] distance between the poses whose clearance is tested


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionJob:
    """Distances, speeds and limits of an inspection."""

    distance: float = 1.4  # [m] camera to outline at half the object's height, along the camera's axis
    clearance: float = 0.3  # [m] least distance of hull and folded arm to object and seabed
    speed: float = 0.15  # [m/s] of the hull
    acceleration: float = 0.05  # [m/s^2] of the hull
    turn_rate: float = 0.1  # [rad/s] of the hull
    rest: RestLimits = field(default_factory=partial(RestLimits, speed=0.03, error=math.inf, time=3.0))
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
class OrbitState:
    """State of `FlyOrbit`."""

    orbit: Orbit
    progress: Progress
    worked: float = 0.0  # [s] time argument of `progress`
    v_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [m/s]
    w_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [rad/s]


class FlyOrbit(Phase):
    """Move the hull along the orbit of `Held.plan`, no faster than the hull follows."""

    def __init__(self, job: InspectionJob) -> None:
        self._job = job

    def enter(self, held: Held, now: Context) -> OrbitState:
        """Begin at rest."""
        del now
        assert isinstance(held.plan, Orbit)
        return OrbitState(held.plan, held.plan.pace(self._job))

    def step(self, state: OrbitState, held: Held, now: Context) -> Outcome:
        """Done once around."""
        near, far = self._job.behind
        pace = min(max((far - held.off(now.estimate)) / (far - near), 0.0), 1.0)
        state.worked += pace * now.period
        held.s, rate = state.progress.at(state.worked)
        held.X_WB, way, turn = state.orbit.at(held.s)
        state.v_WB_W, state.w_WB_W = pace * rate * way, pace * rate * turn
        return PhaseEvent.DONE if state.worked > state.progress.duration else None

    def setpoint(self, state: OrbitState, held: Held, now: Context) -> Setpoint:
        """The hull's velocity."""
        del held, now
        return Setpoint(v_WB_W=state.v_WB_W, w_WB_W=state.w_WB_W)


class Inspection(TaskPlanner):
    """Planner (`sim.interfaces.protocols.Planner`) that views one known object from all sides, its arm folded."""

    def __init__(
        self,
        own: WorkVehicle,
        target: TargetModel,
        job: InspectionJob,
        *,
        X_WB_scan: Array,
        floor: float = -np.inf,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            own: the vehicle.
            target: model of the object.
            job: distances, speeds and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            floor: [m] height of the seabed in W.
            period: [s] of the planner.
        """
        motion = HullMotion(speed=job.speed, acceleration=job.acceleration, turn_rate=job.turn_rate, behind=None)

        def plan(held: Held, now: Context) -> None:
            assert held.target is not None
            X_WT = held.target.X_WT
            near_W = transform_points(held.X_WB, own.X_BC[None, :3, 3])[0]
            found = orbit(target, X_WT, job, X_BC=own.X_BC, near_W=near_W)
            X_WB = found.at(0.0)[0]
            passing = HullPath(own.vehicle, own.chain, own.hull_box, transform_points(X_WT, target.vertices))
            check_clear(found, motion.to(X_WB, held, now), passing, floor=floor, clearance=job.clearance)
            held.plan, held.way = found, [X_WB]

        monitor = Monitor(condition=adrift(job.lost_place), reaction=Reaction.RETREAT, code=AbortCode.HULL_ADRIFT)
        rows = inspection_rows(job, motion, Decide(plan, AbortCode.NO_CLEAR_WAY))
        super().__init__(rows, [monitor], X_WB=X_WB_scan, q=own.vehicle.q_home, period=period)


def inspection_rows(job: InspectionJob, motion: HullMotion, plan: Decide) -> Iterable[tuple[str, TaskRow]]:
    """Table of the inspection.

    Args:
        job: distances, speeds and limits.
        motion: limits of the hull's move to the orbit.
        plan: chooses the orbit.

    Returns:
        Names and rows.
    """
    settle, states = Settle(job.rest), WorkState
    row = partial(TaskRow, leave={Reaction.RETREAT: "held"})
    scan = ScanTarget(ScanLimits(views=1, finds=1), path=False)
    yield "settle", row(settle, states.SETTLE, {PhaseEvent.DONE: "scan"})
    yield "scan", row(scan, states.SCAN, {PhaseEvent.DONE: at_once("plan")})
    yield "plan", row(plan, states.SCAN, {PhaseEvent.DONE: "travel"})
    yield "travel", row(MoveHull(motion), states.CLOSE_IN, {PhaseEvent.DONE: at_once("rest")})
    yield "rest", row(settle, states.CLOSE_IN, {PhaseEvent.DONE: "orbit"})
    yield "orbit", row(FlyOrbit(job), states.WORK, {PhaseEvent.DONE: "held"})
    yield "held", TaskRow(Hold(), states.DONE)


def check_clear(found: Orbit, move: PoseMove, passing: HullPath, *, floor: float, clearance: float) -> None:
    """Check the distance of hull and folded arm to the object and the seabed on the whole way.

    Args:
        found: the orbit.
        move: of the hull to its begin.
        passing: distances to the object.
        floor: [m] height of the seabed in W.
        clearance: [m] to keep.

    Raises:
        ReachError: if it is not kept.
    """
    ways = {
        "on the way around": [found.at(s)[0] for s in np.arange(0.0, found.s[-1], _CHECKED)],
        "on the way there": [move.at(move.start + share * move.duration)[0] for share in np.linspace(0.0, 1.0, 20)],
    }
    for where, poses in ways.items():
        for X_WB in poses:
            for gap, what in ((passing.gap(X_WB), "object"), (passing.lowest(X_WB) - floor, "seabed")):
                if gap < clearance:
                    said = f"{where} the vehicle would come within {gap:.2f} m of the {what}"
                    raise ReachError(f"{said}, {clearance:g} m are to be kept")

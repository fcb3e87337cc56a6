"""Inspection flight: the hull orbits a known object, at several levels if it has to cover it.

The trajectory is laid on the model and carried to the real object by the identified pose [Konoplin
2019, section 2]. Its eq. 6, x'(t) = H + M_r (x(t) + p_1 - H) + p_2, is R x + p with the pose X_WT
of the model frame.

On the model the line has a set horizontal distance from the object's outline, as seen from above.
It is straight along the sides of the outline and circular around its corners. The camera moves
along it. The hull is level and has the heading at which the camera faces the outline. A periodic
cubic B-spline removes the jumps of curvature.

settle -> scan -> close-in -> work -> done
                     ^---------'  next level
            any of these -> abort
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from uuv.controllers.planning.hull_path import HullPath
from uuv.controllers.planning.outline import offset_outline
from uuv.controllers.planning.trajectories import PoseMove, Progress
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import ScanLimits, ScanTarget
from uuv.controllers.tasks.hull_phases import HullMotion, MoveHull, RestLimits, Settle
from uuv.controllers.tasks.monitors import Monitor, Reaction, adrift
from uuv.controllers.tasks.phase import (
    ZERO,
    Context,
    Decide,
    Held,
    Hold,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
)
from uuv.controllers.tasks.settings import InspectionSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.models.meshes.visibility import SurfaceSamples, View
from uuv.models.objects.targets import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, readonly, transform_points

# least horizontal part of the camera's unit axis: facing straight down it sees no side
_LEVEL_VIEW = 0.2
_CHECKED = 0.1  # [m] distance between the poses whose clearance is tested
_OUT = (0.2, 0.5, 0.8, 1.2, 1.6)  # [m] further levels: from the outline
_UP = (0.2, 0.5, 0.8, 1.2, 1.6, 2.0)  # [m] above the object's top
_VIEWED = 0.3  # [m] distance between the poses whose view is planned
_ENOUGH = 0.99  # share of the surface visible from the levels that ends the choice of further ones
_AROUND = 1.6  # [m] allowed places: to this distance around the object's box
_APART = 0.4  # [m] their distance
_HEADINGS = 12  # number of headings at each of them


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionJob(InspectionSettings):
    """Settings, speeds and limits of an inspection."""

    acceleration: float = 0.05  # [m/s^2] of the hull
    turn_rate: float = 0.1  # [rad/s] of the hull
    rest: RestLimits = field(
        default_factory=partial(RestLimits, speed=0.03, error=math.inf, time=3.0)
    )
    # [m] lag of the hull at which progress slows down, and stops
    behind: tuple[float, float] = (0.1, 0.25)
    lost_place: float = 0.8  # [m] position error of the hull above which the inspection ends

    def __post_init__(self) -> None:
        for name in ("distance", "clearance", "speed", "acceleration", "turn_rate", "lost_place"):
            number = getattr(self, name)
            if not (math.isfinite(number) and number > 0.0):
                raise ConfigurationError(f"inspection {name}: must be > 0, got {number}")

        if not 0.0 < self.behind[0] < self.behind[1] < self.lost_place:
            raise ConfigurationError(
                "inspection: 0 < behind[0] < behind[1] < lost_place [m] must hold"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orbit:
    """Closed line of camera and hull around an object; the last sample equals the first."""

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
        """Progress from rest to rest along the orbit, within speed, acceleration and turn rate."""
        way, yaw = (np.gradient(samples, self.s, axis=0) for samples in (self.p_WB, self.yaw))
        longest = float(np.linalg.norm(way, axis=1).max())
        bend = float(np.linalg.norm(np.gradient(way, self.s, axis=0), axis=1).max())

        # the components along and across the line add up to the limit
        half = job.acceleration / np.sqrt(2.0)
        rate = min(
            job.speed / longest,
            job.turn_rate / max(float(np.abs(yaw).max()), 1e-9),
            np.sqrt(half / bend),
        )

        return Progress(float(self.s[-1]), rate, rate * longest / half)


@dataclass(frozen=True, slots=True)
class Level:
    """Level at which the camera moves around an object."""

    out: float  # [m] horizontal distance from the outline
    up: float  # [m] height above the object's middle


@dataclass(frozen=True, slots=True)
class HullCamera:
    """Camera on the hull."""

    X_BC: Array  # (4, 4) its pose in the hull, z its axis
    view: View


@dataclass(frozen=True, slots=True, eq=False)
class Keep:
    """Clearance of hull and folded arm from the object and the seabed."""

    passing: HullPath  # distances to the object
    floor: float  # [m] height of the seabed in W
    clearance: float  # [m]

    def short(self, poses: Iterable[Array]) -> tuple[float, str] | None:
        """First gap [m] below the clearance at hull `poses` (4, 4), and its obstacle; else None."""
        for X_WB in poses:
            for gap, what in (
                (self.passing.gap(X_WB), "object"),
                (self.passing.lowest(X_WB) - self.floor, "seabed"),
            ):
                if gap < self.clearance:
                    return gap, what
        return None

    def allows(self, X_WB: Array) -> bool:
        """True if nothing is `short` at a hull pose (4, 4)."""
        above = self.passing.lowest(X_WB) - self.floor >= self.clearance
        return above and self.passing.keeps(X_WB, self.clearance)


def orbit(
    target: TargetModel,
    X_WT: Array,
    job: InspectionJob,
    *,
    X_BC: Array,
    near_W: Array,
    level: Level | None = None,
) -> Orbit:
    """Orbit of a camera on the hull around an object.

    Args:
        target: model of the object.
        X_WT: (4, 4) its pose in W.
        job: distances and limits.
        X_BC: (4, 4) pose of the camera in the hull, z its axis.
        near_W: (3,) [m] the orbit begins where the camera is nearest to this point.
        level: where the camera goes round; None takes the job's distance along the camera's axis.

    Returns:
        The orbit in W.

    Raises:
        ConfigurationError: for a camera that faces straight down or up.
    """
    view = X_BC[:3, 2]
    ahead = float(np.hypot(view[0], view[1]))
    if ahead < _LEVEL_VIEW:
        raise ConfigurationError(
            "inspection: the camera looks straight down or up, it does not see an object's sides"
        )

    level = level or Level(ahead * job.distance, -view[2] * job.distance)
    line_T, inward_T = offset_outline(
        target.vertices, X_WT[:3, :3].T @ np.array([0.0, 0.0, 1.0]), level.out
    )
    p_WC = transform_points(X_WT, line_T) + np.array([0.0, 0.0, level.up])  # [Konoplin 2019, eq. 6]
    inward_W = inward_T @ X_WT[:3, :3].T

    # Begin where the camera is nearest
    first = int(np.argmin(np.linalg.norm(p_WC[:-1] - near_W, axis=1)))
    p_WC, inward_W = (
        np.vstack([np.roll(samples[:-1], -first, axis=0), samples[first]])
        for samples in (p_WC, inward_W)
    )

    # Heading of the hull, and its origin beside the camera
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
    return Orbit(
        s=readonly(s), p_WC=readonly(p_WC), p_WB=readonly(p_WC - turned), yaw=readonly(yaw)
    )


@dataclass(slots=True, eq=False)
class OrbitState:
    """State of `FlyOrbit`."""

    orbit: Orbit
    progress: Progress
    worked: float = 0.0  # [s] time argument of `progress`
    v_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [m/s]
    w_WB_W: Array = field(default_factory=lambda: ZERO)  # (3,) [rad/s]


class FlyOrbit(Phase):
    """Move the hull along the next orbit of `Held.plan`, no faster than the hull follows."""

    def __init__(self, job: InspectionJob) -> None:
        self._job = job

    def enter(self, held: Held, context: Context) -> OrbitState:
        """Begin at rest."""
        del context
        next_orbit: Orbit = held.plan_of(list).pop(0)
        return OrbitState(next_orbit, next_orbit.pace(self._job))

    def step(self, state: OrbitState, held: Held, context: Context) -> Outcome:
        """Report DONE after the last orbit, and MORE after any other."""
        near, far = self._job.behind
        pace = min(max((far - held.off(context.estimate)) / (far - near), 0.0), 1.0)

        # Progress as far as the hull follows
        state.worked += pace * context.period
        held.s, rate = state.progress.at(state.worked)
        held.X_WB, way, turn = state.orbit.at(held.s)
        state.v_WB_W = pace * rate * way
        state.w_WB_W = pace * rate * turn

        if state.worked <= state.progress.duration:
            return None
        if not held.plan:
            return PhaseEvent.DONE
        held.way = [held.plan_of(list)[0].at(0.0)[0]]
        return PhaseEvent.MORE

    def setpoint(self, state: OrbitState, held: Held, context: Context) -> Setpoint:
        """The hull's velocity."""
        del held, context
        return Setpoint(v_WB_W=state.v_WB_W, w_WB_W=state.w_WB_W)


class Inspection(TaskPlanner):
    """Planner that views one known object from all sides, its arm folded."""

    def __init__(
        self,
        own: WorkVehicle,
        target: TargetModel,
        job: InspectionJob,
        *,
        X_WB_scan: Array,
        floor: float = -np.inf,
        view: View | None = None,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            own: the vehicle.
            target: model of the object.
            job: distances, speeds and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            floor: [m] height of the seabed in W.
            view: of the camera: further orbits are flown until all that can be seen is seen; None
                flies one.
            period: [s] of the planner.
        """
        motion = HullMotion(
            speed=job.speed, acceleration=job.acceleration, turn_rate=job.turn_rate, behind=None
        )

        def plan(held: Held, context: Context) -> None:
            assert held.target is not None
            X_WT = held.target.X_WT
            near_W = transform_points(held.X_WB, own.X_BC[None, :3, 3])[0]
            first = orbit(target, X_WT, job, X_BC=own.X_BC, near_W=near_W)
            X_WB = first.at(0.0)[0]

            passing = HullPath(
                own.vehicle, own.chain, own.hull_box, transform_points(X_WT, target.vertices)
            )
            keep = Keep(passing, floor, job.clearance)
            check_clear(first, motion.to(X_WB, held, context), keep)

            held.plan = [first]
            held.way = [X_WB]
            if view is not None:
                held.plan = covering(
                    first, target, X_WT, job, camera=HullCamera(own.X_BC, view), keep=keep
                )

        monitor = Monitor(
            condition=adrift(job.lost_place), reaction=Reaction.RETREAT, code=AbortCode.HULL_ADRIFT
        )
        rows = inspection_rows(job, motion, Decide(plan, AbortCode.NO_CLEAR_WAY))
        super().__init__(rows, [monitor], X_WB=X_WB_scan, q=own.vehicle.q_home, period=period)


def inspection_rows(
    job: InspectionJob, motion: HullMotion, plan: Decide
) -> Iterable[tuple[str, TaskRow]]:
    """Table of the inspection.

    Args:
        job: distances, speeds and limits.
        motion: limits of the hull's move to the orbit.
        plan: chooses the orbit.

    Returns:
        Names and rows.
    """
    settle = Settle(job.rest)
    states = WorkState
    row = partial(TaskRow, leave={Reaction.RETREAT: "held"})
    scan = ScanTarget(ScanLimits(views=1, finds=1), path=False)

    yield "settle", row(settle, states.SETTLE, {PhaseEvent.DONE: "scan"})
    yield "scan", row(scan, states.SCAN, {PhaseEvent.DONE: at_once("plan")})
    yield "plan", row(plan, states.SCAN, {PhaseEvent.DONE: "travel"})
    yield "travel", row(MoveHull(motion), states.CLOSE_IN, {PhaseEvent.DONE: at_once("rest")})
    yield "rest", row(settle, states.CLOSE_IN, {PhaseEvent.DONE: "orbit"})
    yield (
        "orbit",
        row(FlyOrbit(job), states.WORK, {PhaseEvent.DONE: "held", PhaseEvent.MORE: "travel"}),
    )
    yield "held", TaskRow(Hold(), states.DONE)


def check_clear(found: Orbit, move: PoseMove, keep: Keep) -> None:
    """Check the distance of hull and folded arm to the object and the seabed on the whole way.

    Args:
        found: the orbit.
        move: of the hull to its begin.
        keep: what is to be kept.

    Raises:
        ReachError: if it is not kept.
    """
    for where, poses in (("on the way around", _along(found)), ("on the way there", _during(move))):
        if (short := keep.short(poses)) is not None:
            sentence = f"{where} the vehicle would come within {short[0]:.2f} m of the {short[1]}"
            raise ReachError(f"{sentence}, {keep.clearance:g} m of clearance are required")


def _along(found: Orbit, every: float = _CHECKED) -> Iterator[Array]:
    return (found.at(s)[0] for s in np.arange(0.0, found.s[-1], every))


def _during(move: PoseMove) -> Iterator[Array]:
    return (move.at(move.start + share * move.duration)[0] for share in np.linspace(0.0, 1.0, 20))


def covering(
    first: Orbit,
    target: TargetModel,
    X_WT: Array,
    job: InspectionJob,
    *,
    camera: HullCamera,
    keep: Keep,
) -> list[Orbit]:
    """Orbits that together see all that orbits can see of an object, in order of decreasing gain.

    Levels are taken from a grid of distances and heights; those that come too near to the object or
    the seabed are left out, as are those with an unclear straight move from the orbit before. It
    ends once _ENOUGH is seen.

    Args:
        first: the orbit that is flown first.
        target: model of the object.
        X_WT: (4, 4) its pose in W.
        job: distances and limits.
        camera: on the hull.
        keep: clearance to keep.

    Returns:
        The orbits in their order, `first` among them.
    """
    samples = SurfaceSamples(target.vertices, target.triangles)
    X_TW = inverse(X_WT)

    def sees(found: Orbit) -> np.ndarray:
        return samples.seen(
            np.array([X_TW @ X @ camera.X_BC for X in _along(found, _VIEWED)]), camera.view
        )

    half = 0.5 * float(np.ptp(transform_points(X_WT, target.vertices)[:, 2]))
    levels = [Level(out, half + up) for out in _OUT for up in _UP]
    make = partial(orbit, target, X_WT, job, X_BC=camera.X_BC, near_W=first.p_WC[0])

    # Orbits that keep the clearance, and what they see
    clear = [
        candidate
        for candidate in (make(level=level) for level in levels)
        if keep.short(_along(candidate)) is None
    ]
    views = [(candidate, sees(candidate)) for candidate in clear]
    orbits = [first]
    covered = sees(first)
    visible = np.any([covered, *(mask for _, mask in views)], axis=0)

    # The largest gain next, if its way is clear
    while views and covered.sum() < _ENOUGH * visible.sum():
        views.sort(key=lambda pair: int((pair[1] & ~covered).sum()))
        candidate, more = views.pop()
        if not (more & ~covered).any():
            break

        move = PoseMove.between(
            0.0,
            orbits[-1].at(0.0)[0],
            candidate.at(0.0)[0],
            speed=job.speed,
            acceleration=job.acceleration,
            turn_rate=job.turn_rate,
        )
        if keep.short(_during(move)) is None:
            orbits.append(candidate)
            covered |= more
    return orbits


def allowed_cameras(vertices_W: Array, X_BC: Array, keep: Keep) -> Array:
    """Camera poses X_WC (n, 4, 4) of a level hull that keeps its clearance, on a grid.

    Args:
        vertices_W: (V, 3) [m] of the object in W.
        X_BC: (4, 4) pose of the camera in the hull.
        keep: clearance to keep.

    Returns:
        The poses.
    """
    low = vertices_W.min(axis=0) - _AROUND
    high = vertices_W.max(axis=0) + _AROUND
    axes = [np.arange(a, b, _APART) for a, b in zip(low, high, strict=True)]
    turned = [exp_so3([0.0, 0.0, yaw]) for yaw in np.arange(_HEADINGS) * 2.0 * np.pi / _HEADINGS]
    positions = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    hulls = (pose(R, p - R @ X_BC[:3, 3]) for R in turned for p in positions)
    return np.array([X_WB @ X_BC for X_WB in hulls if keep.allows(X_WB)]).reshape(-1, 4, 4)

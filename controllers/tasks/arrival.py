"""The way to the work, common to all tasks: settle, scan, come near, unfold, rest, tare."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self

import numpy as np

from uuv.controllers.planning.arm_size import base_axis
from uuv.controllers.planning.hull_path import HullPath
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.promise import NAVIGATION_TIME
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.hull_phases import (
    HullMotion,
    MoveHull,
    RestLimits,
    Settle,
    Unfold,
    heading,
)
from uuv.controllers.tasks.monitors import Reaction
from uuv.controllers.tasks.phase import (
    INSTANT,
    Abort,
    Context,
    Decide,
    Foreseen,
    Held,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
    ToolLine,
)
from uuv.controllers.tasks.task import TaskRow, at_once
from uuv.models.objects.targets import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, StateEstimate, Target, ToolPath, WorkState
from uuv.sim.interfaces.pose_covariance import PoseCovariance, mean_pose
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, readonly, transform_points

# Chooses the hull placement for a path on a target in a current (3,) [m/s], W: (placement, part of
# the path, its share); raises ReachError.
Standing = Callable[[Target, ToolPath, Array], tuple[Placement, ToolPath, float]]
# Chooses a nearer hull pose (4, 4) to scan from, given the estimate and the present one; raises
# ReachError.
ComingNear = Callable[[StateEstimate, Array], Array]
# [m], [rad] between finds without a covariance; one farther off is of another object, or wrong
_AGREE = (0.05, 0.1)
# [-] shares of the usual distance by which the pose of unfolding is moved off, in this order
_FARTHER = (0.0, 0.5, 1.0, 1.5, 2.0)
# [-] standard deviations, RMS over the twists that are held, up to which two finds are of one pose
_SAME = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanLimits:
    """Number of frames and views of the target, and their agreement."""

    views: int = 3  # views taken before giving up
    finds: int = 6  # identifications of a known object per view, of which the mean is used
    interval: float = 4.0  # [s] between them
    frame_within: float = 5.0  # [s] in which a requested frame must arrive
    # share of the finds from one view that must be of one pose, or else the object moves
    agree: float = 0.7
    # looks at the end of a view that show none of its finds, from which on these do not count
    lost: int = 3

    def __post_init__(self) -> None:
        if isinstance(self.finds, bool) or self.finds < 1:
            raise ConfigurationError(f"finds: must be at least 1, got {self.finds}")
        if not 0.0 <= self.interval < np.inf:
            raise ConfigurationError(f"interval: must be >= 0 s, got {self.interval}")


@dataclass(slots=True, eq=False)
class ScanState:
    """State of `ScanTarget`."""

    look_from: float  # [s] earliest time of the next depth frame
    looks: int = 0  # depth frames from this view
    in_vain: int = 0  # the last of them, which show no find nor the pose of one
    finds: tuple[Target, ...] = ()  # accepted identifications from this view


class ScanTarget(Phase):
    """Take depth frames until the target is identified often enough."""

    def __init__(self, limits: ScanLimits, *, path: bool = True) -> None:
        """Set up the phase; `path`: a target without a tool path is not enough."""
        self._limits, self._path = limits, path

    def enter(self, held: Held, context: Context) -> ScanState:
        """Begin a further view."""
        held.views += 1
        return ScanState(context.time)

    def step(self, state: ScanState, held: Held, context: Context) -> Outcome:
        """Report DONE with `held.target`, or REFUSED if this view shows too little and another may
        follow.
        """
        limits = self._limits
        target = context.target

        # Wait for the next frame
        if target is None or target.time < state.look_from:
            if context.time - state.look_from > limits.frame_within:
                return Abort(
                    AbortCode.NO_FRAME, f"no depth frame arrived within {limits.frame_within:g} s"
                )
            return None

        # Look again until there are enough finds. A pose that was not accepted, yet is that of an
        # earlier find, shows that the object rests: far away the sensor's noise leaves it doubtful.
        state.looks += 1
        if target.accepted and (target.path is not None or not self._path):
            state.finds = (*state.finds, target)
            state.in_vain = 0
        elif any(_agree(find, target) for find in state.finds):
            state.in_vain = 0
        else:
            state.in_vain += 1
        if state.finds and state.looks < limits.finds:
            state.look_from = context.time + limits.interval
            return None

        # End of the view: the object must rest
        held.next_X_WB = target.next_X_WB
        again = held.views < limits.views
        if moving := self._moving(state.finds):
            return Abort(AbortCode.OBJECT_MOVES, moving)

        if state.finds and state.in_vain >= limits.lost:
            if again:
                return PhaseEvent.REFUSED
            reason = (
                f"the object was identified, but in none of {state.in_vain} later views: it "
                "moves, or it was another object"
            )
            return Abort(AbortCode.OBJECT_MOVES, reason)

        # Enough from this view
        if state.finds and not (again and target.accepted and target.next_X_WB is not None):
            held.target = fuse_poses((*held.finds, *state.finds))
            return PhaseEvent.DONE

        # Another view, or what all of them show together
        held.finds = (*held.finds, *state.finds)
        if again:
            return PhaseEvent.REFUSED
        if held.finds:  # loose, but found: this view shows less
            held.target = fuse_poses(held.finds)
            return PhaseEvent.DONE

        views = f" in {limits.views} views" if limits.views > 1 else ""
        return Abort(AbortCode.NOT_IDENTIFIED, f"not identified{views}: {target.reason}")

    def _moving(self, finds: Sequence[Target]) -> str:
        """Sentence if too few identifications in one view agree; empty if the object is at rest."""
        same = _agreeing(finds)
        if len(same) >= self._limits.agree * len(finds):
            return ""

        way = max(
            float(np.linalg.norm(find.X_WT[:3, 3] - other.X_WT[:3, 3]))
            for find in finds
            for other in finds
        )
        return (
            f"the object moves: {len(finds)} detections within "
            f"{finds[-1].time - finds[0].time:.0f} s differ by up to {1e3 * way:.0f} mm, "
            f"{len(same)} of them agree"
        )

    def setpoint(self, state: ScanState, held: Held, context: Context) -> Setpoint:
        """Ask for a frame when it is time."""
        del held
        return Setpoint(scan=context.time >= state.look_from)

    def foresee(self, state: ScanState, held: Held) -> Foreseen | None:
        """The wait for the next look."""
        del held
        return Foreseen(until=state.look_from - INSTANT)


def fuse_poses(finds: Sequence[Target]) -> Target:
    """Mean of the identifications that agree, weighted by information; path of the newest one.

    An identification in W has three errors. That of the registration is independent in every frame.
    That of the believed hull position is correlated over some seconds, and that of its attitude is
    constant. The path inherits all, while the tool is later aimed with a position estimate whose
    error has become another. Averaging identifications that lie apart in time reduces the first
    two, and so does the stated covariance of the mean.

    Finds agree if their distance is small against its covariance; the largest group around one of
    them is used. Finds without a covariance are weighted equally, and used only where none has one;
    they agree within fixed bounds.
    """
    stated = [find for find in finds if find.covariance is not None]
    finds = _agreeing(stated or finds)
    last = finds[-1]
    covariances = [find.covariance or _alike(find) for find in finds]
    of_hull = _common(finds)
    X_WT, mean, _ = mean_pose([find.X_WT for find in finds], covariances, of_hull)
    path = last.path
    moved = X_WT @ inverse(last.X_WT)

    # The path of the newest, moved with the pose
    if path is not None:
        R = moved[:3, :3]
        path = replace(
            path,
            p=readonly(transform_points(moved, path.p)),
            z=_turned(R, path.z),
            x=_turned(R, path.x),
        )

    doubt = mean if stated else None
    return replace(
        last, X_WT=readonly(X_WT), path=path, covariance=doubt, hull_covariance=readonly(of_hull)
    )


def _common(finds: Sequence[Target]) -> Array:
    """Covariance (6, 6) [m^2] of the twist error that all finds share because of the hull's pose.

    The hull's attitude is wrong by the same angle in all; of the error of its position a share is
    common to two finds.
    """
    of_hull = np.mean([find.hull_covariance for find in finds], axis=0)
    if len(finds) == 1:
        return of_hull

    times = np.array([find.time for find in finds])
    alike = np.exp(-np.abs(times[:, None] - times) / NAVIGATION_TIME)
    share = (alike.sum() - len(finds)) / (len(finds) * (len(finds) - 1))

    turned = of_hull[:3, 3:] @ np.linalg.pinv(of_hull[3:, 3:], hermitian=True) @ of_hull[3:, :3]
    of_hull[:3, :3] = turned + share * (of_hull[:3, :3] - turned)
    return of_hull


def _agreeing(finds: Sequence[Target]) -> Sequence[Target]:
    """The most finds that agree with one of them; of equal groups, the one around the newest."""
    best: Sequence[Target] = ()
    for find in reversed(finds):
        group = [other for other in finds if _agree(find, other)]
        if len(group) > len(best):
            best = group
    return best


def _agree(one: Target, other: Target) -> bool:
    """True if two finds can be of one pose, apart from their free twists."""
    a = one.covariance
    b = other.covariance
    if a is None or b is None:
        a = _alike(one)
        twist = a.twist(one.X_WT, other.X_WT)
        return bool(
            np.linalg.norm(twist[:3]) <= _AGREE[0]
            and np.linalg.norm(twist[3:]) <= _AGREE[1] * a.radius
        )
    return a.distance(one.X_WT, b, other.X_WT) <= _SAME


def _alike(find: Target) -> PoseCovariance:
    """Covariance of a find that states none: equal weights, about the middle of the path."""
    middle = find.X_WT[:3, 3] if find.path is None else find.path.p.mean(axis=0)
    none = np.zeros((0, 6))
    return PoseCovariance(matrix=np.eye(6), free=none, center=middle, radius=1.0, size_sigma=np.inf)


def _turned(R: Array, axes: Array) -> Array:
    """Rotate axes (N, 3) by `R` (3, 3)."""
    return readonly(axes @ R.T)


@dataclass(slots=True)
class Since:
    """State of a phase that stores only the time of its begin."""

    since: float  # [s]


class TareSensors(Phase):
    """Average the bias of the joint torques, free of contact; the tool is at the stand-off."""

    foresee = Phase.foresee

    def __init__(self, after: float = 1.5, seconds: float = 2.0) -> None:
        """Set up the phase: a wait of `after` [s], then the mean of the bias over `seconds` [s]."""
        self._after = after
        self.duration = after + seconds  # [s]

    def enter(self, held: Held, context: Context) -> Since:
        """Begin with the wait."""
        del held
        return Since(context.time)

    def step(self, state: Since, held: Held, context: Context) -> Outcome:
        """Report DONE after both times."""
        del held
        return PhaseEvent.DONE if context.time - state.since > self.duration else None

    def setpoint(self, state: Since, held: Held, context: Context) -> Setpoint:
        """The tool at rest, and the request to tare during its time."""
        return Setpoint(X_WG=held.tool()[0], tare=context.time - state.since > self._after)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrivalLimits:
    """Limits of the way to the work."""

    rest: RestLimits = field(default_factory=RestLimits)
    motion: HullMotion = field(default_factory=HullMotion)
    scan: ScanLimits = field(default_factory=ScanLimits)
    joint_speed: float = 0.5  # [rad/s] of the unfolding arm
    # [m] distance before the work pose, along the axis of the arm's base, at which the arm unfolds
    lift: float = 0.45
    lost_place: float = 0.6  # [m] position error of the hull above which the work ends
    blind_time: float = 5.0  # [s] without vision after which the work ends

    @classmethod
    def of_size(cls, size: float) -> Self:
        """Limits of an arm whose distances beside an object are `size` [-] times the usual ones."""
        return cls(lift=size * cls().lift)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkSite:
    """Data known before the work: the vehicle, the view, and the choice of a placement."""

    own: WorkVehicle
    X_WB_scan: Array  # (4, 4) hull pose in W from which the target is scanned
    stand: Standing
    # collision check of the hull's way; None: the way is clear
    around: Callable[[Target], HullPath] | None = None
    # chooses a nearer hull pose to scan from, once the hull is at rest
    come_near: ComingNear | None = None


def around(own: WorkVehicle, model: TargetModel) -> Callable[[Target], HullPath]:
    """Collision check of hull moves around a known object, given the identified object."""
    return lambda target: HullPath(
        own.vehicle, own.chain, own.hull_box, transform_points(target.X_WT, model.vertices)
    )


def lifted(own: WorkVehicle, X_WB_work: Array, X_WB: Array, lift: float) -> Array:
    """Hull pose (4, 4) in which the arm unfolds, before the work pose along the base's axis.

    Args:
        own: the vehicle.
        X_WB_work: (4, 4) hull pose at work.
        X_WB: (4, 4) hull pose now; if that is farther away along the axis, so is the result.
        lift: [m] least distance between both.
    """
    before = np.array(X_WB_work)
    away = -base_axis(own.chain, own.vehicle.q_ready) * (X_WB_work @ own.vehicle.X_BA)[:3, 2]
    before[:3, 3] += away * max(lift, float(away @ (X_WB - before)[:3, 3]))
    return before


def unfolding_way(
    own: WorkVehicle, path_in: HullPath, X_WB_work: Array, X_WB: Array, lift: float
) -> list[Array]:
    """Poses (4, 4) of the hull from `X_WB` (4, 4), excluded, to the pose in which the arm unfolds.

    This pose is farther from the work than `lift` [m] if hull and folded arm need it to be clear of
    the object.
    """
    before = lifted(own, X_WB_work, X_WB, lift)
    for more in _FARTHER:
        away = lifted(own, X_WB_work, X_WB, (1.0 + more) * lift)
        if path_in.gap(away) > path_in.gap(before):
            before = away
        if path_in.gap(before) >= path_in.clearance:
            break
    return path_in.way(X_WB, before)


def arrival(
    site: WorkSite,
    limits: ArrivalLimits,
    *,
    then: str,
    depth: float,
    offset: float,
    broken: Mapping[Reaction, str],
    tare: Phase | None = None,
) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the begin of a task to the tare. If the task is aborted in them, the vehicle stays.

    Args:
        site: what is known before the work.
        limits: of the way.
        then: row that follows the tare.
        depth: [m] of the tool at the stand-off.
        offset: [m] of `ToolLine`.
        broken: rows that follow a tare that is broken off.
        tare: phase of the tare; default: `TareSensors`.

    Returns:
        Names and rows, the first one to begin with.
    """
    settle = Settle(limits.rest)
    move = partial(MoveHull, limits.motion)
    free = dict.fromkeys((Reaction.RETREAT, Reaction.RISE, Reaction.WITHDRAW), "held")
    row = partial(TaskRow, leave={**free, Reaction.STOP: "halt"})

    again = "settle" if site.come_near is None else "settled"
    yield (
        "settle",
        row(
            settle,
            WorkState.SETTLE,
            {PhaseEvent.DONE: "scan" if site.come_near is None else at_once("near")},
        ),
    )

    # Nearer, once the hull is at rest
    if site.come_near is not None:
        yield (
            "near",
            row(
                Decide(partial(_come_near, site), AbortCode.NO_GROUND),
                WorkState.SETTLE,
                {PhaseEvent.DONE: "descend"},
            ),
        )
        yield (
            "descend",
            row(
                move(lambda held: held.X_WB_scan),
                WorkState.SETTLE,
                {PhaseEvent.DONE: at_once(again)},
            ),
        )
        yield again, row(settle, WorkState.SETTLE, {PhaseEvent.DONE: "scan"})

    # The object, from as many views as it takes, and the placement
    scanned = {PhaseEvent.DONE: at_once("stand"), PhaseEvent.REFUSED: "other view"}
    yield "scan", row(ScanTarget(limits.scan), WorkState.SCAN, scanned)
    other_view = move(partial(_other_view, site))
    yield "other view", row(other_view, WorkState.SETTLE, {PhaseEvent.DONE: at_once(again)})
    stand = partial(_stand, site, limits.lift, depth, offset)
    yield (
        "stand",
        row(Decide(stand, AbortCode.OUT_OF_REACH), WorkState.SCAN, {PhaseEvent.DONE: "travel"}),
    )

    # The way to the placement, and the tare
    yield "travel", row(move(), WorkState.CLOSE_IN, {PhaseEvent.DONE: "unfold"})
    yield (
        "unfold",
        row(Unfold(limits.joint_speed), WorkState.CLOSE_IN, {PhaseEvent.DONE: "close in"}),
    )
    close_in = move(lambda held: held.start_of_line().X_WB)
    yield "close in", row(close_in, WorkState.CLOSE_IN, {PhaseEvent.DONE: "rest"})
    yield "rest", row(settle, WorkState.CLOSE_IN, {PhaseEvent.DONE: "tare"})
    yield "tare", TaskRow(tare or TareSensors(), WorkState.TARE, {PhaseEvent.DONE: then}, broken)


def _come_near(site: WorkSite, held: Held, context: Context) -> None:
    """Choose a nearer hull pose to scan from."""
    assert site.come_near is not None
    held.X_WB_scan = site.come_near(context.estimate, held.X_WB_scan)


def _other_view(site: WorkSite, held: Held) -> Array:
    """Hull pose (4, 4) of the next view."""
    if held.next_X_WB is not None:  # proposed by perception
        X = np.array(held.X_WB)
        to = held.next_X_WB
        ahead = heading(to[:3, :3]) - heading(X[:3, :3])
        return pose(exp_so3([0.0, 0.0, ahead]) @ X[:3, :3], [to[0, 3], to[1, 3], X[2, 3]])

    # Else to either side in turn, turned towards the object
    side = 0.3 * (1.0 if held.views % 2 else -1.0)
    X = np.array(held.X_WB_scan)
    X[:3, 3] += X[:3, :3] @ np.cross([0.0, 0.0, side], site.own.level_view_B)
    X[:3, :3] = X[:3, :3] @ exp_so3([0.0, 0.0, -0.6 * side])
    return X


def _stand(
    site: WorkSite, lift: float, depth: float, offset: float, held: Held, context: Context
) -> None:
    """Choose the placement for the identified path, and the hull's way there."""
    target = held.target
    assert target is not None
    assert target.path is not None

    placement, path, worked = site.stand(target, target.path, context.current_W)
    if worked < 1.0:
        held.note = f"the arm reaches {worked:.0%} of the path; only that part is worked"
    elif path.note:
        held.note = path.note
    elif placement.note:
        held.note = placement.note
    if not placement.held:
        held.note = "the thrusters may not hold the hull against friction at the set force"

    held.line = ToolLine(path, placement, offset)
    held.depth = depth
    if site.around is None:
        held.way = [lifted(site.own, placement.X_WB, held.X_WB, lift)]
        return
    path_in = site.around(target)
    held.way = unfolding_way(site.own, path_in, placement.X_WB, held.X_WB, lift)

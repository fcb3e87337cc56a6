"""Phases that move the hull, unfold the arm, or wait for the hull to rest."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from uuv.controllers.planning.trajectories import JointMove, PoseMove
from uuv.controllers.safety.blind_departure import ascent_direction
from uuv.controllers.tasks.phase import (
    INSTANT,
    ZERO,
    Abort,
    Context,
    Foreseen,
    Held,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
    way_back,
)
from uuv.controllers.tuning import SAFETY
from uuv.sim.interfaces.kernels.foresight import EstimateBounds
from uuv.sim.interfaces.messages import AbortCode, StateEstimate
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

# [-] vertical part of a direction from which on depth alone tells how far a hull has come along it
_STEEP = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class RestLimits:
    """Limits within which the hull counts as resting."""

    speed: float = 0.018  # [m/s] below which it does, together with
    turn: float = 0.02  # [rad/s] and
    error: float = 0.06  # [m] position error
    time: float = 4.0  # [s] for which it must be at rest
    within: float = 60.0  # [s] after which it is given up: the current is too strong


@dataclass(slots=True)
class SettleState:
    """State of `Settle`."""

    since: float  # [s]
    quiet_since: float = math.inf  # [s] time since when the hull is at rest; inf: it is not


class Settle(Phase):
    """Station keeping until the hull is at rest."""

    def __init__(self, limits: RestLimits) -> None:
        self._limits = limits

    def enter(self, held: Held, context: Context) -> SettleState:
        """The hull does not count as at rest yet."""
        del held
        return SettleState(context.time)

    def step(self, state: SettleState, held: Held, context: Context) -> Outcome:
        """Report DONE once the hull has rested for long enough."""
        limits = self._limits
        estimate = context.estimate

        if context.time - state.since > limits.within:
            return Abort(
                AbortCode.HULL_NOT_AT_REST, f"the hull did not settle within {limits.within:.0f} s"
            )

        moving = math.hypot(*estimate.v_WB_B.tolist()) > limits.speed
        turning = math.hypot(*estimate.w_WB_B.tolist()) > limits.turn
        if moving or turning or held.off(estimate) > limits.error:
            state.quiet_since = math.inf
        elif not math.isfinite(state.quiet_since):
            state.quiet_since = estimate.time

        return PhaseEvent.DONE if estimate.time - state.quiet_since > limits.time else None

    def foresee(self, state: SettleState, held: Held) -> Foreseen | None:
        """The rest of the time at rest."""
        del held
        limits = self._limits
        if not math.isfinite(state.quiet_since):
            return None

        end = min(state.quiet_since + limits.time, state.since + limits.within)
        quiet = EstimateBounds(off=limits.error, speed=limits.speed, turn=limits.turn)
        return Foreseen(until=end - INSTANT, within=quiet)


class KeepStation(Phase):
    """Station keeping for a set time, from a hull at rest."""

    foresee = Phase.foresee

    def __init__(self, seconds: float) -> None:
        """Set up the phase; it lasts `seconds` [s]."""
        self._seconds = seconds

    def enter(self, held: Held, context: Context) -> float:
        """Time [s] of its begin."""
        del held
        return context.time

    def step(self, state: float, held: Held, context: Context) -> Outcome:
        """Report DONE once the time has passed."""
        del held
        return PhaseEvent.DONE if context.time - state >= self._seconds else None


@dataclass(frozen=True, slots=True, kw_only=True)
class HullMotion:
    """Limits of a hull move."""

    speed: float = 0.25  # [m/s]
    acceleration: float = 0.08  # [m/s^2]
    turn_rate: float = 0.15  # [rad/s]
    # [m] lag of the hull at which the move slows down, and stops
    behind: tuple[float, float] | None = (0.18, 0.42)
    late: float = 60.0  # [s] by which it may be delayed in all

    def to(self, X_WB: Array, held: Held, context: Context) -> PoseMove:
        """Move from the present reference to `X_WB` (4, 4), beginning now."""
        return PoseMove.between(
            context.time,
            held.X_WB,
            X_WB,
            speed=self.speed,
            acceleration=self.acceleration,
            turn_rate=self.turn_rate,
        )

    def pace(self, behind: float) -> float:
        """Speed as a share of that planned, for a hull that is `behind` [m]."""
        if self.behind is None:
            return 1.0
        near, far = self.behind
        return min(max((far - behind) / (far - near), 0.0), 1.0)


@dataclass(slots=True, eq=False)
class MoveState:
    """State of `MoveHull`."""

    move: PoseMove
    way: list[Array]  # (4, 4) hull poses after this move's
    v_WB_W: Array  # (3,) [m/s]
    waited: float = 0.0  # [s] by which the present move is delayed


class MoveHull(Phase):
    """Move the hull through the poses of `Held.way`, or to a given one; wait for a late hull."""

    def __init__(self, motion: HullMotion, to: Callable[[Held], Array] | None = None) -> None:
        self._motion = motion
        self._to = to

    def enter(self, held: Held, context: Context) -> MoveState:
        """Begin the first move."""
        way = held.way if self._to is None else [self._to(held)]
        return MoveState(self._motion.to(way[0], held, context), way[1:], ZERO)

    def step(self, state: MoveState, held: Held, context: Context) -> Outcome:
        """Continue the move; report DONE at the exact end of the last one."""
        if state.waited > self._motion.late:
            return Abort(
                AbortCode.HULL_LATE, f"the hull is {self._motion.late:.0f} s behind its trajectory"
            )

        # Slower while the hull lags behind
        pace = self._motion.pace(held.off(context.estimate))
        if pace < 1.0:
            late = (1.0 - pace) * context.period
            state.move = state.move.later(late)
            state.waited = state.waited + late

        if not state.move.done(context.time):
            held.X_WB, v_WB_W = state.move.at(context.time)
            state.v_WB_W = pace * v_WB_W
            return None

        # The next move, if any
        held.X_WB = state.move.X_to
        state.v_WB_W = ZERO
        if not state.way:
            return PhaseEvent.DONE
        state.move = self._motion.to(state.way.pop(0), held, context)
        state.waited = 0.0
        return None

    def setpoint(self, state: MoveState, held: Held, context: Context) -> Setpoint:
        """The hull's velocity; the arm holds its joint angles."""
        del held, context
        return Setpoint(v_WB_W=state.v_WB_W)

    def foresee(self, state: MoveState, held: Held) -> Foreseen | None:
        """The rest of the present move, for a hull that is not late."""
        del held
        if state.waited > self._motion.late:
            return None
        behind = self._motion.behind
        near = EstimateBounds() if behind is None else EstimateBounds(off=behind[0])
        return Foreseen(until=state.move.start + state.move.duration - INSTANT, within=near)


@dataclass(slots=True, eq=False)
class UnfoldState:
    """State of `Unfold`."""

    move: JointMove
    qd: Array  # (n,) [rad/s]


class Unfold(Phase):
    """Move the arm to the posture of the tool before the line."""

    foresee = Phase.foresee

    def __init__(self, speed: float) -> None:
        """Set up the phase; `speed` [rad/s] of the joints."""
        self._speed = speed

    def enter(self, held: Held, context: Context) -> UnfoldState:
        """Begin the joint motion."""
        q_to = held.start_of_line().q_start
        return UnfoldState(
            JointMove.between(context.time, held.q, q_to, speed=self._speed), np.zeros(len(q_to))
        )

    def step(self, state: UnfoldState, held: Held, context: Context) -> Outcome:
        """Report DONE at the exact posture."""
        if state.move.done(context.time):
            held.q = np.array(held.start_of_line().q_start)
            return PhaseEvent.DONE
        held.q, state.qd = state.move.at(context.time)
        return None

    def setpoint(self, state: UnfoldState, held: Held, context: Context) -> Setpoint:
        """The joints' velocity."""
        del held, context
        return Setpoint(qd=state.qd)


@dataclass(slots=True, eq=False)
class PullState:
    """State of `PullBack`."""

    move: PoseMove
    v_WB_W: Array  # (3,) [m/s]


class PullBack(Phase):
    """The hull withdraws the tool along its axis; the arm holds its joint angles."""

    foresee = Phase.foresee

    def __init__(self, motion: HullMotion, clearance: float) -> None:
        """Set up the phase; `clearance` [m] is the least length of the way back."""
        self._motion = motion
        self._clearance = clearance

    def enter(self, held: Held, context: Context) -> PullState:
        """Hold the arm as it is, and begin the move."""
        held.q = np.array(context.estimate.q)

        off = np.array(held.X_WB)
        off[:3, 3] -= way_back(held, self._clearance) * held.tool()[0][:3, 2]
        return PullState(self._motion.to(off, held, context), ZERO)

    def step(self, state: PullState, held: Held, context: Context) -> Outcome:
        """Report DONE at the end of the move, without waiting for the hull."""
        held.X_WB, state.v_WB_W = state.move.at(context.time)
        return PhaseEvent.DONE if state.move.done(context.time) else None

    def setpoint(self, state: PullState, held: Held, context: Context) -> Setpoint:
        """The hull's velocity."""
        del held, context
        return Setpoint(v_WB_W=state.v_WB_W)


@dataclass(frozen=True, slots=True, kw_only=True)
class Leash:
    """Limit of the distance between the hull's reference and a hull that is pushed off it.

    A thruster that is stuck at full thrust, or a current that is too strong, carries the hull away
    whatever is asked for. Against a far reference the others would saturate and tilt the hull: what
    is asked for is therefore bounded. Only a hull that sinks is asked to return to its depth from
    any distance.
    """

    place: float = 0.05  # [m] across the vertical, and downwards
    speed: float = 0.05  # [m/s] likewise
    heading: float = 0.2  # [rad]
    turn: float = 0.1  # [rad/s] about the vertical

    def pull(
        self, X_WB: Array, v_WB_W: Array, estimate: StateEstimate
    ) -> tuple[Array, Array, Array]:
        """The reference within the leash.

        Args:
            X_WB: (4, 4) hull pose wanted, level.
            v_WB_W: (3,) [m/s] its velocity.
            estimate: of the vehicle now.

        Returns:
            Hull pose (4, 4), its velocity (3,) [m/s] and angular velocity (3,) [rad/s], W.
        """
        X_now = estimate.X_WB
        R_now = estimate.X_WB[:3, :3]

        # Position and velocity
        p = _within(X_WB[:3, 3] - X_now[:3, 3], self.place)
        v_now = R_now @ estimate.v_WB_B
        v = _within(v_WB_W - v_now, self.speed)

        # Heading, and turn about the vertical
        off = math.remainder(heading(R_now) - heading(X_WB[:3, :3]), math.tau)
        turned = off - min(max(off, -self.heading), self.heading)
        spin = float((R_now @ estimate.w_WB_B)[2])
        w = np.array([0.0, 0.0, spin - min(max(spin, -self.turn), self.turn)])

        return pose(exp_so3([0.0, 0.0, turned]) @ X_WB[:3, :3], X_now[:3, 3] + p), v_now + v, w


def _within(off: Array, most: float) -> Array:
    """`off` (3,), bounded to `most` across the vertical and downwards."""
    across = math.hypot(off[0], off[1])
    share = min(1.0, most / across) if across > 0.0 else 1.0
    return np.array([share * off[0], share * off[1], max(off[2], -most)])


def heading(R_WB: Array) -> float:
    """Heading [rad], the angle of the hull's x axis about the vertical."""
    return math.atan2(R_WB[1, 0], R_WB[0, 0])


@dataclass(frozen=True, slots=True, kw_only=True)
class EscapeLimits:
    """Ascent off the object when the hull may be out of control."""

    rise: float = 0.6  # [m] length of the ascent, as a factor of `ascent_direction`
    draw: float = 0.35  # [m] by which the tool is drawn up beyond that, from the clearance on
    draw_speed: float = 0.4  # [m/s] at which that is done
    free: float = 0.45  # [m] ascent after which the arm folds
    # [s] after which a hull that cannot ascend is given up, the arm held as it is
    patience: float = 20.0
    fold_speed: float = 0.8  # [rad/s] of the joints
    motion: HullMotion = field(
        default_factory=lambda: HullMotion(speed=0.4, acceleration=0.2, behind=None)
    )
    leash: Leash = field(default_factory=Leash)

    @classmethod
    def of_size(cls, size: float) -> Self:
        """Limits of an arm whose distances beside an object are `size` [-] times the usual ones."""
        return cls(draw=size * cls().draw)


@dataclass(slots=True, eq=False)
class EscapeState:
    """State of `Escape`."""

    since: float  # [s]
    move: PoseMove  # of the hull
    p_WB_from: Array  # (3,) [m] estimated position of the hull at the begin
    up_W: Array  # (3,) unit direction of the ascent
    X_WG: Array  # (4, 4) tool pose now wanted
    v_WB_W: Array  # (3,) [m/s] of the hull
    w_WB_W: Array  # (3,) [rad/s]
    fold: JointMove | None = None  # of the arm, once the tool is drawn off
    qd: Array | None = None  # (n,) [rad/s] then


class Escape(Phase):
    """The hull ascends off the object from its present position, while the arm withdraws the tool
    and folds.

    A hull that has lost a thruster tilts, turns and drifts. The tool is taken off along its axis at
    once and drawn up, both in W. It goes along with the ascent but not with the drift: a tool fixed
    to the hull would swing into the object.
    """

    def __init__(self, limits: EscapeLimits, clearance: float, q_fold: Array) -> None:
        """Set up the phase.

        Args:
            limits: of the motions.
            clearance: [m] distance of the tool from the surface that is asked for at once.
            q_fold: (n,) [rad] joint angles of the folded arm.
        """
        self._limits = limits
        self._clearance = clearance
        self._q_fold = np.array(q_fold)

    def enter(self, held: Held, context: Context) -> EscapeState:
        """Begin the ascent at the estimated position."""
        p_WB_from = np.array(context.estimate.X_WB[:3, 3])
        held.X_WB = pose(held.X_WB[:3, :3], p_WB_from)

        X_WG = held.tool(way_back(held, self._clearance))[0]
        up_W = ascent_direction(-X_WG[:3, 2])

        clear = pose(held.X_WB[:3, :3], p_WB_from + self._limits.rise * up_W)
        move = self._limits.motion.to(clear, held, context)

        return EscapeState(
            context.time, move, p_WB_from, up_W / np.linalg.norm(up_W), X_WG, ZERO, ZERO
        )

    def step(self, state: EscapeState, held: Held, context: Context) -> Outcome:
        """Report DONE after the ascent with the arm folded, or when the ascent is given up."""
        limits = self._limits
        estimate = context.estimate

        held.X_WB, state.v_WB_W, state.w_WB_W = limits.leash.pull(
            *state.move.at(context.time), estimate
        )

        drawn = limits.draw_speed * (context.time - state.since)
        if state.fold is None:
            risen = _ascent(estimate.X_WB[:3, 3] - state.p_WB_from, state.up_W)
            X_WG = held.tool(way_back(held, self._clearance))[0]
            X_WG[:3, 3] += (min(drawn, limits.draw) + risen) * state.up_W
            state.X_WG = X_WG

            # Given up, or high enough for the arm to fold
            if context.time - state.since > limits.patience:
                held.q = np.array(estimate.q)
                return PhaseEvent.DONE
            if risen < limits.free:
                return None

            state.fold = JointMove.between(
                context.time, np.array(estimate.q), self._q_fold, speed=limits.fold_speed
            )

        held.q, state.qd = state.fold.at(context.time)
        return (
            PhaseEvent.DONE
            if state.move.done(context.time) and state.fold.done(context.time)
            else None
        )

    def setpoint(self, state: EscapeState, held: Held, context: Context) -> Setpoint:
        """The hull's velocity, and the tool or the folding joints."""
        del held, context
        if state.fold is not None:
            return Setpoint(v_WB_W=state.v_WB_W, w_WB_W=state.w_WB_W, qd=state.qd)
        return Setpoint(v_WB_W=state.v_WB_W, w_WB_W=state.w_WB_W, X_WG=state.X_WG)


@dataclass(slots=True, eq=False)
class AwayState:
    """State of `HoldAway`."""

    v_WB_W: Array  # (3,) [m/s]
    w_WB_W: Array  # (3,) [rad/s]


class HoldAway(Phase):
    """After an abort, hold joint angles and, as well as it can, the hull away from the object."""

    def __init__(self, leash: Leash) -> None:
        self._leash = leash

    def enter(self, held: Held, context: Context) -> AwayState:
        """At rest."""
        del held, context
        return AwayState(ZERO, ZERO)

    def step(self, state: AwayState, held: Held, context: Context) -> Outcome:
        """Never report DONE."""
        held.X_WB, state.v_WB_W, state.w_WB_W = self._leash.pull(held.X_WB, ZERO, context.estimate)
        return None

    def setpoint(self, state: AwayState, held: Held, context: Context) -> Setpoint:
        """The velocity of a hull that is carried away."""
        del held, context
        return Setpoint(v_WB_W=state.v_WB_W, w_WB_W=state.w_WB_W)


@dataclass(slots=True)
class HaltState:
    """State of `Halt`."""

    left: float  # [s]


class Halt(Phase):
    """Wait while a vehicle without control leaves, as the safety wrapper lets it."""

    def __init__(self, seconds: float = SAFETY.leave_time + SAFETY.rise_time) -> None:
        self._seconds = seconds

    def enter(self, held: Held, context: Context) -> HaltState:
        """All the time is left."""
        del held, context
        return HaltState(self._seconds)

    def step(self, state: HaltState, held: Held, context: Context) -> Outcome:
        """Report DONE when the time is over. Periods are counted, since the time may be unknown."""
        del held
        state.left -= context.period
        return PhaseEvent.DONE if state.left <= 0.0 else None


def _ascent(gone_W: Array, up_W: Array) -> float:
    """Length [m] of the ascent along `up_W` (3,) of a hull displaced by `gone_W` (3,)."""
    steep = abs(up_W[2]) > _STEEP
    return max(0.0, float(gone_W[2] / up_W[2] if steep else gone_W @ up_W))

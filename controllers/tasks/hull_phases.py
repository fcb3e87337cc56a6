"""Phases that move the hull, unfold the arm, or wait for the hull to rest."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from controllers.planning.trajectories import JointMove, PoseMove
from controllers.tasks.phase import ZERO, Abort, Context, Held, Outcome, Phase, PhaseEvent, Setpoint, way_back
from sim.interfaces.messages import AbortCode
from sim.interfaces.spatial import Array, pose


@dataclass(frozen=True, slots=True, kw_only=True)
class RestLimits:
    """When the hull counts as at rest."""

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

    def enter(self, held: Held, now: Context) -> SettleState:
        """The hull does not count as at rest yet."""
        del held
        return SettleState(now.time)

    def step(self, state: SettleState, held: Held, now: Context) -> Outcome:
        """Done once the hull has been at rest for long enough."""
        limits, estimate = self._limits, now.estimate
        if now.time - state.since > limits.within:
            return Abort(AbortCode.HULL_NOT_AT_REST, f"the hull did not become quiet within {limits.within:.0f} s")
        moving = math.hypot(*estimate.v_WB_B.tolist()) > limits.speed
        turning = math.hypot(*estimate.w_WB_B.tolist()) > limits.turn
        if moving or turning or held.off(estimate) > limits.error:
            state.quiet_since = math.inf
        elif not math.isfinite(state.quiet_since):
            state.quiet_since = estimate.time
        return PhaseEvent.DONE if estimate.time - state.quiet_since > limits.time else None


@dataclass(frozen=True, slots=True, kw_only=True)
class HullMotion:
    """Limits of a hull move."""

    speed: float = 0.25  # [m/s]
    acceleration: float = 0.08  # [m/s^2]
    turn_rate: float = 0.15  # [rad/s]
    behind: tuple[float, float] | None = (0.18, 0.42)  # [m] lag of the hull at which the move slows down, and stops
    late: float = 60.0  # [s] by which it may be delayed in all

    def to(self, X_WB: Array, held: Held, now: Context) -> PoseMove:
        """Move from the present reference to `X_WB` (4, 4), beginning now."""
        return PoseMove.between(
            now.time, held.X_WB, X_WB, speed=self.speed, acceleration=self.acceleration, turn_rate=self.turn_rate
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
    """Move the hull through the poses of `Held.way`, or to one that is given; it waits for a hull that lags behind."""

    def __init__(self, motion: HullMotion, to: Callable[[Held], Array] | None = None) -> None:
        self._motion, self._to = motion, to

    def enter(self, held: Held, now: Context) -> MoveState:
        """Begin the first move."""
        way = held.way if self._to is None else [self._to(held)]
        return MoveState(self._motion.to(way[0], held, now), way[1:], ZERO)

    def step(self, state: MoveState, held: Held, now: Context) -> Outcome:
        """Move on; done at the exact end of the last move."""
        if state.waited > self._motion.late:
            return Abort(AbortCode.HULL_LATE, f"the hull came {self._motion.late:.0f} s late on its way")
        pace = self._motion.pace(held.off(now.estimate))
        if pace < 1.0:
            late = (1.0 - pace) * now.period
            state.move, state.waited = state.move.later(late), state.waited + late
        if not state.move.done(now.time):
            held.X_WB, v_WB_W = state.move.at(now.time)
            state.v_WB_W = pace * v_WB_W
            return None
        held.X_WB, state.v_WB_W = state.move.X_to, ZERO
        if not state.way:
            return PhaseEvent.DONE
        state.move, state.waited = self._motion.to(state.way.pop(0), held, now), 0.0
        return None

    def setpoint(self, state: MoveState, held: Held, now: Context) -> Setpoint:
        """The hull's velocity; the arm holds its joint angles."""
        del held, now
        return Setpoint(v_WB_W=state.v_WB_W)


@dataclass(slots=True, eq=False)
class UnfoldState:
    """State of `Unfold`."""

    move: JointMove
    qd: Array  # (n,) [rad/s]


class Unfold(Phase):
    """Move the arm to the posture of the tool before the line."""

    def __init__(self, speed: float) -> None:
        """Set up the phase; `speed` [rad/s] of the joints."""
        self._speed = speed

    def enter(self, held: Held, now: Context) -> UnfoldState:
        """Begin the joint motion."""
        q_to = held.start_of_line().q_start
        return UnfoldState(JointMove.between(now.time, held.q, q_to, speed=self._speed), np.zeros(len(q_to)))

    def step(self, state: UnfoldState, held: Held, now: Context) -> Outcome:
        """Done at the exact posture."""
        if state.move.done(now.time):
            held.q = np.array(held.start_of_line().q_start)
            return PhaseEvent.DONE
        held.q, state.qd = state.move.at(now.time)
        return None

    def setpoint(self, state: UnfoldState, held: Held, now: Context) -> Setpoint:
        """The joints' velocity."""
        del held, now
        return Setpoint(qd=state.qd)


@dataclass(slots=True, eq=False)
class LeaveState:
    """State of the phases in which the hull leaves the object."""

    move: PoseMove
    v_WB_W: Array  # (3,) [m/s]
    p_WB_from: Array  # (3,) [m] estimated position of the hull at the begin
    gone: Array  # (3,) [m] estimated displacement since


class PullBack(Phase):
    """The hull withdraws the tool along its axis; the arm holds its joint angles."""

    def __init__(self, motion: HullMotion, clearance: float) -> None:
        """Set up the phase; `clearance` [m] is the least length of the way back."""
        self._motion, self._clearance = motion, clearance

    def enter(self, held: Held, now: Context) -> LeaveState:
        """Hold the arm as it is, and begin the move."""
        held.q = np.array(now.estimate.q)
        off = np.array(held.X_WB)
        off[:3, 3] -= way_back(held, self._clearance) * held.tool()[0][:3, 2]
        return LeaveState(self._motion.to(off, held, now), ZERO, np.array(now.estimate.X_WB[:3, 3]), ZERO)

    def step(self, state: LeaveState, held: Held, now: Context) -> Outcome:
        """Done at the end of the move; it waits for nothing."""
        held.X_WB, state.v_WB_W = state.move.at(now.time)
        return PhaseEvent.DONE if state.move.done(now.time) else None

    def setpoint(self, state: LeaveState, held: Held, now: Context) -> Setpoint:
        """The hull's velocity."""
        del held, now
        return Setpoint(v_WB_W=state.v_WB_W)


class Ascend(Phase):
    """The hull ascends off the object, from where it is.

    During an ascent on the remaining thrusters the hull tilts. The tool pose is therefore kept in W, moved along with
    the hull's displacement; a tool fixed to the hull would swing into the object.
    """

    def __init__(self, motion: HullMotion, rise: float, clearance: float) -> None:
        """Set up the phase.

        Args:
            motion: limits of the hull's move.
            rise: [m] length of the ascent, as a factor of `ascent_direction`.
            clearance: [m] least distance of the tool from the surface at its begin.
        """
        self._motion, self._rise, self._clearance = motion, rise, clearance

    def enter(self, held: Held, now: Context) -> LeaveState:
        """Begin the ascent at the estimated position."""
        p_WB_from = np.array(now.estimate.X_WB[:3, 3])
        held.X_WB = pose(held.X_WB[:3, :3], p_WB_from)
        normal_W = -held.tool()[0][:3, 2]
        clear = pose(held.X_WB[:3, :3], p_WB_from + self._rise * ascent_direction(normal_W))
        return LeaveState(self._motion.to(clear, held, now), ZERO, p_WB_from, np.zeros(3))

    def step(self, state: LeaveState, held: Held, now: Context) -> Outcome:
        """Done at the end of the ascent, with the joint angles of that moment held."""
        state.gone = now.estimate.X_WB[:3, 3] - state.p_WB_from
        held.X_WB, state.v_WB_W = state.move.at(now.time)
        if not state.move.done(now.time):
            return None
        held.q = np.array(now.estimate.q)
        return PhaseEvent.DONE

    def setpoint(self, state: LeaveState, held: Held, now: Context) -> Setpoint:
        """The hull's velocity, and the tool moved along."""
        del now
        X_WG = held.tool(way_back(held, self._clearance))[0]
        X_WG[:3, 3] += state.gone
        return Setpoint(v_WB_W=state.v_WB_W, X_WG=X_WG, v_WG_W=state.v_WB_W)


@dataclass(slots=True)
class HaltState:
    """State of `Halt`."""

    left: float  # [s]


class Halt(Phase):
    """Wait for a vehicle without control to come to rest."""

    def __init__(self, seconds: float = 3.0) -> None:
        self._seconds = seconds

    def enter(self, held: Held, now: Context) -> HaltState:
        """All the time is left."""
        del held, now
        return HaltState(self._seconds)

    def step(self, state: HaltState, held: Held, now: Context) -> Outcome:
        """Done when the time is over; periods are counted, for the time may be unknown."""
        del held
        state.left -= now.period
        return PhaseEvent.DONE if state.left <= 0.0 else None


def ascent_direction(normal_W: Array) -> Array:
    """Direction (3,) of an ascent off a surface with normal `normal_W` (3,): up, and up to half as much along it.

    Straight up a steep flank the tool would strike parts of the object that bulge above it.
    """
    return np.array([0.0, 0.0, 1.0]) + max(0.0, 0.5 - normal_W[2]) * normal_W

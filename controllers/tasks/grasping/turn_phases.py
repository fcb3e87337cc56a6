"""Phases that turn a handle: moment as force, by a law about the valve's axis, and let go of it.

The law is an admittance about the valve's axis, bounded by the set speed:

    rate = min(speed, A (moment - M)),    A = crossover / (side lever^2 + twist).

A valve that needs little is thus turned with a set speed, one that needs more with a set moment,
and one that needs all of it stands. A stuck handle makes the loop an integrator of the `crossover`
in series with the lags of the estimate (12 ms), of the smoothing, of the joint servo (33 ms) and of
half a period: with 20 ms of smoothing the phase margin at 10 rad/s is 50 deg. `side` and `twist`
are the stiffness of the servoed tool across and about its axis. Four times that crossover swung
between nothing and 1.4 times the set moment.

The moment is that of the tool's whole wrench, force and moment, from the torques of the joints
(`uuv.controllers.estimation.force_from_torques`).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from uuv.controllers.estimation.force_from_torques import tip_wrench
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.axial_phases import AxialLimits, AxialPhase, Push
from uuv.controllers.tasks.grasping.turning_axis import TurningAxis
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, PhaseEvent, Setpoint, towards
from uuv.models.site.turned_valve import QUARTER
from uuv.sim.interfaces.messages import AbortCode, HandleReading
from uuv.sim.interfaces.spatial import Array

_FLOOR = 0.3  # [N m] standard deviation of a joint's torque, beside its share
_SHARE = 0.01  # of the torque


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnLimits:
    """Law of the turning, and what counts as met, turned and stuck."""

    crossover: float = 10.0  # [rad/s] of the law on a stuck handle
    side: float = 2.4e4  # [N/m] stiffness of the tool across its axis
    twist: float = 100.0  # [N m/rad] and about it
    acceleration: float = 0.1  # [rad/s^2] of the tool about the axis
    yielding: float = 1.0  # [rad/s^2] while the moment slows it down
    smoothing: float = 0.02  # [s] filter of the moment
    meet_speed: float = 0.05  # [rad/s] until the tool has met the handle
    touch: float = 0.12  # share of the set moment that counts as met
    slow: float = 0.25  # [rad/s] of speed for 1 rad that is left
    slowest: float = 0.02  # [rad/s] near the stop
    over: float = math.radians(1.5)  # beyond the quarter, where no stop is met
    near: float = math.radians(4.0)  # before it, within which resistance is the stop
    firm: float = 0.85  # share of the set moment that counts as standing against it
    gain: float = math.radians(0.2)  # by which a handle that is not stuck turns
    stall: float = 0.6  # [s] in which it does
    longest: float = 90.0  # [s] of the turning, or longer where the law makes it slow:
    spare: float = 0.2  # share of the set moment that turns the valve, at least
    loose: float = 0.06  # share of the set moment at which the handle is let go
    letting_go: float = 2.0  # [s] at most, of turning back

    def admittance(self, lever: float) -> float:
        """Speed [rad/s] for 1 N m below the set moment, on a lever [m]; 0: a bar."""
        return self.crossover / (self.side * lever**2 + self.twist)

    def time(self, lever: float, moment: float) -> float:
        """Limit [s] of a quarter with a set moment [N m], most of which the valve may need."""
        return max(self.longest, QUARTER / (self.admittance(lever) * self.spare * moment))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnPlan:
    """Axis and moment of a turn, and what has been felt; of `Held.plan`."""

    axis: TurningAxis
    moment: float  # [N m] set
    speed: float  # [rad/s] set
    x_start: Array  # (3,) x axis of the tool at the path's start
    felt: float = 0.0  # [N m] of the tool about the axis, filtered
    angle: float = 0.0  # [rad] of the tool about the axis
    met: float = math.nan  # [rad] at which it met the handle
    rate: float = 0.0  # [rad/s] of the set point

    @property
    def turned(self) -> float:
        """Angle [rad] of the handle from where it was met; NaN: it was not."""
        return self.angle - self.met

    @property
    def reading(self) -> HandleReading:
        """What is felt of the handle."""
        return HandleReading(angle=self.turned, moment=self.felt)


@dataclass(slots=True)
class TurnState:
    """State of the phases that turn."""

    since: float  # [s] begin of the phase
    best: float = -math.inf  # [rad] farthest angle so far
    gained: float = 0.0  # [s] when it grew last
    firm_for: float = 0.0  # [s] for which the handle has stood against the set moment


class TurnPhase(AxialPhase):
    """Base of the phases with a handle in the tool."""

    def __init__(
        self, limits: AxialLimits, push: Push, vehicle: WorkVehicle, turn: TurnLimits
    ) -> None:
        """Set up the phase for the `vehicle` whose arm feels the handle."""
        super().__init__(limits, push)
        self._vehicle = vehicle
        self._turn = turn

    def enter(self, held: Held, context: Context) -> TurnState:
        """Begin at rest."""
        held.plan = replace(held.plan_of(TurnPlan), rate=0.0)
        return TurnState(context.time, gained=context.time)

    def feel(self, held: Held, context: Context) -> TurnPlan:
        """Angle and moment of this period, in the plan."""
        plan = held.plan_of(TurnPlan)
        last = context.last
        if last is None or last.contact.torques is None:
            return plan

        # Pose of the tool, and the wrench of the world on it.
        arm = self._vehicle
        X_WA = context.estimate.X_WB @ arm.vehicle.X_BA
        X_AG, J_A = arm.chain.kinematics(context.estimate.q)
        tau = context.estimate.tau
        sigma = _FLOOR + _SHARE * np.abs(tau)
        on_tip = tip_wrench(last.contact.torques, J_A, sigma).wrench
        R_WA = X_WA[:3, :3]
        wrench_W = np.concatenate([R_WA @ on_tip[:3], R_WA @ on_tip[3:]])

        # The tool does to the handle the opposite.
        X_WG = X_WA @ X_AG
        moment = -plan.axis.moment(X_WG[:3, 3], wrench_W)
        share = min(1.0, context.period / self._turn.smoothing)
        plan = replace(
            plan,
            felt=plan.felt + share * (moment - plan.felt),
            angle=plan.axis.angle(X_WG, plan.x_start),
        )
        held.plan = plan
        return plan

    def turn_on(self, held: Held, context: Context, rate: float, most: float) -> TurnPlan:
        """Move the tool on its arc by a period, towards `rate` [rad/s], `most` [rad/s^2]."""
        plan = held.plan_of(TurnPlan)
        assert held.line is not None
        s = held.s + plan.axis.pace * plan.rate * context.period
        end = float(held.line.path.s[-1])
        held.s = min(max(s, 0.0), end)

        rate = towards(plan.rate, rate, most * context.period)
        if held.s in (0.0, end) and held.s != s:
            rate = 0.0
        plan = replace(plan, rate=rate)
        held.plan = plan
        return plan

    def setpoint(self, state: TurnState, held: Held, context: Context) -> Setpoint:
        """The tool on its arc."""
        setpoint = super().setpoint(state, held, context)
        plan = held.plan_of(TurnPlan)
        _, tangent, turn = held.tool()
        along = plan.axis.pace * plan.rate
        return replace(
            setpoint,
            v_WG_W=setpoint.v_WG_W + along * tangent,
            w_WG_W=along * turn,
            handle=plan.reading,
        )

    def _rest(self, held: Held, context: Context) -> None:
        """Bring the tool to rest along its axis."""
        limits = self._limits
        held.speed = towards(held.speed, 0.0, limits.yielding * context.period)
        held.depth += held.speed * context.period


class TurnHandle(TurnPhase):
    """Turn the handle by a quarter, or to its stop."""

    def step(self, state: TurnState, held: Held, context: Context) -> Outcome:
        """Done at the stop or a little beyond the quarter; aborted if the handle stands before."""
        limits = self._turn
        self._rest(held, context)
        plan = self.feel(held, context)

        # Has the tool met the handle?
        if math.isnan(plan.met) and plan.felt > limits.touch * plan.moment:
            plan = replace(plan, met=plan.angle)
            held.plan = plan
        met = not math.isnan(plan.met)

        # The law: a set speed, or less where the moment is near to the set one.
        left = QUARTER - plan.turned if met else math.inf
        near_stop = max(limits.slowest, limits.slow * left)
        fastest = min(plan.speed, near_stop if met else limits.meet_speed)
        spare = limits.admittance(plan.axis.lever) * (plan.moment - plan.felt)
        slowed = limits.yielding if spare < fastest else limits.acceleration
        self.turn_on(held, context, min(fastest, max(spare, -fastest)), slowed)
        return self._ended(state, held, context, plan)

    def _ended(self, state: TurnState, held: Held, context: Context, plan: TurnPlan) -> Outcome:
        """How the turning has ended; None: it goes on."""
        limits = self._turn
        assert held.line is not None
        at_end = held.s >= float(held.line.path.s[-1])
        if plan.turned >= QUARTER + limits.over:
            return self._done(held, plan)

        # Does it stand against the set moment?
        if plan.angle > state.best + limits.gain:
            state.best = plan.angle
            state.gained = context.time
        firm = plan.felt >= limits.firm * plan.moment
        state.firm_for = max(0.0, state.firm_for + (context.period if firm else -context.period))
        still = min(state.firm_for, context.time - state.gained) > limits.stall
        if still and plan.turned >= QUARTER - limits.near:
            return self._done(held, plan)
        if still:
            return Abort(
                AbortCode.VALVE_STUCK,
                f"the handle stands at {math.degrees(plan.turned):.0f} deg against "
                f"{plan.felt:.1f} of {plan.moment:.1f} N m",
            )

        # The end of the way, or of the time.
        late = context.time - state.since > limits.time(plan.axis.lever, plan.moment)
        if not (at_end or late):
            return None
        if math.isnan(plan.met):
            return Abort(AbortCode.NO_CONTACT, "the tool has met no handle on its way")
        if plan.turned >= QUARTER - limits.near:
            return self._done(held, plan)
        reason = f"the handle was turned by {math.degrees(plan.turned):.0f} deg only"
        return Abort(AbortCode.TIME_LIMIT, reason)

    @staticmethod
    def _done(held: Held, plan: TurnPlan) -> PhaseEvent:
        held.note = f"turned by {math.degrees(plan.turned):.1f} deg"
        return PhaseEvent.DONE


class Release(TurnPhase):
    """Turn the tool back until nothing is felt of the handle."""

    def step(self, state: TurnState, held: Held, context: Context) -> Outcome:
        """Done without a moment, or after a while."""
        limits = self._turn
        self._rest(held, context)
        plan = self.feel(held, context)

        share = plan.felt / plan.moment
        loose = abs(share) < limits.loose
        back = 0.0 if loose else -math.copysign(min(1.0, 4.0 * abs(share)), share)
        self.turn_on(held, context, back * limits.meet_speed, limits.yielding)
        state.firm_for = state.firm_for + context.period if loose else 0.0

        late = context.time - state.since > limits.letting_go
        return PhaseEvent.DONE if late or state.firm_for > 0.3 else None

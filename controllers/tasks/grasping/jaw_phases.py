"""Phases with driven jaws: open, close on an object, lift and weigh it, carry it, let it go.

The tool moves on its line as in `uuv.controllers.tasks.axial_phases`; depths are of the fingers'
ends below their place in the grasp, negative above it. Set points of the jaws are given while they
move; then their drive goes on with the last one.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any

from uuv.controllers.planning.trajectories import Progress
from uuv.controllers.tasks.arrival import Since
from uuv.controllers.tasks.axial_phases import AxialLimits, AxialPhase, Push
from uuv.controllers.tasks.contact_phases import FollowState
from uuv.controllers.tasks.monitors import Condition
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, PhaseEvent, Setpoint, towards
from uuv.sim.interfaces.messages import AbortCode, JawMeasurement, JawSetpoint
from uuv.sim.interfaces.spatial import GRAVITY


@dataclass(frozen=True, slots=True, kw_only=True)
class JawLimits:
    """Motion of the jaws, and what counts as an object between them."""

    speed: float = 0.012  # [m/s] of the opening, while they close
    opening_speed: float = 0.05  # [m/s] while they open
    at: float = 1.5e-3  # [m] from an opening that counts as reached
    still: float = 1.5e-3  # [m/s] below which the jaws stand
    firm: float = 0.85  # share of the set force from which on they press
    held: float = 0.4  # [s] for which they must stand and press
    within: float = 12.0  # [s] for any motion of the jaws
    silent: float = 0.5  # [s] without a reading of the drive, after which it counts as lost
    thinner: float = 0.012  # [m] less than the grasp's width that still counts as the object
    slip: float = 0.004  # [m] by which the jaws may close further on what they hold
    tries: int = 2  # times that the jaws close before the work is given up


@dataclass(frozen=True, slots=True, kw_only=True)
class GripPlan:
    """What is gripped, and how; of `Held.plan`."""

    opening: float  # [m] of the jaws on the way to the object
    width: float  # [m] expected between the pads on it
    bears: float  # [N] weight in water that may be carried
    tries: int = 0  # times that the jaws have closed
    gripped: float = math.nan  # [m] opening on the object
    weight: float = math.nan  # [N] of the object in water, as weighed after the lift


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighing:
    """Times of the weighing after the lift."""

    after: float = 1.5  # [s] in which arm and hull come to rest
    seconds: float = 2.0  # [s] over which the mean is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class CarryLimits:
    """Motion with the object."""

    speed: float = 0.05  # [m/s] along the path
    ramp: float = 2.0  # [s] from rest to it
    weighing: Weighing = field(default_factory=Weighing)


def reading(held: Held, now: Context, limits: JawLimits) -> JawMeasurement | Abort:
    """Newest reading of the gripper's drive; an abort if it is silent."""
    del held
    jaws = now.estimate.jaws
    if jaws is not None and now.time - jaws.time <= limits.silent:
        return jaws
    return Abort(AbortCode.JAWS, f"the gripper has been silent for {limits.silent:g} s")


class JawPhase(AxialPhase):
    """Base of the phases with jaws; here they hold on to what they have."""

    def __init__(self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float) -> None:
        """Set up the phase; `force` [N] is the most that the jaws' motor may give."""
        super().__init__(limits, push)
        self._jaws = jaws
        self._force = force

    def _stand(self, held: Held, now: Context) -> None:
        """Bring the tool to rest, and back off while it presses more than the set push."""
        limits = self._limits
        away = -limits.speed if now.normal > self._push.force else 0.0
        held.speed = towards(held.speed, away, limits.yielding * now.period)
        held.depth += held.speed * now.period

    def _set(self, held: Held) -> JawSetpoint:
        """Set point of the jaws: closed on what they hold."""
        weight = held.plan_of(GripPlan).weight
        return JawSetpoint(opening=0.0, speed=self._jaws.speed, force=self._force, load=weight)

    def setpoint(self, state: Any, held: Held, now: Context) -> Setpoint:
        """The tool on its axis, and the jaws."""
        return replace(super().setpoint(state, held, now), jaws=self._set(held))


class MoveJaws(JawPhase):
    """Open the jaws, or a part of them, while the tool stands."""

    def enter(self, held: Held, now: Context) -> Since:
        """Begin to move."""
        del held
        return Since(now.time)

    def step(self, state: Since, held: Held, now: Context) -> Outcome:
        """Done at the opening of the plan."""
        self._stand(held, now)
        jaws = reading(held, now, self._jaws)
        if isinstance(jaws, Abort):
            return jaws

        target = held.plan_of(GripPlan).opening
        if abs(jaws.opening - target) <= self._jaws.at:
            return PhaseEvent.DONE
        if now.time - state.since <= self._jaws.within:
            return None
        reason = (
            f"the jaws are stuck at {1e3 * jaws.opening:.0f} mm on the way to {1e3 * target:.0f} mm"
        )
        return Abort(AbortCode.JAWS, reason)

    def _set(self, held: Held) -> JawSetpoint:
        """Set point of the jaws: the opening of the plan."""
        plan = held.plan_of(GripPlan)
        return JawSetpoint(
            opening=plan.opening,
            speed=self._jaws.opening_speed,
            force=self._force,
            load=plan.weight,
        )


@dataclass(slots=True)
class ClosingState:
    """State of `CloseJaws`."""

    since: float  # [s]
    firm_for: float = 0.0  # [s] for which the jaws have stood and pressed


class CloseJaws(JawPhase):
    """Close the jaws until they stand and press with the set force."""

    def enter(self, held: Held, now: Context) -> ClosingState:
        """Begin to close."""
        plan = held.plan_of(GripPlan)
        held.plan = replace(plan, tries=plan.tries + 1)
        return ClosingState(now.time)

    def step(self, state: ClosingState, held: Held, now: Context) -> Outcome:
        """Done with the object between the pads; refused without it, if a try is left."""
        self._stand(held, now)
        limits = self._jaws
        jaws = reading(held, now, limits)
        if isinstance(jaws, Abort):
            return jaws

        firm = abs(jaws.speed) < limits.still and jaws.force >= limits.firm * self._force
        closed = abs(jaws.speed) < limits.still and jaws.opening < limits.at
        state.firm_for = state.firm_for + now.period if firm or closed else 0.0
        if state.firm_for < limits.held:
            if now.time - state.since <= limits.within:
                return None
            reason = f"the jaws neither close nor press, at {1e3 * jaws.opening:.0f} mm"
            return Abort(AbortCode.JAWS, reason)

        # What is between them?
        plan = held.plan_of(GripPlan)
        if jaws.opening >= plan.width - limits.thinner:
            held.plan = replace(plan, gripped=jaws.opening)
            return PhaseEvent.DONE
        if plan.tries < limits.tries:
            return PhaseEvent.REFUSED
        reason = (
            f"nothing of the object's {1e3 * plan.width:.0f} mm between the jaws in "
            f"{plan.tries} attempts: they closed to {1e3 * jaws.opening:.0f} mm"
        )
        return Abort(AbortCode.NOT_GRIPPED, reason)


class Lift(JawPhase):
    """Draw the tool with the object off the ground, back to the stand-off."""

    def step(self, state: None, held: Held, now: Context) -> Outcome:
        """Done at the stand-off."""
        del state
        self._advance(held, now, -self._limits.speed)
        if held.depth > -self._limits.standoff:
            return None
        held.depth = -self._limits.standoff
        held.speed = 0.0
        return PhaseEvent.DONE


@dataclass(slots=True)
class WeighingState:
    """State of `Weigh`."""

    since: float  # [s]
    total: float = 0.0  # [N] sum of the readings
    count: int = 0


class Weigh(JawPhase):
    """Weigh the object: the mean force of the world on the tip, upwards negative, at rest."""

    def __init__(
        self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float, times: Weighing
    ) -> None:
        """Set up the phase; `force` [N] is the set grip force on each finger."""
        super().__init__(limits, push, jaws, force)
        self._after = times.after
        self._seconds = times.seconds

    def enter(self, held: Held, now: Context) -> WeighingState:
        """Begin with the wait."""
        del held
        return WeighingState(now.time)

    def step(self, state: WeighingState, held: Held, now: Context) -> Outcome:
        """Done with the weight in the plan; aborted if that is more than may be carried."""
        self._stand(held, now)
        if now.last is not None and now.time - state.since > self._after:
            state.total -= float(now.last.contact.force_W[2])
            state.count += 1
        if now.time - state.since <= self._after + self._seconds or not state.count:
            return None

        weight = state.total / state.count
        plan = replace(held.plan_of(GripPlan), weight=weight)
        held.plan = plan
        held.note = f"lifted: {weight / GRAVITY:.2f} kg in water"
        if weight <= plan.bears:
            return PhaseEvent.DONE
        reason = f"the object weighs {weight:.0f} N in water, {plan.bears:.0f} N are allowed"
        return Abort(AbortCode.TOO_HEAVY, reason)


class Carry(JawPhase):
    """Carry the object along the path, above it."""

    def __init__(
        self,
        limits: AxialLimits,
        push: Push,
        jaws: JawLimits,
        force: float,
        *,
        speed: float,
        ramp: float,
    ) -> None:
        """Set up the phase.

        Args:
            limits: of the motion along the tool's axis.
            push: force on the tool.
            jaws: of the jaws.
            force: [N] set grip force on each finger.
            speed: [m/s] along the path.
            ramp: [s] from rest to that speed.
        """
        super().__init__(limits, push, jaws, force)
        self._along = speed
        self._ramp = ramp

    def enter(self, held: Held, now: Context) -> FollowState:
        """Begin at rest."""
        assert held.line is not None
        length = float(held.line.path.s[-1])
        return FollowState(Progress(length, self._along, self._ramp), now.time)

    def step(self, state: FollowState, held: Held, now: Context) -> Outcome:
        """Done at the end of the path."""
        self._stand(held, now)
        held.s, _ = state.progress.at(now.time - state.since)
        return PhaseEvent.DONE if now.time - state.since > state.progress.duration else None

    def setpoint(self, state: FollowState, held: Held, now: Context) -> Setpoint:
        """The tool above the path."""
        _, rate = state.progress.at(now.time - state.since)
        _, tangent, turn = held.tool()
        moving = super().setpoint(state, held, now)
        return replace(moving, v_WG_W=rate * tangent, w_WG_W=rate * turn)


def dropped(limits: JawLimits) -> Condition:
    """Condition: what the jaws held is no longer between them."""

    def condition(held: Held, now: Context) -> str:
        plan = held.plan
        jaws = now.estimate.jaws
        if not isinstance(plan, GripPlan) or jaws is None or math.isnan(plan.gripped):
            return ""
        if jaws.opening >= plan.gripped - limits.slip:
            return ""
        return (
            f"the object has slipped out: the jaws closed from {1e3 * plan.gripped:.0f} to "
            f"{1e3 * jaws.opening:.0f} mm"
        )

    return condition

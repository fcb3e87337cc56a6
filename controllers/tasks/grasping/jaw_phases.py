"""Phases with driven jaws: open, close on an object, lift and weigh it, carry it, let it go.

The tool moves on its line as in `uuv.controllers.tasks.axial_phases`; depths are of the fingers'
ends below their place in the grasp, negative above it. Set points of the jaws are given while they
move; then their drive goes on with the last one.
"""

import math
from dataclasses import dataclass, replace

from uuv.controllers.planning.trajectories import Progress
from uuv.controllers.tasks.axial_phases import AxialLimits, AxialPhase, Push
from uuv.controllers.tasks.monitors import Condition
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, PhaseEvent, Setpoint, towards
from uuv.sim.interfaces.messages import AbortCode, JawMeasurement, JawSetpoint
from uuv.sim.interfaces.spatial import GRAVITY, Array


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
class CarrySpeed:
    """Motion along the path with the object."""

    speed: float  # [m/s]
    ramp: float = 2.0  # [s] from rest to it


def reading(context: Context, limits: JawLimits) -> JawMeasurement | Abort:
    """Newest reading of the gripper's drive; an abort if it is silent."""
    jaws = context.estimate.jaws
    if jaws is not None and context.time - jaws.time <= limits.silent:
        return jaws

    return Abort(AbortCode.JAWS, f"the gripper has been silent for {limits.silent:g} s")


@dataclass(slots=True)
class JawPhaseState:
    """State of the phases with jaws."""

    since: float  # [s] begin of the phase
    firm_for: float = 0.0  # [s] for which the jaws have stood and pressed
    total: float = 0.0  # [N] sum of the weights that were read
    count: int = 0  # of them


class JawPhase(AxialPhase):
    """Base of the phases with jaws, which hold on to what they have."""

    def __init__(self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float) -> None:
        """Set up the phase; `force` [N] is the most that the jaws' motor may give."""
        super().__init__(limits, push)
        self._jaws = jaws
        self._force = force

    def enter(self, held: Held, context: Context) -> JawPhaseState:
        """Begin; the jaws' own part is `begin`."""
        self.begin(held)
        return JawPhaseState(context.time)

    def begin(self, held: Held) -> None:
        """What the begin of the phase changes."""

    def step(self, state: JawPhaseState, held: Held, context: Context) -> Outcome:
        """As `go_on` says, with a reading of the jaws; aborted without one."""
        jaws = reading(context, self._jaws)
        return jaws if isinstance(jaws, Abort) else self.go_on(state, held, context, jaws)

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """One period, as of `Phase.step`."""
        raise NotImplementedError

    def setpoint(self, state: JawPhaseState, held: Held, context: Context) -> Setpoint:
        """The tool on its axis, and the jaws."""
        setpoint = super().setpoint(state, held, context)
        return replace(setpoint, jaws=self.jaws_set(held), **self.rates(state, held, context))

    def jaws_set(self, held: Held) -> JawSetpoint:
        """Set point of the jaws: closed on what they hold."""
        weight = held.plan_of(GripPlan).weight
        return JawSetpoint(opening=0.0, speed=self._jaws.speed, force=self._force, load=weight)

    def rates(self, state: JawPhaseState, held: Held, context: Context) -> dict[str, Array]:
        """Velocities of the tool other than along its axis, by their names in `Setpoint`."""
        del state, held, context
        return {}

    def _stand(self, held: Held, context: Context) -> None:
        """Bring the tool to rest, and back off while it presses more than the set push."""
        limits = self._limits
        away = -limits.speed if context.normal > self._push.force else 0.0
        held.speed = towards(held.speed, away, limits.yielding * context.period)
        held.depth += held.speed * context.period


class MoveJaws(JawPhase):
    """Move the jaws to the opening of the plan while the tool stands."""

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done at the opening."""
        self._stand(held, context)
        target = held.plan_of(GripPlan).opening
        if abs(jaws.opening - target) <= self._jaws.at:
            return PhaseEvent.DONE
        if context.time - state.since <= self._jaws.within:
            return None

        reason = (
            f"the jaws are stuck at {1e3 * jaws.opening:.0f} mm on the way to {1e3 * target:.0f} mm"
        )
        return Abort(AbortCode.JAWS, reason)

    def jaws_set(self, held: Held) -> JawSetpoint:
        """Set point of the jaws: the opening of the plan."""
        plan = held.plan_of(GripPlan)
        return JawSetpoint(
            opening=plan.opening,
            speed=self._jaws.opening_speed,
            force=self._force,
            load=plan.weight,
        )


class CloseJaws(JawPhase):
    """Close the jaws until they stand and press with the set force."""

    def begin(self, held: Held) -> None:
        """Count the try."""
        plan = held.plan_of(GripPlan)
        held.plan = replace(plan, tries=plan.tries + 1)

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done with the object between the pads; refused without it, if a try is left."""
        self._stand(held, context)
        limits = self._jaws

        # Do they stand and press, or are they shut?
        still = abs(jaws.speed) < limits.still
        firm = still and jaws.force >= limits.firm * self._force
        shut = still and jaws.opening < limits.at
        state.firm_for = state.firm_for + context.period if firm or shut else 0.0
        if state.firm_for < limits.held:
            if context.time - state.since <= limits.within:
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

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done at the stand-off."""
        del state, jaws
        limits = self._limits
        self._advance(held, context, -limits.speed)
        if held.depth > -limits.standoff:
            return None

        held.depth = -limits.standoff
        held.speed = 0.0
        return PhaseEvent.DONE


class Weigh(JawPhase):
    """Weigh the object at rest: the mean force of the world on the tip, downwards."""

    def __init__(
        self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float, times: Weighing
    ) -> None:
        """Set up the phase; `force` [N] is the set grip force on each finger."""
        super().__init__(limits, push, jaws, force)
        self._times = times

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done with the weight in the plan; aborted if that is more than may be carried."""
        del jaws
        times = self._times
        self._stand(held, context)
        passed = context.time - state.since
        if context.last is not None and passed > times.after:
            state.total -= float(context.last.contact.force_W[2])
            state.count += 1
        if passed <= times.after + times.seconds or not state.count:
            return None

        # The weight is a force of the world, also where the hull's thrusters bear it.
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
        self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float, along: CarrySpeed
    ) -> None:
        """Set up the phase; `force` [N] is the set grip force on each finger."""
        super().__init__(limits, push, jaws, force)
        self._along = along

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done at the end of the path."""
        del jaws
        self._stand(held, context)
        progress = self._progress(held)
        passed = context.time - state.since
        held.s, _ = progress.at(passed)
        return PhaseEvent.DONE if passed > progress.duration else None

    def rates(self, state: JawPhaseState, held: Held, context: Context) -> dict[str, Array]:
        """Velocities along the path."""
        _, rate = self._progress(held).at(context.time - state.since)
        _, tangent, turn = held.tool()
        return {"v_WG_W": rate * tangent, "w_WG_W": rate * turn}

    def _progress(self, held: Held) -> Progress:
        """Way along the path over time."""
        assert held.line is not None
        return Progress(float(held.line.path.s[-1]), self._along.speed, self._along.ramp)


def dropped(limits: JawLimits) -> Condition:
    """Condition: what the jaws held is no longer between them."""

    def condition(held: Held, context: Context) -> str:
        plan = held.plan
        jaws = context.estimate.jaws
        if not isinstance(plan, GripPlan) or jaws is None or math.isnan(plan.gripped):
            return ""
        if jaws.opening >= plan.gripped - limits.slip:
            return ""

        return (
            f"the object has slipped out: the jaws closed from {1e3 * plan.gripped:.0f} to "
            f"{1e3 * jaws.opening:.0f} mm"
        )

    return condition

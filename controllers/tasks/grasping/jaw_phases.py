"""Phases with driven jaws: open, close on an object, lift and weigh it, carry it, let it go.

The tool moves on its line as in `uuv.controllers.tasks.axial_phases`; depths are of the fingers'
ends below their place in the grasp, negative above it.

Work that is broken off lets go of what is still on the ground, which may be fixed there, and keeps
what hangs free (`keep_what_is_free`). A slip in the lift or at rest above is gripped once more.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any

from uuv.controllers.planning.trajectories import Progress
from uuv.controllers.tasks.axial_phases import (
    AxialApproach,
    AxialLimits,
    AxialPhase,
    Push,
    TouchedFor,
)
from uuv.controllers.tasks.monitors import Condition
from uuv.controllers.tasks.phase import (
    Abort,
    Context,
    Held,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
    towards,
)
from uuv.sim.interfaces.messages import AbortCode, HeldLoad, JawMeasurement, JawSetpoint
from uuv.sim.interfaces.spatial import GRAVITY, Array, readonly


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
    # [m] less, and more, than the grasp's width that still counts as the object
    thinner: float = 0.012
    wider: float = 0.012
    slip: float = 0.004  # [m] by which the jaws may close further on what they hold
    tries: int = 2  # times that the jaws close before the work is given up
    clear: float = 0.03  # [m] above its place from which on an object hangs free
    heavier: float = 1.3  # share of the largest load with which a lift goes on,
    pull: float = 8.0  # [N] in addition; more is a load that is too heavy, or fixed
    pull_time: float = 0.1  # [s] for which it must last
    gone: float = 0.7  # share of the weight that is missing if the object has dropped,
    least_gone: float = 8.0  # [N] or at least this,
    gone_time: float = 0.3  # [s] for so long


@dataclass(frozen=True, slots=True, kw_only=True)
class GripPlan:
    """What is gripped, and how; of `Held.plan`."""

    opening: float  # [m] of the jaws on the way to the object
    width: float  # [m] expected between the pads on it
    bears: float  # [N] weight in water that may be carried
    # what is to be held: the water that it displaces, and its middle for the tool at depth 0
    expected: HeldLoad
    tries: int = 0  # times that the jaws have closed
    gripped: float = math.nan  # [m] opening on the object; NaN: they do not hold it
    load: HeldLoad | None = None  # what is held, as identified after the lift
    carried: bool = False  # it has been weighed, and is on its way


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighing:
    """Times of the weighing after the lift."""

    after: float = 1.5  # [s] in which arm and hull come to rest
    seconds: float = 2.0  # [s] over which the load is identified
    adopt: float = 0.5  # [s] in which the controller's model of the arm takes it over


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
class Limp:
    """Time for which jaws that should hold something have not pressed."""

    seconds: float = 0.0
    share = 0.5  # of the grip force below which they do not hold,
    lasting = 0.3  # [s] for so long

    def lost(self, jaws: JawMeasurement, force: float, period: float) -> str:
        """Sentence if they have lost their hold; to be asked once a period [s]."""
        limp = jaws.force < self.share * force
        self.seconds = self.seconds + period if limp else 0.0
        held = self.seconds <= self.lasting
        return "" if held else f"the jaws press with {jaws.force:.0f} of {force:.0f} N only"


@dataclass(slots=True)
class JawPhaseState:
    """State of the phases with jaws."""

    since: float  # [s] begin of the phase
    firm_for: float = 0.0  # [s] for which the jaws have stood and pressed, or the load pulled
    total: float = 0.0  # [N] sum of the weights that were read
    count: int = 0  # of them
    load: HeldLoad | None = None  # that was identified
    known_at: float = math.nan  # [s] when it was
    # of a pull out of a receptacle
    highest: float = 0.0  # [m] depth at the last gain, negative above the seat
    gained: float = 0.0  # [s] time of it
    limp: Limp = field(default_factory=Limp)
    most: float = 0.0  # [N] largest pull that was felt


class JawPhase(AxialPhase, ABC):
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

    @abstractmethod
    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """One period, as of `Phase.step`, with the newest reading of the jaws."""

    def setpoint(self, state: JawPhaseState, held: Held, context: Context) -> Setpoint:
        """The tool on its axis, and the jaws."""
        setpoint = super().setpoint(state, held, context)
        return replace(setpoint, jaws=self.jaws_set(held), **self.rates(state, held, context))

    def jaws_set(self, held: Held) -> JawSetpoint:
        """Set point of the jaws: closed on what they hold."""
        return closed(held.plan_of(GripPlan), self._jaws, self._force)

    def rates(self, state: JawPhaseState, held: Held, context: Context) -> dict[str, Array]:
        """Velocities of the tool other than along its axis, by their names in `Setpoint`."""
        del state, held, context
        return {}

    def _slipped(self, held: Held, jaws: JawMeasurement) -> Outcome:
        """The end of the phase if the object has slipped out; refused if a try is left."""
        plan = held.plan_of(GripPlan)
        sentence = slipped(plan, jaws, self._jaws)
        if sentence and plan.tries < self._jaws.tries:
            return PhaseEvent.REFUSED
        return Abort(AbortCode.DROPPED, sentence) if sentence else None

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
        """Done at the opening; what was held is let go as they open."""
        self._stand(held, context)
        plan = held.plan_of(GripPlan)
        target = plan.opening
        if jaws.opening > plan.gripped + self._jaws.at:
            held.plan = let_go(plan)
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
        return opened(held.plan_of(GripPlan), self._jaws, self._force)


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

        # What is between them? Shut jaws hold nothing, however thin the object is.
        plan = held.plan_of(GripPlan)
        if not shut and plan.width - limits.thinner <= jaws.opening <= plan.width + limits.wider:
            # The tool may have stopped above its place, and is then farther from the middle.
            expected = moved(plan.expected, -held.depth)
            held.plan = replace(plan, gripped=jaws.opening, expected=expected)
            return PhaseEvent.DONE
        if plan.tries < limits.tries:
            return PhaseEvent.REFUSED

        if jaws.opening > plan.width:
            reason = (
                f"the jaws stand and press at {1e3 * jaws.opening:.0f} mm, and the object has "
                f"{1e3 * plan.width:.0f} mm: they jam, or something else is between them"
            )
            return Abort(AbortCode.JAWS, reason)
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
        """Done at the stand-off; refused if the object slips out and a try is left; aborted if the
        pull is more than the load may be.
        """
        limits = self._limits
        lost = self._slipped(held, jaws)
        if lost is not None:
            return lost
        self._advance(held, context, -limits.speed)

        # Too heavy, or fixed.
        bears = held.plan_of(GripPlan).bears
        most = self._jaws.heavier * bears + self._jaws.pull
        pull = _pull(context)
        state.firm_for = state.firm_for + context.period if pull > most else 0.0
        if state.firm_for > self._jaws.pull_time:
            reason = f"a pull of {pull:.0f} N does not lift the object, {bears:.0f} N are allowed"
            return Abort(AbortCode.TOO_HEAVY, reason)

        if held.depth > -limits.standoff:
            return None

        held.depth = -limits.standoff
        held.speed = 0.0
        return PhaseEvent.DONE


class Weigh(JawPhase):
    """Identify what is held at rest, and give it to the controller's model of the arm.

    A controller that identifies nothing is helped by the mean force of the world on the tip,
    downwards.
    """

    def __init__(
        self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float, times: Weighing
    ) -> None:
        """Set up the phase; `force` [N] is the set grip force on each finger."""
        super().__init__(limits, push, jaws, force)
        self._times = times

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done with the load in the plan; aborted if that is more than may be carried, and refused
        as in the lift.
        """
        times = self._times
        lost = self._slipped(held, jaws)
        if lost is not None:
            return lost
        self._stand(held, context)

        # Identify it.
        passed = context.time - state.since
        if context.last is not None and passed > times.after:
            state.total += _pull(context)
            state.count += 1
        if passed <= times.after + times.seconds or not state.count:
            return None
        plan = held.plan_of(GripPlan)
        if state.load is None:
            state.load = self._identified(state, plan.expected, context)
            state.known_at = context.time

        # Take it over bit by bit, as a force of the world becomes a load of the arm.
        load = state.load
        share = min(1.0, (context.time - state.known_at) / times.adopt)
        held.plan = replace(plan, load=load.part(share) if share < 1.0 else load)
        if share < 1.0:
            return None

        held.note = f"lifted: {load.mass:.2f} kg, {load.weight / GRAVITY:.2f} kg in water"
        if load.weight <= plan.bears:
            return PhaseEvent.DONE
        reason = f"the object weighs {load.weight:.0f} N in water, {plan.bears:.0f} N are allowed"
        return Abort(AbortCode.TOO_HEAVY, reason)

    def setpoint(self, state: JawPhaseState, held: Held, context: Context) -> Setpoint:
        """The jaws closed, and the request to weigh what they hold."""
        setpoint = super().setpoint(state, held, context)
        jaws = setpoint.jaws
        if (
            jaws is None
            or state.load is not None
            or context.time <= state.since + self._times.after
        ):
            return setpoint
        return replace(setpoint, jaws=replace(jaws, weigh=held.plan_of(GripPlan).expected))

    def _identified(self, state: JawPhaseState, expected: HeldLoad, context: Context) -> HeldLoad:
        """What is held, as the controller has identified it, or by the mean pull."""
        load = None if context.last is None else context.last.contact.load
        if load is not None:
            return load
        weight = state.total / state.count
        mass = max(weight / GRAVITY + expected.displaced, 0.0)
        return replace(expected, mass=mass)


class Carry(JawPhase):
    """Carry the object along the path, above it."""

    def __init__(
        self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float, along: CarrySpeed
    ) -> None:
        """Set up the phase; `force` [N] is the set grip force on each finger."""
        super().__init__(limits, push, jaws, force)
        self._along = along

    def begin(self, held: Held) -> None:
        """From now on a drop ends the work."""
        held.plan = replace(held.plan_of(GripPlan), carried=True)

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


class PutBack(AxialApproach):
    """Lower the object to its place; done at once without it."""

    def __init__(self, jaws: JawLimits, *args: Any, **options: Any) -> None:
        """Set up the phase; the other arguments are those of `AxialApproach`."""
        super().__init__(*args, **options)
        self._jaws = jaws

    def step(self, state: TouchedFor, held: Held, context: Context) -> Outcome:
        """As `AxialApproach`, while the jaws hold something."""
        jaws = context.estimate.jaws
        if jaws is not None and slipped(held.plan_of(GripPlan), jaws, self._jaws):
            held.speed = 0.0
            return PhaseEvent.DONE
        return super().step(state, held, context)


class Depart(Phase):
    """Another phase with what hangs free in the closed jaws, or else with open jaws."""

    def __init__(self, inner: Phase, jaws: JawLimits, force: float) -> None:
        """Wrap `inner`; `force` [N] is the most that the jaws' motor may give."""
        self._inner = inner
        self._jaws = jaws
        self._force = force

    def enter(self, held: Held, context: Context) -> Any:
        """Decide, and begin the phase."""
        keep_what_is_free(held, context, self._jaws)
        return self._inner.enter(held, context)

    def step(self, state: Any, held: Held, context: Context) -> Outcome:
        """A period of the phase."""
        return self._inner.step(state, held, context)

    def setpoint(self, state: Any, held: Held, context: Context) -> Setpoint:
        """The phase's, and that of the jaws; without one before a grasp is chosen."""
        setpoint = self._inner.setpoint(state, held, context)
        plan = held.plan
        if not isinstance(plan, GripPlan):
            return setpoint
        give = opened if math.isnan(plan.gripped) else closed
        return replace(setpoint, jaws=give(plan, self._jaws, self._force))


class LetGo(MoveJaws):
    """Open the jaws around what may be fixed; done at once with what hangs free."""

    def enter(self, held: Held, context: Context) -> JawPhaseState:
        """Decide what is kept."""
        keep_what_is_free(held, context, self._jaws)
        return super().enter(held, context)

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done at once with what is kept, else as `MoveJaws`."""
        if math.isnan(held.plan_of(GripPlan).gripped):
            return super().go_on(state, held, context, jaws)
        held.speed = 0.0
        return PhaseEvent.DONE

    def jaws_set(self, held: Held) -> JawSetpoint:
        """Set point of the jaws: closed on what is kept."""
        plan = held.plan_of(GripPlan)
        give = opened if math.isnan(plan.gripped) else closed
        return give(plan, self._jaws, self._force)


def closed(plan: GripPlan, limits: JawLimits, force: float) -> JawSetpoint:
    """Set point of jaws that close on what they hold, or on what is between them."""
    return JawSetpoint(opening=0.0, speed=limits.speed, force=force, holds=plan.load)


def opened(plan: GripPlan, limits: JawLimits, force: float) -> JawSetpoint:
    """Set point of jaws that open; they hold the load until they have left it."""
    speed = limits.opening_speed
    return JawSetpoint(opening=plan.opening, speed=speed, force=force, holds=plan.load)


def let_go(plan: GripPlan) -> GripPlan:
    """The plan without what was held."""
    return replace(plan, gripped=math.nan, load=None, carried=False)


def moved(load: HeldLoad, by: float) -> HeldLoad:
    """A load that is `by` [m] farther along the tool axis."""
    off_G = (0.0, 0.0, by)
    return replace(
        load, center_G=readonly(load.center_G + off_G), buoyancy_G=readonly(load.buoyancy_G + off_G)
    )


def slipped(plan: GripPlan, jaws: JawMeasurement, limits: JawLimits) -> str:
    """Sentence if the jaws have closed further on what they held; else empty."""
    if math.isnan(plan.gripped) or jaws.opening >= plan.gripped - limits.slip:
        return ""
    return (
        f"the object has slipped out: the jaws closed from {1e3 * plan.gripped:.0f} to "
        f"{1e3 * jaws.opening:.0f} mm"
    )


def is_free(held: Held, context: Context, limits: JawLimits) -> bool:
    """True if the jaws hold something that hangs free, above its place."""
    plan = held.plan_of(GripPlan)
    jaws = context.estimate.jaws
    if math.isnan(plan.gripped) or held.depth > -limits.clear:
        return False
    lost = jaws is not None and slipped(plan, jaws, limits)
    return not lost and not weight_gone(limits)(held, context)


def keep_what_is_free(held: Held, context: Context, limits: JawLimits) -> None:
    """Take out of the plan what is not to be kept: what is fixed, or lost."""
    plan = held.plan
    if isinstance(plan, GripPlan) and not is_free(held, context, limits):
        held.plan = let_go(plan)


def dropped(limits: JawLimits) -> Condition:
    """Condition: what is carried is no longer between the jaws."""

    def condition(held: Held, context: Context) -> str:
        plan = held.plan
        jaws = context.estimate.jaws
        if not isinstance(plan, GripPlan) or jaws is None or not plan.carried:
            return ""
        return slipped(plan, jaws, limits)

    return condition


def weight_gone(limits: JawLimits) -> Condition:
    """Condition: the weight of what is carried is missing."""

    def condition(held: Held, context: Context) -> str:
        plan = held.plan
        if not isinstance(plan, GripPlan) or not plan.carried or plan.load is None:
            return ""
        weight = plan.load.weight
        missing = -math.copysign(1.0, weight) * _pull(context)
        if missing <= max(limits.gone * abs(weight), limits.least_gone):
            return ""
        return f"the object has dropped: of its {weight:.0f} N in water {missing:.0f} N are missing"

    return condition


def _pull(context: Context) -> float:
    """Downward force [N] of the world on the tip; 0 if it is not known."""
    if context.last is None or not context.last.contact.known:
        return 0.0
    return -float(context.last.contact.force_W[2])

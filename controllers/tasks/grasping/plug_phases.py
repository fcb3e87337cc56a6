"""Phases with a plug in the jaws: pull it out of its receptacle, weigh it, put it into another.

The tool moves on its line as in `uuv.controllers.tasks.axial_phases`. Depths are of the fingers'
ends below their place on the seated plug: 0 with the plug in its seat, in both receptacles.

The friction of the seat is unknown. The pull is an admittance as the push into a hole is: at no
resistance the tool has the set speed, at the set pull it stands. A plug that stands there is stuck.
"""

from dataclasses import dataclass, field, replace
from typing import Any

from uuv.controllers.tasks.axial_phases import AxialLimits, Push
from uuv.controllers.tasks.grasping.jaw_phases import (
    GripPlan,
    JawLimits,
    JawPhase,
    JawPhaseState,
    Limp,
    Weigh,
    closed,
    reading,
    slipped,
)
from uuv.controllers.tasks.insertion import EnterHole, EntryState
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, Phase, PhaseEvent, Setpoint
from uuv.sim.interfaces.messages import AbortCode, JawMeasurement


@dataclass(frozen=True, slots=True, kw_only=True)
class PullLimits:
    """The pull on a plug, and what counts as stuck."""

    force: float  # [N] at which the tool stands
    firm: float = 0.85  # share of it from which on the plug resists
    stall: float = 0.6  # [s] for which it must resist without
    gain: float = 1e-3  # [m] of way
    longest: float = 40.0  # [s] of the way out


class PullOut(JawPhase):
    """Draw the plug out along its axis with a bounded pull, up to the stand-off."""

    def __init__(
        self, limits: AxialLimits, push: Push, jaws: JawLimits, force: float, pull: PullLimits
    ) -> None:
        """Set up the phase; `force` [N] is the set grip force on each finger."""
        super().__init__(limits, push, jaws, force)
        self._pull = pull

    def enter(self, held: Held, context: Context) -> JawPhaseState:
        """Begin at the present depth."""
        self.begin(held)
        return JawPhaseState(context.time, highest=held.depth, gained=context.time)

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done at the stand-off; refused if the jaws lose the plug and a try is left; aborted if it
        is stuck.
        """
        limits = self._limits
        lost = self._slipped(held, jaws) or self._limp(state, held, context, jaws)
        if lost is not None:
            return lost

        # In the receptacle the pull is bounded.
        axial, _ = self._forces(held, context)
        pull = -axial
        fixed = held.depth > -self._jaws.clear
        if fixed:
            state.most = max(state.most, pull)
        self._advance(held, context, -limits.speed, pull / self._pull.force if fixed else 0.0)

        if fixed and (stuck := self._stuck(state, held, context, pull)):
            return Abort(AbortCode.STUCK, stuck)
        if held.depth > -limits.standoff:
            return None

        held.depth = -limits.standoff
        held.speed = 0.0
        held.note = f"the plug came out at {state.most:.0f} N"
        return PhaseEvent.DONE

    def _stuck(self, state: JawPhaseState, held: Held, context: Context, pull: float) -> str:
        """Sentence if the plug stands against the set pull, or takes too long; else empty."""
        limits = self._pull
        if held.depth < state.highest - limits.gain:
            state.highest = held.depth
            state.gained = context.time

        firm = pull >= limits.firm * limits.force
        state.firm_for = max(0.0, state.firm_for + (context.period if firm else -context.period))
        if min(state.firm_for, context.time - state.gained) > limits.stall:
            return (
                f"the plug stands {-1e3 * held.depth:.0f} mm above its seat against a pull of "
                f"{pull:.0f} of {limits.force:.0f} N"
            )
        if context.time - state.since > limits.longest:
            return f"the plug was not out of its receptacle in {limits.longest:.0f} s"
        return ""

    def _limp(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """The end of the phase if the jaws no longer press; refused if a try is left."""
        sentence = state.limp.lost(jaws, self._force, context.period)
        if not sentence:
            return None
        if held.depth > -self._jaws.clear and held.plan_of(GripPlan).tries < self._jaws.tries:
            return PhaseEvent.REFUSED
        return Abort(AbortCode.DROPPED, sentence)


class WeighPlug(Weigh):
    """Weigh what was pulled out: a plug that stayed behind is missed here."""

    def _slipped(self, held: Held, jaws: JawMeasurement) -> Outcome:
        """A plug that slips out here falls, and is not gripped once more."""
        sentence = slipped(held.plan_of(GripPlan), jaws, self._jaws)
        return Abort(AbortCode.DROPPED, sentence) if sentence else None

    def go_on(
        self, state: JawPhaseState, held: Held, context: Context, jaws: JawMeasurement
    ) -> Outcome:
        """Done with the plug in the jaws, which has the weight that is expected of it."""
        pulled = held.note
        outcome = super().go_on(state, held, context, jaws)
        if outcome is not PhaseEvent.DONE or state.load is None:
            return outcome

        expected = held.plan_of(GripPlan).expected.weight
        weight = state.load.weight
        if weight >= (1.0 - self._jaws.gone) * expected:
            held.note = f"{pulled}; {held.note}"
            return outcome
        reason = f"the jaws hold {weight:.1f} N, the plug weighs {expected:.1f} N in water"
        return Abort(AbortCode.DROPPED, reason)


@dataclass(slots=True)
class WithPlugState:
    """State of `WithPlug`."""

    inner: Any  # of the other phase
    limp: Limp = field(default_factory=Limp)


class WithPlug(Phase):
    """Another phase with the plug in the closed jaws; ended if they lose it."""

    def __init__(self, inner: Phase, jaws: JawLimits, force: float) -> None:
        """Wrap `inner`; `force` [N] is the set grip force on each finger."""
        self._inner = inner
        self._jaws = jaws
        self._force = force

    def enter(self, held: Held, context: Context) -> WithPlugState:
        """Begin; from now on the receptacle may bear the plug's weight."""
        held.plan = replace(held.plan_of(GripPlan), carried=False)
        return WithPlugState(self._inner.enter(held, context))

    def step(self, state: WithPlugState, held: Held, context: Context) -> Outcome:
        """A period of the phase, with a reading of the jaws; aborted without one."""
        jaws = reading(context, self._jaws)
        if isinstance(jaws, Abort):
            return jaws

        # Do they still hold it?
        slip = slipped(held.plan_of(GripPlan), jaws, self._jaws)
        if sentence := slip or state.limp.lost(jaws, self._force, context.period):
            return Abort(AbortCode.DROPPED, sentence)
        return self._inner.step(state.inner, held, context)

    def setpoint(self, state: WithPlugState, held: Held, context: Context) -> Setpoint:
        """The phase's, and the closed jaws."""
        setpoint = self._inner.setpoint(state.inner, held, context)
        return replace(setpoint, jaws=closed(held.plan_of(GripPlan), self._jaws, self._force))


class SeatPlug(EnterHole):
    """Advance into the receptacle until the plug stands in its seat.

    Its collar stops it there; a stop within `near` [m] of the seat is the seat.
    """

    near = 0.006

    def _stopped(self, state: EntryState, held: Held) -> Outcome:
        """Done at the seat; before it as `EnterHole`."""
        if held.depth >= -self.near:
            held.speed = 0.0
            held.note = f"seated, {1e3 * held.depth:.1f} mm from the place of the seat"
            return PhaseEvent.DONE

        outcome = super()._stopped(state, held)
        if not isinstance(outcome, Abort):
            return outcome
        tries = self._job.inside.tries
        above = -1e3 * held.depth
        return Abort(outcome.code, f"stopped {above:.0f} mm above the seat in {tries} attempts")

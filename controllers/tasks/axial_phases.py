"""Phases that move a tool in along its axis under admittance control: into holes, into soil.

The advance is a damping law. At zero force the tool has the wanted speed; the speed falls as the
opposing force grows, is zero at the set force and negative above it. A tool that is stopped is thus
pressed with the set force. Depths are of the tip below the surface as identified, negative before
it.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from uuv.controllers.tasks.arrival import Since
from uuv.controllers.tasks.hull_phases import Halt
from uuv.controllers.tasks.monitors import (
    BEFORE_CONTACT,
    Monitor,
    Reaction,
    adrift,
    contact_force,
    fault_monitors,
    too_much_force,
)
from uuv.controllers.tasks.phase import (
    Abort,
    Context,
    Held,
    Hold,
    HoldTool,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
    towards,
)
from uuv.controllers.tasks.task import TaskRow
from uuv.sim.interfaces.messages import AbortCode, WorkState

_AT_WORK = frozenset(
    {WorkState.APPROACH, WorkState.SEARCH, WorkState.INSERT, WorkState.PRESS, WorkState.WORK}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxialLimits:
    """Limits of the tool's motion along its axis, and conditions for the end of the work."""

    standoff: float  # [m] distance before the surface from which the tool approaches
    approach_speed: float  # [m/s] outside
    speed: float  # [m/s] inside, in and out
    acceleration: float = 0.03  # [m/s^2] limit
    yielding: float = 0.3  # [m/s^2] limit while a force opposes the motion
    longest: float  # [s] limit from the stand-off to the work, and of the way out
    force_limit: float  # [N] contact force, in any direction, above which the work ends
    # [m] position error of the hull above which the work ends; up to it the arm compensates
    lost_place: float = 0.08


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """Force on the tool, and the depths from which the controller gets it as a set point."""

    force: float  # [N] axial force at which the tool stands still
    beyond: float  # [m] depth beyond which it is given to the controller
    # [m] depth beyond which the tool yields to forces across its axis
    compliant_beyond: float = math.inf
    force_control: bool = False  # the force loop is closed


class AxialPhase(Phase):
    """Base of the phases with a tool on its axis: its set point and its advance."""

    def __init__(self, limits: AxialLimits, push: Push) -> None:
        self._limits, self._push = limits, push

    def _forces(self, held: Held, context: Context) -> tuple[float, float]:
        """Estimated force [N] against the advance, and across it."""
        return context.contact_force(held.tool()[0][:3, 2])

    def _advance(self, held: Held, context: Context, wanted: float, resisted: float = 0.0) -> None:
        """Move the depth by a period at `wanted` [m/s], less for `resisted` (see `next_speed`)."""
        limits = self._limits
        held.speed = next_speed(
            held.speed,
            wanted,
            resisted,
            acceleration=limits.acceleration,
            yielding=limits.yielding,
            period=context.period,
        )
        held.depth += held.speed * context.period

    def setpoint(self, state: Any, held: Held, context: Context) -> Setpoint:
        """The tool on its axis."""
        del state, context
        X_WG = held.tool()[0]
        return Setpoint(
            X_WG=X_WG,
            v_WG_W=held.speed * X_WG[:3, 2],
            set_force=self._push.force if held.depth > self._push.beyond else 0.0,
            force_control=self._push.force_control,
            compliant=held.depth > self._push.compliant_beyond,
        )


@dataclass(slots=True)
class TouchedFor:
    """State of `AxialApproach`."""

    seconds: float = 0.0  # for which contact has lasted


@dataclass(frozen=True, slots=True, kw_only=True)
class AxialContact:
    """Definition of contact on the way to the surface, and its meaning."""

    touch: float  # [N] axial force that counts as contact
    touch_time: float = 0.0  # [s] for which it must last
    early: float = 0.0  # [m] distance before the surface from which contact is no obstacle
    obstacle: str  # sentence for contact farther off, with {} for the distance in mm
    yields: bool = False  # the advance stops at the set force


class AxialApproach(AxialPhase):
    """Advance from the stand-off to a depth; contact on the way is an obstacle, or the rim."""

    def __init__(
        self,
        limits: AxialLimits,
        push: Push,
        contact: AxialContact,
        *,
        slow: tuple[float, float],
        to: float,
    ) -> None:
        """Set up the phase.

        Args:
            limits: of the motion.
            push: force on the tool.
            contact: what counts as contact.
            slow: depth [m] from which the tool moves slower, and its speed [m/s] there.
            to: [m] depth at which the phase is done.
        """
        super().__init__(limits, push)
        self._contact = contact
        self._slow = slow
        self._to = to

    def enter(self, held: Held, context: Context) -> TouchedFor:
        """Begin without contact."""
        del held, context
        return TouchedFor()

    def step(self, state: TouchedFor, held: Held, context: Context) -> Outcome:
        """Report DONE at the depth, and TOUCHED if the tool meets the rim."""
        contact = self._contact
        slow_from, slow = self._slow
        axial, _ = self._forces(held, context)

        speed = self._limits.approach_speed if held.depth < slow_from else slow
        self._advance(
            held, context, speed, max(0.0, axial) / self._push.force if contact.yields else 0.0
        )

        state.seconds = state.seconds + context.period if axial > contact.touch else 0.0
        if state.seconds and state.seconds >= contact.touch_time:
            if held.depth < -contact.early:
                return Abort(
                    AbortCode.OBSTACLE, contact.obstacle.format(f"{-held.depth * 1e3:.0f}")
                )
            return PhaseEvent.TOUCHED

        return PhaseEvent.DONE if held.depth >= self._to else None


class Stay(AxialPhase):
    """Stay at the depth reached, or under the set force, for some time."""

    def __init__(self, limits: AxialLimits, push: Push, seconds: float) -> None:
        super().__init__(limits, push)
        self._seconds = seconds

    def enter(self, held: Held, context: Context) -> Since:
        """Begin to wait."""
        del held
        return Since(context.time)

    def step(self, state: Since, held: Held, context: Context) -> Outcome:
        """Report DONE when the time is over; the tool comes to rest."""
        self._advance(held, context, 0.0)
        return PhaseEvent.DONE if context.time - state.since > self._seconds else None


class Withdraw(AxialPhase):
    """Move out along the axis, with the pull bounded as the push was, back to the stand-off."""

    def __init__(self, limits: AxialLimits, push: Push, mouth: float) -> None:
        """Set up the phase; outside the depth `mouth` [m] the tool moves freely."""
        super().__init__(limits, push)
        self._mouth = mouth

    def enter(self, held: Held, context: Context) -> Since:
        """Begin at the present speed."""
        del held
        return Since(context.time)

    def step(self, state: Since, held: Held, context: Context) -> Outcome:
        """Report DONE at the stand-off. In the hole, the pull is at most the push on the way in."""
        limits = self._limits
        axial, _ = self._forces(held, context)
        inside = held.depth > self._mouth

        speed, resisted = (
            (-limits.speed, -axial / self._push.force) if inside else (-limits.approach_speed, 0.0)
        )
        self._advance(held, context, speed, resisted)

        stuck = context.time - state.since > limits.longest
        if not stuck and held.depth > -limits.standoff:
            return None
        held.speed = 0.0
        reason = f"stuck at {1e3 * held.depth:.0f} mm on the way out"
        return Abort(AbortCode.STUCK, reason) if stuck else PhaseEvent.DONE


_ANY = (Reaction.RETREAT, Reaction.RISE, Reaction.WITHDRAW)
# how work is left from the approach on
WITHDRAW: Mapping[Reaction, str] = dict.fromkeys(_ANY, "withdraw")
# and a tare
PARK: Mapping[Reaction, str] = {**dict.fromkeys(_ANY, "parked"), Reaction.STOP: "halt"}


def axial_end(withdraw: Withdraw) -> Iterable[tuple[str, TaskRow]]:
    """Rows that end axial work."""
    yield (
        "withdraw",
        TaskRow(
            withdraw, WorkState.WITHDRAW, {PhaseEvent.DONE: "parked"}, {Reaction.RETREAT: "parked"}
        ),
    )
    yield "parked", TaskRow(HoldTool(), WorkState.DONE)
    yield "held", TaskRow(Hold(), WorkState.DONE)
    yield "halt", TaskRow(Halt(), WorkState.RETREAT, {PhaseEvent.DONE: "held"})


def axial_monitors(
    limits: AxialLimits, *, lost_place: float, blind_time: float, too_long: str
) -> tuple[Monitor, ...]:
    """Monitors of axial work; faults are watched up to the stand-off.

    Args:
        limits: of force, place and time from the stand-off on.
        lost_place: [m] position error of the hull before.
        blind_time: [s] without vision.
        too_long: first words of the sentence for too long a way in.

    Returns:
        The monitors.
    """

    def too_late(held: Held, context: Context) -> str:
        del context
        return f"{too_long} within {limits.longest:.0f} s, at {1e3 * held.depth:.0f} mm"

    at_work = partial(Monitor, reaction=Reaction.RETREAT, during=_AT_WORK)
    force = too_much_force(limits.force_limit, contact_force)

    return (
        *fault_monitors(blind_time, BEFORE_CONTACT),
        Monitor(
            condition=adrift(lost_place),
            reaction=Reaction.RISE,
            code=AbortCode.HULL_ADRIFT,
            during=BEFORE_CONTACT,
        ),
        at_work(condition=adrift(limits.lost_place), code=AbortCode.HULL_ADRIFT),
        at_work(condition=force, code=AbortCode.FORCE_LIMIT),
        Monitor(
            condition=too_late,
            reaction=Reaction.RETREAT,
            code=AbortCode.TIME_LIMIT,
            lasting=limits.longest,
            during=_AT_WORK - {WorkState.WORK},
        ),
    )


def next_speed(
    speed: float,
    wanted: float,
    resisted: float,
    *,
    acceleration: float,
    yielding: float,
    period: float,
) -> float:
    """Damping law of the advance: speed one period later.

    Args:
        speed: [m/s] now.
        wanted: [m/s] speed at zero force.
        resisted: force against the motion as a share of the force at which the tool stands still.
            Above 1 the tool moves back, at most at the speed `wanted`.
        acceleration: [m/s^2] limit of the change of speed.
        yielding: [m/s^2] the same limit while a force opposes the motion.
        period: [s].

    Returns:
        The speed [m/s].
    """
    wanted *= min(max(1.0 - resisted, -1.0), 1.0)
    return towards(speed, wanted, (yielding if resisted > 0.0 else acceleration) * period)

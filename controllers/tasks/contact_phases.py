"""Phases of work on a surface: approach, press, follow the path, release, retreat.

Depths count from the stand-off.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from uuv.controllers.planning.path_poses import stretches
from uuv.controllers.planning.trajectories import Progress, SpeedLaw, progress_along
from uuv.controllers.tasks.approach_limits import ApproachLimits
from uuv.controllers.tasks.arrival import Since
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.phase import (
    ZERO,
    Abort,
    Context,
    Foreseen,
    Held,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
    towards,
    way_back,
)
from uuv.controllers.tasks.stops import Stops
from uuv.sim.interfaces.kernels.foresight import EstimateBounds
from uuv.sim.interfaces.messages import AbortCode, StateEstimate
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True)
class ApproachState:
    """State of `GuardedApproach`."""

    felt_for: float = 0.0  # [s] for which contact has lasted


class GuardedApproach(Phase):
    """Guarded move along the tool axis until contact, or to a distance without contact."""

    def __init__(self, limits: ApproachLimits, distance: float | None = None) -> None:
        """Set up the phase; `distance` [m] to keep from the surface, None: contact is sought."""
        self._limits = limits
        self._distance = distance

    def enter(self, held: Held, context: Context) -> ApproachState:
        """Begin at rest, at the stand-off."""
        del context
        held.speed = 0.0
        return ApproachState()

    def step(self, state: ApproachState, held: Held, context: Context) -> Outcome:
        """Report DONE in contact, or at the distance."""
        limits = self._limits
        state.felt_for = state.felt_for + context.period if context.normal > limits.touch else 0.0
        touched = state.felt_for >= limits.touch_time

        # Without contact, to a distance from the surface
        if self._distance is not None:
            depth = limits.standoff - self._distance
            if touched:
                reason = "unexpected contact on the way to the set distance from the surface"
                return Abort(AbortCode.OBSTACLE, reason)
            self._advance(held, context, depth)
            if held.depth < depth:
                return None
            held.depth = depth
            return PhaseEvent.DONE

        # Until contact
        if touched:
            held.set_force = context.normal
            held.speed = 0.0
            return PhaseEvent.DONE

        self._advance(held, context, limits.standoff)
        if held.depth > limits.standoff + limits.search:
            return Abort(
                AbortCode.NO_CONTACT,
                f"no contact within {limits.search} m beyond the expected surface",
            )
        return None

    def _advance(self, held: Held, context: Context, depth: float) -> None:
        """Advance for one period, at `touch_speed` from `guard` [m] before `depth` [m] on."""
        limits = self._limits
        speed = limits.speed if held.depth < depth - limits.guard else limits.touch_speed
        held.speed = towards(
            held.speed, 0.0 if context.paused else speed, limits.acceleration * context.period
        )
        held.depth += held.speed * context.period

    def setpoint(self, state: ApproachState, held: Held, context: Context) -> Setpoint:
        """The tool on its way."""
        del state, context
        X_WG = held.tool()[0]
        return Setpoint(X_WG=X_WG, v_WG_W=held.speed * X_WG[:3, 2])

    def foresee(self, state: ApproachState, held: Held) -> Foreseen | None:
        """Up to the first touch."""
        del held
        return (
            None if state.felt_for else Foreseen(within=EstimateBounds(normal=self._limits.touch))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PressLimits:
    """Force build-up before the work begins."""

    tolerance: float = 0.05  # of the set force, as a share of it
    noise: float = 3.0  # standard deviations of the estimate, where they are more than that
    held: float = 0.5  # [s] for which the force must be within it
    within: float = 6.0  # [s] limit for that
    # [m] by which the surface may yield; 136 N on the softest one allowed, 5e3 N/m, are 27 mm
    gives_way: float = 0.03


@dataclass(slots=True)
class PressState:
    """State of `Press`."""

    since: float  # [s] later by every pause
    p_WG: Array | None = None  # (3,) [m] believed tip when it touched; None: not watched
    set_since: float = math.inf  # [s] time since when the force is reached; inf: it is not


class Press(Phase):
    """Ramp the force to its set value and wait until it is reached; the tool rests on the path."""

    def __init__(
        self,
        limits: PressLimits,
        set_force: float,
        rate: float,
        *,
        insist: bool = True,
        tip: Callable[[StateEstimate], Array] | None = None,
    ) -> None:
        """Set up the phase.

        Args:
            limits: when the force counts as reached.
            set_force: [N] to press with.
            rate: [N/s] of its change.
            insist: False: done at any force when the time is over (ablation).
            tip: place (3,) [m] of the tip in W, by the estimate; None: a surface that gives way is
                pressed on all the same.
        """
        self._limits = limits
        self._rate = rate
        self._insist = insist
        self._tip = tip
        self._set_force = set_force

    def enter(self, held: Held, context: Context) -> PressState:
        """Begin at the force that is felt."""
        del held
        return PressState(context.time, None if self._tip is None else self._tip(context.estimate))

    def step(self, state: PressState, held: Held, context: Context) -> Outcome:
        """Report DONE once the force has been reached for long enough."""
        limits = self._limits
        set_force = self._set_force
        felt = context.normal
        if context.paused:
            state.since += context.period
        held.set_force = towards(held.set_force, set_force, self._rate * context.period)

        # A surface that gives way
        if self._tip is not None and state.p_WG is not None:
            yielded = float((self._tip(context.estimate) - state.p_WG) @ held.tool()[0][:3, 2])
            if yielded > limits.gives_way:
                reason = (
                    f"the surface gives way: {1e3 * yielded:.0f} mm under {max(felt, 0.0):.0f} N"
                )
                return Abort(AbortCode.GIVES_WAY, reason)

        # Reached: within a share of it, or within the noise of the estimate.
        noise = limits.noise * context.normal_sigma if math.isfinite(context.normal_sigma) else 0.0
        tolerance = max(limits.tolerance * set_force, noise)
        if abs(felt - set_force) > tolerance or held.set_force != set_force:
            state.set_since = math.inf
        elif not math.isfinite(state.set_since):
            state.set_since = context.time

        late = context.time - state.since > limits.within
        if context.time - state.set_since > limits.held or (late and not self._insist):
            return PhaseEvent.DONE
        if late:
            reason = (
                f"the force did not settle at {set_force:g} N within {limits.within:g} s: "
                f"{felt:.1f} N"
            )
            return Abort(AbortCode.FORCE_NOT_REACHED, reason)
        return None

    def setpoint(self, state: PressState, held: Held, context: Context) -> Setpoint:
        """The tool at rest under force control."""
        del state, context
        return Setpoint(X_WG=held.tool()[0], set_force=held.set_force, force_control=True)


class Dwell(Phase):
    """Stay in place under the set force for some time."""

    foresee = Phase.foresee

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def enter(self, held: Held, context: Context) -> Since:
        """Begin to wait."""
        del held
        return Since(context.time)

    def step(self, state: Since, held: Held, context: Context) -> Outcome:
        """Done when the time is over."""
        del held
        return PhaseEvent.DONE if context.time - state.since > self._seconds else None

    def setpoint(self, state: Since, held: Held, context: Context) -> Setpoint:
        """The tool at rest under force control."""
        del state, context
        return Setpoint(X_WG=held.tool()[0], set_force=held.set_force, force_control=True)


@dataclass(slots=True)
class FollowState:
    """State of `FollowPath`."""

    progress: Progress | SpeedLaw
    since: float  # [s] start of the motion, later by every pause and stop
    begin: float = 0.0  # [m] arc length where it starts
    pace: float = 1.0  # speed along the path as a share of that planned
    # (3,) [m/s] of the hull, which travels with the tool
    v_WB_W: Array = field(default_factory=lambda: ZERO)
    stops: Stops | None = None


class FollowPath(Phase):
    """Move along the path with set forces on equally long parts of it; the hull travels along.

    Where the tool cannot press on all of the path, this is one stretch of it, and there may be
    more.
    """

    def __init__(self, limits: FollowLimits, forces: Sequence[float], rate: float) -> None:
        """Set up the phase.

        Args:
            limits: of the motion.
            forces: [N] set forces; empty: no contact.
            rate: [N/s] of their change.
        """
        self._limits = limits
        self._forces = tuple(forces)
        self._rate = rate

    def enter(self, held: Held, context: Context) -> FollowState:
        """Begin at rest, at the begin of a stretch."""
        assert held.line is not None
        path = held.line.path
        limits = self._limits
        end = float(path.s[-1])
        if self._forces:
            end = min(last for _, last in stretches(path) if last > held.s)

        progress = progress_along(
            path, held.s, end, speed=path.pace * limits.speed, ramp=limits.ramp, bend=limits.bend
        )

        stops = (
            Stops(limits.stops)
            if limits.stops and self._forces and limits.stops.help(held.promise)
            else None
        )

        return FollowState(progress, context.time, held.s, stops=stops)

    def step(self, state: FollowState, held: Held, context: Context) -> Outcome:
        """Report DONE at the end of the path, and MORE at the end of any other stretch."""
        assert held.line is not None
        limits = self._limits
        progress = state.progress
        length = float(held.line.path.s[-1])

        # Progress, slower before a pause or a stop
        stopping = self._stops(state, held, context)
        state.pace = towards(
            state.pace,
            0.0 if context.paused or stopping else 1.0,
            context.period / limits.pace_time,
        )
        state.since += (1.0 - state.pace) * context.period
        done, rate = progress.at(context.time - state.since)
        held.s = state.begin + done

        # Set force of this part of the path
        if self._forces:
            change = self._rate * context.period
            held.set_force = towards(held.set_force, self._set_force(held, context), change)

        if context.time - state.since > progress.duration + limits.linger:
            return (
                PhaseEvent.DONE
                if next_stretch(held) is None or not self._forces
                else PhaseEvent.MORE
            )

        # The hull travels along
        placement = held.start_of_line()
        held.X_WB = placement.hull_at(held.s / length)
        state.v_WB_W = rate * state.pace / length * placement.hull_rate(held.s / length)
        return None

    def _set_force(self, held: Held, context: Context) -> float:
        """Set force [N] at the present place."""
        assert held.line is not None
        part = int(held.s / float(held.line.path.s[-1]) * len(self._forces))
        level = self._forces[min(part, len(self._forces) - 1)]
        return level * (self._limits.paused_force if context.paused else 1.0)

    def _stops(self, state: FollowState, held: Held, context: Context) -> bool:
        """True while the tool has to stop, which is never the case at the path's end."""
        if state.stops is None:
            return False
        if context.time - state.since >= state.progress.duration:
            state.stops.end()
            return False
        steady = held.set_force == self._set_force(held, context)
        return state.stops.step(state.pace, held.tool()[0][:3, 2], steady=steady, context=context)

    def setpoint(self, state: FollowState, held: Held, context: Context) -> Setpoint:
        """The tool on the path."""
        rate = state.progress.at(context.time - state.since)[1] * state.pace
        X_WG, tangent, turn = held.tool()
        standing = state.stops is not None and state.stops.standing

        return Setpoint(
            X_WG=X_WG,
            v_WG_W=rate * tangent,
            w_WG_W=rate * turn,
            v_WB_W=state.v_WB_W,
            set_force=held.set_force,
            force_control=bool(self._forces),
            compliant=standing,
            standing=standing,
            at_rest=None if state.stops is None else state.stops.said,
        )

    def foresee(self, state: FollowState, held: Held) -> Foreseen | None:
        """The whole motion, unless the tool stops on the path."""
        del held
        return Foreseen() if state.stops is None else None


def next_stretch(held: Held) -> float | None:
    """Arc length [m] at which the next stretch of the path begins; None after the last one."""
    assert held.line is not None
    return min((begin for begin, _ in stretches(held.line.path) if begin > held.s), default=None)


def travel(state: FollowState, held: Held, context: Context) -> None:
    """Move the tool along the path, off the surface, and the hull with it, to the present time."""
    assert held.line is not None
    done, rate = state.progress.at(context.time - state.since)
    held.s = state.begin + done
    length = float(held.line.path.s[-1])
    placement = held.start_of_line()
    held.X_WB = placement.hull_at(held.s / length)
    state.v_WB_W = rate / length * placement.hull_rate(held.s / length)


def travelling(state: FollowState, held: Held, context: Context) -> Setpoint:
    """Set point of a tool that `travel` moves."""
    X_WG, tangent, turn = held.tool()
    rate = state.progress.at(context.time - state.since)[1]
    return Setpoint(X_WG=X_WG, v_WG_W=rate * tangent, w_WG_W=rate * turn, v_WB_W=state.v_WB_W)


class NextStretch(Phase):
    """Move the tool at the stand-off to the next stretch that it can press; the hull goes along."""

    foresee = Phase.foresee

    def __init__(self, limits: FollowLimits, standoff: float) -> None:
        """Set up the phase: limits of the motion, and distance [m] from the surface."""
        self._limits = limits
        self._standoff = standoff

    def enter(self, held: Held, context: Context) -> FollowState:
        """Begin where the retreat ended."""
        begin = next_stretch(held)
        assert begin is not None
        held.depth = min(0.0, held.depth - self._standoff)
        limits = self._limits
        return FollowState(
            Progress(begin - held.s, limits.speed, limits.ramp), context.time, held.s
        )

    def step(self, state: FollowState, held: Held, context: Context) -> Outcome:
        """Report DONE when the tool rests before the next stretch."""
        travel(state, held, context)
        return (
            PhaseEvent.DONE
            if context.time - state.since > state.progress.duration + self._limits.linger
            else None
        )

    def setpoint(self, state: FollowState, held: Held, context: Context) -> Setpoint:
        """The tool at the stand-off."""
        return travelling(state, held, context)


class Unload(Phase):
    """Ramp the force down before the tool leaves: released at 90 N, it rebounds."""

    foresee = Phase.foresee

    def __init__(self, rate: float, until: float) -> None:
        """Set up the phase: `rate` [N/s] of the force, down to `until` [N]."""
        self._rate = rate
        self._until = until

    def step(self, state: None, held: Held, context: Context) -> Outcome:
        """Report DONE when the force is nearly zero."""
        del state
        held.set_force = towards(held.set_force, 0.0, self._rate * context.period)
        return None if held.set_force > self._until else PhaseEvent.DONE

    def setpoint(self, state: None, held: Held, context: Context) -> Setpoint:
        """The tool at rest under force control."""
        del state, context
        return Setpoint(X_WG=held.tool()[0], set_force=held.set_force, force_control=True)


class Retreat(Phase):
    """Withdraw the tool by the arm along its axis: the whole approach, at least the stand-off."""

    foresee = Phase.foresee

    def __init__(self, speed: float, clearance: float) -> None:
        """Set up the phase: `speed` [m/s] of the tool, `clearance` [m] least length of the way."""
        self._speed = speed
        self._clearance = clearance

    def enter(self, held: Held, context: Context) -> Since:
        """Begin at the surface, without a set force."""
        held.set_force = 0.0
        return Since(context.time)

    def step(self, state: Since, held: Held, context: Context) -> Outcome:
        """Report DONE when the tool is clear."""
        return (
            PhaseEvent.DONE
            if (context.time - state.since) * self._speed > way_back(held, self._clearance)
            else None
        )

    def setpoint(self, state: Since, held: Held, context: Context) -> Setpoint:
        """The tool on its way off."""
        back = min((context.time - state.since) * self._speed, way_back(held, self._clearance))
        X_WG = held.tool(back)[0]
        return Setpoint(X_WG=X_WG, v_WG_W=-self._speed * X_WG[:3, 2])


class NextPoint(Phase):
    """Move the tool at the stand-off to the next of several points; done after the last one.

    The hull travels along.
    """

    foresee = Phase.foresee

    def __init__(self, points: Sequence[float], limits: FollowLimits, standoff: float) -> None:
        """Set up the phase; the tool is at the point of index 0 when it is entered first.

        Args:
            points: [m] arc lengths.
            limits: of the motion.
            standoff: [m] distance from the surface.
        """
        self._points = tuple(points)
        self._limits = limits
        self._standoff = standoff

    def enter(self, held: Held, context: Context) -> FollowState | None:
        """Begin where the retreat ended; None after the last point."""
        k = len(held.places)
        if k == len(self._points):
            return None

        held.depth = min(0.0, held.depth - self._standoff)
        limits = self._limits
        before = self._points[k - 1]
        return FollowState(
            Progress(self._points[k] - before, limits.speed, limits.ramp), context.time, before
        )

    def step(self, state: FollowState | None, held: Held, context: Context) -> Outcome:
        """Report MORE at the point."""
        if state is None:
            return PhaseEvent.DONE
        travel(state, held, context)
        return PhaseEvent.MORE if context.time - state.since > state.progress.duration else None

    def setpoint(self, state: FollowState | None, held: Held, context: Context) -> Setpoint:
        """The tool at the stand-off."""
        if state is None:
            return Setpoint(X_WG=held.tool(way_back(held, self._standoff))[0])
        return travelling(state, held, context)

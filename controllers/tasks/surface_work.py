r"""Surface work: presses the tool along a path on a known object with set forces.

settle -> scan -> close-in -> tare -> approach -> press -> work -> retreat -> done
             \-> other view -> scan ...          any state with contact -> retreat -> abort

Where the end of the tool does not fit the surface on part of the path (`ToolPath.fits`), the tool
is lifted there: work -> retreat -> close-in -> approach, once for each further stretch. Work
without contact [Konoplin 2019] goes from approach directly to work: there is no surface to press
on.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.placement import PlacementSearch
from uuv.controllers.planning.promise import PromiseLimits, promise
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.approach_limits import ApproachLimits
from uuv.controllers.tasks.arrival import (
    ArrivalLimits,
    Since,
    TareSensors,
    WorkSite,
    around,
    arrival,
)
from uuv.controllers.tasks.contact_phases import (
    FollowPath,
    GuardedApproach,
    NextStretch,
    Press,
    PressLimits,
    Retreat,
    Unload,
)
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.hull_phases import Escape, EscapeLimits, Halt, HoldAway, PullBack
from uuv.controllers.tasks.monitors import (
    BEFORE_CONTACT,
    IN_CONTACT,
    LEAVING,
    Bounded,
    Monitor,
    Reaction,
    adrift,
    contact_force,
    fault_monitors,
    normal_force,
    object_moves,
    too_much_force,
    uncertain_force,
)
from uuv.controllers.tasks.phase import (
    INSTANT,
    Abort,
    Context,
    Foreseen,
    Held,
    Hold,
    HoldTool,
    Outcome,
    Phase,
    PhaseEvent,
    Setpoint,
)
from uuv.controllers.tasks.settings import SurfaceSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow
from uuv.models.objects.targets import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels.foresight import EstimateBounds
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.interfaces.spatial import Array

_HEADROOM = 0.85  # largest set force as a share of the force limit; the rest is for overshoot


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLimits:
    """Limits of force and position from the approach on."""

    force: float = 160.0  # [N] estimated normal force above which the work ends at any set force
    # share of the largest set force, and [N], by which it ends it at once
    above: tuple[float, float] = (0.25, 20.0)
    # [N] standard deviation of the normal force above which it does not count as felt
    sigma: float = 20.0
    # [s] without contact, or without a force that is felt, after which the work ends
    lost_time: float = 0.5
    # share of the set force, `touch` added, by which the estimated force may exceed it
    excess: float = 0.3
    excess_time: float = 0.3  # [s] after which a larger excess ends the work
    # [m] position error of the hull; in normal station-keeping it stays in 0.025
    lost_place: float = 0.04


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceTaskConfig(SurfaceSettings):
    """Settings of surface work, and the limits of its phases."""

    unchecked: bool = False  # True: also where the tool would leave its path at a singular posture
    force_control: bool = True  # False: work begins after `press.within` at any force (ablation)
    arrival: ArrivalLimits = field(default_factory=ArrivalLimits)
    press: PressLimits = field(default_factory=PressLimits)
    contact: ContactLimits = field(default_factory=ContactLimits)
    escape: EscapeLimits = field(default_factory=EscapeLimits)

    def __post_init__(self) -> None:
        SurfaceSettings.__post_init__(self)
        for force in self.forces:
            if force > _HEADROOM * self.contact.force:
                raise ConfigurationError(
                    f"forces: {force:g} N leaves no room for overshoot: at most "
                    f"{_HEADROOM * self.contact.force:g} N, {_HEADROOM:.0%} of the "
                    f"{self.contact.force:g} N at which the tool retreats (less for smaller set "
                    "forces)"
                )

        if self.presses and min(self.forces) < self.least_force:
            raise ConfigurationError(
                f"task.forces [N]: {min(self.forces):g} N cannot be distinguished from no contact: "
                f"at least {self.least_force:g} N, half of the {self.approach.touch:g} N that "
                "count as contact (task.approach.touch); below half of the set force contact "
                "counts as lost"
            )

        standoff = self.approach.standoff
        if self.contactless is not None and not 0.0 < self.contactless <= standoff:
            raise ConfigurationError(
                f"contactless: the distance must be > 0 and at most the stand-off of {standoff} "
                f"m, got {self.contactless}"
            )

    @property
    def force_limit(self) -> float:
        """Estimated force [N] above which the tool leaves the surface at once."""
        largest = max(self.forces)
        share, least = self.contact.above
        return min(self.contact.force, largest + max(share * largest, least) + self.approach.touch)

    @property
    def least_force(self) -> float:
        """Least set force [N] at which a loss of contact is above the scatter of the estimate."""
        return self.approach.least_force

    @property
    def presses(self) -> bool:
        """True if a set force is to be held at work."""
        return self.force_control and self.contactless is None


@dataclass(slots=True)
class CertainState:
    """State of `CertainPlace`."""

    inner: Since
    asked: float = -np.inf  # [s] when the chance was last judged
    tared: float = np.inf  # [s] when the inner phase was done
    chance: float = 0.0  # judged then


class CertainPlace(Phase):
    """The tare, followed by a wait while the probability of keeping the path's tolerance rises.

    Waiting helps where the estimate still becomes better: a camera on the arm that holds the place
    while vision adds its mean. Else the work begins, or is refused, after one more look.
    """

    def __init__(self, tare: TareSensors, limits: PromiseLimits, speed: float) -> None:
        """Set up the phase; `speed` [m/s] along the path."""
        self._tare = tare
        self._limits = limits
        self._speed = speed

    def enter(self, held: Held, context: Context) -> CertainState:
        """Begin with the tare."""
        return CertainState(self._tare.enter(held, context))

    def step(self, state: CertainState, held: Held, context: Context) -> Outcome:
        """Report DONE with `held.promise`, or abort if the probability is too small."""
        limits = self._limits
        outcome = self._tare.step(state.inner, held, context)
        if outcome is not PhaseEvent.DONE or context.time - state.asked < limits.interval:
            return None if outcome is PhaseEvent.DONE else outcome
        assert held.line is not None

        # Probability for the time of the work
        state.tared = min(state.tared, context.time)
        duration = float(held.line.path.s[-1]) / (self._speed * held.line.path.pace)
        target = held.target
        held.promise = (
            None
            if target is None
            else promise(context.estimate, target, limits.tolerance, duration)
        )
        if held.promise is None:
            return PhaseEvent.DONE

        chance = held.promise.chance
        first = not np.isfinite(state.asked)
        rising = first or chance > state.chance + limits.gain
        state.asked = context.time
        state.chance = chance
        if (
            chance < max(limits.wanted, limits.least)
            and rising
            and context.time - state.tared < limits.patience
        ):
            return None

        held.note = f"{held.note}; {held.promise}" if held.note else str(held.promise)
        if chance < limits.least:
            return Abort(
                AbortCode.PLACE_UNCERTAIN,
                f"{held.promise}; at least {limits.least:.1%} is required",
            )
        return PhaseEvent.DONE

    def setpoint(self, state: CertainState, held: Held, context: Context) -> Setpoint:
        """The set points of the tare."""
        return self._tare.setpoint(state.inner, held, context)

    def foresee(self, state: CertainState, held: Held) -> Foreseen | None:
        """The rest of the tare."""
        del held
        return Foreseen(until=state.inner.since + self._tare.duration - INSTANT)


class SurfaceWork(TaskPlanner):
    """Planner that works along one tool path on one known object."""

    def __init__(
        self,
        own: WorkVehicle,
        target: TargetModel,
        job: SurfaceTaskConfig,
        *,
        X_WB_scan: Array,
        floor: float = -np.inf,
        period: float = 0.01,
        search: PlacementSearch | None = None,
        holding: ThrustMargin | None = None,
    ) -> None:
        """Set up the planner.

        Args:
            own: the vehicle.
            target: model of the object.
            job: set forces, speeds and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            floor: [m] height of the seabed in W.
            period: [s] of the planner.
            search: hull placements that are tried.
            holding: thrust margin of the hull beside the object; without it placements are not
                tested for it.
        """
        stand = PathStanding(
            vehicle=own.vehicle,
            chain=own.chain,
            model=target,
            hull_box=own.hull_box,
            limits=StandingLimits(
                force=max(job.forces),
                standoff=job.approach.standoff,
                least_share=job.least,
                thrust=job.promise.most_thrust,
                place=job.hull_place,
                speed=job.speed,
                unchecked=job.unchecked,
            ),
            floor=floor,
            search=search,
            holding=holding if job.contactless is None else None,
        )

        site = WorkSite(
            own=own, X_WB_scan=np.array(X_WB_scan), stand=stand, around=around(own, target)
        )

        self.job = job
        self.stand = stand
        super().__init__(
            surface_rows(site, job),
            surface_monitors(job),
            X_WB=X_WB_scan,
            q=own.vehicle.q_home,
            period=period,
        )


BREAK_OFF = {
    Reaction.RETREAT: "retreat",
    Reaction.RISE: "rise",
    Reaction.WITHDRAW: "pull back",
    Reaction.STOP: "halt",
}


def surface_rows(site: WorkSite, job: SurfaceTaskConfig) -> Iterable[tuple[str, TaskRow]]:
    """Table of surface work.

    Args:
        site: what is known before the work.
        job: set forces, speeds and limits.

    Returns:
        Names and rows.
    """
    approach = job.approach
    states = WorkState
    press = Press(
        job.press, job.forces[0], job.force_rate, insist=job.force_control, tip=site.own.tip
    )

    along = FollowLimits(speed=job.speed, stops=job.promise.stops)
    follow = FollowPath(along, job.forces if job.contactless is None else (), job.force_rate)
    tare = CertainPlace(TareSensors(), job.promise, job.speed)
    stand_off = -approach.standoff

    yield from arrival(
        site, job.arrival, then="approach", depth=0.0, offset=stand_off, broken=BREAK_OFF, tare=tare
    )

    meet = TaskRow(
        GuardedApproach(approach, job.contactless),
        states.APPROACH,
        {PhaseEvent.DONE: "press" if job.contactless is None else "work"},
        BREAK_OFF,
        feels=True,
    )
    yield "approach", meet
    yield "press", TaskRow(press, states.PRESS, {PhaseEvent.DONE: "work"}, BREAK_OFF, feels=True)

    ends = {
        PhaseEvent.DONE: "unload" if job.presses else "retreat",
        PhaseEvent.MORE: "let go" if job.presses else "lift",
    }
    yield "work", TaskRow(follow, states.WORK, ends, BREAK_OFF, feels=True)

    # Off the surface, and on to the next stretch
    let_go = Unload(job.force_rate, approach.touch)
    lift = Retreat(approach.speed, approach.standoff)
    onward = NextStretch(FollowLimits(speed=job.speed), approach.standoff)
    yield "let go", TaskRow(let_go, states.RETREAT, {PhaseEvent.DONE: "lift"}, BREAK_OFF)
    yield "lift", TaskRow(lift, states.RETREAT, {PhaseEvent.DONE: "onward"}, BREAK_OFF)
    yield "onward", TaskRow(onward, states.CLOSE_IN, {PhaseEvent.DONE: "approach"}, BREAK_OFF)

    yield from retreat_rows(site.own, job)


def retreat_rows(vehicle: WorkVehicle, job: SurfaceTaskConfig) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the surface to the end: release, retreat, and what follows a fault.

    Args:
        vehicle: the vehicle.
        job: speeds and limits.

    Returns:
        Names and rows; "unload" and "retreat" are to be entered.
    """
    approach = job.approach
    motion = job.arrival.motion
    states = WorkState
    clear = approach.standoff
    stop = {Reaction.STOP: "halt"}
    off = {**stop, Reaction.RISE: "rise"}
    retreat = Retreat(approach.speed, clear)
    escape = Escape(job.escape, clear, vehicle.vehicle.q_home)

    yield (
        "unload",
        TaskRow(
            Unload(job.force_rate, approach.touch),
            states.RETREAT,
            {PhaseEvent.DONE: "retreat"},
            off,
        ),
    )

    yield "retreat", TaskRow(retreat, states.RETREAT, {PhaseEvent.DONE: "parked"}, off)
    yield "rise", TaskRow(escape, states.RETREAT, {PhaseEvent.DONE: "held"}, stop)
    yield (
        "pull back",
        TaskRow(PullBack(motion, clear), states.RETREAT, {PhaseEvent.DONE: "held"}, stop),
    )

    yield "parked", TaskRow(HoldTool(clear), states.DONE, leave=off)
    yield "held", TaskRow(HoldAway(job.escape.leash), states.DONE, leave=stop)
    yield "halt", TaskRow(Halt(), states.RETREAT, {PhaseEvent.DONE: "halted"})
    yield "halted", TaskRow(Hold(), states.DONE)


def surface_monitors(job: SurfaceTaskConfig) -> tuple[Monitor, ...]:
    """Monitors of surface work."""
    limits = job.contact
    touch = job.approach.touch
    at_work = frozenset({WorkState.WORK}) if job.presses else frozenset()

    def allowed(held: Held) -> float:
        return (1.0 + limits.excess) * held.set_force + touch

    def too_hard(held: Held, context: Context) -> str:
        forces = f"{context.normal:.0f} N estimated, {held.set_force:.0f} N set"
        return f"the force cannot be held: {forces}" if context.normal > allowed(held) else ""

    def leaving_force(held: Held, context: Context) -> float:
        """Force that is monitored: along the normal, of any direction after the release."""
        return (
            normal_force(held, context) if held.set_force > touch else contact_force(held, context)
        )

    return (
        *fault_monitors(job.arrival.blind_time),
        *_drift_monitors(job),
        # the object
        Monitor(
            condition=object_moves(job.promise.tolerance),
            reaction=Reaction.RETREAT,
            code=AbortCode.OBJECT_MOVES,
            during=IN_CONTACT,
        ),
        # too much force
        Monitor(
            condition=too_much_force(job.force_limit, normal_force),
            reaction=Reaction.RETREAT,
            code=AbortCode.FORCE_LIMIT,
            during=IN_CONTACT,
        ),
        Monitor(
            condition=too_much_force(job.force_limit, leaving_force),
            reaction=Reaction.RISE,
            code=AbortCode.FORCE_LIMIT,
            during=LEAVING,
        ),
        # force not felt or not held, contact lost
        Monitor(
            condition=uncertain_force(limits.sigma),
            reaction=Reaction.RETREAT,
            code=AbortCode.FORCE_NOT_FELT,
            lasting=limits.lost_time,
            during=IN_CONTACT if job.presses else frozenset(),
        ),
        Monitor(
            condition=Bounded(too_hard, lambda held: EstimateBounds(normal=allowed(held))),
            reaction=Reaction.RETREAT,
            code=AbortCode.FORCE_NOT_HELD,
            lasting=limits.excess_time,
            during=at_work,
        ),
        Monitor(
            condition=_contact_lost(job.approach, limits.lost_time),
            reaction=Reaction.RETREAT,
            code=AbortCode.CONTACT_LOST,
            lasting=limits.lost_time,
            during=at_work,
        ),
    )


def _contact_lost(approach: ApproachLimits, time: float) -> Bounded:
    """Condition: the estimated normal force is that of lost contact; `time` [s]: how long."""

    def condition(held: Held, context: Context) -> str:
        pressed = context.normal > approach.lost_below(held.set_force)
        return "" if pressed else f"contact lost for {time} s"

    return Bounded(
        condition, lambda held: EstimateBounds(slack=-approach.lost_below(held.set_force))
    )


def _drift_monitors(job: SurfaceTaskConfig) -> Iterable[Monitor]:
    """Monitors of the hull's position, narrowest in contact."""
    limit = job.contact.lost_place
    for distance, during in (
        (job.arrival.lost_place, BEFORE_CONTACT),
        (limit, IN_CONTACT),
        (2.0 * limit, LEAVING),
    ):
        yield Monitor(
            condition=adrift(distance),
            reaction=Reaction.RISE,
            code=AbortCode.HULL_ADRIFT,
            during=during,
        )

r"""Collection of an object: picked up from the ground, and put into a basket beside it.

settle -> scan -> close-in -> tare -> approach -> press -> work -> retreat -> withdraw -> done
                                                  any of these -> retreat or withdraw -> abort

The jaws close in press. The work is lift -> weigh -> carry -> lower; in retreat they let go. What
slips out before it is carried is gripped once more.

The grasp is chosen once the object is identified (`uuv.controllers.planning.grasp_choice`): from
above, at the best margin from which the hull can stand with the load. The thrusters get the weight
as it is felt in the lift, and from the weighing on as a part of the arm.

| what happens | before it hangs free | while it hangs free |
|---|---|---|
| sensors wrong, force or place out of bounds | let go, withdraw | keep, withdraw |
| a thruster lost | open the jaws and rise | keep and rise |
| an encoder wrong | open the jaws, the hull withdraws the arm | keep, the same |
| it slips out | grip once more | drop: open the jaws, withdraw |
| too heavy, or fixed | put back, let go, withdraw | |
| no estimate | let go; arm braked, hull off and up (`safety_wrapper`) | keep, the same |
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.planning.arm_size import FULL
from uuv.controllers.planning.grasp_choice import GraspChoice, PlacedGrasp, carry_path
from uuv.controllers.planning.hull_path import HullPath
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import ArrivalLimits, WorkSite, around, arrival
from uuv.controllers.tasks.axial_phases import (
    AxialApproach,
    AxialContact,
    AxialLimits,
    Push,
    Withdraw,
    axial_monitors,
)
from uuv.controllers.tasks.grasping.jaw_phases import (
    Carry,
    CarrySpeed,
    CloseJaws,
    Depart,
    GripPlan,
    JawLimits,
    LetGo,
    Lift,
    MoveJaws,
    PutBack,
    Weigh,
    Weighing,
    dropped,
    weight_gone,
)
from uuv.controllers.tasks.hull_phases import Escape, EscapeLimits, Halt, HoldAway, PullBack
from uuv.controllers.tasks.monitors import IN_CONTACT, Monitor, Reaction, fault_monitors
from uuv.controllers.tasks.phase import Context, Decide, Held, Hold, HoldTool, Phase, PhaseEvent
from uuv.controllers.tasks.settings import CollectSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.models.objects.target_model import TargetModel
from uuv.models.tools.jaw_shape import JawShape
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import AbortCode, HeldLoad, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, inverse, readonly, transform_points

FRICTION_USED = 0.7  # share of the friction cone that the expected load may take
ENDS = PhaseEvent.DONE
_TRIED = 6  # grasps from which a place to stand is sought
_GYRATION = 0.5  # radius of gyration over the radius of the object, about that of a ball
# how work is left on the way to the object
LEAVE = {
    Reaction.RETREAT: "withdraw",
    Reaction.RISE: "rise",
    Reaction.WITHDRAW: "pull back",
    Reaction.STOP: "halt",
}
AT_OBJECT = {**LEAVE, Reaction.RETREAT: "free"}  # with the jaws around it
OFF_GROUND = {**LEAVE, Reaction.RETREAT: "put back"}  # in the lift, and over its place


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectJob(CollectSettings):
    """Settings and limits of a collection; depths are of the fingers' ends below their grasp."""

    push: float = 20.0  # [N] axial force at which the advance stops
    touch: float = 6.0  # [N] axial force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last,
    loaded_touch_time: float = 0.2  # [s] or with a load, whose own motion is felt
    early: float = 0.05  # [m] contact farther than this above the grasp is an obstacle
    guard: float = 0.04  # [m] height above the grasp at which the slower speed begins
    touch_speed: float = 0.012  # [m/s] from there on
    drop: float = 0.01  # [m] height over the basket's floor at which the object is let go
    axial: AxialLimits = field(
        default_factory=partial(
            AxialLimits,
            standoff=0.18,
            approach_speed=0.04,
            speed=0.03,
            longest=60.0,
            force_limit=80.0,
        )
    )
    jaws: JawLimits = field(default_factory=JawLimits)
    weighing: Weighing = field(default_factory=Weighing)
    # with open jaws, or a load, the arm does not fold
    escape: EscapeLimits = field(default_factory=partial(EscapeLimits, free=math.inf))
    carry_ramp: float = 2.0  # [s] from rest to the speed with the object


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Basket:
    """The basket as it is charted: open above, level."""

    floor_W: Array  # (3,) [m] middle of its floor
    rim: float  # [m] height of the rim over the floor
    half: float  # [m] half of its side

    def corners(self) -> Array:
        """Corners (8, 3) [m] in W."""
        sides = np.array([[x, y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) * self.half
        levels = [np.column_stack([sides, np.full(4, height)]) for height in (0.0, self.rim)]
        return self.floor_W + np.vstack(levels)


def check_grip(job: CollectJob, jaws: JawShape) -> None:
    """Refuse a grip that the jaws cannot give, or that cannot bear the load.

    Raises:
        ConfigurationError: with the figures.
    """
    check_motor(job.grip, jaws, job.jaws)
    held = 2.0 * jaws.friction * job.grip
    if job.load > FRICTION_USED * held:
        least = job.load / (2.0 * jaws.friction * FRICTION_USED)
        raise ConfigurationError(
            f"task.load {job.load:g} N: friction holds {held:.0f} N at task.grip {job.grip:g} N, "
            f"of which {FRICTION_USED:.0%} may be used; that needs a grip of {least:.0f} N or more"
        )


def check_motor(grip: float, jaws: JawShape, limits: JawLimits) -> None:
    """Refuse a grip [N] that the jaws cannot give, or with which their stop is not detected.

    Raises:
        ConfigurationError: with the figures.
    """
    if grip > jaws.force:
        raise ConfigurationError(
            f"task.grip [N]: the jaws give at most {jaws.force:g}, got {grip:g}"
        )

    # Free jaws must move faster than jaws that have stopped at something.
    least = jaws.loss + 0.5 * jaws.damping * 2.0 * limits.still
    if grip < least:
        raise ConfigurationError(
            f"task.grip [N]: at least {least:.1f}, or the jaws close too slowly for their "
            f"stop to be detected, got {grip:g}"
        )


def longest_lever(job: CollectJob, jaws: JawShape) -> float:
    """Lever [m] of the load about the line between the pads which these can bear.

    Friction spread over the breadth b of two pads bears the moment 2 mu N b / 4.
    """
    return 2.0 * FRICTION_USED * jaws.friction * job.grip * 0.25 * jaws.breadth / job.load


class Collecting(TaskPlanner):
    """Planner that collects one known object."""

    def __init__(
        self,
        vehicle: WorkVehicle,
        choice: GraspChoice,
        job: CollectJob,
        *,
        X_WB_scan: Array,
        basket: Basket,
        displaced: float,
        holding: ThrustMargin | None = None,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            vehicle: the vehicle.
            choice: grasps of the object.
            job: forces, speeds and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            basket: where the object is put.
            displaced: [kg] water that the object displaces.
            holding: thrust margin of the hull; None: not tested.
            period: [s] of the planner.

        Raises:
            ConfigurationError: the jaws cannot give the grip, that cannot bear the load, or the
                arm has fewer than six joints.
        """
        check_grip(job, choice.jaws)
        if vehicle.chain.n < FULL:
            raise ConfigurationError(
                "collect: the grasp fixes the jaws' axes, which an arm of "
                f"{vehicle.chain.n} joints cannot hold; at least {FULL} are needed"
            )
        self._vehicle = vehicle
        self._choice = choice
        self._job = job
        self._basket = basket
        self._displaced = displaced
        standing = PathStanding(
            vehicle=vehicle.vehicle,
            chain=vehicle.chain,
            model=choice.target,
            hull_box=vehicle.hull_box,
            # The load pulls along the tool's axis. The hull keeps its place while the arm carries.
            limits=StandingLimits(force=-job.load, standoff=job.axial.standoff, roomy=0.0),
            holding=None if holding is None else holding.without_friction(),
        )
        self._standing = standing
        self.stand = self._stand

        site = WorkSite(
            own=vehicle, X_WB_scan=np.array(X_WB_scan), stand=self._stand, around=self.around
        )
        limits = ArrivalLimits()
        rows = collect_rows(site, limits, job, self._take, choice.jaws.force)
        super().__init__(
            rows,
            jaw_monitors(job, limits, too_long="the object was not gripped"),
            X_WB=X_WB_scan,
            q=vehicle.vehicle.q_home,
            period=period,
        )

    def with_path(self, target: Target) -> Target:
        """The target with a path to its middle, which stands for it until the grasp is chosen."""
        return replace(target, path=straight_down(target.X_WT, self._choice))

    def grasps(self, target: Target) -> Sequence[tuple[PlacedGrasp, ToolPath]]:
        """Grasps of the identified object with their paths to the basket, best first.

        Raises:
            ReachError: no grasp is possible.
        """
        model = self._choice.target
        floor = float(transform_points(target.X_WT, model.vertices)[:, 2].min())
        center_W = transform_points(target.X_WT, model.center)
        ranked = self._choice.ranked(target.X_WT, floor)

        paths = []
        for grasp in ranked[:_TRIED]:
            # The object's middle over the basket's, its underside a little above the floor.
            p_end = self._basket.floor_W + grasp.X_WG[:3, 3] - center_W
            p_end[2] = self._basket.floor_W[2] + grasp.X_WG[2, 3] - floor + self._job.drop
            paths.append((grasp, carry_path(grasp, p_end)))
        return paths

    def around(self, target: Target) -> HullPath:
        """Clearance of the hull's moves from the identified object and the basket."""
        return around(self._vehicle, self._with_basket(target))(target)

    def _with_basket(self, target: Target) -> TargetModel:
        """The object's model with the corners of the basket among its vertices."""
        model = self._choice.target
        corners_T = transform_points(inverse(target.X_WT), self._basket.corners())
        return replace(model, vertices=np.vstack([model.vertices, corners_T]), hulls=(), solids=())

    def _stand(
        self, target: Target, path: ToolPath, current_W: Array
    ) -> tuple[Placement, ToolPath, float]:
        """Hull placement for the best grasp that has one.

        Raises:
            ReachError: no grasp has one.
        """
        del path
        model = self._choice.target
        floor = float(transform_points(target.X_WT, model.vertices)[:, 2].min())

        # Hull and arm keep clear of the object and of the basket.
        standing = replace(self._standing, model=self._with_basket(target), floor=floor)

        failure: ReachError | None = None
        for _, carried in self.grasps(target):
            for turned in (carried, half_turn(carried)):
                try:
                    placement, worked, share = standing(target, turned, current_W)
                except ReachError as error:
                    failure = failure or error
                    continue
                if np.any(placement.travel_W) or share < 1.0:
                    failure = failure or ReachError("object and basket are too far apart")
                    continue
                return placement, worked, share
        raise failure or ReachError("there is no grasp")

    def _take(self, held: Held, context: Context) -> None:
        """Keep the grasp that the chosen line belongs to."""
        del context
        assert held.target is not None
        assert held.line is not None
        path = held.line.path

        def distance(grasp: PlacedGrasp) -> float:
            """From the start of the path [m], and how far the closing lines differ (1: square)."""
            away = np.linalg.norm(grasp.X_WG[:3, 3] - path.p[0])
            return float(away + 1.0 - abs(grasp.X_WG[:3, 0] @ path.x[0]))

        grasp = min((grasp for grasp, _ in self.grasps(held.target)), key=distance)
        held.plan = GripPlan(
            opening=grasp.opening,
            width=grasp.width,
            bears=self._job.load,
            expected=self.expected(held.target, held.line.at(0.0, 0.0)[0]),
        )

    def expected(self, target: Target, X_WG: Array) -> HeldLoad:
        """What the jaws will hold with the tool at `X_WG` (4, 4); as heavy as its water."""
        model = self._choice.target
        center_W = transform_points(target.X_WT, model.center)
        center_G = readonly(transform_points(inverse(X_WG), center_W))
        return HeldLoad(
            mass=self._displaced,
            displaced=self._displaced,
            center_G=center_G,
            buoyancy_G=center_G,
            radius=_GYRATION * model.radius,
        )


def straight_down(X_WT: Array, choice: GraspChoice) -> ToolPath:
    """A path that stands for the object until its grasp is chosen: from above, to its middle."""
    p = transform_points(X_WT, choice.target.center)
    X = np.eye(4)
    X[:3, :3] = np.diag([1.0, -1.0, -1.0])
    X[:3, 3] = p
    at = PlacedGrasp(X_WG=X, width=choice.jaws.opening, opening=choice.jaws.opening, margin=0.0)
    return carry_path(at, p + np.array([0.01, 0.0, 0.0]))


def half_turn(path: ToolPath) -> ToolPath:
    """The same path with the tool turned by half about its axis: the fingers change places."""
    return replace(path, x=readonly(-path.x))


class JawJob(Protocol):
    """What the ways of a job with jaws have in common."""

    @property
    def grip(self) -> float:
        """Set force [N] of each finger."""
        ...

    @property
    def axial(self) -> AxialLimits:
        """Limits of the tool's motion."""
        ...

    @property
    def jaws(self) -> JawLimits:
        """Limits of the jaws."""
        ...

    @property
    def escape(self) -> EscapeLimits:
        """Limits of the ascent."""
        ...


def jaw_monitors(
    job: JawJob,
    limits: ArrivalLimits,
    *,
    too_long: str,
    at_object: frozenset[WorkState] = IN_CONTACT,
) -> tuple[Monitor, ...]:
    """Monitors of work with jaws: those of axial work, and of the object in the jaws.

    Args:
        job: forces and limits.
        limits: of the way to the stand-off.
        too_long: first words of the sentence for too long a way in.
        at_object: states in which faults are watched besides the way to the stand-off.
    """
    of_tool = axial_monitors(
        job.axial, lost_place=limits.lost_place, blind_time=limits.blind_time, too_long=too_long
    )
    # Faults, also with the jaws at the object.
    faults = fault_monitors(limits.blind_time, at_object)
    leaving = frozenset({WorkState.RETREAT, WorkState.WITHDRAW, WorkState.DONE})
    urgent = [
        replace(monitor, during=leaving)
        for monitor in faults
        if monitor.reaction not in (Reaction.PAUSE, Reaction.RETREAT)
    ]
    return (*of_tool, *faults, *urgent, *drop_monitors(job.jaws))


def drop_monitors(jaws: JawLimits) -> tuple[Monitor, ...]:
    """Monitors of an object that is carried: it slips out, or its weight is gone."""
    drop = partial(
        Monitor,
        reaction=Reaction.RETREAT,
        code=AbortCode.DROPPED,
        during=frozenset({WorkState.WORK}),
    )
    gone = drop(condition=weight_gone(jaws), lasting=jaws.gone_time)
    return drop(condition=dropped(jaws)), gone


def collect_rows(
    site: WorkSite,
    limits: ArrivalLimits,
    job: CollectJob,
    take: Callable[[Held, Context], None],
    motor: float,
) -> Iterable[tuple[str, TaskRow]]:
    """Table of a collection.

    Args:
        site: what is known before the work.
        limits: of the way to the stand-off.
        job: forces, speeds and limits.
        take: keeps the chosen grasp in `Held.plan`.
        motor: [N] most force of the jaws' motor.

    Returns:
        Names and rows.
    """
    yield from arrival(
        site, limits, then=at_once("grasp"), depth=-job.axial.standoff, offset=0.0, broken=LEAVE
    )
    yield (
        "grasp",
        TaskRow(Decide(take, AbortCode.OUT_OF_REACH), WorkState.TARE, {ENDS: "open"}, LEAVE),
    )
    yield from rows_at_object(job, site.own.vehicle.q_home, limits, motor)


def gripping_rows(
    opened: Phase, down: Phase, close: Phase, opened_again: Phase, *, then: str, again: str
) -> Iterable[tuple[str, TaskRow]]:
    """Rows that grip an object; "open" is to be entered.

    Args:
        opened: opens the jaws above the object.
        down: lowers them to their place around it.
        close: closes them.
        opened_again: opens them there, after a grip that failed.
        then: row after the grip.
        again: row after `opened_again`.
    """
    states = WorkState
    arrived = {ENDS: "close", PhaseEvent.TOUCHED: "close"}
    yield "open", TaskRow(opened, states.APPROACH, {ENDS: "approach"}, LEAVE)
    yield "approach", TaskRow(down, states.APPROACH, arrived, LEAVE)

    closed = {ENDS: then, PhaseEvent.REFUSED: "open again"}
    yield "close", TaskRow(close, states.PRESS, closed, AT_OBJECT)
    yield "open again", TaskRow(opened_again, states.PRESS, {ENDS: again}, AT_OBJECT)


def rows_at_object(
    job: CollectJob, q_home: Array, limits: ArrivalLimits | None = None, motor: float | None = None
) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the stand-off over the object on; "open" is to be entered.

    Args:
        job: forces, speeds and limits.
        q_home: (n,) [rad] joint angles of the folded arm.
        limits: of the hull's motions.
        motor: [N] most force of the jaws' motor, with which they open; default: that of the grip.
    """
    axial = job.axial
    states = WorkState
    free = Push(force=job.push, beyond=-job.early)
    yielding = replace(free, beyond=-math.inf, compliant_beyond=-math.inf)
    loaded = replace(free, beyond=-math.inf)

    met = AxialContact(
        touch=job.touch,
        touch_time=job.touch_time,
        early=job.early,
        obstacle="obstacle {} mm above the grasp",
        yields=True,
    )
    # What hangs in the jaws swings: contact under a load lasts longer than at an empty tool.
    landed = replace(
        met,
        touch_time=job.loaded_touch_time,
        obstacle="the object meets something {} mm above its place",
    )
    way = {"slow": (-job.guard, job.touch_speed), "to": 0.0}
    jaws = partial(MoveJaws, axial, jaws=job.jaws, force=job.grip if motor is None else motor)

    let_go = {ENDS: "let go", PhaseEvent.TOUCHED: "let go"}

    # To the object, and the jaws around it.
    down = AxialApproach(axial, free, contact=met, **way)
    close = CloseJaws(axial, yielding, job.jaws, job.grip)
    yield from gripping_rows(jaws(free), down, close, jaws(yielding), then="lift", again="close")

    # With it to the basket.
    gripped = (axial, loaded, job.jaws, job.grip)
    again = {PhaseEvent.REFUSED: "open above"}
    weigh = Weigh(*gripped, job.weighing)
    carry = Carry(*gripped, CarrySpeed(speed=job.carry_speed, ramp=job.carry_ramp))
    lower = AxialApproach(axial, loaded, contact=landed, **way)
    yield "lift", TaskRow(Lift(*gripped), states.WORK, {ENDS: "weigh", **again}, OFF_GROUND)
    yield "weigh", TaskRow(weigh, states.WORK, {ENDS: "carry", **again}, OFF_GROUND)
    yield "open above", TaskRow(jaws(free), states.PRESS, {ENDS: "approach"}, AT_OBJECT)
    yield "carry", TaskRow(carry, states.WORK, {ENDS: "lower"}, AT_OBJECT)
    yield "lower", TaskRow(lower, states.WORK, let_go, AT_OBJECT)
    put_back = PutBack(job.jaws, axial, loaded, contact=landed, **way)
    yield "put back", TaskRow(put_back, states.RETREAT, let_go, AT_OBJECT)
    yield "let go", TaskRow(jaws(loaded), states.RETREAT, {ENDS: "withdraw"}, LEAVE)
    yield "free", TaskRow(LetGo(*gripped), states.RETREAT, {ENDS: "withdraw"}, LEAVE)

    yield from departure_rows(job, loaded, q_home, limits or ArrivalLimits())


def departure_rows(
    job: JawJob, push: Push, q_home: Array, limits: ArrivalLimits
) -> Iterable[tuple[str, TaskRow]]:
    """Rows of the ways off the object, each with what hangs free in the jaws."""
    axial = job.axial
    states = WorkState
    depart = partial(Depart, jaws=job.jaws, force=job.grip)
    stop = {Reaction.STOP: "halt"}
    off = {**stop, Reaction.RISE: "rise"}

    withdraw = depart(Withdraw(axial, push, math.inf))
    yield (
        "withdraw",
        TaskRow(withdraw, states.WITHDRAW, {ENDS: "parked"}, {**off, Reaction.RETREAT: "parked"}),
    )
    rise = depart(Escape(job.escape, axial.standoff, q_home))
    yield "rise", TaskRow(rise, states.RETREAT, {ENDS: "held"}, stop)
    pull = depart(PullBack(limits.motion, axial.standoff))
    yield "pull back", TaskRow(pull, states.RETREAT, {ENDS: "held"}, stop)

    yield "parked", TaskRow(HoldTool(), states.DONE, leave=off)
    yield "held", TaskRow(HoldAway(job.escape.leash), states.DONE, leave=stop)
    yield "halt", TaskRow(depart(Halt()), states.RETREAT, {ENDS: "halted"})
    yield "halted", TaskRow(Hold(), states.DONE)

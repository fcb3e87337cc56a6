r"""Move of a plug out of one receptacle into another.

settle -> scan -> close-in -> tare -> approach -> press -> work -> insert -> retreat -> withdraw
                          any of these -> retreat or withdraw -> abort        \-> search -/

The jaws close on the plug's handle in press. The work is pull -> weigh -> carry -> lower; in
retreat they let go. The pull is bounded, since the friction of the seat is unknown; a plug that
stands against it is stuck. Into the other receptacle the plug goes as a sampler into a hole
(`uuv.controllers.tasks.insertion`), until its collar meets the panel.

Before contact the pull and the push that arm and thrusters can give are computed, and the job
refused beyond.

| what happens | the plug is in a receptacle | it is out of both |
|---|---|---|
| sensors wrong, force or place out of bounds | let go, withdraw | keep, withdraw |
| a thruster lost | open the jaws and rise | keep and rise |
| an encoder wrong | open the jaws, the hull withdraws the arm | keep, the same |
| it slips out | in the pull: grip once more; else open the jaws, withdraw | drop: the same |
| stuck, jammed | let go, withdraw | |
| the other hole is not found | | keep, withdraw |
| no estimate | let go; arm braked, hull off and up (`safety_wrapper`) | keep, the same |
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.planning.arm_size import FULL
from uuv.controllers.planning.grasp_choice import PlacedGrasp, carry_path
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.tool_statics import LoadBound, ToolStatics
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import ArrivalLimits, WorkSite, around, arrival
from uuv.controllers.tasks.axial_phases import AxialApproach, AxialContact, AxialLimits, Push
from uuv.controllers.tasks.grasping.collecting import (
    AT_OBJECT,
    FRICTION_USED,
    LEAVE,
    check_motor,
    departure_rows,
    gripping_rows,
    half_turn,
    jaw_monitors,
)
from uuv.controllers.tasks.grasping.jaw_phases import (
    Carry,
    CarrySpeed,
    CloseJaws,
    GripPlan,
    JawLimits,
    LetGo,
    MoveJaws,
    Weighing,
)
from uuv.controllers.tasks.grasping.plug_phases import (
    PullLimits,
    PullOut,
    SeatPlug,
    WeighPlug,
    WithPlug,
)
from uuv.controllers.tasks.hull_phases import EscapeLimits
from uuv.controllers.tasks.insertion import EntryLimits, InsertionJob, SearchLimits, SpiralSearch
from uuv.controllers.tasks.monitors import IN_CONTACT
from uuv.controllers.tasks.phase import Context, Decide, Held, PhaseEvent
from uuv.controllers.tasks.settings import PlugSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.models.site.plugged_panel import HANDLE, PIN, PluggedPanel
from uuv.models.tools.jaw_shape import JawShape
from uuv.sim.interfaces.errors import (
    ConfigurationError,
    OverloadError,
    OverloadHereError,
    ReachError,
)
from uuv.sim.interfaces.messages import AbortCode, HeldLoad, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, inverse, readonly, transform_points

LENGTH = PIN[1]  # [m] of the way from the seat to where the nose is at the mouth
_FREE = 0.01  # [m] of the nose in a receptacle up to which the plug is free to leave it
_BESIDE = 0.012  # [m] of each open jaw beside the handle
_GYRATION = 0.035  # [m] radius of gyration of the plug
_ENDS = PhaseEvent.DONE
_AT_PANEL = IN_CONTACT | {WorkState.INSERT, WorkState.SEARCH}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlugJob(PlugSettings):
    """Settings and limits of a move; depths are of the fingers' ends below their place on the
    seated plug.
    """

    advance: float = 20.0  # [N] axial force at which the empty jaws stop on their way to the plug
    touch: float = 6.0  # [N] axial force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last,
    loaded_touch_time: float = 0.2  # [s] or with the plug, whose own motion is felt
    early: float = 0.02  # [m] contact farther than this above the place is an obstacle
    guard: float = 0.04  # [m] before the place, at which the slower speed begins
    touch_speed: float = 0.012  # [m/s] from there on
    deeper: float = 0.004  # [m] beyond the seat to which the advance goes, so that it presses there
    pull_speed: float = 0.015  # [m/s] out of the receptacle
    seat_speed: float = 0.008  # [m/s] into the other
    heaviest: float = 1.5  # of the plug's known weight that may be carried
    axial: AxialLimits = field(
        default_factory=partial(
            AxialLimits,
            standoff=LENGTH + 0.05,
            approach_speed=0.04,
            speed=0.03,
            longest=90.0,
            force_limit=100.0,
        )
    )
    jaws: JawLimits = field(default_factory=partial(JawLimits, clear=LENGTH - _FREE))
    weighing: Weighing = field(default_factory=Weighing)
    # with open jaws, or the plug, the arm does not fold
    escape: EscapeLimits = field(default_factory=partial(EscapeLimits, free=math.inf))

    @property
    def out(self) -> PullLimits:
        """The pull out of the receptacle."""
        return PullLimits(force=self.pull)

    @property
    def insertion(self) -> InsertionJob:
        """The way into the other receptacle, in depths of this job."""
        return InsertionJob(
            depth=self.deeper,
            force=self.push,
            entry=LENGTH + 0.004,
            guard=LENGTH + 0.02,
            axial=replace(self.axial, speed=self.seat_speed),
            inside=EntryLimits(side_easy=8.0, side_full=16.0, nose=PIN[0] - LENGTH),
            search=SearchLimits(force=10.0),
        )


def check_forces(job: PlugJob, jaws: JawShape) -> None:
    """Refuse a grip that the jaws cannot give, and a pull or push that it does not bear.

    Raises:
        ConfigurationError: with the figures.
    """
    check_motor(job.grip, jaws, job.jaws)
    if jaws.opening < HANDLE[0] + 2.0 * _BESIDE:
        raise ConfigurationError(
            f"vehicle.tool: the jaws open to {1e3 * jaws.opening:.0f} mm; the plug's handle of "
            f"{1e3 * HANDLE[0]:.0f} mm needs {1e3 * (HANDLE[0] + 2.0 * _BESIDE):.0f} mm"
        )

    # Friction of both pads, and the limit of the watched force.
    held = 2.0 * jaws.friction * job.grip
    for name in ("pull", "push"):
        force = getattr(job, name)
        if force > FRICTION_USED * held:
            least = force / (2.0 * jaws.friction * FRICTION_USED)
            raise OverloadError(
                f"task.{name} {force:g} N: friction holds {held:.0f} N at task.grip {job.grip:g} "
                f"N, of which {FRICTION_USED:.0%} may be used; that needs a grip of {least:.0f} N "
                "or more",
                setting=name,
                most=FRICTION_USED * held,
            )
        most = 0.5 * job.axial.force_limit
        if force > most:
            raise OverloadError(
                f"task.{name} [N]: at most {most:g}, half of the watched force, got {force:g}",
                setting=name,
                most=most,
            )


class PlugMoving(TaskPlanner):
    """Planner that moves the plug of one known panel."""

    def __init__(
        self,
        worker: WorkVehicle,
        panel: PluggedPanel,
        job: PlugJob,
        jaws: JawShape,
        *,
        X_WB_scan: Array,
        water: float,
        holding: ThrustMargin,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            worker: the vehicle.
            panel: model of panel and plug.
            job: forces, speeds and limits.
            jaws: the gripper.
            X_WB_scan: (4, 4) hull pose in W from which the panel is scanned.
            water: [kg/m^3] density of the water.
            holding: thrust margin of the hull.
            period: [s] of the planner.

        Raises:
            ConfigurationError: the jaws cannot give the forces, or the arm has fewer than six
                joints.
        """
        vehicle = worker.vehicle
        if worker.chain.n < FULL:
            raise ConfigurationError(
                "move-plug: a receptacle fixes the jaws' axes, which an arm of "
                f"{worker.chain.n} joints cannot hold; at least {FULL} are needed"
            )
        check_forces(job, jaws)

        self._panel = panel
        self._job = job
        self._displaced = water * panel.volume
        still = holding.without_friction()
        self._statics = ToolStatics(vehicle=vehicle, chain=worker.chain, holding=still)
        self._standing = PathStanding(
            vehicle=vehicle,
            chain=worker.chain,
            model=panel.target,
            hull_box=worker.hull_box,
            # The seat pulls along the tool's axis. The hull keeps its place while the arm carries.
            limits=StandingLimits(force=-job.pull, standoff=job.axial.standoff, roomy=0.0),
            holding=still,
        )
        self.stand = self._stand

        site = WorkSite(
            own=worker,
            X_WB_scan=np.array(X_WB_scan),
            stand=self._stand,
            around=around(worker, panel.target),
        )
        limits = ArrivalLimits()
        monitors = jaw_monitors(
            job, limits, too_long="the plug was not in its place", at_object=_AT_PANEL
        )
        rows = plug_rows(site, limits, job, self._take, jaws.force)
        super().__init__(rows, monitors, X_WB=X_WB_scan, q=vehicle.q_home, period=period)

    def with_path(self, target: Target) -> Target:
        """The target with the tool's way from the one seat to the other."""
        X_WG = target.X_WT @ self._panel.grip(self._panel.start)
        grasp = PlacedGrasp(X_WG=X_WG, width=HANDLE[0], opening=HANDLE[0], margin=1.0)
        p_end = X_WG[:3, 3] + target.X_WT[:3, :3] @ self._panel.way
        return replace(target, path=carry_path(grasp, p_end))

    def bound(self, path: ToolPath, placement: Placement, sign: float) -> LoadBound:
        """Largest pull (`sign` 1) or push (-1) [N] along the path from a placement."""

        def unit(X_WG: Array) -> Array:
            """Wrench (6,) of the world on the tip: a plug that is pulled pulls along the tool."""
            del X_WG
            return np.array([0.0, 0.0, sign, 0.0, 0.0, 0.0])

        return self._statics.largest(unit, path, placement)

    def _stand(
        self, target: Target, path: ToolPath, current_W: Array
    ) -> tuple[Placement, ToolPath, float]:
        """Hull placement from which arm and thrusters can give the set forces.

        Raises:
            ReachError: there is none; the message has the bound.
        """
        failure: ReachError | None = None
        for turned in (path, half_turn(path)):
            try:
                placement, worked, share = self._standing(target, turned, current_W)
            except ReachError as error:
                failure = failure or error
                continue
            if np.any(placement.travel_W) or share < 1.0:
                failure = failure or ReachError("the receptacles are too far apart for the arm")
                continue

            # Both forces.
            weak: ReachError | None = None
            for name, force, sign in (
                ("pull", self._job.pull, 1.0),
                ("push", self._job.push, -1.0),
            ):
                bound = self.bound(worked, placement, sign)
                if bound.most < force:
                    weak = weak or OverloadHereError(
                        f"the set {name} of {force:.1f} N is above the bound of {bound.most:.1f} N "
                        f"here, by {bound.by}",
                        setting=name,
                        most=bound.most,
                    )
            if weak is None:
                return placement, worked, share
            failure = weak
        raise failure or ReachError("there is no place to move the plug from")

    def _take(self, held: Held, context: Context) -> None:
        """Keep what is gripped, and how."""
        del context
        assert held.target is not None
        assert held.line is not None
        held.plan = self.plan(held.target, held.line.at(0.0, 0.0)[0])

    def plan(self, target: Target, X_WG: Array) -> GripPlan:
        """What the jaws grip with the tool at `X_WG` (4, 4)."""
        center_W = transform_points(target.X_WT, self._panel.center)
        center_G = readonly(transform_points(inverse(X_WG), center_W))
        expected = HeldLoad(
            mass=self._panel.mass,
            displaced=self._displaced,
            center_G=center_G,
            buoyancy_G=center_G,
            radius=_GYRATION,
        )
        return GripPlan(
            opening=HANDLE[0] + 2.0 * _BESIDE,
            width=HANDLE[0],
            bears=self._job.heaviest * abs(expected.weight) + self._job.jaws.pull,
            expected=expected,
        )


def plug_rows(
    site: WorkSite,
    limits: ArrivalLimits,
    job: PlugJob,
    take: Callable[[Held, Context], None],
    motor: float,
) -> Iterable[tuple[str, TaskRow]]:
    """Table of a move.

    Args:
        site: what is known before the work.
        limits: of the way to the stand-off.
        job: forces, speeds and limits.
        take: keeps the grip in `Held.plan`.
        motor: [N] most force of the jaws' motor.

    Returns:
        Names and rows.
    """
    yield from arrival(
        site, limits, then=at_once("grasp"), depth=-job.axial.standoff, offset=0.0, broken=LEAVE
    )
    decide = Decide(take, AbortCode.OUT_OF_REACH)
    yield "grasp", TaskRow(decide, WorkState.TARE, {_ENDS: "open"}, LEAVE)
    yield from rows_at_panel(job, site.own.vehicle.q_home, motor, limits)


def rows_at_panel(
    job: PlugJob, q_home: Array, motor: float, limits: ArrivalLimits | None = None
) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the stand-off over the plug on; "open" is to be entered.

    Args:
        job: forces, speeds and limits.
        q_home: (n,) [rad] joint angles of the folded arm.
        motor: [N] most force of the jaws' motor, with which they open.
        limits: of the hull's motions.
    """
    axial = job.axial
    states = WorkState
    free = Push(force=job.advance, beyond=-job.early)
    yielding = replace(free, beyond=-math.inf, compliant_beyond=-math.inf)
    loaded = Push(force=job.push, beyond=-math.inf)

    met = AxialContact(
        touch=job.touch,
        touch_time=job.touch_time,
        early=job.early,
        obstacle="obstacle {} mm above the place on the plug",
        yields=True,
    )
    way = {"slow": (-job.guard, job.touch_speed), "to": 0.0}
    jaws = partial(MoveJaws, axial, jaws=job.jaws, force=motor)

    # To the plug, and the jaws around its handle.
    down = AxialApproach(axial, free, contact=met, **way)
    close = CloseJaws(axial, yielding, job.jaws, job.grip)
    yield from gripping_rows(jaws(free), down, close, jaws(yielding), then="pull", again="approach")

    # Out, and over the other receptacle.
    gripped = (axial, loaded, job.jaws, job.grip)
    pulling = replace(axial, speed=job.pull_speed)
    out = PullOut(pulling, replace(loaded, compliant_beyond=-math.inf), *gripped[2:], job.out)
    pulled = {_ENDS: "weigh", PhaseEvent.REFUSED: "open again"}
    yield "pull", TaskRow(out, states.WORK, pulled, AT_OBJECT)
    weigh = WeighPlug(*gripped, job.weighing)
    yield "weigh", TaskRow(weigh, states.WORK, {_ENDS: "carry"}, AT_OBJECT)
    carry = Carry(*gripped, CarrySpeed(speed=job.carry_speed))
    yield "carry", TaskRow(carry, states.WORK, {_ENDS: "lower"}, AT_OBJECT)
    yield from _seat_rows(job)

    # Off it.
    yield "let go", TaskRow(jaws(yielding), states.RETREAT, {_ENDS: "withdraw"}, LEAVE)
    yield "free", TaskRow(LetGo(*gripped), states.RETREAT, {_ENDS: "withdraw"}, LEAVE)
    yield from departure_rows(job, loaded, q_home, limits or ArrivalLimits())


def _seat_rows(job: PlugJob) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the stand-off over the other receptacle to the seat."""
    into = job.insertion
    states = WorkState
    with_plug = partial(WithPlug, jaws=job.jaws, force=job.grip)
    outside = Push(force=job.push, beyond=-math.inf)
    inside = replace(outside, compliant_beyond=-into.entry)
    rim = AxialContact(
        touch=job.touch,
        touch_time=job.loaded_touch_time,
        early=LENGTH + job.early,
        obstacle="the plug meets something {} mm above its seat",
        yields=True,
    )

    way = {"slow": (-into.guard, into.touch_speed), "to": -into.entry}
    lower = AxialApproach(into.axial, outside, contact=rim, **way)
    lowered = {PhaseEvent.DONE: "insert", PhaseEvent.TOUCHED: "search"}
    yield "lower", TaskRow(with_plug(lower), states.WORK, lowered, AT_OBJECT)
    spiral = SpiralSearch(into, outside)
    yield "search", TaskRow(with_plug(spiral), states.SEARCH, {_ENDS: "insert"}, AT_OBJECT)
    seated = {PhaseEvent.DONE: "let go", PhaseEvent.TOUCHED: "search"}
    yield "insert", TaskRow(with_plug(SeatPlug(into, inside)), states.INSERT, seated, AT_OBJECT)

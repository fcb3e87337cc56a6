r"""Turn of a valve by its handle: a quarter, with a set moment that is never exceeded by half.

settle -> scan -> close-in -> tare -> approach -> work -> retreat -> withdraw -> done
                                  any of these -> retreat or withdraw -> abort

The socket is put over the handle from above, and carried along on the arc with it. Where the
object was seen the handle counts as at its first stop; the angle is then counted from where the
tool meets it. In retreat the tool turns back until nothing is felt.

Before contact the moment that arm and thrusters can give is computed, and the job refused beyond.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.planning.arm_size import FULL
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.tool_statics import LoadBound
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import ArrivalLimits, WorkSite, around, arrival
from uuv.controllers.tasks.axial_phases import (
    PARK,
    WITHDRAW,
    AxialApproach,
    AxialContact,
    AxialLimits,
    Push,
    Withdraw,
    axial_end,
    axial_monitors,
)
from uuv.controllers.tasks.grasping.turn_phases import Release, TurnHandle, TurnLimits, TurnPlan
from uuv.controllers.tasks.grasping.turning_axis import TurningAxis, TurningStatics
from uuv.controllers.tasks.monitors import Reaction
from uuv.controllers.tasks.phase import Context, Decide, Held, PhaseEvent
from uuv.controllers.tasks.settings import TurnSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.models.site.turned_valve import QUARTER, TurnedValve
from uuv.sim.interfaces.errors import (
    ConfigurationError,
    OverloadError,
    OverloadHereError,
    ReachError,
)
from uuv.sim.interfaces.messages import AbortCode, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, readonly, transform_points

WATCHED = 0.9  # share of the watched force that the lever may ask for
_WRIST = 0.8  # share of the last joint's torque that a bar about the tool's axis may ask for
_ENDS = PhaseEvent.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnJob(TurnSettings):
    """Settings and limits of a turn; depths are of the tip below its place in the handle."""

    depth: float = 0.025  # [m] of the tip below the handle's upper side
    push: float = 20.0  # [N] axial force at which the advance stops
    touch: float = 6.0  # [N] axial force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last
    early: float = 0.012  # [m] contact farther than this above the place is an obstacle
    guard: float = 0.05  # [m] before the place, at which the slower speed begins
    touch_speed: float = 0.012  # [m/s] from there on
    spare: float = math.radians(5.0)  # of the way beyond the quarter, besides the tool's play
    axial: AxialLimits = field(
        default_factory=partial(
            AxialLimits,
            standoff=0.15,
            approach_speed=0.04,
            speed=0.03,
            longest=60.0,
            force_limit=120.0,
        )
    )
    turn: TurnLimits = field(default_factory=TurnLimits)


def check_moment(job: TurnJob, valve: TurnedValve, wrist: float) -> None:
    """Refuse a moment that the tool may not give in any posture.

    Args:
        job: the set moment.
        valve: its handle.
        wrist: [N m] torque limit of the last joint.

    Raises:
        OverloadError: with the bound.
    """
    if valve.lever:
        most = WATCHED * job.axial.force_limit * valve.lever
        by = f"{WATCHED:.0%} of the watched {job.axial.force_limit:g} N at {valve.lever:g} m"
    else:
        most = _WRIST * wrist
        by = f"{_WRIST:.0%} of the last joint's {wrist:g} N m"

    if job.moment > most:
        raise OverloadError(
            f"task.moment [N m]: at most {most:.1f} here, {by}, got {job.moment:g}",
            setting="moment",
            most=most,
        )


class ValveTurning(TaskPlanner):
    """Planner that turns the handle of one known valve by a quarter."""

    def __init__(
        self,
        worker: WorkVehicle,
        valve: TurnedValve,
        job: TurnJob,
        *,
        X_WB_scan: Array,
        holding: ThrustMargin,
        play: float = 0.0,
        period: float = 0.01,
    ) -> None:
        """Set up the planner.

        Args:
            worker: the vehicle.
            valve: model of the valve.
            job: moment, speed and limits.
            X_WB_scan: (4, 4) hull pose in W from which the valve is scanned.
            holding: thrust margin of the hull.
            play: [rad] of the handle in the tool, in each direction.
            period: [s] of the planner.

        Raises:
            ConfigurationError: the moment is too large, or the arm has fewer than six joints.
        """
        vehicle = worker.vehicle

        # What cannot be done in any posture.
        if worker.chain.n < FULL:
            raise ConfigurationError(
                "turn-valve: the handle fixes the tool's axes, which an arm of "
                f"{worker.chain.n} joints cannot hold; at least {FULL} are needed"
            )
        check_moment(job, valve, float(vehicle.torque_limits[-1]))

        self._valve = valve
        self._job = job
        self._play = play
        self._statics = TurningStatics(
            vehicle=vehicle, chain=worker.chain, holding=holding.without_friction()
        )

        # Along a lever the force is across the tool, like a friction.
        across = job.moment / valve.lever / job.push if valve.lever else 0.0
        self._standing = PathStanding(
            vehicle=vehicle,
            chain=worker.chain,
            model=valve.target,
            hull_box=worker.hull_box,
            limits=StandingLimits(force=job.push, standoff=job.axial.standoff, roomy=0.0),
            holding=holding.with_friction(across),
        )
        self.stand = self._stand

        site = WorkSite(
            own=worker,
            X_WB_scan=np.array(X_WB_scan),
            stand=self._stand,
            around=around(worker, valve.target),
        )

        # Rows and monitors.
        limits = ArrivalLimits()
        monitors = axial_monitors(
            job.axial,
            lost_place=limits.lost_place,
            blind_time=limits.blind_time,
            too_long="the handle was not reached",
        )
        rows = turn_rows(site, limits, job, self._take, lever=valve.lever > 0.0)
        super().__init__(rows, monitors, X_WB=X_WB_scan, q=vehicle.q_home, period=period)

    def axis(self, X_WT: Array) -> TurningAxis:
        """The valve's axis for its pose (4, 4) in W."""
        grip = self._valve.grip(self._job.depth)
        return TurningAxis(
            p=readonly(transform_points(X_WT, np.array([0.0, 0.0, grip[2]]))),
            a=readonly(X_WT[:3, 2]),
            ahead=readonly(X_WT[:3, 1]),
            lever=self._valve.lever,
        )

    def with_path(self, target: Target) -> Target:
        """The target with the tool's way about the valve."""
        last = QUARTER + self._play + self._job.spare
        return replace(target, path=self.axis(target.X_WT).path(0.0, last))

    def bound(self, target: Target, path: ToolPath, placement: Placement) -> LoadBound:
        """Largest moment [N m] along the path from a placement."""
        return self._statics.bound(self.axis(target.X_WT), path, placement)

    def _stand(
        self, target: Target, path: ToolPath, current_W: Array
    ) -> tuple[Placement, ToolPath, float]:
        """Hull placement from which arm and thrusters can give the set moment.

        Raises:
            ReachError: there is none; the message has the bound.
        """
        failure: ReachError | None = None

        # The slot may be put over the handle either way.
        for turned in (path, replace(path, x=readonly(-path.x))):
            try:
                placement, worked, share = self._standing(target, turned, current_W)
            except ReachError as error:
                failure = failure or error
                continue
            if np.any(placement.travel_W) or share < 1.0:
                failure = failure or ReachError("the handle's way is longer than the arm")
                continue

            bound = self.bound(target, worked, placement)
            if bound.most >= self._job.moment:
                return placement, worked, share
            failure = OverloadHereError(
                f"the set moment of {self._job.moment:.1f} N m is above the bound of "
                f"{bound.most:.1f} N m here, by {bound.by}",
                setting="moment",
                most=bound.most,
            )
        raise failure or ReachError("there is no place to turn the handle from")

    def _take(self, held: Held, context: Context) -> None:
        """Keep axis and moment of the turn."""
        del context
        assert held.target is not None
        assert held.line is not None
        held.plan = TurnPlan(
            axis=self.axis(held.target.X_WT),
            moment=self._job.moment,
            speed=self._job.speed,
            x_start=held.line.path.x[0],
        )


def turn_rows(
    site: WorkSite,
    limits: ArrivalLimits,
    job: TurnJob,
    take: Callable[[Held, Context], None],
    *,
    lever: bool,
) -> Iterable[tuple[str, TaskRow]]:
    """Table of a turn.

    Args:
        site: what is known before the work.
        limits: of the way to the stand-off.
        job: moment, speed and limits.
        take: keeps axis and moment in `Held.plan`.
        lever: the handle is a lever, not a bar.

    Returns:
        Names and rows.
    """
    yield from arrival(
        site, limits, then=at_once("take"), depth=-job.axial.standoff, offset=0.0, broken=PARK
    )
    decide = Decide(take, AbortCode.OUT_OF_REACH)
    yield "take", TaskRow(decide, WorkState.TARE, {_ENDS: "approach"}, PARK)
    yield from rows_at_handle(job, site.own, lever=lever)


def rows_at_handle(
    job: TurnJob, worker: WorkVehicle, *, lever: bool
) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the stand-off over the handle on; "approach" is to be entered.

    On a bar, without `lever`, the tool yields to forces across its axis, which is beside the
    valve's by the error of its pose.
    """
    axial = job.axial
    states = WorkState
    free = Push(force=job.push, beyond=-job.early)
    over = replace(free, compliant_beyond=-job.depth - job.early)
    yields = math.inf if lever else -math.inf
    loaded = replace(free, beyond=-math.inf, compliant_beyond=yields)
    met = AxialContact(
        touch=job.touch,
        touch_time=job.touch_time,
        early=job.early,
        obstacle="obstacle {} mm before the tool is in place over the handle",
        yields=True,
    )

    # Over the handle.
    slow = (-job.guard, job.touch_speed)
    approach = AxialApproach(axial, over, met, slow=slow, to=0.0)
    arrived = {_ENDS: "turn", PhaseEvent.TOUCHED: "turn"}
    yield "approach", TaskRow(approach, states.APPROACH, arrived, WITHDRAW)

    # With it, and off it.
    loosen = {**WITHDRAW, Reaction.RETREAT: "let go", Reaction.RISE: "let go"}
    turn = TurnHandle(axial, loaded, worker, job.turn)
    yield "turn", TaskRow(turn, states.WORK, {_ENDS: "let go"}, loosen, feels=True)
    go = Release(axial, loaded, worker, job.turn)
    yield "let go", TaskRow(go, states.RETREAT, {_ENDS: "withdraw"}, WITHDRAW)
    yield from axial_end(Withdraw(axial, free, math.inf))

r"""Insertion of a sampler into a hole of a known object, and out of it [Konoplin 2022].

settle -> scan -> close-in -> tare -> approach -> insert -> work (in the hole) -> withdraw -> done
                                         \-> search -/       any of these -> withdraw -> abort

From the stand-off the tool moves along the axis of the hole as identified, by the damping law of
`uuv.controllers.tasks.axial_phases`. While a side force acts, the advance waits until the lateral
compliance of the controller has centred the tool.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from uuv.controllers.planning.arm_size import FULL
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.placement import PlacementSearch
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.tasks.arrival import ArrivalLimits, WorkSite, around, arrival
from uuv.controllers.tasks.axial_phases import (
    PARK,
    WITHDRAW,
    AxialApproach,
    AxialContact,
    AxialLimits,
    AxialPhase,
    Push,
    Stay,
    Withdraw,
    axial_end,
    axial_monitors,
)
from uuv.controllers.tasks.phase import Abort, Context, Held, Outcome, PhaseEvent
from uuv.controllers.tasks.settings import InsertionSettings
from uuv.controllers.tasks.task import TaskPlanner, TaskRow, at_once
from uuv.models.objects.manifold import Hole
from uuv.models.objects.targets import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, Target, ToolPath, WorkState
from uuv.sim.interfaces.spatial import Array, readonly


@dataclass(frozen=True, slots=True, kw_only=True)
class EntryLimits:
    """Advance in the hole; depths are of the tip below the mouth as identified."""

    side_easy: float = 5.0  # [N] side force up to which the advance has full speed,
    side_full: float = 10.0  # [N] and from which it waits
    # [m] length of the tool's nose: a stop at less depth is the rim, at more the wall
    nose: float = 0.018
    stall: float = 2.0  # [s] in which the tool must advance by `gain`, else it counts as stopped
    gain: float = 0.0015  # [m]
    back: float = 0.01  # [m] by which a jammed tool backs off before the next try
    tries: int = 3  # stops after which the insertion is tried again


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchLimits:
    """Spiral search for the hole, with the tool in contact with the rim."""

    force: float = 8.0  # [N] pressed on the rim
    speed: float = 0.008  # [m/s] along the spiral
    pitch: float = 0.004  # [m] between its turns
    radius: float = 0.016  # [m] around the hole as identified
    dip: float = 0.003  # [m] drop of the tool by which the hole is found


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionJob(InsertionSettings):
    """Settings and limits of an insertion; depths are of the tip below the mouth as identified."""

    stay: float = 2.0  # [s] time at that depth
    force: float = 15.0  # [N] axial force at which the advance stops
    touch_speed: float = 0.008  # [m/s] from `guard` on, and in the search
    guard: float = 0.02  # [m] distance before the mouth at which the slower speed begins
    early: float = 0.012  # [m] contact farther than this before the mouth is an obstacle
    entry: float = 0.005  # [m] distance before the mouth from which the tool is compliant
    touch: float = 5.0  # [N] axial force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last
    axial: AxialLimits = field(
        default_factory=partial(
            AxialLimits,
            standoff=0.06,
            approach_speed=0.02,
            speed=0.006,
            longest=90.0,
            force_limit=60.0,
        )
    )
    inside: EntryLimits = field(default_factory=EntryLimits)
    search: SearchLimits = field(default_factory=SearchLimits)

    def __post_init__(self) -> None:
        axial = self.axial
        for name, number in (
            ("depth", self.depth),
            ("standoff", axial.standoff),
            ("speed", axial.speed),
            ("approach_speed", axial.approach_speed),
            ("touch_speed", self.touch_speed),
            ("force", self.force),
            ("search_force", self.search.force),
        ):
            if not (math.isfinite(number) and number > 0.0):
                raise ConfigurationError(f"insertion {name}: must be > 0, got {number}")

        if self.force > 0.5 * axial.force_limit:
            raise ConfigurationError(
                f"insertion force: {self.force} N leaves no room: at most half the limit of "
                f"{axial.force_limit} N"
            )

        inside = self.inside
        if not inside.side_full > inside.side_easy > 0.0:
            raise ConfigurationError(
                f"insertion side_full: must exceed side_easy of {inside.side_easy} N > 0, got "
                f"{inside.side_full}"
            )

        if not axial.standoff > self.guard > self.entry:
            raise ConfigurationError("insertion: standoff > guard > entry [m] must hold")


def axis_path(X_WT: Array, hole: Hole, depth: float) -> ToolPath:
    """Path of the tip along the bore, from the mouth to a depth.

    Args:
        X_WT: (4, 4) pose of the target in W.
        hole: the bore.
        depth: [m] end of the path below the mouth.

    Returns:
        The path in W, with samples at most some 5 mm apart.
    """
    X_WH = hole.pose(X_WT)
    s = np.linspace(0.0, depth, max(4, 1 + round(depth / 0.005)))
    ones = np.ones((len(s), 1))
    flags = np.zeros(len(s), dtype=bool)
    flags.setflags(write=False)

    return ToolPath(
        s=readonly(s),
        p=readonly(X_WH[:3, 3] + s[:, None] * X_WH[:3, 2]),
        z=readonly(ones * X_WH[:3, 2]),
        x=readonly(ones * X_WH[:3, 0]),
        on_scan=flags,
    )


@dataclass(slots=True)
class EntryState:
    """State of `EnterHole`."""

    deepest: float  # [m] depth at the last gain
    gained: float  # [s] time of the last gain in depth
    backing_to: float = -math.inf  # [m] depth to which a jammed tool backs off; -inf: it does not


class EnterHole(AxialPhase):
    """Advance with bounded axial and side force; a stopped tool searches or tries again."""

    def __init__(self, job: InsertionJob, push: Push) -> None:
        super().__init__(job.axial, push)
        self._job = job

    def enter(self, held: Held, context: Context) -> EntryState:
        """Begin at the present depth."""
        return EntryState(held.depth, context.time)

    def step(self, state: EntryState, held: Held, context: Context) -> Outcome:
        """Report DONE at the set depth, and TOUCHED if the tool has stopped at the rim."""
        job = self._job
        limits = self._job.inside
        axial, aside = self._forces(held, context)

        # A jammed tool backs off
        if math.isfinite(state.backing_to):
            self._advance(held, context, -job.axial.speed, -axial / job.force)
            if held.depth <= state.backing_to:
                state.backing_to = -math.inf
                state.deepest = held.depth
                state.gained = context.time
            return None

        # Slower under a side force, until the tool is centred
        ease = min(1.0, (limits.side_full - aside) / (limits.side_full - limits.side_easy))
        self._advance(held, context, max(0.0, ease) * job.axial.speed, axial / job.force)

        if held.depth >= job.depth:
            return PhaseEvent.DONE
        if held.depth > state.deepest + limits.gain:
            state.deepest = held.depth
            state.gained = context.time
        elif context.time - state.gained > limits.stall:
            return self._stopped(state, held)
        return None

    def _stopped(self, state: EntryState, held: Held) -> Outcome:
        """After a stop: search for the hole at the rim, back off inside the bore, or give up."""
        limits = self._job.inside
        held.tries += 1

        if held.tries > limits.tries:
            return Abort(
                AbortCode.JAMMED, f"stopped at {held.depth * 1e3:.0f} mm in {limits.tries} attempts"
            )

        if state.deepest < limits.nose:
            return PhaseEvent.TOUCHED
        state.backing_to = max(held.depth - limits.back, -self._job.entry)
        return None


@dataclass(slots=True)
class SpiralState:
    """State of `SpiralSearch`."""

    touched_at: float  # [m] depth at which the search began
    angle: float = 0.0  # [rad] along the spiral


class SpiralSearch(AxialPhase):
    """Spiral around the hole as identified, with a light force on the rim, until the tool drops.

    A loss of contact may mean that the tool is over the hole. The spiral then waits while the tool
    moves down.
    """

    def __init__(self, job: InsertionJob, push: Push) -> None:
        super().__init__(job.axial, push)
        self._search = job.search
        self._speed_down = job.touch_speed

    def enter(self, held: Held, context: Context) -> SpiralState:
        """Begin at the present depth."""
        del context
        return SpiralState(held.depth)

    def step(self, state: SpiralState, held: Held, context: Context) -> Outcome:
        """Report DONE when the tool drops."""
        search = self._search
        axial, _ = self._forces(held, context)
        self._advance(held, context, self._speed_down, axial / search.force)

        radius = search.pitch * state.angle / (2.0 * np.pi)
        if axial > 0.5 * search.force:
            # Equal speed along the spiral r = c angle: d angle = v dt / sqrt(r^2 + c^2).
            state.angle += (
                search.speed * context.period / math.hypot(radius, search.pitch / (2.0 * np.pi))
            )
            held.aside = (radius * math.cos(state.angle), radius * math.sin(state.angle))

        if held.depth > state.touched_at + search.dip:
            return PhaseEvent.DONE
        if radius > search.radius:
            reason = f"no hole within {search.radius * 1e3:.0f} mm of its identified position"
            return Abort(AbortCode.HOLE_NOT_FOUND, reason)
        return None


class HoleInsertion(TaskPlanner):
    """Planner that inserts the tool into one hole of one known object."""

    def __init__(
        self,
        own: WorkVehicle,
        target: TargetModel,
        hole: Hole,
        job: InsertionJob,
        *,
        X_WB_scan: Array,
        period: float = 0.01,
        search: PlacementSearch | None = None,
    ) -> None:
        """Set up the planner: as `uuv.controllers.tasks.surface_work`, with a hole for a path.

        Args:
            own: the vehicle.
            target: model of the object.
            hole: hole of that object.
            job: depths, speeds, forces and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            period: [s] of the planner.
            search: hull placements that are tried.

        Raises:
            ConfigurationError: if the hole is not deeper than the job's depth, or the arm has fewer
                than six joints.
        """
        if own.chain.n < FULL:
            raise ConfigurationError(
                f"insertion: a hole fixes the tool's axis, which an arm of {own.chain.n} joints "
                f"cannot hold against the hull's drift; at least {FULL} are needed"
            )
        if not job.depth < hole.depth:
            raise ConfigurationError(
                f"insertion depth: must be below the hole's {hole.depth} m, got {job.depth}"
            )

        self._hole = hole
        self._depth = job.depth
        standing = StandingLimits(force=job.force, standoff=job.axial.standoff)
        stand = PathStanding(
            vehicle=own.vehicle,
            chain=own.chain,
            model=target,
            hull_box=own.hull_box,
            limits=standing,
            search=search,
        )
        self.stand = stand

        site = WorkSite(
            own=own, X_WB_scan=np.array(X_WB_scan), stand=stand, around=around(own, target)
        )

        limits = ArrivalLimits()
        monitors = axial_monitors(
            job.axial,
            lost_place=limits.lost_place,
            blind_time=limits.blind_time,
            too_long="the depth was not reached",
        )

        rows = insertion_rows(site, limits, job)
        super().__init__(rows, monitors, X_WB=X_WB_scan, q=own.vehicle.q_home, period=period)

    def with_path(self, target: Target) -> Target:
        """The target with the axis of the hole as its path."""
        return replace(target, path=axis_path(target.X_WT, self._hole, self._depth))

    def path_s(self, held: Held) -> float:
        """Depth [m] below the mouth."""
        return max(0.0, held.depth)


def insertion_rows(
    site: WorkSite, limits: ArrivalLimits, job: InsertionJob
) -> Iterable[tuple[str, TaskRow]]:
    """Table of the insertion.

    Args:
        site: what is known before the work.
        limits: of the way to the stand-off.
        job: depths, forces and limits.

    Returns:
        Names and rows.
    """
    yield from arrival(
        site, limits, then=at_once("approach"), depth=-job.axial.standoff, offset=0.0, broken=PARK
    )
    yield from rows_at_hole(job)


def rows_at_hole(job: InsertionJob) -> Iterable[tuple[str, TaskRow]]:
    """Rows from the stand-off on; "approach" is to be entered."""
    axial = job.axial
    states = WorkState

    outside = Push(force=job.force, beyond=-job.early)
    inside = replace(outside, compliant_beyond=-job.entry if job.compliance else math.inf)
    rim = AxialContact(
        touch=job.touch,
        touch_time=job.touch_time,
        early=job.early,
        obstacle="obstacle {} mm before the mouth",
        yields=True,
    )

    approach = AxialApproach(axial, outside, rim, slow=(-job.guard, job.touch_speed), to=-job.entry)
    searched = {PhaseEvent.DONE: "insert", PhaseEvent.TOUCHED: "search"}
    inserted = {PhaseEvent.DONE: "work", PhaseEvent.TOUCHED: "search"}

    yield "approach", TaskRow(approach, states.APPROACH, searched, WITHDRAW)
    yield (
        "search",
        TaskRow(SpiralSearch(job, outside), states.SEARCH, {PhaseEvent.DONE: "insert"}, WITHDRAW),
    )
    yield "insert", TaskRow(EnterHole(job, inside), states.INSERT, inserted, WITHDRAW)
    yield (
        "work",
        TaskRow(
            Stay(axial, inside, job.stay), states.WORK, {PhaseEvent.DONE: "withdraw"}, WITHDRAW
        ),
    )
    yield from axial_end(Withdraw(axial, inside, -job.entry))

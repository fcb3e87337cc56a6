"""Insertion: a sampler put into a hole of a known object, and drawn out (the sampling holes of paper 002's manifolds).

settle -> scan -> close-in -> tare -> approach -> insert -> work (its stay) -> withdraw -> done
                                         \\-> search -/       any of these -> withdraw -> abort

The way to the stand-off is that of `controllers.tasks.supervisor`; from there on it goes along the axis of the hole as
it was found. The advance is a damping law: the wanted speed at no force, less as the axial force grows, none at the set
force and back beyond it, so that what stops the tool is pressed with the set force; and it waits while the tool is
pressed aside, until the lateral compliance of the controller has brought it to the middle.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from controllers.mkps import Chain
from controllers.planning.hull_placement import PlacementSearch, tool_pose
from controllers.tasks.axial_work import AxialState, AxialWork, felt_by_tool
from controllers.tasks.supervisor import SurfaceWork
from controllers.tasks.surface_task_config import SurfaceTaskConfig
from models.objects.manifold import Hole
from models.objects.targets import TargetModel
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import Command, Reference, StateEstimate, Target, ToolPath, WorkState
from sim.interfaces.spatial import Array, readonly

_ZERO = readonly(np.zeros(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionJob:
    """How far, how fast, how hard; and when to give up. Depths are those of the tip below the mouth as found."""

    depth: float = 0.06  # [m] to be reached
    stay: float = 2.0  # [s] at that depth
    standoff: float = 0.06  # [m] before the mouth, from which the tool approaches
    approach_speed: float = 0.02  # [m/s] up to `guard` before the mouth
    touch_speed: float = 0.008  # [m/s] from there on
    guard: float = 0.02  # [m]
    early: float = 0.012  # [m] before the mouth at which nothing may yet be touched
    entry: float = 0.005  # [m] before the mouth from which the tool gives way
    touch: float = 5.0  # [N] felt along the axis that counts as touch
    touch_time: float = 0.04  # [s] that it must be felt
    force: float = 15.0  # [N] along the axis at which the entry stands still
    speed: float = 0.006  # [m/s] of the entry, and of the way out
    side_easy: float = 5.0  # [N] felt across the axis up to which the entry goes at full speed,
    side_full: float = 10.0  # [N] and at which it waits
    acceleration: float = 0.03  # [m/s^2]
    yielding: float = 0.3  # [m/s^2] where a force is felt
    nose: float = 0.018  # [m] depth at which the tool's nose is in: before, a stop is the rim, after, the wall
    stall: float = 2.0  # [s] within which the tool must gain
    gain: float = 0.0015  # [m]; else it is stopped
    search_force: float = 8.0  # [N] with which the rim is felt for the hole
    search_speed: float = 0.008  # [m/s] along the spiral
    search_pitch: float = 0.004  # [m] between its turns
    search_radius: float = 0.016  # [m] around the hole as found
    dip: float = 0.003  # [m] by which the tool must drop for the hole to be found
    back: float = 0.01  # [m] by which a jammed tool is drawn back to try again
    tries: int = 3
    longest: float = 90.0  # [s] from the stand-off to the depth
    compliance: bool = True  # False: the tool does not give way (ablation)
    force_limit: float = 60.0  # [N] felt in any direction that ends the work
    lost_place: float = 0.08  # [m] off its place at which the hull counts as carried away: the arm has that in hand

    def __post_init__(self) -> None:
        for name in ("depth", "standoff", "speed", "approach_speed", "touch_speed", "force", "search_force"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigurationError(f"insertion {name}: must be > 0, got {value}")
        if self.force > 0.5 * self.force_limit:
            raise ConfigurationError(
                f"insertion force: {self.force} N leaves no room: at most half the limit of {self.force_limit} N"
            )
        if not self.side_full > self.side_easy > 0.0:
            raise ConfigurationError(
                f"insertion side_full: must exceed side_easy of {self.side_easy} N > 0, got {self.side_full}"
            )
        if not self.standoff > self.guard > self.entry:
            raise ConfigurationError("insertion: standoff > guard > entry [m] must hold")


@dataclass(slots=True, eq=False)
class InsertionState(AxialState):
    """Where the insertion stands; the depth is below the mouth."""

    aside: tuple[float, float] = (0.0, 0.0)  # [m] off the axis as found, along the tool's x and y
    angle: float = 0.0  # [rad] along the spiral
    touched_at: float = 0.0  # [m] depth at which the search began
    felt_for: float = 0.0  # [s] that a touch has been felt
    deepest: float = 0.0  # [m] since `gained`
    gained: float = 0.0  # [s] of the last gain in depth
    backing_to: float = -np.inf  # [m] depth to which a jammed tool is being drawn back
    tries: int = 0


def axis_path(X_WT: Array, hole: Hole, depth: float) -> ToolPath:
    """The way of the tip from the mouth to `depth` [m] along the bore of a target at `X_WT` (4, 4), in W."""
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


class HoleInsertion(AxialWork[InsertionJob, InsertionState]):
    """Planner (`sim.interfaces.protocols.Planner`) that puts the tool into one hole of one known object."""

    def __init__(
        self,
        vehicle: Vehicle,
        chain: Chain,
        target: TargetModel,
        hole: Hole,
        job: InsertionJob,
        *,
        X_WB_scan: Array,
        hull_box: Array,
        period: float = 0.01,
        search: PlacementSearch | None = None,
    ) -> None:
        """As `controllers.tasks.supervisor.SurfaceWork`, for `hole` of `target` in place of a path.

        Raises ConfigurationError if the hole is not as deep as the job asks for.
        """
        if not job.depth < hole.depth:
            raise ConfigurationError(f"insertion depth: must be below the hole's {hole.depth} m, got {job.depth}")
        self._hole = hole
        arrival = SurfaceWork(
            vehicle,
            chain,
            target,
            SurfaceTaskConfig(forces=(job.force,), standoff=job.standoff),
            X_WB_scan=X_WB_scan,
            hull_box=hull_box,
            period=period,
            search=search,
        )
        super().__init__(job, arrival, too_long="the depth was not reached")

    def init(self, estimate: StateEstimate) -> InsertionState:
        arrival = self._arrival.init(estimate)
        return InsertionState(arrival=arrival, state=arrival.state, since=arrival.since)

    def step(
        self, state: InsertionState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[InsertionState, Reference]:
        time, job = estimate.time, self._job
        if target is not None and target.accepted:
            target = replace(target, path=axis_path(target.X_WT, self._hole, job.depth))
        on_the_way = self._arrive(state, estimate, target, last)
        if on_the_way is not None:
            return state, on_the_way
        axial, aside = felt_by_tool(last, self._pose(state)[:3, 2])
        self._watch(state, estimate, math.hypot(axial, aside))
        match state.state:
            case WorkState.APPROACH:
                self._approach(state, time, axial)
            case WorkState.SEARCH:
                self._search(state, time, axial)
            case WorkState.INSERT:
                self._insert(state, time, axial, aside)
            case WorkState.WORK:
                self._advance(state, 0.0)
                if time - state.since > job.stay:
                    self._enter(state, WorkState.WITHDRAW, time)
            case WorkState.WITHDRAW:
                self._withdraw(state, time, axial)
        return state, self._reference(state, time)

    # -- states ----------------------------------------------------------------------------------------------------

    def _enter(self, state: InsertionState, what: WorkState, time: float) -> None:
        super()._enter(state, what, time)
        state.felt_for, state.deepest, state.gained = 0.0, state.depth, time

    def _approach(self, state: InsertionState, time: float, axial: float) -> None:
        """To just before the mouth; there the tool begins to give way."""
        job = self._job
        wanted = job.approach_speed if state.depth < -job.guard else job.touch_speed
        self._advance(state, wanted, max(0.0, axial) / job.force)
        if self._touched(state, axial):
            if state.depth < -job.early:
                self._break_off(state, time, f"something stands {-state.depth * 1e3:.0f} mm before the mouth")
            else:
                self._begin_search(state, time)
        elif state.depth >= -job.entry:
            self._enter(state, WorkState.INSERT, time)

    def _insert(self, state: InsertionState, time: float, axial: float, aside: float) -> None:
        """In, with the axial force below its set value and the side force below its own; stopped: search, or again."""
        job = self._job
        if np.isfinite(state.backing_to):
            self._advance(state, -job.speed, -axial / job.force)
            if state.depth <= state.backing_to:
                state.backing_to = -np.inf
                state.deepest, state.gained = state.depth, time
            return
        ease = min(1.0, (job.side_full - aside) / (job.side_full - job.side_easy))
        self._advance(state, max(0.0, ease) * job.speed, axial / job.force)
        if state.depth >= job.depth:
            self._enter(state, WorkState.WORK, time)
        elif state.depth > state.deepest + job.gain:
            state.deepest, state.gained = state.depth, time
        elif time - state.gained > job.stall:
            self._stopped(state, time)

    def _stopped(self, state: InsertionState, time: float) -> None:
        job = self._job
        state.tries += 1
        if state.tries > job.tries:
            self._break_off(state, time, f"stopped at {state.depth * 1e3:.0f} mm, {job.tries} times over")
        elif state.deepest < job.nose:
            self._begin_search(state, time)
        else:
            state.backing_to = max(state.depth - job.back, -job.entry)

    def _begin_search(self, state: InsertionState, time: float) -> None:
        state.touched_at, state.angle = state.depth, 0.0
        self._enter(state, WorkState.SEARCH, time)

    def _search(self, state: InsertionState, time: float, axial: float) -> None:
        """A spiral around the hole as found, pressed lightly on the rim, until the tool drops.

        Where it loses touch it may be over the hole, and goes down before it goes on.
        """
        job = self._job
        self._advance(state, job.touch_speed, axial / job.search_force)
        radius = job.search_pitch * state.angle / (2.0 * np.pi)
        if axial > 0.5 * job.search_force:
            # Equal speed along the spiral r = c angle: d angle = v dt / sqrt(r^2 + c^2).
            state.angle += job.search_speed * self.period / math.hypot(radius, job.search_pitch / (2.0 * np.pi))
            state.aside = (radius * math.cos(state.angle), radius * math.sin(state.angle))
        if state.depth > state.touched_at + job.dip:
            self._enter(state, WorkState.INSERT, time)
        elif radius > job.search_radius:
            self._break_off(state, time, f"no hole within {job.search_radius * 1e3:.0f} mm of where it was found")

    def _withdraw(self, state: InsertionState, time: float, axial: float) -> None:
        self._draw_out(state, time, mouth=-self._job.entry, resisted=-axial / self._job.force)

    def _touched(self, state: InsertionState, axial: float) -> bool:
        state.felt_for = state.felt_for + self.period if axial > self._job.touch else 0.0
        return state.felt_for >= self._job.touch_time

    # -- references ------------------------------------------------------------------------------------------------

    def _pose(self, state: InsertionState) -> Array:
        """Tool pose (4, 4) at the depth, off the axis by the search."""
        arrival = state.arrival
        assert arrival.path is not None
        assert arrival.placement is not None
        X = tool_pose(arrival.path, 0.0, arrival.placement.roll)[0]
        X[:3, 3] += X[:3, :3] @ [*state.aside, state.depth]
        return X

    def _reference(self, state: InsertionState, time: float) -> Reference:
        X_WG = self._pose(state)
        at_rest = state.state in (WorkState.DONE, WorkState.ABORT)
        touching = not at_rest and state.depth > -self._job.early
        entering = state.state in (WorkState.INSERT, WorkState.WORK, WorkState.WITHDRAW)
        return Reference(
            time=time,
            state=state.state,
            X_WB=state.arrival.X_WB,
            v_WB_W=_ZERO,
            X_WG=X_WG,
            v_WG_W=_ZERO if at_rest else state.speed * X_WG[:3, 2],
            w_WG_W=_ZERO,
            q=state.arrival.q,
            qd=np.zeros(len(state.arrival.q)),
            force=self._job.force if touching else 0.0,
            force_control=False,
            tare=False,
            scan=False,
            path_s=max(0.0, state.depth),
            note=state.reason or state.arrival.note,
            compliant=self._job.compliance and entering and state.depth > -self._job.entry,
        )

r"""Insertion: puts a sampler into a hole of a known object and withdraws it (the sampling holes of [Konoplin 2022]).

settle -> scan -> close-in -> tare -> approach -> insert -> work (stays in the hole) -> withdraw -> done
                                         \-> search -/       any of these -> withdraw -> abort

`controllers.tasks.supervisor` brings the tool to the stand-off. From there it moves along the axis of the hole as
identified, by the damping law of `controllers.tasks.axial_work`. While a side force acts, the advance waits until the
lateral compliance of the controller has centred the tool.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from controllers.mkps import Chain
from controllers.planning.hull_placement import PlacementSearch, tool_pose
from controllers.tasks.axial_work import AxialState, AxialWork, contact_force_on_tool
from controllers.tasks.supervisor import SurfaceWork
from controllers.tasks.surface_task_config import SurfaceTaskConfig
from models.objects.manifold import Hole
from models.objects.targets import TargetModel
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import AbortCode, Command, Reference, StateEstimate, Target, ToolPath, WorkState
from sim.interfaces.spatial import Array, readonly

_ZERO = readonly(np.zeros(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionJob:
    """Depths, speeds, forces and limits of an insertion; depths are of the tip below the mouth as identified."""

    depth: float = 0.06  # [m] to reach
    stay: float = 2.0  # [s] time at that depth
    standoff: float = 0.06  # [m] distance before the mouth from which the tool approaches
    approach_speed: float = 0.02  # [m/s] up to `guard` before the mouth
    touch_speed: float = 0.008  # [m/s] from there on
    guard: float = 0.02  # [m] distance before the mouth at which the slower speed begins
    early: float = 0.012  # [m] contact farther than this before the mouth is an obstacle
    entry: float = 0.005  # [m] distance before the mouth from which the tool is compliant
    touch: float = 5.0  # [N] axial force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last
    force: float = 15.0  # [N] axial force at which the advance stops
    speed: float = 0.006  # [m/s] in the hole, in and out
    side_easy: float = 5.0  # [N] side force up to which the advance has full speed,
    side_full: float = 10.0  # [N] and from which it waits
    acceleration: float = 0.03  # [m/s^2] limit
    yielding: float = 0.3  # [m/s^2] limit while a force opposes the motion
    nose: float = 0.018  # [m] length of the tool's nose: a stop at less depth is the rim, at more the wall
    stall: float = 2.0  # [s] in which the tool must advance by `gain`, else it counts as stopped
    gain: float = 0.0015  # [m]
    search_force: float = 8.0  # [N] pressed on the rim while the hole is searched for
    search_speed: float = 0.008  # [m/s] along the spiral
    search_pitch: float = 0.004  # [m] between its turns
    search_radius: float = 0.016  # [m] around the hole as identified
    dip: float = 0.003  # [m] drop of the tool by which the hole is found
    back: float = 0.01  # [m] by which a jammed tool backs off before the next try
    tries: int = 3  # stops after which the insertion is tried again
    longest: float = 90.0  # [s] limit from the stand-off to the depth
    compliance: bool = True  # False: no lateral compliance (ablation)
    force_limit: float = 60.0  # [N] contact force, in any direction, above which the work ends
    lost_place: float = 0.08  # [m] position error of the hull above which the work ends; up to it the arm compensates

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
    """State of the insertion; the depth is below the mouth."""

    aside: tuple[float, float] = (0.0, 0.0)  # [m] offset from the axis as identified, along the tool's x and y
    angle: float = 0.0  # [rad] along the spiral
    touched_at: float = 0.0  # [m] depth at which the search began
    felt_for: float = 0.0  # [s] for which contact has lasted
    deepest: float = 0.0  # [m] depth at the last gain
    gained: float = 0.0  # [s] time of the last gain in depth
    backing_to: float = -np.inf  # [m] depth to which a jammed tool backs off; -inf: it does not
    tries: int = 0  # stops so far


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


class HoleInsertion(AxialWork[InsertionJob, InsertionState]):
    """Planner (`sim.interfaces.protocols.Planner`) that inserts the tool into one hole of one known object."""

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
        """Set up the planner; arguments as `controllers.tasks.supervisor.SurfaceWork`, with a hole instead of a path.

        Args:
            vehicle: the vehicle.
            chain: its arm, base to tool.
            target: model of the object.
            hole: hole of that object.
            job: depths, speeds, forces and limits.
            X_WB_scan: (4, 4) hull pose in W from which the object is scanned.
            hull_box: (2, 3) [m] corners of the hull in B.
            period: [s] of the planner.
            search: hull placements that are tried.

        Raises:
            ConfigurationError: if the hole is not deeper than the job's depth.
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
        """State at the start: settling before the scan."""
        arrival = self._arrival.init(estimate)
        return InsertionState(arrival=arrival, state=arrival.state, since=arrival.since)

    def step(
        self, state: InsertionState, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[InsertionState, Reference]:
        """Advance the insertion by one period.

        Args:
            state: state of the insertion, changed in place.
            estimate: estimated state of the vehicle.
            target: newest identification, if any.
            last: the controller's last command, with its estimate of the contact force.

        Returns:
            The state and the reference for the controller.

        Raises:
            ConfigurationError: if the controller does not estimate the contact force.
        """
        time, job = estimate.time, self._job
        if target is not None and target.accepted:
            target = replace(target, path=axis_path(target.X_WT, self._hole, job.depth))
        on_the_way = self._arrive(state, estimate, target, last)
        if on_the_way is not None:
            return state, on_the_way
        axial, aside = contact_force_on_tool(last, self._pose(state)[:3, 2])
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
        """Change to another state and restart its counters."""
        super()._enter(state, what, time)
        state.felt_for, state.deepest, state.gained = 0.0, state.depth, time

    def _approach(self, state: InsertionState, time: float, axial: float) -> None:
        """Advance to just before the mouth, where compliance begins."""
        job = self._job
        wanted = job.approach_speed if state.depth < -job.guard else job.touch_speed
        self._advance(state, wanted, max(0.0, axial) / job.force)
        if self._touched(state, axial):
            if state.depth < -job.early:
                self._break_off(
                    state, time, AbortCode.OBSTACLE, f"something stands {-state.depth * 1e3:.0f} mm before the mouth"
                )
            else:
                self._begin_search(state, time)
        elif state.depth >= -job.entry:
            self._enter(state, WorkState.INSERT, time)

    def _insert(self, state: InsertionState, time: float, axial: float, aside: float) -> None:
        """Advance with axial and side force below their set values; a stopped tool searches or tries again."""
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
        """After a stop: search for the hole at the rim, back off inside the bore, or give up."""
        job = self._job
        state.tries += 1
        if state.tries > job.tries:
            said = f"stopped at {state.depth * 1e3:.0f} mm, {job.tries} times over"
            self._break_off(state, time, AbortCode.JAMMED, said)
        elif state.deepest < job.nose:
            self._begin_search(state, time)
        else:
            state.backing_to = max(state.depth - job.back, -job.entry)

    def _begin_search(self, state: InsertionState, time: float) -> None:
        """Start the spiral at the present depth."""
        state.touched_at, state.angle = state.depth, 0.0
        self._enter(state, WorkState.SEARCH, time)

    def _search(self, state: InsertionState, time: float, axial: float) -> None:
        """Spiral around the hole as identified, with a light force on the rim, until the tool drops.

        A loss of contact may mean that the tool is over the hole. The spiral then waits while the tool moves down.
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
            said = f"no hole within {job.search_radius * 1e3:.0f} mm of where it was found"
            self._break_off(state, time, AbortCode.HOLE_NOT_FOUND, said)

    def _withdraw(self, state: InsertionState, time: float, axial: float) -> None:
        """Move out of the hole, back to the stand-off."""
        self._draw_out(state, time, mouth=-self._job.entry, resisted=-axial / self._job.force)

    def _touched(self, state: InsertionState, axial: float) -> bool:
        """True once the axial force has been above `touch` for `touch_time`."""
        state.felt_for = state.felt_for + self.period if axial > self._job.touch else 0.0
        return state.felt_for >= self._job.touch_time

    # -- references ------------------------------------------------------------------------------------------------

    def _pose(self, state: InsertionState) -> Array:
        """Tool pose X_WG (4, 4) at the present depth, offset across the axis by the search."""
        arrival = state.arrival
        assert arrival.path is not None
        assert arrival.placement is not None
        X = tool_pose(arrival.path, 0.0, arrival.placement.roll)[0]
        X[:3, 3] += X[:3, :3] @ [*state.aside, state.depth]
        return X

    def _reference(self, state: InsertionState, time: float) -> Reference:
        """Reference for the controller in the present state."""
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
            abort=state.abort,
            note=state.reason or state.arrival.note,
            compliant=self._job.compliance and entering and state.depth > -self._job.entry,
        )

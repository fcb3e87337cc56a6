"""Work that lets a tool in along its axis, by what is felt: what holes and soil share.

The way to the stand-off is that of `controllers.tasks.supervisor`. From there the advance is a damping law: the wanted
speed at no force, less as the force against the motion grows, none at the set force and back beyond it, so that what
stops the tool is pressed with the set force. The way out is that of the way in, as far as the stand-off.
"""

import math
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from controllers.tasks.supervisor import SurfaceWork
from controllers.tasks.surface_task_config import SupervisorState
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import Command, Reference, StateEstimate, Target, WorkState
from sim.interfaces.spatial import Array

_UNDER_WAY = (WorkState.SETTLE, WorkState.SCAN, WorkState.CLOSE_IN, WorkState.TARE)
_OVER = (WorkState.WITHDRAW, WorkState.DONE, WorkState.ABORT)


class AxialJob(Protocol):
    """What the job of such work says, whatever else it says."""

    @property
    def standoff(self) -> float:
        """[m] before the surface, from which the tool approaches."""
        ...

    @property
    def approach_speed(self) -> float:
        """[m/s] of the tool outside."""
        ...

    @property
    def speed(self) -> float:
        """[m/s] of the tool inside."""
        ...

    @property
    def acceleration(self) -> float:
        """[m/s^2] of the tool."""
        ...

    @property
    def yielding(self) -> float:
        """[m/s^2] of the tool where a force is felt."""
        ...

    @property
    def longest(self) -> float:
        """[s] from the stand-off to the work, and of the way out."""
        ...

    @property
    def force_limit(self) -> float:
        """[N] felt in any direction that ends the work."""
        ...

    @property
    def lost_place(self) -> float:
        """[m] off its place at which the hull counts as carried away."""
        ...


@dataclass(slots=True, eq=False)
class AxialState:
    """Where such work stands."""

    arrival: SupervisorState
    state: WorkState
    since: float  # [s] the state was entered
    began: float = 0.0  # [s] the stand-off was left
    depth: float = 0.0  # [m] of the tip below the surface as found; negative before it
    speed: float = 0.0  # [m/s] of its advance
    reason: str = ""  # why the work was broken off


JobT = TypeVar("JobT", bound=AxialJob)
StateT = TypeVar("StateT", bound=AxialState)


class AxialWork(Generic[JobT, StateT]):
    """Base of planners whose tool goes in along its axis; a planner adds its own states."""

    def __init__(self, job: JobT, arrival: SurfaceWork, *, too_long: str) -> None:
        """Take the job, the way to its stand-off, and what to say where the work is not begun in time."""
        self.period = arrival.period
        self._job, self._arrival, self._too_long = job, arrival, too_long

    def _arrive(
        self, state: StateT, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> Reference | None:
        """The reference on the way to the stand-off, and where that is not reached; None from there on."""
        under_way = state.state in _UNDER_WAY
        if not under_way and state.arrival.path is not None:
            return None
        state.arrival, reference = self._arrival.step(state.arrival, estimate, target, last)
        if not under_way:
            return reference
        if state.arrival.state in _UNDER_WAY:
            state.state, state.since = state.arrival.state, state.arrival.since
            return reference
        if state.arrival.state is not WorkState.APPROACH:  # it could not come there
            state.state, state.reason = state.arrival.state, state.arrival.reason
            return reference
        state.depth, state.began = -self._job.standoff, estimate.time
        self._enter(state, WorkState.APPROACH, estimate.time)
        return None

    def _enter(self, state: StateT, what: WorkState, time: float) -> None:
        state.state, state.since = what, time

    def _break_off(self, state: StateT, time: float, reason: str) -> None:
        state.reason = reason
        self._enter(state, WorkState.WITHDRAW, time)

    def _advance(self, state: StateT, wanted: float, resisted: float = 0.0) -> None:
        """Move the depth by one period, at `wanted` [m/s] less what `resisted` takes of it, see `next_speed`."""
        job = self._job
        state.speed = next_speed(
            state.speed, wanted, resisted, acceleration=job.acceleration, yielding=job.yielding, period=self.period
        )
        state.depth += state.speed * self.period

    def _draw_out(self, state: StateT, time: float, *, mouth: float, resisted: float) -> None:
        """Out along the axis, with the pull bounded as the push was; beyond `mouth` [m], back to the stand-off."""
        job = self._job
        inside = state.depth > mouth
        self._advance(state, -job.speed if inside else -job.approach_speed, resisted if inside else 0.0)
        stuck = time - state.since > job.longest
        if stuck:
            said = f"stuck at {1e3 * state.depth:.0f} mm on the way out"
            state.reason = f"{state.reason}; {said}" if state.reason else said
        if stuck or state.depth <= -job.standoff:
            state.speed = 0.0
            self._enter(state, WorkState.ABORT if state.reason else WorkState.DONE, time)

    def _watch(self, state: StateT, estimate: StateEstimate, force: float) -> None:
        """Draw the tool out when the hull is carried away, the force [N] is too large, or it takes too long."""
        job, time = self._job, estimate.time
        if state.state in _OVER:
            return
        off = math.dist(estimate.X_WB[:3, 3].tolist(), state.arrival.X_WB[:3, 3].tolist())
        if off > job.lost_place:
            self._break_off(state, time, f"the hull cannot hold its place: {off:.2f} m off")
        elif force > job.force_limit:
            self._break_off(state, time, f"felt force {force:.0f} N is above the limit of {job.force_limit:.0f} N")
        elif time - state.began > job.longest and state.state is not WorkState.WORK:
            self._break_off(state, time, f"{self._too_long} within {job.longest:.0f} s, at {1e3 * state.depth:.0f} mm")


def next_speed(
    speed: float, wanted: float, resisted: float, *, acceleration: float, yielding: float, period: float
) -> float:
    """Speed [m/s] one `period` [s] after `speed`, where `wanted` [m/s] is the speed at no force.

    `resisted` is the force against the motion as a share of that at which it stands still; beyond, the tool gives way,
    no faster than it came. It changes by at most `acceleration` [m/s^2], or `yielding` [m/s^2] where a force is felt.
    """
    wanted *= min(max(1.0 - resisted, -1.0), 1.0)
    most = (yielding if resisted > 0.0 else acceleration) * period
    return speed + min(max(wanted - speed, -most), most)


def felt_by_tool(last: Command | None, axis_W: Array) -> tuple[float, float]:
    """Force [N] felt against the advance along `axis_W` (3,), and across it.

    Raises ConfigurationError if the controller does not say what it feels.
    """
    if last is None or not math.isfinite(last.felt_normal) or "f_tip_W" not in last.believed:
        raise ConfigurationError(
            "the controller must say what it feels: Command.felt_normal [N] and believed['f_tip_W'] (3,) [N]"
        )
    f_tip_W = last.believed["f_tip_W"]
    return last.felt_normal, float(np.linalg.norm(f_tip_W - (f_tip_W @ axis_W) * axis_W))

"""Base of work that moves a tool in along its axis under admittance control: insertion into holes, penetration of soil.

`controllers.tasks.supervisor` brings the tool to the stand-off. From there the advance is a damping law. At zero force
the tool has the wanted speed; the speed falls as the opposing force grows, is zero at the set force and negative above
it. A tool that is stopped is thus pressed with the set force. The tool leaves by the same way, back to the stand-off.
"""

import math
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from controllers.tasks.supervisor import SurfaceWork
from controllers.tasks.surface_task_config import SupervisorState
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import AbortCode, Command, Reference, StateEstimate, Target, WorkState
from sim.interfaces.spatial import Array

_UNDER_WAY = (WorkState.SETTLE, WorkState.SCAN, WorkState.CLOSE_IN, WorkState.TARE)
_OVER = (WorkState.WITHDRAW, WorkState.DONE, WorkState.ABORT)


class AxialJob(Protocol):
    """Parameters that every job of axial work has."""

    @property
    def standoff(self) -> float:
        """Distance [m] before the surface from which the tool approaches."""
        ...

    @property
    def approach_speed(self) -> float:
        """Speed [m/s] of the tool outside."""
        ...

    @property
    def speed(self) -> float:
        """Speed [m/s] of the tool inside."""
        ...

    @property
    def acceleration(self) -> float:
        """Acceleration limit [m/s^2] of the tool."""
        ...

    @property
    def yielding(self) -> float:
        """Acceleration limit [m/s^2] of the tool while a force opposes its motion."""
        ...

    @property
    def longest(self) -> float:
        """Time limit [s] from the stand-off to the work, and of the way out."""
        ...

    @property
    def force_limit(self) -> float:
        """Estimated contact force [N], in any direction, above which the work ends."""
        ...

    @property
    def lost_place(self) -> float:
        """Position error [m] of the hull above which the work ends."""
        ...


@dataclass(slots=True, eq=False)
class AxialState:
    """State of axial work."""

    arrival: SupervisorState
    state: WorkState
    since: float  # [s] time at which the state was entered
    began: float = 0.0  # [s] time at which the stand-off was left
    depth: float = 0.0  # [m] of the tip below the surface as identified; negative before it
    speed: float = 0.0  # [m/s] of the advance
    abort: AbortCode | None = None  # why the work was broken off
    reason: str = ""  # the same in a sentence


JobT = TypeVar("JobT", bound=AxialJob)
StateT = TypeVar("StateT", bound=AxialState)


class AxialWork(Generic[JobT, StateT]):
    """Base of planners that move a tool in along its axis; a planner adds states of its own."""

    def __init__(self, job: JobT, arrival: SurfaceWork, *, too_long: str) -> None:
        """Store the job and the planner of the way to the stand-off.

        Args:
            job: parameters of the work.
            arrival: planner that brings the tool to the stand-off.
            too_long: first words of the reason given when `longest` is exceeded before the work begins.
        """
        self.period = arrival.period
        self._job, self._arrival, self._too_long = job, arrival, too_long

    def _arrive(
        self, state: StateT, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> Reference | None:
        """Reference on the way to the stand-off, or after a failure to reach it; None once the tool is there."""
        under_way = state.state in _UNDER_WAY
        if not under_way and state.arrival.path is not None:
            return None
        state.arrival, reference = self._arrival.step(state.arrival, estimate, target, last)
        if not under_way:
            return reference
        if state.arrival.state in _UNDER_WAY:
            state.state, state.since = state.arrival.state, state.arrival.since
            return reference
        if state.arrival.state is not WorkState.APPROACH:  # the stand-off could not be reached
            state.state, state.abort, state.reason = state.arrival.state, state.arrival.abort, state.arrival.reason
            return reference
        state.depth, state.began = -self._job.standoff, estimate.time
        self._enter(state, WorkState.APPROACH, estimate.time)
        return None

    def _enter(self, state: StateT, what: WorkState, time: float) -> None:
        """Change to another state."""
        state.state, state.since = what, time

    def _break_off(self, state: StateT, time: float, code: AbortCode, reason: str) -> None:
        """Withdraw the tool, for the given reason."""
        state.abort, state.reason = code, reason
        self._enter(state, WorkState.WITHDRAW, time)

    def _advance(self, state: StateT, wanted: float, resisted: float = 0.0) -> None:
        """Move the depth by one period at `wanted` [m/s], reduced by the force share `resisted` (see `next_speed`)."""
        job = self._job
        state.speed = next_speed(
            state.speed, wanted, resisted, acceleration=job.acceleration, yielding=job.yielding, period=self.period
        )
        state.depth += state.speed * self.period

    def _draw_out(self, state: StateT, time: float, *, mouth: float, resisted: float) -> None:
        """Move out along the axis, with the pull bounded as the push was.

        Outside `mouth` [m] the tool moves freely, back to the stand-off.
        """
        job = self._job
        inside = state.depth > mouth
        self._advance(state, -job.speed if inside else -job.approach_speed, resisted if inside else 0.0)
        stuck = time - state.since > job.longest
        if stuck:
            said = f"stuck at {1e3 * state.depth:.0f} mm on the way out"
            state.abort = state.abort or AbortCode.STUCK
            state.reason = f"{state.reason}; {said}" if state.reason else said
        if stuck or state.depth <= -job.standoff:
            state.speed = 0.0
            self._enter(state, WorkState.ABORT if state.reason else WorkState.DONE, time)

    def _watch(self, state: StateT, estimate: StateEstimate, force: float) -> None:
        """Withdraw the tool if the hull drifts off, the force [N] is above its limit, or time runs out."""
        job, time = self._job, estimate.time
        if state.state in _OVER:
            return
        off = math.dist(estimate.X_WB[:3, 3].tolist(), state.arrival.X_WB[:3, 3].tolist())
        if off > job.lost_place:
            self._break_off(state, time, AbortCode.HULL_ADRIFT, f"the hull cannot hold its place: {off:.2f} m off")
        elif force > job.force_limit:
            said = f"felt force {force:.0f} N is above the limit of {job.force_limit:.0f} N"
            self._break_off(state, time, AbortCode.FORCE_LIMIT, said)
        elif time - state.began > job.longest and state.state is not WorkState.WORK:
            said = f"{self._too_long} within {job.longest:.0f} s, at {1e3 * state.depth:.0f} mm"
            self._break_off(state, time, AbortCode.TIME_LIMIT, said)


def next_speed(
    speed: float, wanted: float, resisted: float, *, acceleration: float, yielding: float, period: float
) -> float:
    """Damping law of the advance: speed one period later.

    Args:
        speed: [m/s] now.
        wanted: [m/s] speed at zero force.
        resisted: force against the motion as a share of the force at which the tool stands still. Above 1 the tool
            moves back, at most at the speed `wanted`.
        acceleration: [m/s^2] limit of the change of speed.
        yielding: [m/s^2] the same limit while a force opposes the motion.
        period: [s].

    Returns:
        The speed [m/s].
    """
    wanted *= min(max(1.0 - resisted, -1.0), 1.0)
    most = (yielding if resisted > 0.0 else acceleration) * period
    return speed + min(max(wanted - speed, -most), most)


def contact_force_on_tool(last: Command | None, axis_W: Array) -> tuple[float, float]:
    """Estimated contact force along and across the direction of advance.

    Args:
        last: the controller's last command.
        axis_W: (3,) unit direction of advance in W.

    Returns:
        Force [N] against the advance, and magnitude [N] of the force across it.

    Raises:
        ConfigurationError: if the controller does not estimate the contact force.
    """
    if last is None or not last.contact.known:
        raise ConfigurationError("the controller gives no contact estimate: Command.contact.normal [N] is not a number")
    f_tip_W = last.contact.force_W
    return last.contact.normal, float(np.linalg.norm(f_tip_W - (f_tip_W @ axis_W) * axis_W))

"""What the supervisor watches for, and what it does then.

| found | reaction |
|---|---|
| vision too old | the path waits at half the force, and goes on when vision is back; after `blind_time` retreat |
| one torque sensor wrong | the work goes on, the motor's word in its place (`safety_wrapper`); two: retreat |
| an encoder wrong | the arm holds still, the hull withdraws the tool along its axis |
| a thruster lost | no more push, retreat along the tool axis, then off and up, as well as the other thrusters can |
| hull off its place | the same, with all thrusters |
| hull does not become quiet, or not come along | the work is given up |
| force above its limit, or long above the set one; contact lost | retreat along the tool axis |
| the estimate or the controller gives no numbers | arm braked, thrusters off (`safety_wrapper`), abort |

A retreat ends in ABORT. Before there is anything to retreat from, the work is given up where the vehicle is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from controllers.tasks.surface_task_config import SupervisorState, SurfaceTaskConfig
from sim.interfaces.messages import Fault, FaultKind, StateEstimate, WorkState


class Reaction(StrEnum):
    """What to do."""

    GO_ON = "go on"
    PAUSE = "pause"  # the path waits, the tool presses less
    RETREAT = "retreat"  # the arm draws the tool off along its axis
    RISE = "retreat and rise"  # and then the hull goes off and up, the arm held, out of reach of anything
    WITHDRAW = "withdraw"  # the hull does, the arm holds still
    STOP = "stop"  # nothing can be controlled


REACTIONS = {
    FaultKind.VISION: Reaction.PAUSE,
    FaultKind.TORQUE_SENSOR: Reaction.GO_ON,
    FaultKind.ENCODER: Reaction.WITHDRAW,
    FaultKind.THRUSTER: Reaction.RISE,
    FaultKind.ESTIMATE: Reaction.STOP,
    FaultKind.CONTROLLER: Reaction.STOP,
}
_SEVERITY = tuple(Reaction)
_AGAIN = {FaultKind.TORQUE_SENSOR: Reaction.RETREAT}  # where it is the second of its kind
_SAID = {
    FaultKind.VISION: "vision is lost",
    FaultKind.TORQUE_SENSOR: "torque sensors of {} are wrong",
    FaultKind.ENCODER: "encoder of {} is wrong",
    FaultKind.THRUSTER: "thruster {} is lost",
    FaultKind.ESTIMATE: "the state estimate is lost",
    FaultKind.CONTROLLER: "the controller's commands are no numbers",
}
_OVER = (WorkState.RETREAT, WorkState.DONE, WorkState.ABORT)
_TOUCHING = (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK)


@dataclass(frozen=True, slots=True)
class Verdict:
    """The hardest reaction that anything asks for, and why."""

    reaction: Reaction
    reason: str = ""


_SOUND = Verdict(Reaction.GO_ON)


def choose_reaction(
    job: SurfaceTaskConfig, state: SupervisorState, estimate: StateEstimate, felt: float, faults: Sequence[Fault]
) -> Verdict:
    """What is to be done now; `felt` [N], `faults` as the controller reports them. Counts times in `state`."""
    found = (
        _of_faults(job, faults, estimate.time),
        _of_place(job, state, estimate),
        _of_contact(job, state, estimate, felt),
    )
    if all(one is _SOUND for one in found):
        return _SOUND
    return max(found, key=lambda one: _SEVERITY.index(one.reaction))


def _of_faults(job: SurfaceTaskConfig, faults: Sequence[Fault], time: float) -> Verdict:
    if not math.isfinite(time):
        return Verdict(Reaction.STOP, _SAID[FaultKind.ESTIMATE])
    hardest, seen = _SOUND, []
    for fault in faults:
        reaction = _AGAIN.get(fault.kind, REACTIONS[fault.kind]) if fault.kind in seen else REACTIONS[fault.kind]
        if fault.kind is FaultKind.VISION and time - fault.time > job.blind_time:
            reaction = Reaction.RETREAT
        seen.append(fault.kind)
        if _SEVERITY.index(reaction) > _SEVERITY.index(hardest.reaction):
            alike = [other for other in faults if other.kind is fault.kind]
            figures = "; ".join(other.figures for other in alike if other.figures)
            said = _SAID[fault.kind].format(", ".join(other.part for other in alike))
            hardest = Verdict(reaction, f"{said} ({figures})" if figures else said)
    return hardest


def _of_place(job: SurfaceTaskConfig, state: SupervisorState, estimate: StateEstimate) -> Verdict:
    """The hull is carried away, or does not come to rest where it waits for that."""
    time = estimate.time
    off = math.dist(estimate.X_WB[:3, 3].tolist(), state.X_WB[:3, 3].tolist())
    waiting = state.state in (WorkState.SETTLE, WorkState.CLOSE_IN) and state.hull_move is None
    late = waiting and not state.joint_moves and time - state.still_since > job.settle_limit
    if not waiting or state.joint_moves:
        state.still_since = time
    if state.state in _OVER:
        return _SOUND
    if off > (job.lost_place_at_work if state.state in _TOUCHING else job.lost_place):
        return Verdict(Reaction.RISE, f"the hull cannot hold its place: {off:.2f} m off")
    if late:
        return Verdict(Reaction.RETREAT, f"the hull did not become quiet within {job.settle_limit:.0f} s")
    if state.hull_waited > job.settle_limit:
        return Verdict(Reaction.RETREAT, f"the hull came {job.settle_limit:.0f} s late on its way")
    return _SOUND


def _of_contact(job: SurfaceTaskConfig, state: SupervisorState, estimate: StateEstimate, felt: float) -> Verdict:
    """The force is too large, or the contact is gone."""
    if state.state in _TOUCHING and felt > job.force_limit:
        return Verdict(Reaction.RETREAT, f"felt force {felt:.0f} N is above the limit of {job.force_limit:.0f} N")
    working = state.state is WorkState.WORK and job.force_control and job.contactless is None
    if not working or felt <= (1.0 + job.excess) * state.force + job.touch:
        state.held_at = estimate.time
    elif estimate.time - state.held_at > job.excess_time:
        return Verdict(Reaction.RETREAT, f"the force cannot be held: {felt:.0f} N felt, {state.force:.0f} N set")
    if working:
        if felt > 0.5 * job.touch:
            state.contact_at = estimate.time
        elif estimate.time - state.contact_at > job.lost_time:
            return Verdict(Reaction.RETREAT, f"contact lost for {job.lost_time} s")
    return _SOUND

"""Fault responses of the supervisor to reported faults, drift of the hull, and wrong contact forces.

| condition | response |
|---|---|
| vision too old | the path waits at half the force until vision is back; after `blind_time` retreat |
| one torque sensor wrong | the work goes on with the motor's torque in its place (`safety_wrapper`); two: retreat |
| an encoder wrong | the arm holds its joint angles, the hull withdraws the tool along its axis |
| a thruster lost | no more push, retreat along the tool axis, then ascent off the object on the other thrusters |
| hull off its place | the same, with all thrusters |
| hull does not come to rest, or lags behind its move | the work is given up |
| force above its limit, or long above the set one; contact lost | retreat along the tool axis |
| estimate or command not finite | arm braked, thrusters off (`safety_wrapper`), abort |

A retreat ends in ABORT. Up to CLOSE_IN there is no contact to retreat from: the work then ends where the vehicle is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from controllers.tasks.surface_task_config import SupervisorState, SurfaceTaskConfig
from sim.interfaces.messages import AbortCode, Fault, FaultKind, StateEstimate, WorkState


class Reaction(StrEnum):
    """Fault response, the mildest first."""

    GO_ON = "go on"
    PAUSE = "pause"  # the path waits at a reduced force
    RETREAT = "retreat"  # the arm withdraws the tool along its axis
    RISE = "retreat and rise"  # then the hull ascends off the object
    WITHDRAW = "withdraw"  # the hull withdraws the tool, the arm holds its joint angles
    STOP = "stop"  # no control is possible


REACTIONS = {
    FaultKind.VISION: Reaction.PAUSE,
    FaultKind.TORQUE_SENSOR: Reaction.GO_ON,
    FaultKind.ENCODER: Reaction.WITHDRAW,
    FaultKind.THRUSTER: Reaction.RISE,
    FaultKind.ESTIMATE: Reaction.STOP,
    FaultKind.CONTROLLER: Reaction.STOP,
}
_SEVERITY = tuple(Reaction)
_AGAIN = {FaultKind.TORQUE_SENSOR: Reaction.RETREAT}  # response to the second fault of a kind
_SAID = {
    FaultKind.VISION: "vision is lost",
    FaultKind.TORQUE_SENSOR: "torque sensors of {} are wrong",
    FaultKind.ENCODER: "encoder of {} is wrong",
    FaultKind.THRUSTER: "thruster {} is lost",
    FaultKind.ESTIMATE: "the state estimate is lost",
    FaultKind.CONTROLLER: "the controller's commands are no numbers",
}
_CODES = {
    FaultKind.VISION: AbortCode.VISION,
    FaultKind.TORQUE_SENSOR: AbortCode.TORQUE_SENSORS,
    FaultKind.ENCODER: AbortCode.ENCODER,
    FaultKind.THRUSTER: AbortCode.THRUSTER,
    FaultKind.ESTIMATE: AbortCode.ESTIMATE,
    FaultKind.CONTROLLER: AbortCode.CONTROLLER,
}
_OVER = (WorkState.RETREAT, WorkState.DONE, WorkState.ABORT)
_TOUCHING = (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK)


@dataclass(frozen=True, slots=True)
class Verdict:
    """The most severe response that any condition asks for, and the reason."""

    reaction: Reaction
    code: AbortCode | None = None
    reason: str = ""  # the same in a sentence


_SOUND = Verdict(Reaction.GO_ON)


def choose_reaction(
    job: SurfaceTaskConfig, state: SupervisorState, estimate: StateEstimate, felt: float, faults: Sequence[Fault]
) -> Verdict:
    """Choose the response to faults, drift of the hull, and the contact force.

    Args:
        job: limits of the work.
        state: state of the supervisor; times of contact, excess force and rest are updated in place.
        estimate: estimated state of the vehicle.
        felt: [N] normal force at the tool as the controller estimates it.
        faults: faults that the controller reports.

    Returns:
        The response with its reason.
    """
    found = (
        _of_faults(job, faults, estimate.time),
        _of_place(job, state, estimate),
        _of_contact(job, state, estimate, felt),
    )
    if all(one is _SOUND for one in found):
        return _SOUND
    return max(found, key=lambda one: _SEVERITY.index(one.reaction))


def _of_faults(job: SurfaceTaskConfig, faults: Sequence[Fault], time: float) -> Verdict:
    """Response to the reported faults, the reason naming all faults of that kind."""
    if not math.isfinite(time):
        return Verdict(Reaction.STOP, AbortCode.ESTIMATE, _SAID[FaultKind.ESTIMATE])
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
            hardest = Verdict(reaction, _CODES[fault.kind], f"{said} ({figures})" if figures else said)
    return hardest


def _of_place(job: SurfaceTaskConfig, state: SupervisorState, estimate: StateEstimate) -> Verdict:
    """Response to a hull that drifts off, or does not come to rest in a state that waits for it."""
    time = estimate.time
    off = math.dist(estimate.X_WB[:3, 3].tolist(), state.X_WB[:3, 3].tolist())
    waiting = state.state in (WorkState.SETTLE, WorkState.CLOSE_IN) and state.hull_move is None
    late = waiting and not state.joint_moves and time - state.still_since > job.settle_limit
    if not waiting or state.joint_moves:
        state.still_since = time
    if state.state in _OVER:
        return _SOUND
    if off > (job.lost_place_at_work if state.state in _TOUCHING else job.lost_place):
        return Verdict(Reaction.RISE, AbortCode.HULL_ADRIFT, f"the hull cannot hold its place: {off:.2f} m off")
    if late:
        said = f"the hull did not become quiet within {job.settle_limit:.0f} s"
        return Verdict(Reaction.RETREAT, AbortCode.HULL_NOT_AT_REST, said)
    if state.hull_waited > job.settle_limit:
        return Verdict(Reaction.RETREAT, AbortCode.HULL_LATE, f"the hull came {job.settle_limit:.0f} s late on its way")
    return _SOUND


def _of_contact(job: SurfaceTaskConfig, state: SupervisorState, estimate: StateEstimate, felt: float) -> Verdict:
    """Response to a force that is too large, or to a lost contact."""
    if state.state in _TOUCHING and felt > job.force_limit:
        said = f"felt force {felt:.0f} N is above the limit of {job.force_limit:.0f} N"
        return Verdict(Reaction.RETREAT, AbortCode.FORCE_LIMIT, said)
    working = state.state is WorkState.WORK and job.force_control and job.contactless is None
    if not working or felt <= (1.0 + job.excess) * state.force + job.touch:
        state.held_at = estimate.time
    elif estimate.time - state.held_at > job.excess_time:
        said = f"the force cannot be held: {felt:.0f} N felt, {state.force:.0f} N set"
        return Verdict(Reaction.RETREAT, AbortCode.FORCE_NOT_HELD, said)
    if working:
        if felt > 0.5 * job.touch:
            state.contact_at = estimate.time
        elif estimate.time - state.contact_at > job.lost_time:
            return Verdict(Reaction.RETREAT, AbortCode.CONTACT_LOST, f"contact lost for {job.lost_time} s")
    return _SOUND

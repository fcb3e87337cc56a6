"""Tick of the tool as one kernel: force law, lateral displacement, drift correction and inverse
kinematics.

Replaceable components are slots (`uuv.sim.interfaces.kernels.slots`); for an empty slot the
component named here is used.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.arm import compliance, position_force
from uuv.controllers.arm.compliance import OFFSET, ComplianceGains, come_back, give_way
from uuv.controllers.arm.joint_servo import ToolTarget
from uuv.controllers.arm.position_force import (
    CLOSED,
    INWARDS,
    OUTWARDS,
    ForceLoopGains,
    displace,
    let_go,
)
from uuv.controllers.arm.tool_motion import ToolMotion, ToolTracking, hold_joints, track_tool
from uuv.controllers.estimation.tip_force_kernels import ContactRecord
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import NO_POSE
from uuv.sim.interfaces.kernels.record_box import new_box
from uuv.sim.interfaces.kernels.slots import FINE, Slot, call
from uuv.sim.interfaces.records import COMPLIANT, CONTROLLED, FOLLOWS, STANDING, ReferenceRecord
from uuv.sim.interfaces.spatial import Array

# Entries of `ToolRecord.numbers`: displacement [m] along the tool axis; compliance [m/N] of the
# servoed tip along it, 0 if unknown; number of entries
K, SERVO_COMPLIANCE, NUMBERS = range(3)

# Entries of the values of a slot for a drift correction: poses X_WB (4, 4), row by row
SEEN, HELD, PLACED = 0, 16, 32  # estimated; to hold; the result, from which the arm places the tool
DRIFT_VALUES = 3 * 16


class ToolGains(NamedTuple):
    """Constants of tool control."""

    tracking: ToolTracking
    force: ForceLoopGains  # gains of `ForceDisplacement`
    side: ComplianceGains  # gains of `LateralCompliance`
    # number of ticks of the tool between two computations of the servo's compliance
    compliance_ticks: int


class ToolRecord(NamedTuple):
    """State of tool control, as arrays that are changed in place."""

    gains: ToolGains
    force: Slot  # force law; empty: `ForceDisplacement`
    # slot for the displacement perpendicular to the tool axis; empty: `LateralCompliance`
    side: Slot
    drift: Slot  # slot for the drift correction; empty: `FromEstimate`
    stiffness: Slot  # slot that writes SERVO_COMPLIANCE
    motion: ToolMotion
    X_AG: Array  # (4, 4) last tool pose reference, in the arm's base
    numbers: Array  # (NUMBERS,)
    ticks: np.ndarray  # (1,) number of ticks of the tool so far


@kernel
def move_tool(tool, contact, e, reference):
    """Compute the desired joint motion, once per period of the tool.

    Args:
        tool: `ToolRecord`; updated, with the motion.
        contact: `ContactRecord`.
        e: present `EstimateRecord` of the vehicle.
        reference: `ReferenceRecord`.

    Returns:
        FINE, NO_POSE, or the return value of a slot that failed.
    """
    gains = tool.gains
    motion = tool.motion
    sensed = contact.sensed
    age = e.time[0] - reference.time[0]
    answer = _displace(tool, contact, reference)
    if answer != FINE:
        return answer
    if not reference.flags[FOLLOWS]:
        hold_joints(motion, reference.q, reference.qd, age)
        tool.ticks[0] += 1
        return FINE

    # Hull pose from which the arm places the tool.
    X_WB = e.X_WB
    if tool.drift.address:
        values = tool.drift.values
        for i in range(4):
            for j in range(4):
                values[SEEN + 4 * i + j] = e.X_WB[i, j]
                values[HELD + 4 * i + j] = reference.X_WB[i, j]
        answer = call(tool.drift)
        if answer != FINE:
            return answer
        X_WB = values[PLACED:DRIFT_VALUES].reshape(4, 4)

    # Inverse kinematics.
    target = ToolTarget(reference.X_WG, reference.v_WG_W, reference.w_WG_W)
    displaced = tool.numbers[K], tool.side.values[OFFSET : OFFSET + 3]
    tip = sensed.X_BG, sensed.J_B
    solved, tool.X_AG[:, :] = track_tool(
        gains.tracking, motion, target, age, displaced, X_WB, sensed.hull, tip
    )
    if not solved:
        return NO_POSE
    tool.ticks[0] += 1
    return FINE


@kernel
def _displace(tool, contact, reference):
    """Write the displacement of the tool along its axis into `numbers`, and perpendicular to it
    into the slot's values.
    """
    gains = tool.gains
    numbers = tool.numbers
    dt = tool.gains.tracking.period
    follows = reference.flags[FOLLOWS]
    closed = follows and reference.flags[CONTROLLED]
    if closed and (numbers[SERVO_COMPLIANCE] == 0.0 or tool.ticks[0] % gains.compliance_ticks == 0):
        answer = call(tool.stiffness)
        if answer != FINE:
            return answer

    # Along the axis.
    force = tool.force.values
    law = tool.force.memory
    asked = reference.set_force[0]
    felt = contact.felt[0]
    soft = numbers[SERVO_COMPLIANCE]
    force[position_force.ASKED] = asked
    force[position_force.MEASURED] = felt
    force[position_force.SOFT] = soft
    force[position_force.LASTING] = dt
    force[position_force.LOOP] = CLOSED if closed else OUTWARDS if follows else INWARDS
    for i in range(3):
        force[position_force.WHOLE + i] = contact.f_W[i]
    if tool.force.address:
        answer = call(tool.force)
        if answer != FINE:
            return answer
        numbers[K] = force[position_force.ANSWER]
    elif closed:
        numbers[K] = displace(gains.force, law, asked, felt, soft, dt)
    else:
        numbers[K] = let_go(law, gains.force.speed * dt, not follows)

    # Perpendicular to the axis.
    side = tool.side.values
    for i in range(3):
        side[compliance.FORCE + i], side[compliance.AXIS + i] = contact.f_W[i], reference.X_WG[i, 2]
    side[compliance.DT] = dt
    side[compliance.CONTROLLED] = closed
    side[compliance.COMPLIANT] = follows and reference.flags[COMPLIANT]
    side[compliance.STANDING] = reference.flags[STANDING]
    if tool.side.address:
        return call(tool.side)
    if side[compliance.COMPLIANT] != 0.0:
        z_WG = side[compliance.AXIS : compliance.AXIS + 3]
        give_way(gains.side, tool.side.memory, contact.f_W, z_WG, dt, reference.flags[STANDING])
    else:
        come_back(gains.side, tool.side.memory, dt)
    for i in range(3):
        side[OFFSET + i] = tool.side.memory[i]
    return FINE


class ToolWork(NamedTuple):
    """Tool control alone, for a controller that has no tick of its own."""

    tool: ToolRecord
    contact: ContactRecord
    reference: ReferenceRecord


@kernel
def tool_box(work):
    """`RecordBox` of a `ToolWork`."""
    return new_box(work)


@kernel(nogil=True)
def tool_tick(box, estimate):
    """Run `move_tool` on the boxes of a `ToolWork` and of an `EstimateRecord`."""
    work = box.record
    return move_tool(work.tool, work.contact, estimate.record, work.reference)

"""Step of the hull within the tick of the position-force controller, at the rate of the hull."""

from typing import NamedTuple

import numpy as np

from uuv.controllers.arm import compliance
from uuv.controllers.estimation.tip_force_kernels import contact_wrench
from uuv.controllers.hull.feedforward import CONTACT_B, LEFT_OUT_B, WRENCH_B
from uuv.controllers.hull.hull_control import HullRecord, control_hull
from uuv.controllers.hull.station_keeping import HullTarget, MeasuredMotion
from uuv.controllers.whole_body.tool_tick import K
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import FINE, Slot, call
from uuv.sim.interfaces.records import IN_CONTACT
from uuv.sim.interfaces.spatial import Array


class LoggedStep(NamedTuple):
    """Quantities of the controller at the last step of the hull, as arrays, for the log only."""

    displacement: Array  # (1,) [m] displacement of the tool along its axis
    compliance_W: Array  # (3,) [m] displacement of the tool perpendicular to its axis
    q_wanted: Array  # (n,) [rad] joint angles
    ik_error: Array  # (2,) errors as in `ToolMotion`


class HullStepRecord(NamedTuple):
    """Step of the hull, as arrays that are changed in place."""

    hull: HullRecord
    # slot that returns the part left out; empty: the whole wrench is fed forward, `ArmWrench`
    feedforward: Slot
    log: LoggedStep


@kernel
def step_hull(step, contact, tool, e, reference, command):
    """Command the thrusters against the arm's wrench, without the part that `feedforward` leaves
    out.

    The wrench is that of the arm's motion and weight and of the estimated force, C_F_M = C_F_D + A
    f_e and C_M_M = C_M_D + C_M_e of [Konoplin 2022].

    Args:
        step: `HullStepRecord`; updated.
        contact: `ContactRecord` after the joints' part of a tick.
        tool: `ToolRecord` at the same time.
        e: present `EstimateRecord` of the vehicle.
        reference: `ReferenceRecord`.
        command: `Commanded`; updated.

    Returns:
        FINE, or the return value of a slot that failed.
    """
    sensed = contact.sensed
    hull = step.hull
    contact_B = np.zeros(6)
    fed_B = np.empty(6)
    if reference.flags[IN_CONTACT]:
        contact_wrench(sensed.X_BG, sensed.f_B, contact_B)
    for k in range(6):
        command.arm_wrench_B[k] = sensed.wrench_B[k] + contact_B[k]
        fed_B[k] = command.arm_wrench_B[k]

    # Part that is not fed forward.
    if step.feedforward.address:
        values = step.feedforward.values
        for k in range(6):
            values[CONTACT_B + k] = contact_B[k]
            values[WRENCH_B + k] = command.arm_wrench_B[k]
        answer = call(step.feedforward)
        if answer != FINE:
            return answer
        for k in range(6):
            fed_B[k] -= values[LEFT_OUT_B + k]

    # Hull, and the command.
    motion = MeasuredMotion(e.X_WB, e.v_WB_B, e.w_WB_B)
    target = HullTarget(reference.X_WB, reference.v_WB_W, reference.w_WB_W)
    control_hull(hull, motion, target, fed_B)
    command.thrusters[:] = hull.thrusters
    command.current_W[:] = hull.current_W
    command.hull_steps[0] += 1

    # Log.
    log = step.log
    tool_motion = tool.motion
    side = tool.side.values
    log.displacement[0] = tool.numbers[K]
    log.compliance_W[:] = side[compliance.OFFSET : compliance.OFFSET + 3]
    log.q_wanted[:] = tool_motion.q
    log.ik_error[:] = tool_motion.ik_error
    return FINE

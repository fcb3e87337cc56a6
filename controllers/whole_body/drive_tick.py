"""Tick of the position-force controller: its whole computation at the rate of the drives, as one
kernel.

`WorkController.step` and the compiled ticks of the loop both call it, on the record that is the
controller's state. Replaceable components are slots (`uuv.sim.interfaces.kernels.slots`): the
contact estimator, the parts of tool control (`tool_tick`), and the feedforward to the hull
(`hull_step`).
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmParameters
from uuv.controllers.arm.joint_servo import (
    BorneLoad,
    Drives,
    JointTarget,
    SeenArm,
    SoftAxis,
    servo_joints,
)
from uuv.controllers.estimation.tip_force_kernels import (
    ArmReadings,
    ContactRecord,
    FeelGains,
    add_to_tare,
    feel_by_slot,
    feel_by_torques,
    find_sigma,
)
from uuv.controllers.whole_body.hull_step import HullStepRecord, step_hull
from uuv.controllers.whole_body.tool_tick import ToolRecord, move_tool
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import Commanded
from uuv.sim.interfaces.kernels.record_box import new_box
from uuv.sim.interfaces.kernels.slots import FINE, Slot, call
from uuv.sim.interfaces.records import CONTROLLED, IN_CONTACT, TARE, ReferenceRecord
from uuv.sim.interfaces.spatial import Array


class DriveGains(NamedTuple):
    """Constants of the controller."""

    feel: FeelGains
    # True: the tick senses the arm before it calls the estimator's slot; False: the slot does so
    feels: bool
    closed_loop: bool  # True: the force law controls the estimated force
    drives: Drives
    softness: float  # [-] share of the stiffness that force control removes along the tool axis
    hardening: float  # [-] share of this stiffness that is restored in a tick
    friction_feedforward: float  # [-] share of the tangential force that is fed forward
    task_ticks: int  # number of ticks in a period of the tool
    hull_ticks: int  # number of ticks in a period of the hull
    period: float  # [s] period of the drives


class DriveRecord(NamedTuple):
    """State of the controller, as arrays that are changed in place."""

    gains: DriveGains
    arm: ArmParameters  # arm model of the controller
    contact: ContactRecord
    estimator: Slot  # slot of the contact estimator; empty: `TorqueSensors`
    # slot of the payload of `TorqueSensors`, at its slow ticks, until the payload is known
    weigh: Slot
    tool: ToolRecord
    reference: ReferenceRecord
    integral: Array  # (n,) [rad s] integral of the joint servo
    hull: HullStepRecord  # step of the hull, at the rate of the hull
    command: Commanded
    softness: Array  # (1,) [-] share of the stiffness given up at present along the tool axis
    ticks: np.ndarray  # (1,) number of ticks so far


@kernel
def drive_box(record):
    """`RecordBox` of a `DriveRecord`."""
    return new_box(record)


@kernel(nogil=True)
def drive_tick(box, estimate):
    """One tick: contact force, tool motion if due, joint torques, and the hull if due.

    Args:
        box: of a `DriveRecord`; updated.
        estimate: box of the present `EstimateRecord` of the vehicle.

    Returns:
        FINE, NO_POSE, or the return value of a slot that failed.
    """
    record = box.record
    e = estimate.record
    gains = record.gains
    tick = record.ticks[0]

    # Parts are passed on one by one, since passing a whole record would change the reference count
    # of each of its arrays.
    parts = record.estimator, record.weigh
    asked = record.command.tau, record.command.current_W
    answer = _feel(gains, record.arm, record.contact, parts, record.reference, asked, e)
    if answer != FINE:
        return answer
    since = tick % gains.task_ticks
    if since == 0:
        answer = move_tool(record.tool, record.contact, e, record.reference)
        if answer != FINE:
            return answer
    goal = record.tool.motion, since
    felt = record.contact.sensed, record.contact.friction
    held = record.softness, record.integral
    _drive(gains, record.arm, goal, felt, record.reference, held, e, record.command.tau)
    if tick % gains.hull_ticks == 0:
        answer = step_hull(
            record.hull, record.contact, record.tool, e, record.reference, record.command
        )
        if answer != FINE:
            return answer
    record.ticks[0] += 1
    return FINE


@kernel
def _feel(gains, arm, contact, parts, reference, asked, e):
    """Contact force, friction of the gears, and motion of arm and hull.

    Args:
        gains: `DriveGains`.
        arm: `ArmParameters`.
        contact: `ContactRecord`; updated.
        parts: slots of the estimator and of the payload.
        reference: `ReferenceRecord`.
        asked: motor torques (n,) [N m], and the estimated current (3,) [m/s], of the last step.
        e: present `EstimateRecord` of the vehicle.

    Returns:
        FINE, or the return value of a slot that failed.
    """
    estimator, weigh = parts
    tau, current_W = asked
    if not gains.feels:
        return call(estimator)
    readings = ArmReadings(e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, current_W, e.q, e.qd, e.tau)
    feel_by_torques(arm, gains.feel, readings, e.tau_doubt, tau, contact)
    if estimator.address:
        answer = feel_by_slot(estimator, (e.X_WB, e.q, e.qd, e.tau), tau, contact)
        if answer != FINE:
            return answer
    if reference.flags[TARE]:
        add_to_tare(contact.tare, contact.sensed.tau_e, contact.bias)

    # At the rate of the hull: the payload, and the uncertainty of the force.
    answer = FINE
    if contact.ticks[0] % gains.feel.slow_ticks == 0:
        if contact.weighing[0]:
            answer = call(weigh)
        find_sigma(gains.feel, e.tau, contact)
    contact.ticks[0] += 1
    return answer


@kernel
def _drive(gains, arm, goal, felt, reference, held, e, tau_motor):
    """Joint torques.

    Args:
        gains: `DriveGains`.
        arm: `ArmParameters`.
        goal: `ToolMotion`, and the number of ticks since it was computed.
        felt: `SensedArm`, and the friction (n,) [N m] of the gears.
        reference: `ReferenceRecord`.
        held: softness and integral of the `DriveRecord`; updated.
        e: present `EstimateRecord` of the vehicle.
        tau_motor: (n,) [N m] output.
    """
    motion, since = goal
    sensed, friction = felt
    given_up, integral = held
    controlled = reference.flags[CONTROLLED]
    presses = controlled and gains.closed_loop

    # Stiffness along the tool axis is given up at once and restored slowly.
    softness = given_up[0]
    if presses:
        softness = gains.softness
    elif softness > 0.0:
        softness = max(0.0, softness - gains.hardening)
    given_up[0] = softness

    # Loads that are fed forward.
    borne = BorneLoad(np.zeros(6), friction)
    if reference.flags[IN_CONTACT]:
        for i in range(3):
            borne.wrench_G[i] = gains.friction_feedforward * sensed.f_G[i]
    borne.wrench_G[2] = -reference.set_force[0] if presses else 0.0

    # Servo.
    target = JointTarget(motion.q, motion.qd, motion.qdd, since * gains.period)
    seen = SeenArm(e.q, e.qd, sensed.hull)
    soft = SoftAxis(motion.yielding, softness)
    tau = servo_joints(arm, gains.drives, seen, target, soft, borne, integral)
    for j in range(tau.shape[0]):
        tau_motor[j] = tau[j]

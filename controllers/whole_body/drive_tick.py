"""Ticks of the position-force controller, compiled as a whole but for the step of the hull.

`WorkController` composes the same kernels in Python; both give the same bits. Here they run for a controller of which
no part is replaced. Where the hull's step is due, the caller makes it.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmParameters
from uuv.controllers.arm.joint_servo import (
    BorneLoad,
    Drives,
    FrictionTracking,
    JointTarget,
    SeenArm,
    SoftAxis,
    ToolTarget,
    servo_joints,
    track_gear_friction,
)
from uuv.controllers.arm.kernel_force_law import displace_by
from uuv.controllers.arm.position_force import ForceLoopGains, displace, let_go
from uuv.controllers.arm.tool_motion import ToolMotion, ToolTracking, hold_joints, track_tool
from uuv.controllers.estimation.tip_force_estimator import (
    ArmReadings,
    SensedArm,
    SenseTiming,
    Tare,
    TorqueErrors,
    add_to_tare,
    estimate_tip_force,
)
from uuv.controllers.safety.fault_detection import finite
from uuv.controllers.safety.joint_residuals import JointResidualModel, JointResiduals, update_residuals
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import Reference
from uuv.sim.interfaces.spatial import Array

# Outcome of `drive_tick`
FINE = 0  # done
UNSOUND = 1  # nothing was done: the estimate is not finite, or too old
NO_POSE = 2  # nothing was commanded: the tool's target is no pose
SUSPECT = 3  # done, but a residual of the joints' sensors needs evaluation
BROKEN = 4  # done, but the torques are not finite
HULL = 5  # done, and a step of the hull is due

# Entries of `DriveRecord.numbers`
NORMAL, SOFTNESS, SERVO_COMPLIANCE = 0, 1, 2  # [N] felt; [-] given up along the tool axis; [m/N] along it
BEGAN = 3  # [s] time of the first estimate
NUMBERS = 4  # number of entries

# Entries of `DriveRecord.ticks`: of the controller, and of its tool control
TICK, TOOL_TICK = 0, 1


class ReferenceRecord(NamedTuple):
    """Fields of `Reference` that the drives follow; arrays, overwritten by `refer`."""

    time: Array  # (1,) [s]
    X_WG: Array  # (4, 4) tool pose to follow
    v_WG_W: Array  # (3,) [m/s]
    w_WG_W: Array  # (3,) [rad/s]
    q: Array  # (n,) [rad] joint angles to hold
    qd: Array  # (n,) [rad/s]
    set_force: Array  # (1,) [N] normal force to press with
    flags: np.ndarray  # (3,) bool: a tool pose is followed; the force loop is closed; the torque sensors are tared

    @classmethod
    def empty(cls, n: int) -> "ReferenceRecord":
        """Record for `n` joints, to be filled by `refer`."""
        return cls(
            np.zeros(1),
            np.eye(4),
            np.zeros(3),
            np.zeros(3),
            np.zeros(n),
            np.zeros(n),
            np.zeros(1),
            np.zeros(3, np.bool_),
        )

    def refer(self, reference: Reference) -> None:
        """Take over the set points of `reference`."""
        self.time[0], self.set_force[0] = reference.time, reference.set_force
        self.flags[:] = reference.X_WG is not None, reference.force_control, reference.tare
        if reference.X_WG is not None:
            self.X_WG[:] = reference.X_WG
        self.v_WG_W[:], self.w_WG_W[:] = reference.v_WG_W, reference.w_WG_W
        self.q[:], self.qd[:] = reference.q, reference.qd


class DriveGains(NamedTuple):
    """Constants of the controller."""

    timing: SenseTiming
    gears: FrictionTracking
    tracking: ToolTracking
    force: ForceLoopGains
    law: int  # address of a `KernelForceLaw`; 0: `ForceDisplacement`
    drives: Drives
    softness: float  # [-] share of the stiffness that force control removes along the tool axis
    hardening: float  # [-] of it restored in a tick
    friction_feedforward: float  # [-] share of the tangential force that is fed forward
    torque_noise: float  # [-] of the torque sensors, share of the reading
    task_ticks: int  # ticks in a period of the tool
    hull_ticks: int  # ticks in a period of the hull
    period: float  # [s] of the drives
    warm_up: float  # [s] after which residuals count
    oldest: Array  # (3,) [s] largest ages of vision, DVL and IMU


class DriveRecord(NamedTuple):
    """State of the controller as far as the drives change it; arrays, changed in place."""

    gains: DriveGains
    arm: ArmParameters  # believed arm
    sensed: SensedArm
    bias: Array  # (n,) [N m] of the external torques
    tare: Tare
    floor: Array  # (n,) [N m] standard deviation of the external torques
    friction: Array  # (n,) [N m] dry friction in the gears
    force: Array  # of the force loop, see `position_force`
    motion: ToolMotion
    integral: Array  # (n,) [rad s] of the joint servo
    tau: Array  # (n,) [N m] of the motors
    f_W: Array  # (3,) [N] force of the world on the tip, W
    offset_W: Array  # (3,) [m] of the lateral compliance, which is at rest: zero
    current_W: Array  # (3,) [m/s] estimated current
    model: JointResidualModel
    residuals: JointResiduals
    numbers: Array  # (NUMBERS,)
    ticks: np.ndarray  # (2,) int64


@kernel
def drive_tick(record, estimate, reference):
    """One tick: contact force, tool motion on its ticks, joint torques, residuals of the sensors.

    Args:
        record: `DriveRecord`; updated, the torques are in `tau`.
        estimate: `EstimateRecord` of the vehicle now.
        reference: `ReferenceRecord`.

    Returns:
        FINE, UNSOUND, NO_POSE, SUSPECT, BROKEN or HULL.
    """
    gains, numbers, ticks, sensed, motion = record.gains, record.numbers, record.ticks, record.sensed, record.motion
    e, follows, closed, taring = estimate, reference.flags[0], reference.flags[1], reference.flags[2]
    for i in range(3):
        if e.ages[i] > gains.oldest[i]:
            return UNSOUND
    if not finite(e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, e.q, e.qd, e.time[0]):
        return UNSOUND
    readings = ArmReadings(e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, record.current_W, e.q, e.qd, e.tau)
    errors = TorqueErrors(record.bias, record.floor, gains.torque_noise)
    felt = estimate_tip_force(record.arm, readings, errors, gains.timing, sensed, record.f_W)
    track_gear_friction(record.tau, e.tau, e.qd, sensed.qdd, gains.gears, record.friction)
    if taring:
        add_to_tare(record.tare, sensed.tau_e, record.bias)
    numbers[NORMAL] = felt
    since, hull_due = ticks[TICK] % gains.task_ticks, ticks[TICK] % gains.hull_ticks == 0
    if since == 0:
        age, dt = e.time[0] - reference.time[0], gains.tracking.period
        most = gains.force.speed * dt
        if follows:
            if closed:
                compliance, bounds = numbers[SERVO_COMPLIANCE], (gains.force.speed, gains.force.limit)
                if gains.law:
                    k = displace_by(gains.law, bounds, record.force, reference.set_force[0], felt, compliance, dt)
                else:
                    k = displace(gains.force, record.force, reference.set_force[0], felt, compliance, dt)
            else:
                k = let_go(record.force, most, False)
            target = ToolTarget(reference.X_WG, reference.v_WG_W, reference.w_WG_W)
            displaced, tip = (k, record.offset_W), (sensed.X_BG, sensed.J_B)
            solved, _ = track_tool(gains.tracking, motion, target, age, displaced, e.X_WB, sensed.hull, tip)
            if not solved:
                return NO_POSE
        else:
            let_go(record.force, most, True)
            hold_joints(motion, reference.q, reference.qd, age)
        ticks[TOOL_TICK] += 1
    if closed:
        numbers[SOFTNESS] = gains.softness
    elif numbers[SOFTNESS] > 0.0:
        numbers[SOFTNESS] = max(0.0, numbers[SOFTNESS] - gains.hardening)
    borne = BorneLoad(np.zeros(6), record.friction)
    if reference.set_force[0] > 0.0 or closed:
        for i in range(3):
            borne.wrench_G[i] = gains.friction_feedforward * sensed.f_G[i]
    borne.wrench_G[2] = -reference.set_force[0] if closed else 0.0
    target_of_joints = JointTarget(motion.q, motion.qd, motion.qdd, since * gains.period)
    soft = SoftAxis(motion.yielding, numbers[SOFTNESS])
    seen = SeenArm(e.q, e.qd, sensed.hull)
    tau = servo_joints(record.arm, gains.drives, seen, target_of_joints, soft, borne, record.integral)
    ticks[TICK] += 1
    age = e.time[0] - numbers[BEGAN]
    warm = age > gains.warm_up
    look = update_residuals(record.model, (e.q, e.qd, e.tau), age, warm, record.residuals)
    total = 0.0
    for j in range(tau.shape[0]):
        record.tau[j] = record.residuals.tau_motor[j] = tau[j]
        total += 0.0 * tau[j]
    if total != 0.0:  # NaN or infinite
        return BROKEN
    if warm and look:
        return SUSPECT
    return HULL if hull_due else FINE

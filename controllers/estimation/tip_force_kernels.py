"""Kernels of the tip-force estimator: from joint torques to the force on the tool.

The kernels implement `uuv.controllers.arm.inverse_dynamics` and
`uuv.controllers.estimation.force_from_torques`. The tests compare these compiled forms with the
plain forms. Records may be passed as plain tuples of their fields, which numba types faster.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.arm.inverse_dynamics import (
    ArmParameters,
    JointMotion,
    newton_euler,
    tip_kinematics,
    workspace,
)
from uuv.controllers.arm.joint_servo import FrictionTracking, track_gear_friction
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import call
from uuv.sim.interfaces.spatial import Array

# [1/N^2] weak prior with a sigma of 1 kN about zero, which bounds directions that a posture cannot
# observe
PRIOR = 1e-6


class ArmReadings(NamedTuple):
    """Measured motion of hull and arm, and the measured torques."""

    X_WB: Array  # (4, 4) hull pose
    v_B: Array  # (3,) [m/s] velocity of the hull, hull axes
    w_B: Array  # (3,) [rad/s] angular velocity of the hull, hull axes
    a_B: Array  # (3,) [m/s^2] acceleration of the hull's origin, hull axes
    current_W: Array  # (3,) [m/s] steady current
    q: Array  # (n,) [rad] joint angles
    qd: Array  # (n,) [rad/s] joint speeds
    tau: Array  # (n,) [N m] torques at the gear outputs


class TorqueErrors(NamedTuple):
    """Errors of the joint torques."""

    bias: Array  # (n,) [N m] tare, which is not due to contact
    floor: Array  # (n,) [N m] constant standard deviation of a torque
    noise: float  # [-] standard deviation of a torque as a share of its reading


class SenseTiming(NamedTuple):
    """Step and filters of the estimator."""

    period: float  # [s] since the last step
    acceleration: float  # [s] filter of the rates, whose lag gives the accelerations
    force: float  # [s] filter of the force


class SensedArm(NamedTuple):
    """Memory and output of the estimator; all arrays are written at each step."""

    qd_slow: Array  # (n,) [rad/s] filtered joint speeds
    w_slow_B: Array  # (3,) [rad/s] filtered angular velocity of the hull
    hull: Array  # (24,) motion of the hull for `newton_euler`
    qdd: Array  # (n,) [rad/s^2] joint accelerations
    tau_e: Array  # (n,) [N m] external torques before the tare is subtracted
    wrench_B: Array  # (6,) [N, N m] wrench of the arm on the hull without contact, hull axes
    X_BG: Array  # (4, 4) tip pose in the hull's frame
    J_B: Array  # (6, n) Jacobian of the tip, hull axes
    f_B: Array  # (3,) [N] force of the world on the tip, hull axes; filtered
    f_G: Array  # (3,) [N] the same in tool axes

    @classmethod
    def start(cls, qd: Array, w_B: Array) -> "SensedArm":
        """Memory at the first estimate: `qd` (n,) [rad/s], `w_B` (3,) [rad/s] of the hull."""
        n = len(qd)
        return cls(
            qd_slow=np.array(qd),
            w_slow_B=np.array(w_B),
            hull=np.zeros(24),
            qdd=np.zeros(n),
            tau_e=np.zeros(n),
            wrench_B=np.zeros(6),
            X_BG=np.eye(4),
            J_B=np.zeros((6, n)),
            f_B=np.zeros(3),
            f_G=np.zeros(3),
        )


class Tare(NamedTuple):
    """Tare of the torque sensors: mean reading free of contact, which combines bias and model
    error.
    """

    total: Array  # (n,) [N m] sum of the samples
    samples: Array  # (1,) number of samples

    @classmethod
    def start(cls, n: int) -> "Tare":
        """Tare of `n` joints, without a sample."""
        return cls(np.zeros(n), np.zeros(1))


@kernel
def add_to_tare(tare, tau_e, bias):
    """Add a sample of external torques free of contact; the mean of all samples is written to
    `bias`.

    Args:
        tare: fields of `Tare`, in a tuple.
        tau_e: (n,) [N m] the sample.
        bias: (n,) [N m] output.
    """
    total, samples = tare
    samples[0] += 1.0
    for j in range(total.shape[0]):
        total[j] += tau_e[j]
        bias[j] = total[j] / samples[0]


@kernel
def contact_wrench(X_BG, f_B, wrench_B):
    """Contact wrench on the hull through the arm, at the hull's origin in hull axes.

    Args:
        X_BG: (4, 4) tip pose in the hull's frame.
        f_B: (3,) [N] force of the world on the tip, hull axes.
        wrench_B: (6,) [N, N m] output.
    """
    lever_B = np.zeros((3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        lever_B[i, j], lever_B[i, k] = -X_BG[k, 3], X_BG[j, 3]
    wrench_B[:3] = f_B
    wrench_B[3:] = lever_B @ f_B


@kernel
def estimate_tip_force(arm, readings, errors, timing, sensed, f_W):
    """Filtered force of the world on the tip, from torque sensors minus the arm model.

    Joint and hull angular accelerations come from the lag of filtered rates.

    Args:
        arm: fields of `ArmParameters`, in a tuple; likewise below.
        readings: `ArmReadings`.
        errors: `TorqueErrors`.
        timing: `SenseTiming`.
        sensed: `SensedArm`; updated.
        f_W: (3,) [N] output: force in W.

    Returns:
        The normal force [N], positive when the tool presses.
    """
    read = ArmReadings(*readings)
    out = SensedArm(*sensed)
    dt, acceleration_time, force_time = timing
    X_WB = read.X_WB
    v_B = read.v_B
    w_B = read.w_B
    a_B = read.a_B
    hull = out.hull
    w_slow_B = out.w_slow_B
    qd_slow = out.qd_slow

    # Motion of the hull, its angular acceleration from the lag of the filtered rate
    lag = min(1.0, dt / acceleration_time)
    for i in range(3):
        for j in range(3):
            hull[3 * i + j] = X_WB[i, j]
        hull[9 + i] = v_B[i]
        hull[12 + i] = w_B[i]
        hull[21 + i] = read.current_W[i]
        j, k = (i + 1) % 3, (i + 2) % 3
        # time derivative of the components of v_B
        hull[15 + i] = a_B[i] - (w_B[j] * v_B[k] - w_B[k] * v_B[j])
        hull[18 + i] = (w_B[i] - w_slow_B[i]) / acceleration_time
        w_slow_B[i] += lag * (w_B[i] - w_slow_B[i])

    # Accelerations of the joints likewise
    for j in range(read.q.shape[0]):
        out.qdd[j] = (read.qd[j] - qd_slow[j]) / acceleration_time
        qd_slow[j] += lag * (read.qd[j] - qd_slow[j])

    joints = JointMotion(read.q, read.qd, out.qdd)
    f_B = unfiltered_tip_force(ArmParameters(*arm), joints, read.tau, TorqueErrors(*errors), out)

    lag = min(1.0, dt / force_time)
    for i in range(3):
        out.f_B[i] += lag * (f_B[i] - out.f_B[i])
    return _in_axes(X_WB, out, f_W)


@kernel
def force_from_external_torques(X_WB, tau_scale, errors, sensed, f_W):
    """Unfiltered force of the world on the tip from the external torques `sensed.tau_e`.

    Args:
        X_WB: (4, 4) hull pose.
        tau_scale: (n,) [N m] torques that scale the relative error of each joint.
        errors: fields of `TorqueErrors`, in a tuple.
        sensed: fields of `SensedArm`, in a tuple; the force is written.
        f_W: (3,) [N] output: force in W.

    Returns:
        The normal force [N], positive when the tool presses.
    """
    out = SensedArm(*sensed)
    f_B = _least_squares(out.J_B, out.tau_e, tau_scale, TorqueErrors(*errors))
    for i in range(3):
        out.f_B[i] = f_B[i]
    return _in_axes(X_WB, out, f_W)


@kernel
def _in_axes(X_WB, out, f_W):
    """Force in tool axes and in W; returns the normal force."""
    X_BG = out.X_BG
    f_B = out.f_B
    for i in range(3):
        out.f_G[i] = X_BG[0, i] * f_B[0] + X_BG[1, i] * f_B[1] + X_BG[2, i] * f_B[2]
        f_W[i] = X_WB[i, 0] * f_B[0] + X_WB[i, 1] * f_B[1] + X_WB[i, 2] * f_B[2]
    return -out.f_G[2]  # the tool presses along its z axis; the world pushes back


@kernel
def unfiltered_tip_force(arm, joints, tau_measured, errors, sensed):
    """Unfiltered force (3,) [N] on the tip, hull axes, from torque sensors minus the arm model.

    Args:
        arm: `ArmParameters`.
        joints: `JointMotion`.
        tau_measured: (n,) [N m] torques at the gear outputs.
        errors: `TorqueErrors`.
        sensed: `SensedArm` with the hull's motion; external torques, wrench and tip kinematics are
            written.

    Returns:
        The force (3,) [N].
    """
    work = workspace(arm.layout)
    newton_euler(arm, joints, sensed.hull, np.zeros(6), work, sensed.tau_e, sensed.wrench_B)
    tip_kinematics(arm, work, sensed.X_BG, sensed.J_B)

    for j in range(joints.q.shape[0]):
        sensed.tau_e[j] -= tau_measured[j]
    return _least_squares(sensed.J_B, sensed.tau_e, tau_measured, errors)


@kernel
def _least_squares(J_B, tau_e, tau_scale, errors):
    """Force on the tip (3,) [N], hull axes: `force_from_torques.tip_force` by Cholesky."""
    bias = errors.bias
    floor = errors.floor
    noise = errors.noise
    a00 = a11 = a22 = PRIOR
    a01 = a02 = a12 = 0.0
    b0 = b1 = b2 = 0.0

    # Normal equations, with the prior
    for j in range(tau_e.shape[0]):
        weight = 1.0 / (floor[j] + noise * abs(tau_scale[j])) ** 2
        t = weight * (tau_e[j] - bias[j])
        x, y, z = J_B[0, j], J_B[1, j], J_B[2, j]
        a00 += weight * x * x
        a11 += weight * y * y
        a22 += weight * z * z
        a01 += weight * x * y
        a02 += weight * x * z
        a12 += weight * y * z
        b0 += t * x
        b1 += t * y
        b2 += t * z

    # Cholesky factor
    l00 = np.sqrt(a00)
    l10 = a01 / l00
    l20 = a02 / l00
    l11 = np.sqrt(a11 - l10 * l10)
    l21 = (a12 - l20 * l10) / l11
    l22 = np.sqrt(a22 - l20 * l20 - l21 * l21)

    # Forward and back substitution
    y0 = b0 / l00
    y1 = (b1 - l10 * y0) / l11
    y2 = (b2 - l20 * y0 - l21 * y1) / l22
    z = y2 / l22
    y = (y1 - l21 * z) / l11
    return (y0 - l10 * y - l20 * z) / l00, y, z


@kernel
def force_sigma(X_BG, J_B, weighed, variance):
    """Standard deviation (3,) [N] of the force, tool axes: `force_from_torques.force_covariance`.

    Args:
        X_BG: (4, 4) tip pose in the hull's frame.
        J_B: (6, n) Jacobian of the tip, hull axes.
        weighed: (n,) [N m] standard deviations that weight the torques in the estimate.
        variance: (n,) [N^2 m^2] variances of the actual errors of the torques.

    Returns:
        The standard deviation of each component.
    """
    n = weighed.shape[0]
    J = np.zeros((3, n))
    stated = PRIOR * np.eye(3)
    out = np.empty(3)

    # Jacobian in tool axes
    for i in range(3):
        for j in range(n):
            for k in range(3):
                J[i, j] += X_BG[k, i] * J_B[k, j]

    # Covariance that belongs to the weights
    for i in range(3):
        for k in range(3):
            for j in range(n):
                stated[i, k] += J[i, j] * J[k, j] / weighed[j] ** 2
    stated = np.linalg.inv(stated)

    # Covariance from the actual errors
    for i in range(3):
        total = 0.0
        for k in range(3):
            total += PRIOR * stated[i, k] ** 2
        for j in range(n):
            gain = (
                stated[i, 0] * J[0, j] + stated[i, 1] * J[1, j] + stated[i, 2] * J[2, j]
            ) / weighed[j] ** 2
            total += gain * gain * variance[j]
        out[i] = np.sqrt(total)
    return out


class ContactRecord(NamedTuple):
    """Estimated contact, as arrays that are changed in place."""

    sensed: SensedArm
    tare: Tare
    bias: Array  # (n,) [N m] tare of the external torques
    # (n,) [N m] standard deviation of the external torques, in addition to the noise of the sensors
    floor: Array
    friction: Array  # (n,) [N m] dry friction in the gears that the drives have to overcome
    f_W: Array  # (3,) [N] force of the world on the tip, W; NaN: not known
    felt: Array  # (1,) [N] normal force, positive when the tool presses; NaN: not known
    sigma_G: Array  # (3,) [N] standard deviation of the force, tool axes
    weighing: np.ndarray  # (1,) bool: the payload is being identified
    ticks: np.ndarray  # (1,) steps of the estimator so far


class FeelGains(NamedTuple):
    """Constants of `feel_by_torques`."""

    timing: SenseTiming
    noise: float  # [-] noise of the torque sensors, as a share of the reading
    kept: float  # [-] share of the variance of white noise that the filter of the force passes
    drift: float  # [N m] standard deviation of the torques' slow errors
    gears: FrictionTracking
    slow_ticks: int  # number of steps between two updates of payload and sigma


@kernel
def feel_by_torques(arm, gains, readings, doubt, tau_motor, contact):
    """Contact force by `estimate_tip_force`, and gear friction, for `TorqueSensors`.

    Args:
        arm: `ArmParameters`.
        gains: `FeelGains`.
        readings: `ArmReadings`.
        doubt: (n,) [N m] standard deviation of the torques in addition to that of healthy sensors.
        tau_motor: (n,) [N m] last commands of the motors.
        contact: `ContactRecord`; updated.
    """
    # Errors of the torques, which are larger if a sensor is in doubt.
    floor = contact.floor.copy()
    for j in range(doubt.shape[0]):
        if doubt[j] != 0.0:
            floor[j] = np.hypot(floor[j], doubt[j])
    errors = TorqueErrors(contact.bias, floor, gains.noise)

    # Force, and friction of the gears.
    sensed = contact.sensed
    contact.felt[0] = estimate_tip_force(arm, readings, errors, gains.timing, sensed, contact.f_W)
    track_gear_friction(
        tau_motor, readings.tau, readings.qd, sensed.qdd, gains.gears, contact.friction
    )


@kernel
def find_sigma(gains, tau, contact):
    """Write the standard deviation of the contact force into `contact`, once per step of the hull.

    Args:
        gains: `FeelGains`.
        tau: (n,) [N m] measured torques.
        contact: `ContactRecord`; updated.
    """
    n = tau.shape[0]
    weighed = np.empty(n)
    variance = np.empty(n)
    for j in range(n):
        noise = gains.noise * abs(tau[j])
        weighed[j] = contact.floor[j] + noise
        variance[j] = gains.kept * noise**2 + gains.drift**2

    contact.sigma_G[:] = force_sigma(contact.sensed.X_BG, contact.sensed.J_B, weighed, variance)


@kernel
def feel_by_slot(slot, seen, tau_motor, contact):
    """Contact force and friction by a `Slot`, from the results of `feel_by_torques`.

    The inputs of the slot are n values each of angles, speeds, accelerations, measured torques,
    torques of the motors, and external torques minus their tare; then the Jacobian (3, n) of the
    tip's position, hull axes. The values that it changes follow: force (3,), hull axes, and
    friction (n,).

    Args:
        slot: of a `KernelContact`.
        seen: hull pose (4, 4), joint angles, speeds and torques, (n,) each.
        tau_motor: (n,) [N m] last commands of the motors.
        contact: `ContactRecord`; updated.

    Returns:
        The return value of the slot.
    """
    X_WB, q, qd, tau = seen
    sensed = contact.sensed
    values = slot.values
    n = q.shape[0]

    # Input of the slot
    for j in range(n):
        values[j] = q[j]
        values[n + j] = qd[j]
        values[2 * n + j] = sensed.qdd[j]
        values[3 * n + j] = tau[j]
        values[4 * n + j] = tau_motor[j]
        values[5 * n + j] = sensed.tau_e[j] - contact.bias[j]
        for i in range(3):
            values[(6 + i) * n + j] = sensed.J_B[i, j]
        values[9 * n + 3 + j] = contact.friction[j]
    for i in range(3):
        values[9 * n + i] = sensed.f_B[i]
    answer = call(slot)

    # Its output
    for i in range(3):
        sensed.f_B[i] = values[9 * n + i]
    for j in range(n):
        contact.friction[j] = values[9 * n + 3 + j]
    contact.felt[0] = _in_axes(X_WB, sensed, contact.f_W)
    return answer

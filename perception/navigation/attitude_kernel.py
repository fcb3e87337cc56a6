"""Compiled kernels of the hull's attitude, from gyro and attitude reference, also with a faulty
gyro.

Kernels take `f`, the record of `filter_kernel.FILTER`.
"""

import numpy as np

from uuv.perception.navigation.rate_check import CLEAR, JUMPS, WILD
from uuv.sim.interfaces.kernels import kernel

# [rad] limit to which the error of one attitude reading is clipped, so that an outlier changes R
# little
TILT_CLIP = 5e-3
HOLD = (8, 25)  # least and largest number of samples for which a rate that jumped is not used
# [rad/s/sqrt(s)] random walk of a rate that only the attitude observes, 67 rad/s fast
NO_GYRO = 1e-2
# [rad/s] standard deviation of the rate that is used when a gyro is lost: the last reliable rate
REGAINED = 5e-3


@kernel
def turn(R, R_meas, w_B, dt, rate_bias, gyro, variances, missed):
    """Propagate the attitude by the gyro and correct it by the attitude reference, in place.

    A Kalman filter of two states per axis, angle and gyro bias, with one covariance for the three
    axes.

    Args:
        R: (3, 3) attitude R_WB, changed in place.
        R_meas: (3, 3) attitude of the reference.
        w_B: (3,) [rad/s] gyro rates in B.
        dt: [s] step.
        rate_bias: (3,) [rad/s] gyro bias, changed in place.
        gyro: (3,) covariance of angle, angle and bias, bias, changed in place.
        variances: (3,) of the angle by gyro noise in one second, of one attitude reading, of the
            bias in one second.
        missed: (3,) [rad] angle that rates in doubt have turned; while it is not zero, the bias
            is not corrected, since the difference from the reference may be this angle.
    """
    k_angle, k_bias = _gains(gyro, variances[0], variances[1], variances[2], dt)

    # Propagation by the gyro
    angle = np.empty(3)
    for i in range(3):
        angle[i] = (w_B[i] - rate_bias[i]) * dt
    rotate(R, angle)

    # Correction by the reference
    for i in range(3):
        err = min(max(_ahead(R, R_meas, i), -TILT_CLIP), TILT_CLIP)
        angle[i] = k_angle * err
        if missed[i] == 0.0:
            rate_bias[i] += k_bias * err
    rotate(R, angle)


@kernel
def _gains(gyro, rate, attitude, walk, dt):
    """Gains of angle and gyro bias for one reading; also updates the covariance `gyro` (3,).

    Variances as in `turn`.
    """
    # Prediction: an error of the bias rotates the angle
    gyro[0] += dt * (dt * gyro[2] - 2.0 * gyro[1]) + rate * dt
    gyro[1] -= dt * gyro[2]
    gyro[2] += walk * dt

    # Update by one reading of the angle
    s = gyro[0] + attitude
    k_angle, k_bias = gyro[0] / s, gyro[1] / s
    gyro[2] -= k_bias * gyro[1]
    gyro[1] *= 1.0 - k_angle
    gyro[0] *= 1.0 - k_angle
    return k_angle, k_bias


@kernel
def _ahead(R, R_meas, i):
    """Small angle [rad] about axis `i` of B from R to R_meas, (3, 3) each."""
    j, k = (i + 1) % 3, (i + 2) % 3
    err = 0.0  # vector of the antisymmetric part of R^T R_meas
    for m in range(3):
        err += 0.5 * (R[m, k] * R_meas[m, j] - R[m, j] * R_meas[m, k])
    return err


@kernel
def rotate(R, angle):
    """Rotate R (3, 3) by `angle` (3,) [rad] about its own axes, in place."""
    theta = np.sqrt(angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2)
    s = 1.0 - theta * theta / 6.0 if theta < 1e-4 else np.sin(theta) / theta
    c = 0.5 - theta * theta / 24.0 if theta < 1e-4 else (1.0 - np.cos(theta)) / theta**2

    new = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            k, m = (j + 1) % 3, (j + 2) % 3
            # Row of R times exp(S) = 1 + s S + c (a a^T - |a|^2), column j of S being e_k a_m - e_m
            # a_k.
            along = R[i, 0] * angle[0] + R[i, 1] * angle[1] + R[i, 2] * angle[2]
            new[i, j] = R[i, j] + s * (R[i, k] * angle[m] - R[i, m] * angle[k])
            new[i, j] += c * (along * angle[j] - theta * theta * R[i, j])

    for i in range(3):  # one Newton step restores orthonormality of R
        for j in range(3):
            R[i, j] = 1.5 * new[i, j]
            for k in range(3):
                R[i, j] -= (
                    0.5
                    * new[i, k]
                    * (new[0, k] * new[0, j] + new[1, k] * new[1, j] + new[2, k] * new[2, j])
                )


@kernel
def believed(f, w_B, dt):
    """Rates (3,) [rad/s] of the gyro as used by the filter, for a step of `dt` [s].

    A rate that jumps is not used until the check can decide, for twice the time in which a wrong
    jump causes a significant angle. If the gyro was right, as on a light hull that its arm jerks,
    the attitude then catches up on the angle that the rate has turned meanwhile. About an axis with
    a faulty gyro the rate is set to zero; the estimated bias is then the negative of the hull's
    rate.
    """
    check = f.check
    rates = w_B
    caught_up = False
    angle = np.zeros(3)
    least = max(JUMPS, WILD * np.sqrt(f.rate))
    clear = 2.0 * CLEAR * np.sqrt(f.turning[1]) / f.interval

    for i in range(3):
        jump = abs(w_B[i] - f.w_B[i])
        jumped = jump > least and check.on == 1
        check.held[i] = check.held[i] + 1 if jumped else 0

        wrong = check.gyro_off[i] != 0.0
        if wrong or (jumped and check.held[i] <= min(max(clear / jump, HOLD[0]), HOLD[1])):
            if rates is w_B:
                rates = w_B.copy()
            rates[i] = 0.0 if wrong else f.w_B[i]
            check.missed[i] = 0.0 if wrong else check.missed[i] + (w_B[i] - f.w_B[i]) * dt
        elif check.missed[i] != 0.0:
            angle[i] = check.missed[i]
            check.missed[i] = 0.0
            caught_up = True

    if caught_up:
        rotate(f.R_WB, angle)
    return rates


@kernel
def leave_gyro(f, R_meas):
    """Continue without the gyro's faulty axes: set the attitude to `R_meas`, and keep the rate
    before the fault.
    """
    check = f.check
    angle = np.zeros(3)

    for i in range(3):
        if check.gyro_off[i] != 0.0 and f.lone[i, 2] == 0.0:
            f.w_B[i] = 0.0
            f.rate_bias[i] = -check.rate[i]
            angle[i] = _ahead(f.R_WB, R_meas, i)
            f.lone[i, 0] = f.turning[1]
            f.lone[i, 1] = 0.0
            f.lone[i, 2] = REGAINED**2 + check.doubt[i] ** 2
    rotate(f.R_WB, angle)


@kernel
def follow_attitude(f, R_meas, dt):
    """Correct angle and rate about each axis without a working gyro by an attitude reading.

    `R_meas` (3, 3) is that reading, `dt` [s] after the previous one.
    """
    angle = np.zeros(3)

    for i in range(3):
        if f.lone[i, 2] > 0.0:
            k_angle, k_bias = _gains(f.lone[i], 0.0, f.turning[1], NO_GYRO**2, dt)
            err = min(max(_ahead(f.R_WB, R_meas, i), -TILT_CLIP), TILT_CLIP)
            angle[i] = k_angle * err
            f.rate_bias[i] += k_bias * err
    rotate(f.R_WB, angle)

"""Compiled kernels of the navigation filter: propagation by one IMU sample, Kalman update, replay of the stored past.

States x, in this order: position p (3) [m] and velocity v (3) [m/s] in W, accelerometer bias b (3) [m/s^2] in hull
axes. Where the sensors state that they have one, the DVL's bias c (3) [m/s] in hull axes and the wander w (3) [m] of
vision in W follow. With specific force f of the IMU and known attitude R,

    p' = v,   v' = R (f - b) - g,   b' = walk,   c' = 0,   w' = -w / T + noise;
    vision = p + w + noise,   DVL = R^T v + c + noise.
"""

import numba
import numpy as np

from sim.interfaces.kernels import keyed_by_imports
from sim.interfaces.spatial import GRAVITY

MOST_STATES = 15  # size of x with both optional states
VISION, DVL = 0, 1  # kinds of fix: position, velocity

# Columns of `past_input`, one row per stored step
TIME, DT, NOISE_XY, NOISE_Z = 0, 1, 2, 3  # [s], [s], variances of the velocity [m^2/s^2] added by the step
FORCE, ATTITUDE = 4, 7  # specific force (3,) [m/s^2], attitude (9,)
JUMP = 16  # [m^2/s^4] variance that the step adds to the bias, at a detected jump
INPUT = 17  # columns of `past_input`

# Columns of `past_fix`, for each stored step one row per kind
HAS, VALUE, VARIANCE, SHIFT = 0, 1, 4, 5  # flag, (3,) in W, its variance, time after the step [s]
FIX = 6  # columns of `past_fix`

# Entries of `layout`
STATES, AT_DVL_BIAS, AT_WANDER = 0, 1, 2  # number of states, first index of each optional triple (-1: none)

TILT_CLIP = 5e-3  # [rad] error of one attitude reading is clipped to this, so that an outlier turns R by little


@numba.njit(cache=True)
@keyed_by_imports
def turn(R, R_meas, w_B, dt, rate_bias, gyro, variances):
    """Propagate the attitude by the gyro and correct it by the attitude reference, in place.

    A Kalman filter of two states per axis, angle and gyro bias, with one covariance for the three axes.

    Args:
        R: (3, 3) attitude R_WB, changed in place.
        R_meas: (3, 3) attitude of the reference.
        w_B: (3,) [rad/s] gyro rates in B.
        dt: [s] step.
        rate_bias: (3,) [rad/s] gyro bias, changed in place.
        gyro: (3,) covariance of angle, angle and bias, bias, changed in place.
        variances: (3,) of the angle by gyro noise in one second, of one attitude reading, of the bias in one second.
    """
    gyro[0] += dt * (dt * gyro[2] - 2.0 * gyro[1]) + variances[0] * dt
    gyro[1] -= dt * gyro[2]
    gyro[2] += variances[2] * dt
    s = gyro[0] + variances[1]
    k_angle, k_bias = gyro[0] / s, gyro[1] / s
    gyro[2] -= k_bias * gyro[1]
    gyro[1] *= 1.0 - k_angle
    gyro[0] *= 1.0 - k_angle
    angle = np.empty(3)
    for i in range(3):
        angle[i] = (w_B[i] - rate_bias[i]) * dt
    rotate(R, angle)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        err = 0.0
        for m in range(3):  # vee of the antisymmetric part of R^T R_meas: small-angle error in B
            err += 0.5 * (R[m, k] * R_meas[m, j] - R[m, j] * R_meas[m, k])
        err = min(max(err, -TILT_CLIP), TILT_CLIP)
        angle[i] = k_angle * err
        rate_bias[i] += k_bias * err
    rotate(R, angle)


@numba.njit(cache=True)
@keyed_by_imports
def rotate(R, angle):
    """Rotate R (3, 3) by `angle` (3,) [rad] about its own axes, in place."""
    theta = np.sqrt(angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2)
    s = 1.0 - theta * theta / 6.0 if theta < 1e-4 else np.sin(theta) / theta
    c = 0.5 - theta * theta / 24.0 if theta < 1e-4 else (1.0 - np.cos(theta)) / theta**2
    new = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            k, m = (j + 1) % 3, (j + 2) % 3
            # Row of R times exp(S) = 1 + s S + c (a a^T - |a|^2), column j of S being e_k a_m - e_m a_k.
            along = R[i, 0] * angle[0] + R[i, 1] * angle[1] + R[i, 2] * angle[2]
            new[i, j] = R[i, j] + s * (R[i, k] * angle[m] - R[i, m] * angle[k])
            new[i, j] += c * (along * angle[j] - theta * theta * R[i, j])
    for i in range(3):  # one Newton step keeps R orthonormal
        for j in range(3):
            R[i, j] = 1.5 * new[i, j]
            for k in range(3):
                R[i, j] -= 0.5 * new[i, k] * (new[0, k] * new[0, j] + new[1, k] * new[1, j] + new[2, k] * new[2, j])


@numba.njit(cache=True)
@keyed_by_imports
def propagate(row, layout, walks, x, P):
    """Advance mean and covariance by one stored IMU step, in place.

    Args:
        row: (INPUT,) stored step.
        layout: (3,) state layout.
        walks: (3,) variance of the bias in one second, stationary variance of the wander, its time constant [s].
        x: (15,) mean.
        P: (15, 15) covariance.
    """
    dt, n, wander = row[DT], layout[STATES], layout[AT_WANDER]
    R = row[ATTITUDE : ATTITUDE + 9].reshape((3, 3))
    half = 0.5 * dt * dt
    for i in range(3):
        a = -GRAVITY if i == 2 else 0.0
        for k in range(3):
            a += R[i, k] * (row[FORCE + k] - x[6 + k])
        x[i] += dt * x[3 + i] + half * a
        x[3 + i] += dt * a
    # F P F^T in place, rows and then columns; F is the identity except for three blocks.
    for j in range(n):
        b0, b1, b2 = P[6, j], P[7, j], P[8, j]
        for i in range(3):
            turned = R[i, 0] * b0 + R[i, 1] * b1 + R[i, 2] * b2
            P[i, j] += dt * P[3 + i, j] - half * turned
            P[3 + i, j] -= dt * turned
    for j in range(n):
        b0, b1, b2 = P[j, 6], P[j, 7], P[j, 8]
        for i in range(3):
            turned = R[i, 0] * b0 + R[i, 1] * b1 + R[i, 2] * b2
            P[j, i] += dt * P[j, 3 + i] - half * turned
            P[j, 3 + i] -= dt * turned
    for i in range(3):
        v = row[NOISE_Z] if i == 2 else row[NOISE_XY]
        P[i, i] += 0.25 * v * dt * dt
        P[i, 3 + i] += 0.5 * v * dt
        P[3 + i, i] += 0.5 * v * dt
        P[3 + i, 3 + i] += v
        P[6 + i, 6 + i] += walks[0] * dt + row[JUMP]
    if wander >= 0:
        kept = np.exp(-dt / walks[2])
        for i in range(wander, wander + 3):
            x[i] *= kept
            for j in range(n):
                P[i, j] *= kept
                P[j, i] *= kept
            P[i, i] += walks[1] * (1.0 - kept * kept)


@numba.njit(cache=True)
@keyed_by_imports
def compare(kind, fix, row, layout, x, P, innovation, cross, S):
    """Innovation of a fix, its covariance and cross covariance with the states, all in W; fills the last three arrays.

    Args:
        kind: VISION or DVL.
        fix: (FIX,) the fix.
        row: (INPUT,) stored step of the fix.
        layout: (3,) state layout.
        x: (15,) mean.
        P: (15, 15) covariance.
        innovation: (3,) result.
        cross: (15, 3) result.
        S: (3, 3) result.
    """
    n, dvl_bias, wander = layout[STATES], layout[AT_DVL_BIAS], layout[AT_WANDER]
    R = row[ATTITUDE : ATTITUDE + 9].reshape((3, 3))
    first = 0 if kind == VISION else 3
    for i in range(3):
        innovation[i] = fix[VALUE + i] - x[first + i]
        for j in range(n):
            cross[j, i] = P[j, first + i]
        if kind == VISION:
            innovation[i] -= fix[SHIFT] * x[3 + i]
            for j in range(n):
                cross[j, i] += fix[SHIFT] * P[j, 3 + i]
            if wander >= 0:
                innovation[i] -= x[wander + i]
                for j in range(n):
                    cross[j, i] += P[j, wander + i]
        elif dvl_bias >= 0:
            for k in range(3):
                innovation[i] -= R[i, k] * x[dvl_bias + k]
                for j in range(n):
                    cross[j, i] += R[i, k] * P[j, dvl_bias + k]
    for i in range(3):
        for j in range(3):
            s = cross[first + i, j]
            if kind == VISION:
                s += fix[SHIFT] * cross[3 + i, j]
                if wander >= 0:
                    s += cross[wander + i, j]
            elif dvl_bias >= 0:
                for k in range(3):
                    s += R[i, k] * cross[dvl_bias + k, j]
            S[i, j] = s
        S[i, i] += fix[VARIANCE]


@numba.njit(cache=True)
@keyed_by_imports
def inverse3(S):
    """Inverse of a symmetric positive definite (3, 3)."""
    c00 = S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1]
    c01 = S[1, 2] * S[2, 0] - S[1, 0] * S[2, 2]
    c02 = S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0]
    det = S[0, 0] * c00 + S[0, 1] * c01 + S[0, 2] * c02
    out = np.empty((3, 3))
    out[0, 0], out[1, 0], out[2, 0] = c00 / det, c01 / det, c02 / det
    out[0, 1] = (S[0, 2] * S[2, 1] - S[0, 1] * S[2, 2]) / det
    out[1, 1] = (S[0, 0] * S[2, 2] - S[0, 2] * S[2, 0]) / det
    out[2, 1] = (S[0, 1] * S[2, 0] - S[0, 0] * S[2, 1]) / det
    out[0, 2] = (S[0, 1] * S[1, 2] - S[0, 2] * S[1, 1]) / det
    out[1, 2] = (S[0, 2] * S[1, 0] - S[0, 0] * S[1, 2]) / det
    out[2, 2] = (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]) / det
    return out


@numba.njit(cache=True)
@keyed_by_imports
def absorb(kind, fix, row, layout, x, P):
    """Kalman update of mean and covariance by one fix, in place.

    Args:
        kind: VISION or DVL.
        fix: (FIX,) the fix.
        row: (INPUT,) stored step of the fix.
        layout: (3,) state layout.
        x: (15,) mean.
        P: (15, 15) covariance.
    """
    n = layout[STATES]
    innovation, cross, S = np.empty(3), np.empty((MOST_STATES, 3)), np.empty((3, 3))
    compare(kind, fix, row, layout, x, P, innovation, cross, S)
    inv = inverse3(S)
    gain = np.empty(3)
    for i in range(n):
        for k in range(3):
            gain[k] = cross[i, 0] * inv[0, k] + cross[i, 1] * inv[1, k] + cross[i, 2] * inv[2, k]
        x[i] += gain[0] * innovation[0] + gain[1] * innovation[1] + gain[2] * innovation[2]
        for j in range(i + 1):
            P[i, j] -= gain[0] * cross[j, 0] + gain[1] * cross[j, 1] + gain[2] * cross[j, 2]
            P[j, i] = P[i, j]


@numba.njit(cache=True)
@keyed_by_imports
def inertial(
    specific_force_B,
    w_B,
    R_meas,
    time,
    dt,
    across,
    along,
    layout,
    walks,
    turning,
    R,
    gyro,
    rate_bias,
    x,
    P,
    head,
    past_input,
    past_x,
    past_P,
    past_fix,
):
    """Process one IMU sample: attitude, mean, covariance, and a row of the stored past at `head`.

    Args:
        specific_force_B: (3,) [m/s^2] in B.
        w_B: (3,) [rad/s] gyro rates in B.
        R_meas: (3, 3) attitude of the reference.
        time: [s] of the sample.
        dt: [s] since the last one.
        across: [m^2/s^2] variance added to the horizontal velocity.
        along: [m^2/s^2] variance added to the vertical velocity.
        layout: (3,) state layout.
        walks: (3,) as in `propagate`.
        turning: (3,) `variances` of `turn`.
        R: (3, 3) attitude R_WB, changed in place.
        gyro: (3,) as in `turn`, changed in place.
        rate_bias: (3,) [rad/s] gyro bias, changed in place.
        x: (15,) mean, changed in place.
        P: (15, 15) covariance, changed in place.
        head: Row of the past to write.
        past_input: (h, INPUT) stored steps.
        past_x: (h, 15) stored means, before the fixes of the step.
        past_P: (h, 15, 15) stored covariances.
        past_fix: (h, 2, FIX) stored fixes.

    Returns:
        False, with nothing changed, for a sample that is not finite.
    """
    total = 0.0
    for i in range(3):
        total += specific_force_B[i] + w_B[i] + R_meas[i, 0] + R_meas[i, 1] + R_meas[i, 2]
    if not np.isfinite(total):
        return False
    turn(R, R_meas, w_B, dt, rate_bias, gyro, turning)
    row = past_input[head]
    row[TIME] = time
    row[DT], row[NOISE_XY], row[NOISE_Z], row[JUMP] = dt, across, along, 0.0
    for i in range(3):
        row[FORCE + i] = specific_force_B[i]
        for j in range(3):
            row[ATTITUDE + 3 * i + j] = R[i, j]
    propagate(row, layout, walks, x, P)
    past_x[head] = x
    for i in range(layout[STATES]):
        for j in range(layout[STATES]):
            past_P[head, i, j] = P[i, j]
    past_fix[head, VISION, HAS] = past_fix[head, DVL, HAS] = 0.0
    return True


@numba.njit(cache=True)
@keyed_by_imports
def mahalanobis(kind, fix, at, layout, past_input, past_x, past_P, innovation, white):
    """Squared Mahalanobis distance of a fix from the stored estimate at step `at`.

    Args:
        kind: VISION or DVL.
        fix: (FIX,) the fix.
        at: Row of the past.
        layout: (3,) state layout.
        past_input: (h, INPUT) stored steps.
        past_x: (h, 15) stored means.
        past_P: (h, 15, 15) stored covariances.
        innovation: (3,) result, in W.
        white: (3,) result: the innovation whitened by its covariance.

    Returns:
        The squared distance, chi-square distributed with three degrees of freedom for a sound fix.
    """
    cross, S = np.empty((MOST_STATES, 3)), np.empty((3, 3))
    compare(kind, fix, past_input[at], layout, past_x[at], past_P[at], innovation, cross, S)
    L, total = S, 0.0  # Cholesky factor, in place
    for i in range(3):
        white[i] = innovation[i]
        for j in range(i):
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            L[i, j] /= L[j, j]
            L[i, i] -= L[i, j] * L[i, j]
            white[i] -= L[i, j] * white[j]
        L[i, i] = np.sqrt(L[i, i])
        white[i] /= L[i, i]
        total += white[i] * white[i]
    return total


@numba.njit(cache=True)
@keyed_by_imports
def replay(at, head, layout, walks, past_input, past_x, past_P, past_fix, x, P):
    """Restart the filter at step `at` and run it forward with every fix received since: exact, in order of time.

    Args:
        at: Row of the past to restart from.
        head: Newest row of the past.
        layout: (3,) state layout.
        walks: (3,) as in `propagate`.
        past_input: (h, INPUT) stored steps.
        past_x: (h, 15) stored means, rewritten.
        past_P: (h, 15, 15) stored covariances, rewritten.
        past_fix: (h, 2, FIX) stored fixes.
        x: (15,) result: mean at `head`.
        P: (15, 15) result: covariance at `head`.
    """
    n, size = layout[STATES], len(past_input)
    x[:] = past_x[at]
    for i in range(n):
        for j in range(n):
            P[i, j] = past_P[at, i, j]
    while True:
        for kind in range(2):
            if past_fix[at, kind, HAS]:
                absorb(kind, past_fix[at, kind], past_input[at], layout, x, P)
        if at == head:
            return
        at = (at + 1) % size
        propagate(past_input[at], layout, walks, x, P)
        past_x[at] = x
        for i in range(n):
            for j in range(n):
                past_P[at, i, j] = P[i, j]


@numba.njit(cache=True)
@keyed_by_imports
def all_finite(q, qd, tau):
    """True if three arrays (n,) are finite.

    Args:
        q: (n,) [rad] joint angles.
        qd: (n,) [rad/s] joint rates.
        tau: (n,) [N m] joint torques.
    """
    total = 0.0
    for j in range(q.shape[0]):
        total += q[j] + qd[j] + tau[j]
    return np.isfinite(total)


@numba.njit(cache=True)
@keyed_by_imports
def smoothed_output(dt, lag, smooth, release, specific_force_B, w_B, R, rate_bias, x, P, held, a_B):
    """Smoothed output of the filter: withheld corrections are released as by a damped spring.

    Args:
        dt: [s] since the last output.
        lag: [s] from the filter's time to that of the output.
        smooth: [s] time constant of the acceleration.
        release: (4,) spring: frequency over the filter's own [-], lowest and highest frequency [rad/s], and the
            distance [m] beyond which the pull no longer grows.
        specific_force_B: (3,) [m/s^2] in B.
        w_B: (3,) [rad/s] gyro rates in B.
        R: (3, 3) attitude R_WB.
        rate_bias: (3,) [rad/s] gyro bias.
        x: (15,) mean.
        P: (15, 15) covariance.
        held: (2, 3) withheld corrections of position [m] and velocity [m/s] in W, reduced in place.
        a_B: (3,) [m/s^2] smoothed acceleration in B, changed in place.

    Returns:
        X_WB (4, 4), v_WB_B (3,) [m/s], w_WB_B (3,) [rad/s], a_WB_B (3,) [m/s^2], and the standard deviation (3,) [m] of
        the position in W.
    """
    across = P[0, 3] + P[1, 4] + P[2, 5]
    spread = P[0, 0] + P[1, 1] + P[2, 2]
    frequency = min(max(release[0] * across / spread, release[1]), release[2])
    if dt > 0.0:
        frequency = min(frequency, 0.3 / dt)
        length = np.sqrt(held[0, 0] ** 2 + held[0, 1] ** 2 + held[0, 2] ** 2)
        pull = frequency**2 * (release[3] / length if length > release[3] else 1.0)
        for i in range(3):
            held[1, i] -= dt * (np.sqrt(2.0) * frequency * held[1, i] + pull * held[0, i])
            held[0, i] += dt * held[1, i]
    share = min(1.0, dt / smooth)
    X_WB, v_B, w, sigma = np.eye(4), np.zeros(3), np.empty(3), np.empty(3)
    for i in range(3):
        w[i] = w_B[i] - rate_bias[i]
        fresh = specific_force_B[i] - x[6 + i] - R[2, i] * GRAVITY
        a_B[i] += share * (fresh - a_B[i])
        X_WB[i, 3] = x[i] - held[0, i] + lag * (x[3 + i] - held[1, i])
        sigma[i] = np.sqrt(P[i, i] + held[0, i] ** 2)
        for j in range(3):
            X_WB[i, j] = R[i, j]
            v_B[i] += R[j, i] * (x[3 + j] - held[1, j])
    if lag > 0.0:
        ahead = R.copy()
        rotate(ahead, w * lag)
        X_WB[:3, :3] = ahead
    return X_WB, v_B, w, a_B.copy(), sigma

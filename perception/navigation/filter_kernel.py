"""Compiled kernels of the navigation filter: propagation, Kalman update, replay of the past.

States x, in this order: position p (3) [m] and velocity v (3) [m/s] in W, accelerometer bias b (3)
[m/s^2] in hull axes. If the sensors state that they have them, the next states are the DVL's bias c
(3) [m/s] in hull axes and the slow drift ("wander") w (3) [m] of vision in W. With a camera on the
arm, the last state is the offset o (3) [m] in W of the camera's track from the world. With specific
force f of the IMU and known attitude R,

    p' = v,   v' = R (f - b) - g,   b' = walk,   c' = 0,   w' = -w / T + noise,   o' = 0;
    vision = p + w + noise,   DVL = R^T v + c + noise,   track = p + o + noise.

A track begins at the estimated hull position z. The offset is then o = z - p, the negative error of
the position at that moment, which the filter keeps as a state (stochastic cloning [Roumeliotis
2002]). The same operation continues a track from a new key picture, with the noise of the reading z
at that picture.

The whole memory of the filter is one record of the type FILTER. Kernels that are called from Python
take it as the array (1,) `memory`, the other kernels as its element `f`. Records of
`uuv.sim.interfaces.records` may be given as plain tuples, which are faster to pass from Python.
"""

import numpy as np

from uuv.perception.navigation.attitude_kernel import (
    believed,
    follow_attitude,
    leave_gyro,
    rotate,
    turn,
)
from uuv.perception.navigation.rate_check import ATTITUDE as ATTITUDE_FAULT
from uuv.perception.navigation.rate_check import GYRO as GYRO_FAULT
from uuv.perception.navigation.rate_check import RATE_CHECK, compare_rate
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.records import EstimateRecord, ImuRecord, JointRecord
from uuv.sim.interfaces.spatial import GRAVITY

MOST_STATES = 18  # size of x with all optional states
VISION, DVL = 0, 1  # kinds of fix: position, velocity

# Columns of `past_input`, one row per stored step
# [s] length, [s] time, velocity variance that the step adds [m^2/s^2]
TIME, DT, NOISE_XY, NOISE_Z = 0, 1, 2, 3
FORCE, ATTITUDE = 4, 7  # specific force (3,) [m/s^2], attitude (9,)
# [m^2/s^4] variance that the step adds to the bias, at a detected jump or while the hull tilts
JUMP = 16
INPUT = 17  # number of columns of `past_input`

# Columns of `past_fix`, for each stored step one row per kind
# flag, (3,) in W, variance of the fix, time after the step [s]
HAS, VALUE, VARIANCE, SHIFT = 0, 1, 4, 5
FIX = 6  # number of columns of `past_fix`

# Columns of `past_track`, one row per stored step: flag, (3,) [m] in W, (3, 3) [1/m^2], flag,
# (3,) [m] in W
READ, PLACE, INFORMATION, BEGUN, ORIGIN = 0, 1, 4, 13, 14
TRACK = 17  # number of columns of `past_track`

# Entries of `layout`: number of states, first index of each triple (-1: absent)
STATES, AT_DVL_BIAS, AT_WANDER, AT_TRACK = 0, 1, 2, 3

HISTORY = 512  # number of IMU samples stored, for the largest delay of vision
IMU_REPEATS = 25  # number of equal consecutive samples from which on the IMU counts as frozen
IMU_SILENCE = 0.05  # [s] without a sample, after which the filter runs without the IMU
UNUSED = 1e6  # [rad^2] variance of an attitude that is not used
# [-] sine of the hull's tilt from its usual one, beyond which the error of the attitude reference
# couples gravity anew into the bias
TILTED = 0.05
TILT_TIME = 2.0  # [s] time constant of the usual tilt
BLIND = 2.5e-3  # [(m/s^2)^2 s] spectral density of the hull's unmeasured acceleration

FILTER = np.dtype(
    (
        np.record,
        [
            # Constants of a run
            ("layout", np.int64, 4),
            # variance of the bias in one second, variance of the settled wander, time constant of
            # the wander [s]
            ("walks", np.float64, 3),
            ("acceleration", np.float64),  # [m/s^2] white noise of the accelerometer
            ("rate", np.float64),  # [rad^2/s^2] variance of the gyro
            ("attitude", np.float64),  # [rad^2] variance of one attitude reading
            ("rate_walk", np.float64),  # [rad^2/s^3] variance of the gyro bias in one second
            ("tilt", np.float64),  # [m^2/s^4] variance of the horizontal acceleration by tilt noise
            # [m^2/s^4] variance of the acceleration by the constant tilt error of the reference
            ("coupled", np.float64),
            ("release", np.float64, 4),  # spring of the held corrections, see `put_out`
            ("smooth", np.float64),  # [s] time constant of the output acceleration
            # 1: the output is the position relative to the tracked object, p + o; 0: p
            ("by_track", np.float64),
            # Times [s]
            ("time", np.float64),  # newest IMU sample processed by the filter
            ("clock", np.float64),  # newest time of any measurement
            ("given", np.float64),  # of the last estimate
            ("imu_time", np.float64),  # newest valid IMU sample
            # when a jump of the accelerometer's bias was last detected; -inf: never
            ("jumped", np.float64),
            ("used", np.float64, 2),  # newest fix used, by kind
            ("interval", np.float64),  # shortest interval between IMU samples so far
            # Attitude
            ("R_WB", np.float64, (3, 3)),
            ("up", np.float64, 3),  # upward direction in B, smoothed over TILT_TIME
            ("gyro", np.float64, 3),  # covariance of angle and gyro bias, see `turn`
            ("rate_bias", np.float64, 3),  # [rad/s]
            ("turning", np.float64, 3),  # `variances` of `turn`
            ("check", RATE_CHECK),  # monitor that compares the gyro with the attitude
            # for each axis without a gyro the covariance as in `gyro`; 0: the axis has a gyro
            ("lone", np.float64, (3, 3)),
            # Mean, covariance, output
            ("x", np.float64, MOST_STATES),
            ("P", np.float64, (MOST_STATES, MOST_STATES)),
            # corrections of position [m] and velocity [m/s] in W that are withheld from the output
            ("held", np.float64, (2, 3)),
            ("a_B", np.float64, 3),  # [m/s^2] smoothed acceleration
            # IMU samples: the last one processed, and the last one received
            ("force", np.float64, 3),  # [m/s^2] specific force in B
            ("w_B", np.float64, 3),  # [rad/s]
            ("seen_force", np.float64, 3),
            ("seen_w", np.float64, 3),
            ("repeats", np.int64),  # number of equal consecutive samples, minus one
            # Stored past, a ring of steps
            ("head", np.int64),  # index of the newest row
            ("past_input", np.float64, (HISTORY, INPUT)),
            ("past_x", np.float64, (HISTORY, MOST_STATES)),  # states before the fixes of the step
            ("past_P", np.float64, (HISTORY, MOST_STATES, MOST_STATES)),
            ("past_fix", np.float64, (HISTORY, 2, FIX)),
            ("past_track", np.float64, (HISTORY, TRACK)),
        ],
    ),
    align=True,
)


@kernel
def propagate(f, row):
    """Advance mean and covariance of `f` by one stored IMU step `row` (INPUT,), in place."""
    x = f.x
    P = f.P
    walks = f.walks
    dt = row[DT]
    n = f.layout[STATES]
    wander = f.layout[AT_WANDER]
    R = row[ATTITUDE : ATTITUDE + 9].reshape((3, 3))
    half = 0.5 * dt * dt

    # Mean: constant acceleration during the step
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

    # Noise of the step: acceleration, walk and jump of the bias
    for i in range(3):
        v = row[NOISE_Z] if i == 2 else row[NOISE_XY]
        P[i, i] += 0.25 * v * dt * dt
        P[i, 3 + i] += 0.5 * v * dt
        P[3 + i, i] += 0.5 * v * dt
        P[3 + i, 3 + i] += v
        P[6 + i, 6 + i] += walks[0] * dt + row[JUMP]

    # Wander: a first-order Gauss-Markov process
    if wander >= 0:
        decay = np.exp(-dt / walks[2])
        for i in range(wander, wander + 3):
            x[i] *= decay
            for j in range(n):
                P[i, j] *= decay
                P[j, i] *= decay
            P[i, i] += walks[1] * (1.0 - decay * decay)


@kernel
def compare(kind, fix, row, layout, x, P):
    """Innovation of a fix, its covariance, and its cross covariance with the states, in W.

    Args:
        kind: VISION or DVL.
        fix: (FIX,) the fix.
        row: (INPUT,) stored step of the fix.
        layout: (4,) state layout.
        x: (18,) mean.
        P: (18, 18) covariance.

    Returns:
        Innovation (3,), cross covariance (18, 3) and covariance of the innovation (3, 3).
    """
    innovation = np.empty(3)
    cross = np.zeros((MOST_STATES, 3))
    S = np.empty((3, 3))
    n = layout[STATES]
    dvl_bias = layout[AT_DVL_BIAS]
    wander = layout[AT_WANDER]
    R = row[ATTITUDE : ATTITUDE + 9].reshape((3, 3))
    first = 0 if kind == VISION else 3

    # Innovation z - H x, cross covariance P H^T
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

    # Covariance of the innovation, H P H^T + noise
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
    return innovation, cross, S


@kernel
def inverse3(S):
    """Inverse of a symmetric positive definite (3, 3)."""
    c00 = S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1]
    c01 = S[1, 2] * S[2, 0] - S[1, 0] * S[2, 2]
    c02 = S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0]
    det = S[0, 0] * c00 + S[0, 1] * c01 + S[0, 2] * c02

    # Adjugate over determinant
    out = np.empty((3, 3))
    out[0, 0], out[1, 0], out[2, 0] = c00 / det, c01 / det, c02 / det
    out[0, 1] = (S[0, 2] * S[2, 1] - S[0, 1] * S[2, 2]) / det
    out[1, 1] = (S[0, 0] * S[2, 2] - S[0, 2] * S[2, 0]) / det
    out[2, 1] = (S[0, 1] * S[2, 0] - S[0, 0] * S[2, 1]) / det
    out[0, 2] = (S[0, 1] * S[1, 2] - S[0, 2] * S[1, 1]) / det
    out[1, 2] = (S[0, 2] * S[1, 0] - S[0, 0] * S[1, 2]) / det
    out[2, 2] = (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]) / det
    return out


@kernel
def correct(x, P, n, innovation, cross, weight):
    """Kalman update of the first `n` states, in place.

    Args:
        x: (18,) mean.
        P: (18, 18) covariance.
        n: Number of states.
        innovation: (3,) innovation of a reading.
        cross: (18, 3) covariance of the states with the innovation.
        weight: (3, 3) inverse of the innovation's covariance.
    """
    gain = np.empty(3)

    for i in range(n):
        for k in range(3):
            gain[k] = (
                cross[i, 0] * weight[0, k] + cross[i, 1] * weight[1, k] + cross[i, 2] * weight[2, k]
            )

        # Mean by K (z - H x), covariance by K (P H^T)^T; the lower half is copied
        x[i] += gain[0] * innovation[0] + gain[1] * innovation[1] + gain[2] * innovation[2]
        for j in range(i + 1):
            P[i, j] -= gain[0] * cross[j, 0] + gain[1] * cross[j, 1] + gain[2] * cross[j, 2]
            P[j, i] = P[i, j]


@kernel
def absorb(f, kind, fix, row):
    """Kalman update of mean and covariance of `f` by one fix, in place.

    Args:
        f: Record of FILTER.
        kind: VISION or DVL.
        fix: (FIX,) the fix.
        row: (INPUT,) stored step of the fix.
    """
    x = f.x
    P = f.P
    n = f.layout[STATES]
    innovation, cross, S = compare(kind, fix, row, f.layout, x, P)
    correct(x, P, n, innovation, cross, inverse3(S))


@kernel
def compare_track(row, first, x, P):
    """Innovation of a reading of the track, its cross covariance with the states, and its weight.

    The weight is the inverse of the innovation's covariance S0 + L^-1, in the form L (1 + S0 L)^-1.
    This form is also valid for an information L without full rank, in which directions that were
    not observed have no weight.

    Args:
        row: (TRACK,) the reading.
        first: Index of the track's offset in the states.
        x: (18,) mean.
        P: (18, 18) covariance.

    Returns:
        Innovation (3,), cross covariance (18, 3) and weight (3, 3).
    """
    innovation = np.empty(3)
    cross = np.zeros((MOST_STATES, 3))
    A = np.empty((3, 3))
    L = row[INFORMATION : INFORMATION + 9].reshape((3, 3))

    # Innovation z - p - o, cross covariance P H^T
    for i in range(3):
        innovation[i] = row[PLACE + i] - x[i] - x[first + i]
        for j in range(MOST_STATES):
            cross[j, i] = P[j, i] + P[j, first + i]

    # A = 1 + S0 L
    for i in range(3):
        for k in range(3):
            A[i, k] = 1.0 if i == k else 0.0
            for j in range(3):
                A[i, k] += (cross[i, j] + cross[first + i, j]) * L[j, k]

    # L A^-1, symmetric except for rounding
    weight = np.linalg.solve(A.T, np.ascontiguousarray(L.T)).T
    return innovation, cross, 0.5 * (weight + weight.T)


@kernel
def absorb_track(f, row):
    """Kalman update of `f` by a reading of the track, and the beginning of a track, in place.

    Args:
        f: Record of FILTER.
        row: (TRACK,) row stored for the step.
    """
    x = f.x
    P = f.P
    n = f.layout[STATES]
    first = f.layout[AT_TRACK]
    if row[READ]:
        innovation, cross, weight = compare_track(row, first, x, P)
        correct(x, P, n, innovation, cross, weight)

    if row[BEGUN]:  # offset = origin - position
        for i in range(3):
            x[first + i] = row[ORIGIN + i] - x[i]
            for j in range(n):
                P[first + i, j] = -P[i, j]

        for i in range(3):
            for j in range(n):
                P[j, first + i] = (
                    P[first + i, j] if j < first or j >= first + 3 else P[i, j - first]
                )


@kernel
def advance(f, dt, specific_force_B, w_B, R_meas, unknown):
    """Process one IMU sample: attitude, mean, covariance, and a new row of the stored past.

    Args:
        f: Record of FILTER.
        dt: [s] since the last sample.
        specific_force_B: (3,) [m/s^2] in B.
        w_B: (3,) [rad/s] gyro rates in B.
        R_meas: (3, 3) attitude of the reference.
        unknown: [m^2/s^2] variance added to the velocity for a motion that was not measured; 0 for
            a sample.

    Returns:
        False for a sample or an interval that is not finite, which changes nothing.
    """
    # A sample that is not finite is not used
    total = dt
    for i in range(3):
        total += specific_force_B[i] + w_B[i] + R_meas[i, 0] + R_meas[i, 1] + R_meas[i, 2]
    if not np.isfinite(total):
        return False

    # Interval of the stream: the noise of a step follows it; a gap adds to the velocity's variance
    if dt < 0.999 * f.interval and unknown == 0.0:  # first samples, or a faster stream than assumed
        f.interval = dt
        f.turning[0] = f.rate * dt
        f.turning[1] = f.attitude + 1e-16
        f.turning[2] = f.rate_walk
    elif dt > 1.5 * f.interval and unknown == 0.0:
        unknown = BLIND * (dt - f.interval)

    # Attitude
    turn(f.R_WB, R_meas, w_B, dt, f.rate_bias, f.gyro, f.turning, f.check.missed)
    if f.lone[0, 2] > 0.0 or f.lone[1, 2] > 0.0 or f.lone[2, 2] > 0.0:
        follow_attitude(f, R_meas, dt)

    # Inputs of the step, in a new row of the past
    head = (f.head + 1) % HISTORY
    row = f.past_input[head]
    along = (f.acceleration * dt) ** 2 + unknown
    # Tilt noise remaining after the attitude filter: equal shares of gyro and reference, white at
    # the time resolution of vision.
    across = along + f.tilt * f.interval * dt
    row[TIME] = f.time + dt
    row[DT] = dt
    row[NOISE_XY] = across
    row[NOISE_Z] = along
    row[JUMP] = _tilted(f, dt)
    for i in range(3):
        row[FORCE + i] = specific_force_B[i]
        for j in range(3):
            row[ATTITUDE + 3 * i + j] = f.R_WB[i, j]

    # States of the step, before any fixes
    propagate(f, row)
    _store(f, head)
    f.past_fix[head, VISION, HAS] = f.past_fix[head, DVL, HAS] = 0.0
    f.past_track[head, READ] = f.past_track[head, BEGUN] = 0.0

    # The sample itself, for fixes that arrive before the next one
    for i in range(3):
        f.force[i] = specific_force_B[i]
        f.w_B[i] = w_B[i]
    f.head = head
    f.time += dt
    return True


@kernel
def _tilted(f, dt):
    """Variance [m^2/s^4] that a step of `dt` [s] adds to the bias because the hull tilts.

    The reference's constant error, about hull axes, is a part of the accelerometer's bias by the
    gravity that it couples in. That part depends on the tilt: the bias found in one tilt is wrong
    in another by gravity times the error and the sine of the angle between them.
    """
    up = f.up
    apart = 0.0
    for i in range(3):
        off = f.R_WB[2, i] - up[i]
        up[i] += min(1.0, dt / TILT_TIME) * off
        apart += off * off
    if apart <= TILTED**2:
        return 0.0
    return f.coupled * apart * min(1.0, 2.0 * dt / TILT_TIME)


@kernel
def _store(f, at):
    """Store mean and covariance in row `at` of the past."""
    n = f.layout[STATES]
    P = f.P
    past_P = f.past_P[at]
    f.past_x[at] = f.x
    for i in range(n):
        for j in range(n):
            past_P[i, j] = P[i, j]


@kernel
def take_imu(memory, sample):
    """Process one sample of the IMU, unless it is old, not finite or frozen.

    Args:
        memory: (1,) of FILTER.
        sample: ImuRecord.
    """
    f = memory[0]
    sample = ImuRecord(*sample)

    dt = sample.time[0] - f.time
    if not 1e-9 < dt < np.inf:
        return

    # A frozen IMU repeats its samples bit by bit
    force = sample.specific_force_B
    w = sample.w_WB_B
    frozen = False
    if force[0] != f.seen_force[0]:
        f.repeats = 0
    else:
        equal = True
        for i in range(3):
            equal = equal and force[i] == f.seen_force[i] and w[i] == f.seen_w[i]
        if equal:
            f.repeats += 1
            frozen = f.repeats >= IMU_REPEATS

    for i in range(3):
        f.seen_force[i] = force[i]
        f.seen_w[i] = w[i]

    # The gyro and the attitude of a valid sample are compared
    if not frozen and advance(f, dt, force, believed(f, w, dt), sample.R_WB, 0.0):
        f.imu_time = sample.time[0]
        if f.check.on:
            verdict = compare_rate(f, dt, w, sample.R_WB)
            if verdict == GYRO_FAULT:
                leave_gyro(f, sample.R_WB)
            # from now on the attitude of the hull follows the gyro alone
            elif verdict == ATTITUDE_FAULT:
                f.check.on = 0
                f.attitude = UNUSED
                f.turning[1] = UNUSED


@kernel
def take_sample(memory, sample):
    """Process the IMU's sample of one step; without one for too long, assume constant speed.

    Args:
        memory: (1,) of FILTER.
        sample: ImuRecord; its time is also that of encoders and torque sensors, -inf without a new
            sample.
    """
    f = memory[0]
    sample = ImuRecord(*sample)
    if f.clock < sample.time[0] < np.inf:
        f.clock = sample.time[0]

    take_imu(memory, sample)

    # Too long without the IMU: continue at constant velocity
    dt = f.clock - f.time
    if f.clock - f.imu_time > IMU_SILENCE and dt > 1e-9:
        force = f.R_WB[2] * GRAVITY + f.x[6:9]
        advance(f, dt, force, f.rate_bias, f.R_WB, BLIND * dt)


@kernel
def put_out(memory, joints, out):
    """Write the present estimate, releasing withheld corrections like a damped spring.

    Its parameters, `release` of the filter, are the ratio of its frequency to the filter's [-],
    lowest and highest frequency [rad/s], and the distance [m] beyond which its force is constant.

    Args:
        memory: (1,) of FILTER.
        joints: JointRecord of the newest readings; if a reading is not finite, the joint keeps its
            last value in `out`.
        out: EstimateRecord, the same record during a run.
    """
    f = memory[0]
    joints = JointRecord(*joints)
    out = EstimateRecord(*out)
    dt = f.clock - f.given
    lag = f.clock - f.time
    R = f.R_WB
    x = f.x
    P = f.P
    held = f.held
    a_B = f.a_B
    release = f.release
    track = f.layout[AT_TRACK] if f.by_track else -1

    # Spring of the withheld corrections, with a frequency that follows the filter's gain and is
    # stable at this step
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

    # Motion, extrapolated from the filter's time to the present
    share = min(1.0, dt / f.smooth)
    for i in range(3):
        out.w_WB_B[i] = f.w_B[i] - f.rate_bias[i]
        fresh = f.force[i] - x[6 + i] - R[2, i] * GRAVITY
        a_B[i] += share * (fresh - a_B[i])
        out.a_WB_B[i] = a_B[i]
        position = x[i] + x[track + i] if track >= 0 else x[i]
        out.X_WB[i, 3] = position - held[0, i] + lag * (x[3 + i] - held[1, i])
        out.gyro_off_B[i] = f.check.gyro_off[i]
        out.attitude_off_B[i] = f.check.attitude_off[i]
        out.position_sigma[i] = np.sqrt(P[i, i] + held[0, i] ** 2)

        v = 0.0
        for j in range(3):
            out.X_WB[i, j] = R[i, j]
            v += R[j, i] * (x[3 + j] - held[1, j])
        out.v_WB_B[i] = v

    if lag > 0.0:
        ahead = R.copy()
        rotate(ahead, out.w_WB_B * lag)
        out.X_WB[:3, :3] = ahead

    # Joints
    for j in range(out.q.shape[0]):
        if np.isfinite(joints.q[j]):
            out.q[j] = joints.q[j]
        if np.isfinite(joints.qd[j]):
            out.qd[j] = joints.qd[j]
        if np.isfinite(joints.tau[j]):
            out.tau[j] = joints.tau[j]

    # Times
    out.time[0] = f.clock
    out.ages[0] = f.clock - f.used[VISION]
    out.ages[1] = f.clock - f.used[DVL]
    out.ages[2] = f.clock - f.imu_time
    out.ages[3] = f.clock - f.jumped
    f.given = f.clock


@kernel
def row_at(memory, time):
    """Row of the past nearest to a time.

    Args:
        memory: (1,) of FILTER.
        time: [s]

    Returns:
        The row, or -1 if the past does not reach `time`, and `time` minus the time of the row [s].
    """
    f = memory[0]

    at = 0
    for row in range(1, HISTORY):
        if abs(f.past_input[row, TIME] - time) < abs(f.past_input[at, TIME] - time):
            at = row

    shift = time - f.past_input[at, TIME]
    known = f.interval if np.isfinite(f.interval) else 0.0
    return at if abs(shift) <= 0.75 * known + 1e-9 else -1, shift


@kernel
def mahalanobis(memory, kind, fix, at):
    """Distance of a fix from the stored estimate at step `at`.

    Args:
        memory: (1,) of FILTER.
        kind: VISION or DVL.
        fix: (FIX,) the fix.
        at: Row of the past.

    Returns:
        Squared Mahalanobis distance, chi-square distributed with three degrees of freedom for a
            valid fix; innovation (3,) in W; the innovation whitened by its covariance (3,).
    """
    f = memory[0]
    innovation, _, L = compare(kind, fix, f.past_input[at], f.layout, f.past_x[at], f.past_P[at])

    # Innovation over the Cholesky factor of its covariance, by forward substitution
    white = np.empty(3)
    total = 0.0
    for i in range(3):  # Cholesky factor, in place
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
    return total, innovation, white


@kernel
def replay(memory, at):
    """Restart the filter at step `at`, and run it forward with every fix since, in order of time.

    The correction of position and velocity is added to the corrections withheld from the output.

    Args:
        memory: (1,) of FILTER.
        at: Row of the past to restart from.
    """
    f = memory[0]
    n = f.layout[STATES]
    x = f.x
    P = f.P
    held = f.held
    track = f.layout[AT_TRACK]
    by_track = f.by_track

    # Restart
    before = x.copy()
    x[:] = f.past_x[at]
    for i in range(n):
        for j in range(n):
            P[i, j] = f.past_P[at, i, j]

    # Fixes of each step in turn, up to the newest
    while True:
        for kind in range(2):
            if f.past_fix[at, kind, HAS]:
                absorb(f, kind, f.past_fix[at, kind], f.past_input[at])
        if track >= 0:
            absorb_track(f, f.past_track[at])
        if at == f.head:
            break
        at = (at + 1) % HISTORY
        propagate(f, f.past_input[at])
        _store(f, at)

    # The correction is withheld from the output
    for i in range(3):
        held[0, i] += x[i] - before[i]
        held[1, i] += x[3 + i] - before[3 + i]
        if track >= 0 and by_track:
            held[0, i] += x[track + i] - before[track + i]

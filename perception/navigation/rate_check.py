"""Check of the gyro against the attitude reference, since both fields of a message must show the
same rotation.

About each axis of the hull, the difference of the attitude angle and the integrated gyro consists
of the noise of the attitude and the integrated noise of the gyro. A steady-state Kalman filter of
this angle has a white innovation. The check has three steps:

- *Alarm.* A cumulative sum of the innovation, for either sign [Page 1954], exceeds its limit, and
  so does the angle.
- *Blame.* At the onset, when the sum left zero, the rate of one of the two sensors changed and that
  of the other did not. The two can be distinguished if the change is well above the usual changes
  of the hull's own rate. Otherwise, and for a slow drift, the cause may be either; then the gyro is
  blamed if its samples have a step of the size of the slope, which no hull can make. A sensor whose
  readings repeat bit by bit since the onset is blamed first of all.
- *Size.* The error of the gyro is its jump, or the slope of the angle since the onset, within a
  factor of two.

A small time difference between the two fields and small errors of scale and alignment are allowed
for. They cause angles that are proportional to the rotation.
"""

import numpy as np

from uuv.sim.interfaces.kernels import kernel

NONE, GYRO, ATTITUDE, EITHER = 0, 1, 2, 3  # verdicts

SLACK = 0.5  # [-] standard deviations by which the mean of an innovation may differ from zero
LIMIT = 30.0  # [-] limit of the cumulative sum; white noise exceeds it once in exp(30) samples
CLIP = 20.0  # [-] largest innovation counted, so that a single reading raises no alarm
CLEAR = 5.0  # [-] standard deviations of an attitude reading that the angle must exceed
# [s] duration of a sum above zero, after which it restarts; a slower growth is below the least rate
LONGEST = 0.5
# [-] standard deviations of a sample of the gyro and of its bias: smallest rate that is a fault
LEAST_RATE = 4.0
FINEST_RATE, FINEST_ANGLE = 1.2e-4, 5e-5  # [rad/s], [rad] smallest standard deviations assumed
# [rad/s] largest change of a hull's rate from one sample to the next, except in an impact
JUMPS = 0.01
WILD = 8.0  # [-] standard deviations of a sample of the gyro that a jump must exceed too
TIMING = 2e-3  # [s] time between the two fields, in addition to one sample
SCALE = 1e-3  # [-] error of the gyro's scale
USUAL = 0.2  # [s] time constant of the usual rates, with which those since the onset are compared
RESTLESS = 1.0  # [s] time constant of the mean square by which the gyro moves about its usual rate
# [-] factor on the root of that mean square, above which a change is not the hull's own
DISTINCT = 4.0
# Share [-] of the angle since the onset that one of the two has turned beyond its usual rate, to be
# blamed.
GUILTY = 0.6
# [-] and the largest share that the gyro may have turned if the attitude is to blame
INNOCENT = 0.25
PAST = 128  # number of stored samples of the gyro, in which a jump is searched for
BESIDE = 5  # number of samples on either side of a jump whose means are compared
BEFORE = 10  # number of samples by which a jump may precede the moment at which the sum left zero
# [-] factor on the root mean square of that comparison elsewhere, above which the gyro has jumped
SUDDEN = 5.0
# [-] ratio of the gyro's jump to the slope of the angle, if the jump caused the slope
AGREES = (0.5, 2.0)
REPEATS = 5  # number of consecutive readings from which on a sensor is frozen, or is no rotation
ANGLE_CLIP = 5e-3  # [rad] angle whose correction is taken whole, against single outliers
NO_ROTATION = 1e-2  # [-] largest error of orthonormality of the columns of an attitude

RATE_CHECK = np.dtype(
    (
        np.record,
        [
            ("on", np.int64),  # 1: the two are compared
            # [rad] largest stated angle between the axes of the two
            ("misaligned", np.float64),
            # [s] duration of the comparison so far; 0: the next sample is the first
            ("compared", np.float64),
            ("R_last", np.float64, (3, 3)),  # last attitude
            ("w_last", np.float64, 3),  # [rad/s] last rate
            # number of equal consecutive readings, minus one: of each axis of the gyro, of the
            # attitude
            ("same", np.int64, 4),
            ("improper", np.int64),  # number of consecutive attitudes that are no rotations
            # [rad] of the attitude ahead of the gyro, after the filter's correction
            ("angle", np.float64, 3),
            ("sums", np.float64, (2, 3)),  # [-] cumulative sums, for either sign
            ("usual", np.float64, (2, 3)),  # [rad/s] usual rates up to now: gyro, attitude
            ("past", np.float64, (PAST, 3)),  # [rad/s] ring of the last rates
            ("stored", np.int64),  # number of rates stored since the comparison began
            ("restless", np.float64, 3),  # [rad^2/s^2] mean square of the gyro about its usual rate
            # Since the onset, for either sign and about each axis
            ("lasting", np.float64, (2, 3)),  # [s]
            # [rad] correction that the filter subtracted from `angle`
            ("corrected", np.float64, (2, 3)),
            # sums of angle times time [rad s], and of time squared [s^2]
            ("slope", np.float64, (2, 3, 2)),
            ("moved", np.float64, (2, 3, 2)),  # [rad] turned beyond the usual rate: gyro, attitude
            # at the onset: usual rates of gyro and attitude [rad/s], `restless`
            ("before", np.float64, (2, 3, 3)),
            ("held", np.int64, 3),  # samples for which a rate that jumped is not used
            ("missed", np.float64, 3),  # [rad] angle that the gyro has turned in these samples
            # Findings
            ("gyro_off", np.float64, 3),  # [rad/s] error of the gyro; 0: valid
            ("rate", np.float64, 3),  # [rad/s] rate of the gyro before it became faulty
            ("doubt", np.float64, 3),  # [rad/s] possible change of the hull's own rate since then
            # [rad] error of the attitude; 0: valid, NaN: no rotation; about an axis with a faulty
            # gyro: either may be the cause
            ("attitude_off", np.float64, 3),
        ],
    ),
    align=True,
)


@kernel
def compare_rate(f, dt, w_B, R_meas):
    """Compare one sample of the gyro with the attitude of the same message.

    Args:
        f: record of `filter_kernel.FILTER` that has taken the sample; its `check` is updated.
        dt: [s] since the last sample.
        w_B: (3,) [rad/s] rates of the gyro.
        R_meas: (3, 3) attitude of the reference.

    Returns:
        NONE, GYRO or ATTITUDE: the sensor to continue without. `gyro_off` and `attitude_off` of the
            check contain its error about each axis; both are set if either sensor may be the cause.
    """
    check = f.check

    # An attitude that is no rotation cannot be compared
    if not _proper(R_meas):
        check.improper += 1
        check.compared = 0.0
        if check.improper < REPEATS:
            return NONE
        check.attitude_off[:] = np.nan
        return ATTITUDE

    check.improper = 0

    # The comparison begins
    if check.compared == 0.0 or dt > 1.5 * f.interval:  # the first sample, or the first after a gap
        check.compared = dt
        check.angle[:] = 0.0
        check.sums[:] = 0.0
        check.lasting[:] = 0.0
        check.usual[0] = w_B
        check.usual[1] = w_B
        check.R_last[:] = R_meas
        check.w_last[:] = w_B
        check.restless[:] = 0.0
        check.stored = 0
        _store(check, w_B)
        return NONE

    check.compared += dt
    _count_repeats(check, w_B, R_meas)
    _store(check, w_B)

    # Steady Kalman filter of the angle: noise and gain
    white = max(f.turning[1], FINEST_ANGLE**2)
    noise = max(np.sqrt(f.rate), FINEST_RATE)
    share = min(1.0, dt / USUAL)
    ratio = (noise * dt) ** 2 / white
    gain = max(0.5 * (np.sqrt(ratio**2 + 4.0 * ratio) - ratio), dt / check.compared)

    # Errors of time, scale and alignment cause angles proportional to the rotation
    turning = np.sqrt((check.usual[0] ** 2).sum())
    variance = white + ((TIMING + f.interval) * turning) ** 2
    least_rate = LEAST_RATE * (noise + np.sqrt(f.gyro[2])) + (SCALE + check.misaligned) * turning

    verdict = NONE
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3

        # Angle of the attitude since the last sample
        turned = 0.0
        for m in range(3):  # vee of the antisymmetric part of the rotation since the last sample
            turned += 0.5 * (check.R_last[m, k] * R_meas[m, j] - check.R_last[m, j] * R_meas[m, k])

        if check.gyro_off[i] != 0.0:  # the comparison ends
            continue

        # Innovation of the angle
        innovation = check.angle[i] + turned - (w_B[i] - f.rate_bias[i]) * dt
        correction = gain * min(max(innovation, -ANGLE_CLIP), ANGLE_CLIP)
        check.angle[i] = innovation - correction
        z = innovation * np.sqrt((1.0 - gain) / variance)

        # Alarm, for either sign: cumulative sum and angle exceed their limits
        for side in range(2):
            if not _summed(check, side, i, z if side == 0 else -z):
                continue

            off = innovation + check.corrected[side, i]
            rate = _follow(check, side, i, dt, off, (w_B[i], turned))
            check.corrected[side, i] += correction
            clear = abs(off) > CLEAR * np.sqrt(variance) and abs(rate) > least_rate
            if not clear or check.sums[side, i] <= LIMIT:
                continue

            # Blame and size
            blamed = _blamed(check, side, i, dt, off)
            if blamed == EITHER and _gyro_jumped(
                check, i, round(check.lasting[side, i] / dt), -rate
            ):
                blamed = GYRO
            if blamed != GYRO:
                check.attitude_off[i] = off
            if blamed != ATTITUDE:
                _leave_out(check, side, i, w_B[i], rate, white)
            verdict = max(verdict, GYRO if blamed == EITHER else blamed)

        # Usual rates
        check.restless[i] += min(1.0, dt / RESTLESS) * (
            (w_B[i] - check.usual[0, i]) ** 2 - check.restless[i]
        )
        check.usual[0, i] += share * (w_B[i] - check.usual[0, i])
        check.usual[1, i] += share * (turned / dt - check.usual[1, i])

    check.R_last[:] = R_meas
    check.w_last[:] = w_B
    return verdict


@kernel
def _proper(R):
    """True if the columns of R (3, 3) are right-handed and orthonormal within NO_ROTATION."""
    worst = 0.0

    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3

        # Columns of unit length, at right angles, with a positive triple product
        square = 0.0
        product = 0.0
        triple = 0.0
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            square += R[m, i] * R[m, i]
            product += R[m, i] * R[m, j]
            triple += (R[n, i] * R[o, j] - R[o, i] * R[n, j]) * R[m, k]

        worst = max(worst, abs(square - 1.0), abs(product), abs(triple - 1.0))
    return worst <= NO_ROTATION


@kernel
def _count_repeats(check, w_B, R_meas):
    """Count equal readings in a row: of each axis of the gyro, and of the attitude."""
    equal = True
    for i in range(3):
        check.same[i] = check.same[i] + 1 if w_B[i] == check.w_last[i] else 0
        for j in range(3):
            equal = equal and R_meas[i, j] == check.R_last[i, j]
    check.same[3] = check.same[3] + 1 if equal else 0


@kernel
def _store(check, w_B):
    """Keep a sample `w_B` (3,) [rad/s] of the gyro."""
    check.past[check.stored % PAST] = w_B
    check.stored += 1


@kernel
def _gyro_jumped(check, i, since, size):
    """True if the gyro jumped by about `size` [rad/s] about axis `i`, `since` samples ago at most.

    A jump shortly before those samples counts too. The hull itself cannot jump: its change of rate
    within BESIDE samples is small compared with a step, even when it rolls. At a jump, the means
    before and after differ by much more than at other samples.
    """
    # Largest step of the gyro since shortly before the onset
    count = min(check.stored, PAST)
    newest = check.stored - 1
    most = 0.0
    at = -1
    for back in range(BESIDE - 1, min(count - BESIDE, since + BEFORE)):
        step = _step(check, i, newest - back)
        if abs(step) > abs(most):
            most, at = step, back

    # It must have the size and sign of the slope
    if at < 0 or not AGREES[0] * abs(size) < abs(most) < AGREES[1] * abs(size) or most * size < 0.0:
        return False

    # It must be much larger than the steps elsewhere
    total = 0.0
    samples = 0
    for back in range(BESIDE - 1, count - BESIDE):
        if abs(back - at) >= BESIDE:  # a jump increases the comparison at samples that near to it
            total += _step(check, i, newest - back) ** 2
            samples += 1
    return samples >= 4 * BESIDE and most * most * samples > SUDDEN**2 * total


@kernel
def _step(check, i, first):
    """Mean rate [rad/s] of BESIDE samples from index `first` on, minus the mean of as many samples
    before.
    """
    total = 0.0
    for k in range(BESIDE):
        total += check.past[(first + k) % PAST, i] - check.past[(first - 1 - k) % PAST, i]
    return total / BESIDE


@kernel
def _summed(check, side, i, z):
    """Add an innovation `z` [standard deviations] to a sum about axis `i`; False if it restarts.

    Then all quantities that are counted from the onset are set to zero too.
    """
    total = max(0.0, check.sums[side, i] + min(max(z, -CLIP), CLIP) - SLACK)
    if check.lasting[side, i] > LONGEST:
        total = 0.0
    check.sums[side, i] = total

    # A new onset
    if total > 0.0:
        return True
    check.lasting[side, i] = check.corrected[side, i] = 0.0
    for k in range(2):
        check.slope[side, i, k] = check.moved[side, i, k] = 0.0
        check.before[side, i, k] = check.usual[k, i]
    check.before[side, i, 2] = check.restless[i]
    return False


@kernel
def _follow(check, side, i, dt, off, seen):
    """Take a sample since the onset, and return the slope of the angle since then [rad/s].

    Args:
        check: the record.
        side: 0: the attitude is ahead, 1: it is behind.
        i: axis.
        dt: [s] since the last sample.
        off: [rad] angle since the onset.
        seen: rate of the gyro [rad/s], angle of the attitude since the last sample [rad].
    """
    w, turned = seen

    check.lasting[side, i] += dt
    slope = check.slope[side, i]
    moved = check.moved[side, i]
    before = check.before[side, i]
    slope[0] += off * check.lasting[side, i]
    slope[1] += check.lasting[side, i] ** 2
    moved[0] += (w - before[0]) * dt
    moved[1] += turned - before[1] * dt
    return slope[0] / slope[1]


@kernel
def _blamed(check, side, i, dt, off):
    """GYRO, ATTITUDE or EITHER as the cause of an angle `off` [rad] about axis `i`.

    Samples come every `dt` [s].
    """
    lasting = check.lasting[side, i]

    # Readings that repeat
    repeats = max(REPEATS, round(lasting / dt) - 1)
    if check.same[3] >= repeats:
        return ATTITUDE
    if check.same[i] >= repeats:
        return GYRO

    # A change within the hull's usual motion may come from either sensor
    if (
        check.compared < RESTLESS
        or abs(off) < DISTINCT * np.sqrt(check.before[side, i, 2]) * lasting
    ):
        return EITHER

    # Which of the two has turned beyond its usual rate
    gyro = abs(check.moved[side, i, 0] / off)
    attitude = abs(check.moved[side, i, 1] / off)
    if gyro > GUILTY:
        return GYRO
    return ATTITUDE if gyro < INNOCENT and attitude > GUILTY else EITHER


@kernel
def _leave_out(check, side, i, w, rate, white):
    """Record a fault of the gyro about axis `i`: it reads `w`, and the attitude turns faster by
    `rate`.

    Both are in rad/s; `white` [rad^2] is the variance of one attitude reading.
    """
    before = check.before[side, i, 0]

    jump = w - before
    if rate * jump >= 0.0:  # a gyro that sticks has not changed
        check.gyro_off[i] = -rate
    else:  # the jump includes the hull's own change, and the slope begins before the step
        check.gyro_off[i] = jump if abs(jump) > JUMPS else 0.5 * (jump - rate)

    # Rate before the fault, and the possible change of the hull's own rate since
    check.rate[i] = before
    moved = abs(check.moved[side, i, 1])
    lasting = check.lasting[side, i]
    check.doubt[i] = moved / lasting if moved > CLEAR * np.sqrt(white) else 0.0

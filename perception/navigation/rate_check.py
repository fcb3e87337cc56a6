"""Check of the gyro against the attitude reference: both fields of a message show one rotation.

The angle by which the attitude has turned beyond the integrated gyro, about each axis of the hull,
is the noise of the attitude and the integral of the gyro's. A steady Kalman filter of it has a
white innovation. Three parts follow:

- *Alarm.* A cumulative sum of the innovation, for either sign [Page 1954], exceeds its limit, and
  so does the angle.
- *Blame.* At the onset, where the sum left zero, the rate of one of the two changed, that of the
  other did not. They can be distinguished where the change is well above what the hull's own rate
  did before. Else it may be either, as it may with a drift that comes slowly; then the gyro is
  blamed if its own samples step by the size of the slope, which no hull does. Readings that repeat
  bit by bit since the onset are blamed before all else.
- *Size.* The gyro is off by its jump, or by the slope of the angle since the onset: within a factor
  of two.

A small time between the two fields is allowed for, and a scale and an alignment that are not
perfect. These make angles in step with the turning.
"""

import numpy as np

from uuv.sim.interfaces.kernels import kernel

NONE, GYRO, ATTITUDE, EITHER = 0, 1, 2, 3  # verdicts

SLACK = 0.5  # [-] standard deviations by which the mean of an innovation may be off
LIMIT = 30.0  # [-] of the cumulative sum; white noise exceeds it once in exp(30) samples
CLIP = 20.0  # [-] largest innovation counted, so that a single reading raises no alarm
CLEAR = 5.0  # [-] standard deviations of an attitude reading that the angle must exceed
# [s] of a sum above zero, after which it starts anew: what grows slower is below the least rate
LONGEST = 0.5
# [-] standard deviations of a sample of the gyro, and of its bias: smallest rate that is a fault
LEAST_RATE = 4.0
FINEST_RATE, FINEST_ANGLE = 1.2e-4, 5e-5  # [rad/s], [rad] smallest standard deviations assumed
JUMPS = 0.01  # [rad/s] by which no hull turns faster from one sample to the next but in an impact
WILD = 8.0  # [-] standard deviations of a sample of the gyro that a jump exceeds too
TIMING = 2e-3  # [s] between the two fields, beside one sample
SCALE = 1e-3  # [-] error of the gyro's scale
USUAL = 0.2  # [s] time constant of the usual rates, with which those since the onset are compared
RESTLESS = 1.0  # [s] time constant of the mean square by which the gyro moves about its usual rate
DISTINCT = 4.0  # [-] times its root, above which a change is not the hull's own
# Share [-] of the angle since the onset that one of the two has turned beyond its usual rate, to be
# blamed.
GUILTY = 0.6
INNOCENT = 0.25  # [-] and the most of it that the gyro has turned if it is the attitude
PAST = 128  # samples of the gyro that are kept, to look back for a jump
BESIDE = 5  # of them on either side of a jump, whose means are compared
BEFORE = 10  # by how many samples a jump may come before the sum left zero
# [-] times the root mean square of that comparison elsewhere, above which a gyro has jumped
SUDDEN = 5.0
AGREES = (0.5, 2.0)  # [-] jump of the gyro over the slope of the angle, if the one made the other
REPEATS = 5  # readings in a row by which one is frozen, or is no rotation
ANGLE_CLIP = 5e-3  # [rad] angle whose correction is taken whole, against single outliers
NO_ROTATION = 1e-2  # [-] by which the columns of an attitude may miss being orthonormal

RATE_CHECK = np.dtype(
    (
        np.record,
        [
            ("on", np.int64),  # 1: both are compared
            # [rad] largest angle between the axes of the two that is stated
            ("misaligned", np.float64),
            # [s] for which both have been compared; 0: the next sample is the first
            ("compared", np.float64),
            ("R_last", np.float64, (3, 3)),  # last attitude
            ("w_last", np.float64, 3),  # [rad/s] last rate
            # equal readings in a row, less one: of each axis of the gyro, of the attitude
            ("same", np.int64, 4),
            ("improper", np.int64),  # attitudes in a row that are no rotations
            # [rad] of the attitude ahead of the gyro, after the filter's correction
            ("angle", np.float64, 3),
            ("sums", np.float64, (2, 3)),  # [-] cumulative sums, for either sign
            ("usual", np.float64, (2, 3)),  # [rad/s] usual rates up to now: gyro, attitude
            ("past", np.float64, (PAST, 3)),  # [rad/s] ring of the last rates
            ("stored", np.int64),  # how many were stored since both are compared
            ("restless", np.float64, 3),  # [rad^2/s^2] mean square of the gyro about its usual rate
            # Since the onset, for either sign and about each axis
            ("lasting", np.float64, (2, 3)),  # [s]
            ("corrected", np.float64, (2, 3)),  # [rad] what the filter took off `angle`
            # sums of angle times time [rad s], and of time squared [s^2]
            ("slope", np.float64, (2, 3, 2)),
            ("moved", np.float64, (2, 3, 2)),  # [rad] turned beyond the usual rate: gyro, attitude
            # at the onset: usual rates of gyro and attitude [rad/s], `restless`
            ("before", np.float64, (2, 3, 3)),
            ("held", np.int64, 3),  # samples for which a rate that jumped is not used
            # Findings
            ("gyro_off", np.float64, 3),  # [rad/s] 0: sound
            ("rate", np.float64, 3),  # [rad/s] that the gyro showed before it went wrong
            ("doubt", np.float64, 3),  # [rad/s] by which the hull's own may have changed since
            # [rad] 0: sound, NaN: no rotation; about an axis of a gyro off: either
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
        NONE, GYRO or ATTITUDE: what to go on without. `gyro_off` and `attitude_off` of the check
            hold about which axes it is off, and by how much; both where it may be either.
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

    # Errors of time, scale and alignment make angles in step with the turning
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

        if check.gyro_off[i] != 0.0:  # there is nothing to compare any more
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
    """True if the columns of R (3, 3) are orthonormal but for NO_ROTATION, and right-handed."""
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

    A jump shortly before those counts too. No hull does: what it turns faster by within BESIDE
    samples is small against a step, however it rolls. The means before and after it differ by much
    more than those before and after other samples.
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

    # It must stand out of the steps elsewhere
    total = 0.0
    samples = 0
    for back in range(BESIDE - 1, count - BESIDE):
        if abs(back - at) >= BESIDE:  # a jump raises the comparison that near to it
            total += _step(check, i, newest - back) ** 2
            samples += 1
    return samples >= 4 * BESIDE and most * most * samples > SUDDEN**2 * total


@kernel
def _step(check, i, first):
    """Mean rate [rad/s] of BESIDE samples from number `first` on, less that of as many before."""
    total = 0.0
    for k in range(BESIDE):
        total += check.past[(first + k) % PAST, i] - check.past[(first - 1 - k) % PAST, i]
    return total / BESIDE


@kernel
def _summed(check, side, i, z):
    """Add an innovation `z` [standard deviations] to a sum about axis `i`; False if it restarts.

    What counts from the onset on is then zero too.
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

    # A change within the hull's own motion is of either
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
    """Record that the gyro is off about axis `i`: it reads `w`, the attitude is faster by `rate`.

    Both are in rad/s; `white` [rad^2] is the variance of one attitude reading.
    """
    before = check.before[side, i, 0]

    jump = w - before
    if rate * jump >= 0.0:  # it has not changed, as one that sticks
        check.gyro_off[i] = -rate
    else:  # the jump contains the hull's own change, the slope begins before the step
        check.gyro_off[i] = jump if abs(jump) > JUMPS else 0.5 * (jump - rate)

    # Rate before, and by how much the hull's own may have changed since
    check.rate[i] = before
    moved = abs(check.moved[side, i, 1])
    lasting = check.lasting[side, i]
    check.doubt[i] = moved / lasting if moved > CLEAR * np.sqrt(white) else 0.0

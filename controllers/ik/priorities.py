"""Tool motion by priorities, for any number of joints: position, tool axis, turn, posture.

Each task is solved in the motions that the tasks before it leave free [Siciliano 1991]. An arm of
four joints then puts its tool where it is wanted exactly, and turns the tool's axis as far as is
left; one of seven keeps off its limits.
"""

import math

import numpy as np

from uuv.controllers.ik.chain_kernels import (
    BAD_TARGET,
    BEST,
    CONVERGED,
    EXHAUSTED,
    HEAD,
    KIND,
    LOWER,
    SCALE,
    SLIDE,
    STALLED,
    UPPER,
    begin,
    column,
    jit,
    note,
    partition,
    pose_error,
    trace,
)

# [m^2/rad^2], [1] added to the squares of a task's Jacobian: bounds the joints near singular
# postures
DAMPING = 1e-6
# [1/rad^2] share of the squared position error that is added to the damping of a descent
FAR = 0.05
LONGEST = 0.3  # [rad] or [scaled m] longest step of a joint; shortened where the error grows
QUIET = 1e-7  # [rad] or [scaled m] largest step at which the descent has come to its end
LEAN = 0.01  # [1/rad^2] weight of the tool axis against the scaled position, where a step is judged
ZONE = 0.15  # share of a joint's range at either end, in which its posture is pushed back
PUSH = 0.3  # share of the way out of that zone that a step makes where the tool leaves it free
TASKS = 3  # position, tool axis, turn about it
FULL = 6  # joints from which on the turn about the tool axis is a task: fewer work with round tools


@jit
def prioritised(J, z, twist, damping, posture, held, rates):
    """Joint rates that give a tool its twist, task by task in order of priority.

    With fewer than six joints the tool is taken to be round: the turn about its axis is left to the
    posture.

    Args:
        J: (6, n) Jacobian (linear; angular) of the tip.
        z: (3,) unit tool axis, in the axes of `J`.
        twist: (6,) velocity of the tip (linear; angular), in the axes of `J`.
        damping: added to the squares of a task's Jacobian, at least `DAMPING`.
        posture: (n,) rates wanted where the tool leaves them free.
        held: (n,) bool: joints that must not move.
        rates: (n,) out.
    """
    n = rates.shape[0]
    free = np.zeros((n, n))  # projects on what the tasks so far leave free
    for i in range(n):
        rates[i] = 0.0
        free[i, i] = 0.0 if held[i] else 1.0

    A = np.empty((3, n))  # Jacobian of a task
    B = np.empty((3, n))  # the same, of the motions that are free
    G = np.empty((3, 3))  # Cholesky factor of B B^T + damping
    gain = np.empty((3, n))
    left = np.empty(3)  # twist that is left to do

    for task in range(TASKS if n >= FULL else TASKS - 1):
        rows = 1 if task == 2 else 3

        # Jacobian and twist: of the position, of the tool axis, or of the turn about it
        for j in range(n):
            along = z[0] * J[3, j] + z[1] * J[4, j] + z[2] * J[5, j]
            for r in range(3):
                A[r, j] = J[r, j] if task == 0 else J[3 + r, j] - along * z[r]
            if task == 2:
                A[0, j] = along

        turn = z[0] * twist[3] + z[1] * twist[4] + z[2] * twist[5]
        for r in range(3):
            left[r] = twist[r] if task == 0 else twist[3 + r] - turn * z[r]
        if task == 2:
            left[0] = turn

        # Less what the tasks before give, in the motions that they leave free
        for r in range(rows):
            for j in range(n):
                left[r] -= A[r, j] * rates[j]
                total = 0.0
                for k in range(n):
                    total += A[r, k] * free[k, j]
                B[r, j] = total

        # Cholesky factor of B B^T + damping
        for r in range(rows):
            for s in range(r + 1):
                total = damping if r == s else 0.0
                for j in range(n):
                    total += B[r, j] * B[s, j]
                for k in range(s):
                    total -= G[r, k] * G[s, k]
                G[r, s] = math.sqrt(total) if r == s else total / G[s, s]

        for j in range(n):  # gain = (B B^T + damping)^-1 B by the Cholesky factor in G
            for r in range(rows):
                total = B[r, j]
                for k in range(r):
                    total -= G[r, k] * gain[k, j]
                gain[r, j] = total / G[r, r]
            for r in range(rows - 1, -1, -1):
                total = gain[r, j]
                for k in range(r + 1, rows):
                    total -= G[k, r] * gain[k, j]
                gain[r, j] = total / G[r, r]

        # Rates of the task, whose motions are then no longer free
        for j in range(n):
            for r in range(rows):
                rates[j] += gain[r, j] * left[r]
        _take(free, B, rows)

    # Posture, in the motions that are left
    for i in range(n):
        left[0] = 0.0
        for j in range(n):
            left[0] += free[i, j] * posture[j]
        rates[i] += left[0]


@jit
def _take(free, B, rows):
    """Take the motions in the first `rows` rows of `B` (3, n) out of the projector `free`.

    `B` is overwritten.

    Gram and Schmidt's way, the longest row first. The damped inverse would leave a little of each
    motion free, and a later task that can do nothing else would use it at any speed.
    """
    n = free.shape[0]
    done = np.zeros(rows, dtype=np.bool_)
    for _ in range(rows):
        # The longest row that is left
        best = 0
        longest = -1.0
        for r in range(rows):
            square = 0.0
            for j in range(n):
                square += B[r, j] * B[r, j]
            if not done[r] and square > longest:
                best = r
                longest = square

        if longest <= DAMPING:
            return

        done[best] = True
        for j in range(n):
            B[best, j] /= math.sqrt(longest)

        # Out of the other rows, and out of the projector
        for r in range(rows):
            if not done[r]:
                along = 0.0
                for j in range(n):
                    along += B[r, j] * B[best, j]
                for j in range(n):
                    B[r, j] -= along * B[best, j]

        for i in range(n):
            for j in range(n):
                free[i, j] -= B[best, i] * B[best, j]


@jit
def out_of_the_zone(q, low, high):
    """Displacement of a joint out of the zone near its limits, in its unit; 0 elsewhere and without
    limits.
    """
    zone = ZONE * (high - low)
    if not math.isfinite(zone):
        return 0.0

    return max(low + zone - q, 0.0) - max(q - (high - zone), 0.0)


@jit
def solve_priority(memory, X, q0, settings, trail, out):
    """Descend to a tool pose task by task from `q0`, by short steps within the limits, no restarts.

    Ends where the steps do: the position is then met or as near as the limits allow, and the tool
    axis as near as is left. Converged: the position within its tolerance, and the tool axis within
    that of the orientation.
    orientation.

    Args:
        memory: kernel memory of the chain, in double precision.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] or [m] start.
        settings: tolerances, limit of the steps.
        trail: (rows, n) takes the joint values of every step that it has a row for.
        out: (n,) takes the solution.

    Returns:
        (code, steps, 0, position error [m], angle of the tool axis to that wanted [rad]).
    """
    n = out.shape[0]
    views = partition(memory, n)
    table, goal, _, work, _, q = views

    options_good = (
        settings.tol_p > 0.0
        and settings.tol_r > 0.0
        and settings.limit >= 1
        and settings.restarts >= 0
    )
    fault = begin(table, X, q0, options_good, False, goal, work, q)
    if fault >= BAD_TARGET:
        return fault, 0, 0, 0.0, 0.0

    J = np.empty((6, n))
    z = np.empty(3)
    twist = np.empty(6)
    rates = np.empty(n)
    posture = np.empty(n)
    held = np.zeros(n, dtype=np.bool_)

    scale = table[0, SCALE]
    steps = 0
    tilt = 0.0
    p2 = 0.0
    before = np.inf
    p2_before = np.inf
    tilt_before = 0.0
    longest = LONGEST
    largest = 1.0
    near2 = (0.1 * settings.tol_p * scale) ** 2

    while True:
        note(q, trail, steps)
        tip = trace(table, q, work)
        error, p2, _ = pose_error(goal, tip)
        px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = tip

        # Tool axis of the tip in base axes
        wx, wy, wz = table[1, 2], table[1, 5], table[1, 8]
        z[0], z[1], z[2] = (
            xx * wx + yx * wy + zx * wz,
            xy * wx + yy * wy + zy * wz,
            xz * wx + yz * wy + zz * wz,
        )

        # Tilt against that of the target, and turn about it
        a, b, c = X[0, 2], X[1, 2], X[2, 2]
        tx, ty, tz = z[1] * c - z[2] * b, z[2] * a - z[0] * c, z[0] * b - z[1] * a
        sine = math.sqrt(tx * tx + ty * ty + tz * tz)
        cosine = z[0] * a + z[1] * b + z[2] * c
        tilt = math.atan2(sine, cosine)
        turn = error[3] * z[0] + error[4] * z[1] + error[5] * z[2]
        scaled = tilt / sine if sine > 1e-12 else 1.0

        # Twist to the target
        twist[0], twist[1], twist[2] = error[0], error[1], error[2]
        twist[3], twist[4], twist[5] = (
            scaled * tx + turn * z[0],
            scaled * ty + turn * z[1],
            scaled * tz + turn * z[2],
        )

        if steps >= settings.limit:
            break
        merit = p2 + LEAN * tilt * tilt

        # the step was too long: go back and take a shorter one
        if merit > before and p2 > p2_before and p2 > near2:
            steps = steps + 1
            longest = 0.3 * longest
            if longest < QUIET:
                p2 = p2_before
                tilt = tilt_before
                for j in range(n):
                    q[j] = work[j, BEST]
                break

            for j in range(n):
                q[j] = work[j, BEST] + longest / largest * rates[j]
                q[j] = min(max(q[j], table[HEAD + j, LOWER]), table[HEAD + j, UPPER])
            continue

        # A turn of the axis may cost position for a step. Shorter steps then keep it from going to
        # and fro for ever.
        longest = 0.5 * longest if p2 > p2_before and p2 > near2 else min(1.2 * longest, LONGEST)
        before = merit
        p2_before = p2
        tilt_before = tilt

        # Jacobian, and the way out of the zones by the limits
        for j in range(n):
            J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j] = column(
                table, work, j, px, py, pz
            )
            posture[j] = PUSH * out_of_the_zone(
                q[j], table[HEAD + j, LOWER], table[HEAD + j, UPPER]
            )
            held[j] = False

        # joints on their limits that would leave them are held, one set after another
        for _ in range(n):
            prioritised(J, z, twist, DAMPING + FAR * p2, posture, held, rates)

            more = False
            for j in range(n):
                outwards = (q[j] <= table[HEAD + j, LOWER] and rates[j] < 0.0) or (
                    q[j] >= table[HEAD + j, UPPER] and rates[j] > 0.0
                )
                if outwards and not held[j]:
                    held[j] = more = True
            if not more:
                break

        # A step of at most `longest`
        largest = 0.0
        for j in range(n):
            largest = max(
                largest, abs(rates[j]) * (scale if table[HEAD + j, KIND] == SLIDE else 1.0)
            )
        if largest <= QUIET:
            break

        factor = 1.0 if largest <= longest else longest / largest
        longest = min(longest, largest)
        for j in range(n):
            work[j, BEST] = q[j]
            q[j] = min(
                max(q[j] + factor * rates[j], table[HEAD + j, LOWER]), table[HEAD + j, UPPER]
            )
        steps += 1

    for j in range(n):
        out[j] = q[j]

    off = math.sqrt(p2) / scale
    code = CONVERGED if off <= settings.tol_p and tilt <= settings.tol_r else STALLED
    if code == STALLED and steps >= settings.limit:
        code = EXHAUSTED
    return code, steps, 0, off, tilt

"""Compiled loops of the Jacobian-free method: MKPS sweeps with Anderson acceleration.

Sweeps: [Danilov 2021], its stages combined. Acceleration: [Anderson 1965]. Arrays are those of
`uuv.controllers.ik.chain_kernels`.
"""

import math

import numpy as np

from uuv.controllers.ik.chain_kernels import (
    ALONG,
    AXIS,
    BAD_TARGET,
    BEST,
    BRANCH_LOST,
    CONVERGED,
    EXHAUSTED,
    HEAD,
    HINGE,
    KIND,
    LOWER,
    OUT_OF_REACH,
    PANTOGRAPH,
    POINT,
    SCALE,
    SLIDE,
    STALLED,
    THROUGH,
    TRAVEL,
    TWO_PI,
    UPPER,
    WITHIN,
    admit,
    begin,
    branch_left,
    fold,
    hand_over,
    jit,
    note,
    partition,
    recall,
    scatter,
    squared_tolerances,
    trace,
    turn_left,
)

# columns of `past`; the last two are DEPTH columns wide
AT, SWEPT, RESIDUAL, STEPS, TURNS = 0, 1, 2, 3, 9
DEPTH = 6  # sweeps that the Anderson acceleration remembers
# [1/rad^2] weight of the tool axes against the scaled position, which must dominate. Each restart
# takes the next weight, for a pose that converges slowly with one often converges fast with
# another.
SWEEP_WEIGHT = 0.01
LIGHTER = 0.003  # the same of the first restart, the fourth, ...
HEAVIER = 0.03  # of the second, the fifth, ...
SWEEP_WINDOW = 10  # [sweeps] a stall: in so many the objective does not
SWEEP_FACTOR = 0.8  # fall to this times itself
# Near singular configurations the objective falls slowly. Below CLOSE the stall factor is therefore
# CLOSE_FACTOR, and an accelerated step may raise the objective by up to the factor LENIENT.
CLOSE = 1e-5
CLOSE_FACTOR = 0.95  # in place of SWEEP_FACTOR
LENIENT = 20.0  # factor of the objective
SHORT_WAY = 0.5  # [rad] joint motion up to which the branch counts as kept without a test


@jit
def turn(vx, vy, vz, ex, ey, ez, c, s):
    """Rotate a vector about a unit axis ([Danilov 2021, eq. 5]).

    Args:
        vx: x of the vector; vy and vz likewise.
        vy: see vx.
        vz: see vx.
        ex: x of the unit axis; ey and ez likewise.
        ey: see ex.
        ez: see ex.
        c: cosine of the angle.
        s: sine of the angle.

    Returns:
        The three components of the rotated vector.
    """
    along = ex * vx + ey * vy + ez * vz
    along -= c * along
    return (
        c * vx + s * (ey * vz - ez * vy) + along * ex,
        c * vy + s * (ez * vx - ex * vz) + along * ey,
        c * vz + s * (ex * vy - ey * vx) + along * ez,
    )


@jit
def sweep(table, goal, weight, mode, q, work):
    """One combined sweep, tip to base: each joint minimises |R|^2 + weight sum |a_k - t_k|^2.

    Each minimum is exact. This joins the stages of [Danilov 2021, eq. 2, 4 and 5] into one. Joints
    between the moving one and the base keep their axes and points. Only the tip point and the tool
    axes are carried along, so a sweep costs O(n).

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        weight: [1/rad^2] of the tool axes against the scaled position.
        mode: ALONG, WITHIN or THROUGH, as in `uuv.controllers.ik.damped_descent.descend`.
        q: (n,) joint values, changed in place.
        work: scratch values, overwritten.

    Returns:
        Squared position error [scaled] and squared chord before the sweep.
    """
    nothing = q.dtype.type(64.0) * np.finfo(q.dtype).eps
    full_turn = q.dtype.type(TWO_PI)

    tip = trace(table, q, work)
    chord2 = turn_left(goal, tip)[3]
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = tip

    # Position error; axes of the goal
    gx, gy, gz = goal[0, 0], goal[0, 1], goal[0, 2]
    rx, ry, rz = gx - px, gy - py, gz - pz
    p2 = rx * rx + ry * ry + rz * rz
    tx, ty, tz = goal[1, 0], goal[1, 1], goal[1, 2]
    ux, uy, uz = goal[2, 0], goal[2, 1], goal[2, 2]
    vx, vy, vz = goal[3, 0], goal[3, 1], goal[3, 2]

    for i in range(q.shape[0] - 1, -1, -1):
        row = table[HEAD + i]
        kind = row[KIND]
        lower = row[LOWER]
        upper = row[UPPER]
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]

        # A slide moves the tip straight towards the goal
        if kind == SLIDE:
            travel = table[0, SCALE] * row[TRAVEL]
            optimum = q[i] + (ex * (gx - px) + ey * (gy - py) + ez * (gz - pz)) / travel
            moved = min(max(optimum, lower), upper)
            d = travel * (moved - q[i])
            q[i] = moved
            px += d * ex
            py += d * ey
            pz += d * ez
            continue

        # S from the joint to the tip (of a pantograph link: the link), and K where it should point
        sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
        if kind == HINGE:
            sx, sy, sz = px - sx, py - sy, pz - sz
        kx, ky, kz = sx + gx - px, sy + gy - py, sz + gz - pz

        # Maximise near * cosine + across * sine, the part of the objective that the angle changes
        es = ex * sx + ey * sy + ez * sz
        near = sx * kx + sy * ky + sz * kz - es * (ex * kx + ey * ky + ez * kz)
        across = ex * (sy * kz - sz * ky) + ey * (sz * kx - sx * kz) + ez * (sx * ky - sy * kx)

        # A hinge also turns the tool axes
        if kind == HINGE:
            ea_et = (
                (ex * xx + ey * xy + ez * xz) * (ex * tx + ey * ty + ez * tz)
                + (ex * yx + ey * yy + ez * yz) * (ex * ux + ey * uy + ez * uz)
                + (ex * zx + ey * zy + ez * zz) * (ex * vx + ey * vy + ez * vz)
            )
            near += weight * (
                xx * tx
                + xy * ty
                + xz * tz
                + yx * ux
                + yy * uy
                + yz * uz
                + zx * vx
                + zy * vy
                + zz * vz
                - ea_et
            )
            across += weight * (
                ex * (xy * tz - xz * ty + yy * uz - yz * uy + zy * vz - zz * vy)
                + ey * (xz * tx - xx * tz + yz * ux - yx * uz + zz * vx - zx * vz)
                + ez * (xx * ty - xy * tx + yx * uy - yy * ux + zx * vy - zy * vx)
            )

        # The best angle, within the limits
        length = math.sqrt(near * near + across * across)
        if length < nothing:  # this joint cannot change the objective
            continue
        c, s = near / length, across / length
        optimum = q[i] + math.atan2(across, near)
        moved = (
            optimum if mode == THROUGH else admit(optimum, lower, upper, mode == WITHIN, full_turn)
        )
        if moved != optimum:
            c, s = math.cos(moved - q[i]), math.sin(moved - q[i])
        q[i] = moved

        # The tip, and the tool axes
        if kind == PANTOGRAPH:
            kx, ky, kz = turn(sx, sy, sz, ex, ey, ez, c, s)
            px, py, pz = px + kx - sx, py + ky - sy, pz + kz - sz
            continue

        sx, sy, sz = turn(sx, sy, sz, ex, ey, ez, c, s)
        px, py, pz = work[i, POINT] + sx, work[i, POINT + 1] + sy, work[i, POINT + 2] + sz
        xx, xy, xz = turn(xx, xy, xz, ex, ey, ez, c, s)
        yx, yy, yz = turn(yx, yy, yz, ex, ey, ez, c, s)
        zx, zy, zz = xy * yz - xz * yy, xz * yx - xx * yz, xx * yy - xy * yx
    return p2, chord2


@jit
def mix(count, past, normal, q):
    """Anderson's step, g - dG argmin |f - dF y|, by regularised normal equations.

    Args:
        count: number of pairs of differences in `past`.
        past: (n, PAST) memory of the acceleration, columns as named above.
        normal: (6, 8) scratch values, overwritten.
        q: (n,) joint values, out.
    """
    real = q.dtype.type
    n = q.shape[0]
    zero = real(0.0)

    # Normal equations, the right-hand side in column 6
    for a in range(count):
        for b in range(a + 1):
            t = zero
            for i in range(n):
                t += past[i, TURNS + a] * past[i, TURNS + b]
            normal[a, b] = t
        t = zero
        for i in range(n):
            t += past[i, TURNS + a] * past[i, RESIDUAL]
        normal[a, 6] = t

    # L D L^T factorisation, forward substitution in the same pass
    ridge = real(1.0) + real(16.0) * np.finfo(q.dtype).eps
    for a in range(count):
        for b in range(a):
            t = normal[a, b]
            for k in range(b):
                t -= normal[a, k] * normal[b, k]
            normal[a, b] = t
        d = normal[a, a] * ridge + np.finfo(q.dtype).tiny
        for k in range(a):
            ld = normal[a, k]
            lower = ld * normal[k, 7]
            d -= lower * ld
            normal[a, 6] -= lower * normal[k, 6]
            normal[a, k] = lower
        normal[a, 7] = real(1.0) / d

    # Back substitution
    for a in range(count - 1, -1, -1):
        t = normal[a, 6] * normal[a, 7]
        for k in range(a + 1, count):
            t -= normal[k, a] * normal[k, 6]
        normal[a, 6] = t

    # g - dG y
    for i in range(n):
        value = past[i, SWEPT]
        for a in range(count):
            value -= normal[a, 6] * past[i, STEPS + a]
        q[i] = value


@jit
def accelerate(views, weight, near, limit, mode, best2, trail, row):
    """Combined sweeps as a fixed-point map g(q) with Anderson acceleration.

    An accelerated step that raises the objective too far, which plain sweeps never do, is undone
    and the memory of the acceleration is cleared.

    Args:
        views: memory of the chain. Its `q` is the start, after convergence the solution. Column
            BEST of its work takes joint values whose error is under `best2` and which are within
            the limits.
        weight: [1/rad^2] as in `sweep`.
        near: errors within which the pose is met.
        limit: largest number of sweeps.
        mode: as in `sweep`.
        best2: least squared error so far.
        trail: (rows, n) takes the joint values of every sweep that it has a row for.
        row: first row of `trail` to write.

    Returns:
        (code, sweeps, least squared error, squared position error, squared chord).
    """
    table, goal, normal, work, past, q = views
    real = q.dtype.type
    n = q.shape[0]
    sweeps = 0
    count = 0
    slot = 0
    known = False  # the memory holds the sweep before this one
    reference = real(np.inf)
    mark = real(np.inf)
    rounding = real(1.0) + real(1.0 / 16.0) * math.sqrt(np.finfo(q.dtype).eps)

    while True:
        note(q, trail, row + sweeps)
        for i in range(n):
            past[i, AT] = q[i]
        p2, chord2 = sweep(table, goal, weight, mode, q, work)
        error2 = p2 + chord2

        # Met: the joint values before this sweep
        if p2 <= near.p2 and chord2 <= near.chord2:
            for i in range(n):
                q[i] = past[i, AT]
            code = CONVERGED if mode != THROUGH or fold(table, q) else STALLED
            return code, sweeps, best2, p2, chord2

        if mode != THROUGH and error2 < best2:
            best2 = error2
            for i in range(n):
                work[i, BEST] = past[i, AT]

        if sweeps >= limit:
            return EXHAUSTED, sweeps, best2, p2, chord2
        sweeps += 1

        # An accelerated step too far is undone
        objective = p2 + real(2.0) * weight * chord2
        if (
            objective
            > reference * (real(LENIENT) if objective < real(CLOSE) else rounding)
            + np.finfo(q.dtype).tiny
        ):
            for i in range(n):
                q[i] = past[i, SWEPT]
            known = False
            count = 0
            slot = 0
            reference = real(np.inf)
            continue

        # Stalled: the objective against that of SWEEP_WINDOW sweeps before
        if sweeps % SWEEP_WINDOW == 1:
            factor = SWEEP_FACTOR if objective > real(CLOSE) else CLOSE_FACTOR
            if not objective < real(factor) * mark:
                return STALLED, sweeps, best2, p2, chord2
            mark = objective

        # Differences to the sweep before
        reference = objective
        for i in range(n):
            residual = q[i] - past[i, AT]
            past[i, TURNS + slot] = residual - past[i, RESIDUAL]
            past[i, STEPS + slot] = q[i] - past[i, SWEPT]
            past[i, RESIDUAL] = residual
            past[i, SWEPT] = q[i]

        # Anderson's step, within the limits
        if known:
            count = min(count + 1, DEPTH)
            slot = (slot + 1) % DEPTH
            mix(count, past, normal, q)
            for i in range(n):
                if mode != THROUGH or table[HEAD + i, KIND] == SLIDE:
                    q[i] = min(max(q[i], table[HEAD + i, LOWER]), table[HEAD + i, UPPER])

        known = True


@jit
def solve_jacobian_free(memory, X, q0, settings, trail, out):
    """Jacobian-free method: accelerated combined sweeps with restarts.

    Every second restart lets hinges pass their limits on the way (THROUGH).

    Args:
        memory: kernel memory of the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] or [m] start.
        settings: tolerances, limits of the iterations, and whether to keep the branch of `q0`.
        trail: (rows, n) takes the joint values of every sweep that it has a row for.
        out: (n,) takes the solution.

    Returns:
        (code, sweeps, restarts, position error [m], orientation error [rad]).
    """
    views = partition(memory, out.shape[0])
    table, goal, _, work, _, q = views
    limit = settings.limit
    restarts = settings.restarts
    keep = settings.keep
    options_good = settings.tol_p > 0.0 and settings.tol_r > 0.0 and limit >= 1 and restarts >= 0
    fault = begin(table, X, q0, options_good, not keep, goal, work, q)
    if fault >= BAD_TARGET:
        return fault, 0, 0, 0.0, 0.0

    real = q.dtype.type
    near = squared_tolerances(table, settings)
    if fault == OUT_OF_REACH:
        restarts = min(restarts, 4)

    sweeps = 0
    restart = 0
    best2 = real(np.inf)
    while True:
        mode = ALONG if keep else WITHIN if restart % 2 == 0 else THROUGH
        weight = SWEEP_WEIGHT if restart % 3 == 0 else LIGHTER if restart % 3 == 1 else HEAVIER

        code, spent, best2, p2, chord2 = accelerate(
            views, real(weight), near, limit - sweeps, mode, best2, trail, sweeps
        )
        sweeps += spent

        if code == CONVERGED or sweeps >= limit or keep or restart >= restarts:
            break
        restart += 1
        scatter(table, restart, work, q)

    if code != CONVERGED:
        p2, chord2 = recall(table, goal, work, q)
        code = OUT_OF_REACH if fault == OUT_OF_REACH else EXHAUSTED if sweeps >= limit else STALLED
    elif keep and branch_left(table, q, SHORT_WAY, work, views.past, views.normal):
        code = BRANCH_LOST

    return hand_over(table, q, p2, chord2, code, sweeps, restart, out)

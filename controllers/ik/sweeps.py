"""Compiled loops of the Jacobian-free method: combined sweeps of paper 003's steps, under Anderson acceleration.

Arrays are those of `mkps_kinematics`.
"""

import math

import numpy as np

from controllers.ik.kinematics import (
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
    TWO_PI,
    UPPER,
    WITHIN,
    admit,
    begin,
    branch_left,
    chord_squared,
    fold,
    hand_over,
    jit,
    note,
    partition,
    recall,
    scatter,
    trace,
    turn_left,
)

AT, SWEPT, RESIDUAL, STEPS, TURNS = 0, 1, 2, 3, 9  # columns of Anderson's memory `past`, DEPTH each for the last two
DEPTH = 6  # of the Anderson acceleration
# [1/rad^2] of the tool axes against the scaled position, which must lead; another at each restart, for what one weight
# is slow at is often easy for the next.
SWEEP_WEIGHT, LIGHTER, HEAVIER = 0.01, 0.003, 0.03
SWEEP_WINDOW, SWEEP_FACTOR = 10, 0.8  # a stall: the objective does not fall to this factor in so many sweeps
# Near singular configurations the objective falls slowly: under CLOSE, patience pays, and so does a mixed step that
# raises it by less than LENIENT.
CLOSE, CLOSE_FACTOR, LENIENT = 1e-5, 0.95, 20.0
SHORT_WAY = 0.5  # [rad] that keeps the branch unlooked


@jit
def turn(vx, vy, vz, ex, ey, ez, c, s):
    """The vector v turned about the unit axis e (paper 003, formula (5))."""
    along = ex * vx + ey * vy + ez * vz
    along -= c * along
    return (
        c * vx + s * (ey * vz - ez * vy) + along * ex,
        c * vy + s * (ez * vx - ex * vz) + along * ey,
        c * vz + s * (ex * vy - ey * vx) + along * ez,
    )


@jit
def sweep(table, goal, weight, mode, q, work):
    """One combined sweep, tip to base: each joint takes the exact minimiser of |R|^2 + weight sum |a_k - t_k|^2.

    This joins the three stages of paper 003, formulas (2), (4) and (5), into one. Joints above the moving one keep
    their axes and points, so only the tip point and the tool axes are carried: O(n). `mode` as in `descend`.

    Returns the squared position error and chord before the sweep.
    """
    nothing, full_turn = q.dtype.type(64.0) * np.finfo(q.dtype).eps, q.dtype.type(TWO_PI)
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(table, q, work)
    chord2 = turn_left(goal, xx, xy, xz, yx, yy, yz, zx, zy, zz)[3]
    gx, gy, gz = goal[0, 0], goal[0, 1], goal[0, 2]
    rx, ry, rz = gx - px, gy - py, gz - pz
    p2 = rx * rx + ry * ry + rz * rz
    tx, ty, tz = goal[1, 0], goal[1, 1], goal[1, 2]
    ux, uy, uz = goal[2, 0], goal[2, 1], goal[2, 2]
    vx, vy, vz = goal[3, 0], goal[3, 1], goal[3, 2]
    for i in range(q.shape[0] - 1, -1, -1):
        row = table[HEAD + i]
        kind, lower, upper = row[KIND], row[LOWER], row[UPPER]
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]
        if kind == SLIDE:
            wanted = q[i] + (ex * (gx - px) + ey * (gy - py) + ez * (gz - pz)) / table[0, SCALE]
            moved = min(max(wanted, lower), upper)
            d = table[0, SCALE] * (moved - q[i])
            q[i] = moved
            px += d * ex
            py += d * ey
            pz += d * ez
            continue
        sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
        if kind == HINGE:
            sx, sy, sz = px - sx, py - sy, pz - sz
        kx, ky, kz = sx + gx - px, sy + gy - py, sz + gz - pz
        es = ex * sx + ey * sy + ez * sz
        near = sx * kx + sy * ky + sz * kz - es * (ex * kx + ey * ky + ez * kz)
        across = ex * (sy * kz - sz * ky) + ey * (sz * kx - sx * kz) + ez * (sx * ky - sy * kx)
        if kind == HINGE:
            ea_et = (
                (ex * xx + ey * xy + ez * xz) * (ex * tx + ey * ty + ez * tz)
                + (ex * yx + ey * yy + ez * yz) * (ex * ux + ey * uy + ez * uz)
                + (ex * zx + ey * zy + ez * zz) * (ex * vx + ey * vy + ez * vz)
            )
            near += weight * (
                xx * tx + xy * ty + xz * tz + yx * ux + yy * uy + yz * uz + zx * vx + zy * vy + zz * vz - ea_et
            )
            across += weight * (
                ex * (xy * tz - xz * ty + yy * uz - yz * uy + zy * vz - zz * vy)
                + ey * (xz * tx - xx * tz + yz * ux - yx * uz + zz * vx - zx * vz)
                + ez * (xx * ty - xy * tx + yx * uy - yy * ux + zx * vy - zy * vx)
            )
        length = math.sqrt(near * near + across * across)
        if length < nothing:  # the joint cannot change the objective
            continue
        c, s = near / length, across / length
        wanted = q[i] + math.atan2(across, near)
        moved = wanted if mode == THROUGH else admit(wanted, lower, upper, mode == WITHIN, full_turn)
        if moved != wanted:
            c, s = math.cos(moved - q[i]), math.sin(moved - q[i])
        q[i] = moved
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
    """Anderson's step: g - dG argmin |f - dF y|, from `count` pairs of differences, by regularised normal equations."""
    real = q.dtype.type
    n = q.shape[0]
    zero = real(0.0)
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
    for a in range(count - 1, -1, -1):
        t = normal[a, 6] * normal[a, 7]
        for k in range(a + 1, count):
            t -= normal[k, a] * normal[k, 6]
        normal[a, 6] = t
    for i in range(n):
        value = past[i, SWEPT]
        for a in range(count):
            value -= normal[a, 6] * past[i, STEPS + a]
        q[i] = value


@jit
def accelerate(table, goal, weight, near_p, near_r, limit, mode, best2, normal, work, past, q, trail, row):
    """Combined sweeps as a fixed-point map g(q) under Anderson acceleration. Arguments and returns as `descend`.

    A mixed step that raises the objective too far, which plain sweeps never do, is taken back and the memory dropped.
    """
    real = q.dtype.type
    n = q.shape[0]
    sweeps, count, slot = 0, 0, 0
    known = False  # whether the memory holds the sweep before this one
    reference, mark = real(np.inf), real(np.inf)
    rounding = real(1.0) + real(1.0 / 16.0) * math.sqrt(np.finfo(q.dtype).eps)
    while True:
        note(q, trail, row + sweeps)
        for i in range(n):
            past[i, AT] = q[i]
        p2, chord2 = sweep(table, goal, weight, mode, q, work)
        error2 = p2 + chord2
        if p2 <= near_p and chord2 <= near_r:
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
        objective = p2 + real(2.0) * weight * chord2
        if objective > reference * (real(LENIENT) if objective < real(CLOSE) else rounding) + np.finfo(q.dtype).tiny:
            for i in range(n):
                q[i] = past[i, SWEPT]
            known, count, slot, reference = False, 0, 0, real(np.inf)
            continue
        if sweeps % SWEEP_WINDOW == 1:
            factor = SWEEP_FACTOR if objective > real(CLOSE) else CLOSE_FACTOR
            if not objective < real(factor) * mark:
                return STALLED, sweeps, best2, p2, chord2
            mark = objective
        reference = objective
        for i in range(n):
            residual = q[i] - past[i, AT]
            past[i, TURNS + slot] = residual - past[i, RESIDUAL]
            past[i, STEPS + slot] = q[i] - past[i, SWEPT]
            past[i, RESIDUAL] = residual
            past[i, SWEPT] = q[i]
        if known:
            count = min(count + 1, DEPTH)
            slot = (slot + 1) % DEPTH
            mix(count, past, normal, q)
            for i in range(n):
                if mode != THROUGH or table[HEAD + i, KIND] == SLIDE:
                    q[i] = min(max(q[i], table[HEAD + i, LOWER]), table[HEAD + i, UPPER])
        known = True


@jit
def solve_jacobian_free(memory, X, q0, tol_p, tol_r, limit, restarts, keep, trail, out):
    """Accelerated combined sweeps with restarts, every other one THROUGH the limits. As `solve_hybrid`."""
    table, goal, normal, work, past, q = partition(memory, out.shape[0])
    options_good = tol_p > 0.0 and tol_r > 0.0 and limit >= 1 and restarts >= 0
    fault = begin(table, X, q0, options_good, not keep, goal, work, q)
    if fault >= BAD_TARGET:
        return fault, 0, 0, 0.0, 0.0
    real = q.dtype.type
    near_p, near_r = (real(tol_p) * table[0, SCALE]) ** 2, real(chord_squared(tol_r))
    if fault == OUT_OF_REACH:
        restarts = min(restarts, 4)
    sweeps, restart, best2 = 0, 0, real(np.inf)
    while True:
        mode = ALONG if keep else WITHIN if restart % 2 == 0 else THROUGH
        weight = SWEEP_WEIGHT if restart % 3 == 0 else LIGHTER if restart % 3 == 1 else HEAVIER
        code, spent, best2, p2, chord2 = accelerate(
            table, goal, real(weight), near_p, near_r, limit - sweeps, mode, best2, normal, work, past, q, trail, sweeps
        )
        sweeps += spent
        if code == CONVERGED or sweeps >= limit or keep or restart >= restarts:
            break
        restart += 1
        scatter(table, restart, work, q)
    if code != CONVERGED:
        p2, chord2 = recall(table, goal, work, q)
        code = OUT_OF_REACH if fault == OUT_OF_REACH else EXHAUSTED if sweeps >= limit else STALLED
    elif keep and branch_left(table, q, SHORT_WAY, work, past, normal):
        code = BRANCH_LOST
    return hand_over(table, q, p2, chord2, code, sweeps, restart, out)

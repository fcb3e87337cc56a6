"""Compiled loops of plain MKPS: stages of [Danilov 2021, chapter 3], with corrected signs.

In formula (2) of [Danilov 2021] the modulus loses the sign of the step, which is atan2(e.(S x K),
S.K - (e.S)(e.K)). Here e is the joint's unit axis, S what it turns and K where S should point. In
an axis stage these are the two axes. In the position stage they lead from the joint to the tip and
to the target; for a pantograph link, S is the link and K the link plus the error. The arguments of
atan2 are `across` and `near` below. Test (1) of [Danilov 2021] mistakes the farthest position of a
joint for the nearest.

Rotating all links beyond a joint costs O(n) per step. Carrying only the tip point and the tool axes
gives the same iterates in O(n) per sweep. Arrays are those of `uuv.controllers.ik.chain_kernels`.
"""

import math

import numpy as np

from uuv.controllers.ik.chain_kernels import (
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
    TRAVEL,
    UPPER,
    begin,
    branch_left,
    hand_over,
    jit,
    note,
    partition,
    recall,
    squared_tolerances,
    trace,
    turn_left,
)
from uuv.controllers.ik.sweeps import SHORT_WAY, turn

STAGE_SWEEPS = 10  # largest number of sweeps of one stage before the next one begins


@jit
def place(table, goal, near_p, q, work):
    """One sweep of the position stage, base to tip: [Danilov 2021, eq. 2 to 4].

    The target is moved instead of the links: turning everything beyond a joint by d equals turning
    the target by -d.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        near_p: squared position tolerance [scaled], at which the sweep ends early.
        q: (n,) joint values, changed in place.
        work: scratch values, overwritten.

    Returns:
        F_R^2 [scaled] after the sweep.
    """
    # Square of |S| |K| across the joint's axis, below which S or K lies along it and the angle
    # means nothing.
    nothing = (q.dtype.type(64.0) * np.finfo(q.dtype).eps) ** 2

    px, py, pz, _, _, _, _, _, _, _, _, _ = trace(table, q, work)
    rx, ry, rz = goal[0, 0] - px, goal[0, 1] - py, goal[0, 2] - pz

    for i in range(q.shape[0]):
        if rx * rx + ry * ry + rz * rz <= near_p:
            break
        row = table[HEAD + i]
        kind = row[KIND]
        lower = row[LOWER]
        upper = row[UPPER]
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]

        # A slide moves straight towards the target
        if kind == SLIDE:
            travel = table[0, SCALE] * row[TRAVEL]
            moved = min(max(q[i] + (ex * rx + ey * ry + ez * rz) / travel, lower), upper)
            d = travel * (moved - q[i])
            q[i] = moved
            rx, ry, rz = rx - d * ex, ry - d * ey, rz - d * ez
            continue

        # S and K of [Danilov 2021, eq. 2]
        sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
        if kind == HINGE:
            sx, sy, sz = px - sx, py - sy, pz - sz
        kx, ky, kz = sx + rx, sy + ry, sz + rz

        # Arguments of atan2, see the module
        near = (
            sx * kx
            + sy * ky
            + sz * kz
            - (ex * sx + ey * sy + ez * sz) * (ex * kx + ey * ky + ez * kz)
        )
        across = ex * (sy * kz - sz * ky) + ey * (sz * kx - sx * kz) + ez * (sx * ky - sy * kx)
        if near * near + across * across < nothing:
            continue

        moved = min(max(q[i] + math.atan2(across, near), lower), upper)
        c, s = math.cos(moved - q[i]), math.sin(moved - q[i])
        q[i] = moved

        # The error that is left
        if kind == PANTOGRAPH:
            lx, ly, lz = turn(sx, sy, sz, ex, ey, ez, c, s)
            rx, ry, rz = kx - lx, ky - ly, kz - lz
        else:
            kx, ky, kz = turn(kx, ky, kz, ex, ey, ez, c, -s)
            rx, ry, rz = kx - sx, ky - sy, kz - sz
    return rx * rx + ry * ry + rz * rz


@jit
def align(table, u, t, tolerance, q, work):
    """One sweep of an axis stage, tip to base: turn an axis of the last frame to its target.

    Args:
        table: the chain.
        u: (3,) the axis, in the last joint frame.
        t: (3,) the target axis, in base axes.
        tolerance: [rad] angle at which the sweep ends early.
        q: (n,) joint values, changed in place.
        work: scratch values, overwritten.

    Returns:
        Angle [rad] between the two axes after the sweep.
    """
    # Square of |S| |K| across the joint's axis, below which S or K lies along it and the angle
    # means nothing.
    nothing = (q.dtype.type(64.0) * np.finfo(q.dtype).eps) ** 2

    # The axis in base axes, and its angle to the target
    tx, ty, tz = t
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(table, q, work)
    ux, uy, uz = u
    ax, ay, az = (
        xx * ux + yx * uy + zx * uz,
        xy * ux + yy * uy + zy * uz,
        xz * ux + yz * uy + zz * uz,
    )
    angle = angle_between(ax, ay, az, tx, ty, tz)

    for i in range(q.shape[0] - 1, -1, -1):
        if angle <= tolerance:
            break
        if table[HEAD + i, KIND] != HINGE:
            continue

        # Arguments of atan2, see the module
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]
        near = (
            ax * tx
            + ay * ty
            + az * tz
            - (ex * ax + ey * ay + ez * az) * (ex * tx + ey * ty + ez * tz)
        )
        across = ex * (ay * tz - az * ty) + ey * (az * tx - ax * tz) + ez * (ax * ty - ay * tx)
        if near * near + across * across < nothing:
            continue

        moved = min(
            max(q[i] + math.atan2(across, near), table[HEAD + i, LOWER]), table[HEAD + i, UPPER]
        )
        ax, ay, az = turn(ax, ay, az, ex, ey, ez, math.cos(moved - q[i]), math.sin(moved - q[i]))
        q[i] = moved
        angle = angle_between(ax, ay, az, tx, ty, tz)
    return angle


@jit
def angle_between(ax, ay, az, tx, ty, tz):
    """Angle between two vectors of equal length, by atan2.

    Args:
        ax: x of the first vector; ay and az likewise.
        ay: see ax.
        az: see ax.
        tx: x of the second vector; ty and tz likewise.
        ty: see tx.
        tz: see tx.

    Returns:
        The angle [rad] in [0, pi].
    """
    cx, cy, cz = ay * tz - az * ty, az * tx - ax * tz, ax * ty - ay * tx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), ax * tx + ay * ty + az * tz)


@jit
def in_frame(v, x, y, z):
    """The vector whose components along the axes `x`, `y` and `z` are those of `v`."""
    return (
        v[0] * x[0] + v[1] * y[0] + v[2] * z[0],
        v[0] * x[1] + v[1] * y[1] + v[2] * z[1],
        v[0] * x[2] + v[1] * y[2] + v[2] * z[2],
    )


@jit
def goal_axis(goal, u):
    """Target, in base axes, of the axis `u` of the last joint frame."""
    x = (goal[1, 0], goal[1, 1], goal[1, 2])
    y = (goal[2, 0], goal[2, 1], goal[2, 2])
    z = (goal[3, 0], goal[3, 1], goal[3, 2])
    return in_frame(u, x, y, z)


@jit
def stage_axes(table, tip_axes, q, work):
    """Axes E_x and E_z of the two axis stages, in the last joint frame.

    By default the tool's own axes, as published. Else E_z is the axis of the last hinge and E_x an
    axis perpendicular to it: the last hinge then turns E_x without moving E_z, while the stages of
    the tool's own axes undo each other in part, unless one of them is parallel to that hinge's
    axis.

    Args:
        table: the chain.
        tip_axes: take the tool's own axes: its z (along the tool) as E_x, its x (across) as E_z.
        q: (n,) joint values.
        work: scratch values, overwritten.

    Returns:
        E_x and E_z, three numbers each.
    """
    if tip_axes:
        return (table[1, 2], table[1, 5], table[1, 8]), (table[1, 0], table[1, 3], table[1, 6])

    # Axis of the last hinge, in the last joint frame
    last = q.shape[0] - 1
    while last > 0 and table[HEAD + last, KIND] != HINGE:
        last -= 1

    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(table, q, work)
    ex, ey, ez = work[last, AXIS], work[last, AXIS + 1], work[last, AXIS + 2]
    # This is the z axis, unless slides or pantograph links lie beyond the hinge.
    ux, uy, uz = (
        ex * xx + ey * xy + ez * xz,
        ex * yx + ey * yy + ez * yz,
        ex * zx + ey * zy + ez * zz,
    )

    # An axis perpendicular to it
    zero = ux - ux  # in the precision of the chain
    if abs(ux) < abs(uy):
        length = math.sqrt(uy * uy + uz * uz)
        return (zero, uz / length, -uy / length), (ux, uy, uz)
    length = math.sqrt(ux * ux + uz * uz)
    return (uz / length, zero, -ux / length), (ux, uy, uz)


@jit
def three_goals(table, goal, along, across, q, work):
    """Goal functions of [Danilov 2021, eq. 6] at `q`, and the whole rotation error.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        along: (3,) E_x, the first stage axis in the last joint frame.
        across: (3,) E_z, the second one.
        q: (n,) joint values.
        work: scratch values, overwritten.

    Returns:
        F_R^2 [scaled], F_alpha1 [rad], F_alpha2 [rad], and the squared chord of the rotation error.
    """
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = tip = trace(table, q, work)
    rx, ry, rz = goal[0, 0] - px, goal[0, 1] - py, goal[0, 2] - pz

    ax, ay, az = in_frame(along, (xx, xy, xz), (yx, yy, yz), (zx, zy, zz))
    bx, by, bz = in_frame(across, (xx, xy, xz), (yx, yy, yz), (zx, zy, zz))
    mx, my, mz = goal_axis(goal, along)
    nx, ny, nz = goal_axis(goal, across)

    return (
        rx * rx + ry * ry + rz * rz,
        angle_between(ax, ay, az, mx, my, mz),
        angle_between(bx, by, bz, nx, ny, nz),
        turn_left(goal, tip)[3],
    )


@jit
def solve_plain(memory, X, q0, settings, trail, out):
    """Plain MKPS: the stages of [Danilov 2021, chapter 3] in turn, until its inequalities (6) hold.

    Args:
        memory: kernel memory of the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] or [m] start.
        settings: tolerances, limit of the sweeps, the axes, and whether to keep the branch of `q0`.
        trail: (rows, n) takes the joint values of every sweep that it has a row for.
        out: (n,) takes the solution.

    Returns:
        (code, sweeps, 0, position error [m], orientation error [rad]).
    """
    table, goal, normal, work, past, q = partition(memory, out.shape[0])
    limit = settings.limit
    keep = settings.keep

    axes_good = settings.tol_1 > 0.0 and settings.tol_2 > 0.0
    options_good = settings.tol_p > 0.0 and settings.tol_r > 0.0 and axes_good and limit >= 1
    fault = begin(table, X, q0, options_good, not keep, goal, work, q)
    if fault >= BAD_TARGET:
        return fault, 0, 0, 0.0, 0.0

    real = q.dtype.type
    near = squared_tolerances(table, settings)
    near_1 = real(settings.tol_1)
    near_2 = real(settings.tol_2)

    along, across = stage_axes(table, settings.tip_axes, q, work)
    target_along = goal_axis(goal, along)
    target_across = goal_axis(goal, across)
    sweeps = 0

    # Errors of the nearest pose so far, of the start at first
    p2, angle_1, angle_2, chord2 = three_goals(table, goal, along, across, q, work)
    best2 = p2 + chord2
    for i in range(q.shape[0]):
        work[i, BEST] = q[i]

    while True:
        note(q, trail, sweeps)

        # Inequalities (6), or the whole rotation in place of the last two
        if p2 <= near.p2 and (chord2 <= near.chord2 or (angle_1 <= near_1 and angle_2 <= near_2)):
            code = (
                BRANCH_LOST
                if keep and branch_left(table, q, SHORT_WAY, work, past, normal)
                else CONVERGED
            )
            break

        if sweeps >= limit:
            p2, chord2 = recall(table, goal, work, q)
            code = OUT_OF_REACH if fault == OUT_OF_REACH else EXHAUSTED
            break

        # Stages of the position and of the two axes
        for stage in range(3):
            for _ in range(STAGE_SWEEPS):
                note(q, trail, sweeps)
                sweeps += 1

                if stage == 0:
                    done = place(table, goal, near.p2, q, work) <= near.p2
                elif stage == 1:
                    done = align(table, along, target_along, near_1, q, work) <= near_1
                else:
                    done = align(table, across, target_across, near_2, q, work) <= near_2

                # Nearest pose of all sweeps: their stages undo each other
                p2, angle_1, angle_2, chord2 = three_goals(table, goal, along, across, q, work)
                if p2 + chord2 < best2:
                    best2 = p2 + chord2
                    for i in range(q.shape[0]):
                        work[i, BEST] = q[i]
                if done:
                    break

    return hand_over(table, q, p2, chord2, code, sweeps, 0, out)

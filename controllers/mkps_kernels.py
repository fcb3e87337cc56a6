"""Compiled loops of the inverse kinematics in `controllers.mkps`. Nothing here allocates.

A chain comes as two tables. `joints` has one row per joint, columns as named below: the frame of a joint turns about
its z axis by offset + q, moves by the link vector, then turns about its x axis by alpha to reach the next joint axis.
With the link vector free this form takes any two axes, parallel ones too, and costs two plane rotations a joint.
`ends` is (2, 3, 4): the pose of the first joint frame in the base, and the rotation of the tip in the last joint frame;
`ends[1, 0, 3]` bounds the distance that the tip can get from the first joint, `ends[1, 1, 3]` is 1 where a far start
deserves a sweep. Lengths in both are multiplied by `scale`, a power of two that makes the arm about one unit long, so
that metres and radians can share one norm.
`scratch` is uninitialised memory of `scratch_size(n)` numbers, cut by `partition` into `goal` (4, 3): the scaled tip
position, then the wanted axes of the last joint frame, one a row; `normal` (6, 8), `work` (n, WORK), `memory`
(n, HISTORY). `trail` takes the joint values of every iteration that it has a row for.
"""

import math

import numpy as np
from numba import njit

KIND, OFFSET, COS_ALPHA, SIN_ALPHA, LINK, LOWER, UPPER, COS_OFFSET, SIN_OFFSET, AFTER, COLUMNS = (
    0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 14,
)  # fmt: skip
HINGE, SLIDE, PANTOGRAPH = 0.0, 1.0, 2.0

COLUMN, AXIS, POINT, STEP, BEST, START, WORK = 0, 3, 6, 9, 10, 11, 12
AT, SWEPT, RESIDUAL, STEPS, TURNS, HISTORY = 0, 1, 2, 3, 8, 13  # columns of Anderson's memory, DEPTH each for two

CONVERGED, STALLED, EXHAUSTED, BRANCH_LOST, OUT_OF_REACH, BAD_TARGET, BAD_START = 0, 1, 2, 3, 4, 5, 6
ALONG, WITHIN, THROUGH = 0, 1, 2
HYBRID, JACOBIAN_FREE, PLAIN = 0, 1, 2

# Chosen on the arms of facts/ik.md; rates and times change little within a factor of two of each.
DAMPING = 0.1  # of the squared error
LONG_STEP, SHORT_STEP = 1.5, 0.5  # [rad] longest step of a joint, free and on its branch
FAR = 0.1  # squared error of a start from which a sweep pays off before a descent
FAR_WEIGHT = 0.1  # [1/rad^2] of the tool axes against the scaled position in that sweep
SWEEP_WEIGHT = 0.01  # [1/rad^2] the same in accelerated sweeps, where position must lead
SETTLE_STEPS = 200  # longest creep to the nearest pose
STAGE_SWEEPS = 10  # longest run of one stage of plain MKPS
SWEEP_WINDOW, SWEEP_FACTOR = 10, 0.8  # like STALL_*, for accelerated sweeps
DEPTH = 5  # of the Anderson acceleration
STALL_WINDOW, STALL_FACTOR = 4, 0.5  # when a descent with restarts left is given up

_TWO_PI = 2.0 * math.pi
_jit = njit(cache=True, nogil=True, error_model="numpy")


@_jit
def trace(joints, ends, scale, q, work):
    """Walk the chain at `q`: write every joint's axis and point to `work`, return the tip (p, x, y, z) as 12 numbers.

    A pantograph link has the vector of the link, not its joint's point, in `work[i, POINT:]`.
    """
    xx, yx, zx, px = ends[0, 0, 0], ends[0, 0, 1], ends[0, 0, 2], ends[0, 0, 3]
    xy, yy, zy, py = ends[0, 1, 0], ends[0, 1, 1], ends[0, 1, 2], ends[0, 1, 3]
    xz, yz, zz, pz = ends[0, 2, 0], ends[0, 2, 1], ends[0, 2, 2], ends[0, 2, 3]
    for i in range(joints.shape[0]):
        kind = joints[i, KIND]
        work[i, AXIS] = zx
        work[i, AXIS + 1] = zy
        work[i, AXIS + 2] = zz
        work[i, POINT] = px
        work[i, POINT + 1] = py
        work[i, POINT + 2] = pz
        if kind == HINGE:
            angle = q[i] + joints[i, OFFSET]
            c, s = math.cos(angle), math.sin(angle)
        else:
            c, s = joints[i, COS_OFFSET], joints[i, SIN_OFFSET]
        xx, yx = c * xx + s * yx, c * yx - s * xx
        xy, yy = c * xy + s * yy, c * yy - s * xy
        xz, yz = c * xz + s * yz, c * yz - s * xz
        lx, ly, lz = joints[i, LINK], joints[i, LINK + 1], joints[i, LINK + 2]
        if kind == SLIDE:
            lz += scale * q[i]
        elif kind == PANTOGRAPH:
            c, s = math.cos(q[i]), math.sin(q[i])
            lx, ly = c * lx - s * ly, s * lx + c * ly
            work[i, POINT] = lx * xx + ly * yx + lz * zx
            work[i, POINT + 1] = lx * xy + ly * yy + lz * zy
            work[i, POINT + 2] = lx * xz + ly * yz + lz * zz
            lx += joints[i, AFTER]
            ly += joints[i, AFTER + 1]
            lz += joints[i, AFTER + 2]
        px += lx * xx + ly * yx + lz * zx
        py += lx * xy + ly * yy + lz * zy
        pz += lx * xz + ly * yz + lz * zz
        c, s = joints[i, COS_ALPHA], joints[i, SIN_ALPHA]
        yx, zx = c * yx + s * zx, c * zx - s * yx
        yy, zy = c * yy + s * zy, c * zy - s * yy
        yz, zz = c * yz + s * zz, c * zz - s * yz
    return px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz


@_jit
def columns(joints, scale, px, py, pz, work):
    """Turn what `trace` wrote into Jacobian columns (linear; angular) at the tip, in `work[:, :6]`."""
    for i in range(joints.shape[0]):
        kind = joints[i, KIND]
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]
        if kind == HINGE:
            sx, sy, sz = px - work[i, POINT], py - work[i, POINT + 1], pz - work[i, POINT + 2]
        else:
            sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
            work[i, AXIS] = 0.0
            work[i, AXIS + 1] = 0.0
            work[i, AXIS + 2] = 0.0
        if kind == SLIDE:
            work[i, COLUMN] = scale * ex
            work[i, COLUMN + 1] = scale * ey
            work[i, COLUMN + 2] = scale * ez
        else:
            work[i, COLUMN] = ey * sz - ez * sy
            work[i, COLUMN + 1] = ez * sx - ex * sz
            work[i, COLUMN + 2] = ex * sy - ey * sx


@_jit
def forward(joints, ends, scale, q, work, X):
    """Tip pose into `X` (4, 4) and Jacobian columns into `work[:, :6]`, both unscaled."""
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
    columns(joints, scale, px, py, pz, work)
    for i in range(joints.shape[0]):
        for k in range(3):
            work[i, COLUMN + k] /= scale
    for k in range(3):
        wx, wy, wz = ends[1, 0, k], ends[1, 1, k], ends[1, 2, k]
        X[0, k] = xx * wx + yx * wy + zx * wz
        X[1, k] = xy * wx + yy * wy + zy * wz
        X[2, k] = xz * wx + yz * wy + zz * wz
        X[3, k] = 0.0
    X[0, 3], X[1, 3], X[2, 3], X[3, 3] = px / scale, py / scale, pz / scale, 1.0


@_jit
def set_goal(ends, scale, X, goal):
    """Fold the tip's rotation and the scale into the target `X` (4, 4); False if it is not a finite pose."""
    # Rows orthonormal to 1e-6 and right-handed; a NaN fails every comparison, so it fails here.
    xx, xy, xz = X[0, 0], X[1, 0], X[2, 0]
    yx, yy, yz = X[0, 1], X[1, 1], X[2, 1]
    zx, zy, zz = X[0, 2], X[1, 2], X[2, 2]
    good = (
        abs(yy * zz - yz * zy - xx) < 1e-6
        and abs(yz * zx - yx * zz - xy) < 1e-6
        and abs(yx * zy - yy * zx - xz) < 1e-6
        and abs(yx * yx + yy * yy + yz * yz - 1.0) < 1e-6
        and abs(zx * zx + zy * zy + zz * zz - 1.0) < 1e-6
        and abs(yx * zx + yy * zy + yz * zz) < 1e-6
        and abs(X[3, 0]) + abs(X[3, 1]) + abs(X[3, 2]) + abs(X[3, 3] - 1.0) < 1e-9
        and math.isfinite(X[0, 3] + X[1, 3] + X[2, 3])
    )
    for k in range(3):
        goal[0, k] = X[k, 3] * scale
        wx, wy, wz = ends[1, k, 0], ends[1, k, 1], ends[1, k, 2]
        goal[1 + k, 0] = xx * wx + yx * wy + zx * wz
        goal[1 + k, 1] = xy * wx + yy * wy + zy * wz
        goal[1 + k, 2] = xz * wx + yz * wy + zz * wz
    return good


@_jit
def rotation_error(goal, xx, xy, xz, yx, yy, yz, zx, zy, zz):
    """Rotation vector [rad] from the tip axes to the goal axes, and its length by atan2."""
    tx, ty, tz = goal[1, 0], goal[1, 1], goal[1, 2]
    ux, uy, uz = goal[2, 0], goal[2, 1], goal[2, 2]
    vx, vy, vz = goal[3, 0], goal[3, 1], goal[3, 2]
    wx = 0.5 * (xy * tz - xz * ty + yy * uz - yz * uy + zy * vz - zz * vy)
    wy = 0.5 * (xz * tx - xx * tz + yz * ux - yx * uz + zz * vx - zx * vz)
    wz = 0.5 * (xx * ty - xy * tx + yx * uy - yy * ux + zx * vy - zy * vx)
    sine2 = wx * wx + wy * wy + wz * wz
    cosine = 0.5 * (xx * tx + xy * ty + xz * tz + yx * ux + yy * uy + yz * uz + zx * vx + zy * vy + zz * vz - 1.0)
    if cosine > 0.0 and sine2 < 1e-3:
        # asin(s)/s to 4e-10 relative, which spares the two slow functions in the last, fast iterations
        factor = 1.0 + sine2 * (1.0 / 6.0 + sine2 * (3.0 / 40.0 + sine2 * (15.0 / 336.0)))
        return wx * factor, wy * factor, wz * factor, math.sqrt(sine2) * factor
    sine = math.sqrt(sine2)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        factor = angle / sine
        return wx * factor, wy * factor, wz * factor, angle
    # Half a turn: the skew part vanishes, but R + 1 = 2 a a^T; take its longest column.
    rx = 1.0 + xx * tx + yx * ux + zx * vx
    ry = 1.0 + xy * ty + yy * uy + zy * vy
    rz = 1.0 + xz * tz + yz * uz + zz * vz
    if rx >= ry and rx >= rz:
        ax, ay, az = rx, ty * xx + uy * yx + vy * zx, tz * xx + uz * yx + vz * zx
    elif ry >= rz:
        ax, ay, az = tx * xy + ux * yy + vx * zy, ry, tz * xy + uz * yy + vz * zy
    else:
        ax, ay, az = tx * xz + ux * yz + vx * zz, ty * xz + uy * yz + vy * zz, rz
    factor = angle / math.sqrt(ax * ax + ay * ay + az * az)
    return ax * factor, ay * factor, az * factor, angle


@_jit
def damped_step(joints, q, limited, damping, ex, ey, ez, wx, wy, wz, normal, work):
    """Levenberg-Marquardt step dq = J^T (J J^T + damping)^-1 e into `work[:, STEP]`; returns its largest entry.

    A joint that stands on a limit and would leave it leaves the problem instead (its column is set to zero).
    """
    n = joints.shape[0]
    for a in range(6):
        for b in range(a + 1):
            normal[a, b] = 0.0
        normal[a, a] = damping
    for i in range(n):
        c0, c1, c2, c3, c4, c5 = work[i, 0], work[i, 1], work[i, 2], work[i, 3], work[i, 4], work[i, 5]
        slope = c0 * ex + c1 * ey + c2 * ez + c3 * wx + c4 * wy + c5 * wz
        if (limited or joints[i, KIND] == SLIDE) and (
            (slope < 0.0 and q[i] <= joints[i, LOWER]) or (slope > 0.0 and q[i] >= joints[i, UPPER])
        ):
            for a in range(6):
                work[i, a] = 0.0
            continue
        normal[0, 0] += c0 * c0
        normal[1, 0] += c1 * c0
        normal[1, 1] += c1 * c1
        normal[2, 0] += c2 * c0
        normal[2, 1] += c2 * c1
        normal[2, 2] += c2 * c2
        normal[3, 0] += c3 * c0
        normal[3, 1] += c3 * c1
        normal[3, 2] += c3 * c2
        normal[3, 3] += c3 * c3
        normal[4, 0] += c4 * c0
        normal[4, 1] += c4 * c1
        normal[4, 2] += c4 * c2
        normal[4, 3] += c4 * c3
        normal[4, 4] += c4 * c4
        normal[5, 0] += c5 * c0
        normal[5, 1] += c5 * c1
        normal[5, 2] += c5 * c2
        normal[5, 3] += c5 * c3
        normal[5, 4] += c5 * c4
        normal[5, 5] += c5 * c5
    normal[0, 6], normal[1, 6], normal[2, 6] = ex, ey, ez
    normal[3, 6], normal[4, 6], normal[5, 6] = wx, wy, wz
    for a in range(6):  # L D L^T by rows; column 7 holds 1 / D
        for b in range(a):
            t = normal[a, b]
            for k in range(b):
                t -= normal[a, k] * normal[b, k]
            normal[a, b] = t  # (L D)[a, b] until the row is done
        d = normal[a, a]
        for k in range(a):
            ld = normal[a, k]
            lower = ld * normal[k, 7]
            d -= lower * ld
            normal[a, 6] -= lower * normal[k, 6]
            normal[a, k] = lower
        normal[a, 7] = 1.0 / d
    for a in range(5, -1, -1):
        t = normal[a, 6] * normal[a, 7]
        for k in range(a + 1, 6):
            t -= normal[k, a] * normal[k, 6]
        normal[a, 6] = t
    y0, y1, y2 = normal[0, 6], normal[1, 6], normal[2, 6]
    y3, y4, y5 = normal[3, 6], normal[4, 6], normal[5, 6]
    largest = 0.0
    for i in range(n):
        dq = work[i, 0] * y0 + work[i, 1] * y1 + work[i, 2] * y2 + work[i, 3] * y3 + work[i, 4] * y4 + work[i, 5] * y5
        work[i, STEP] = dq
        largest = max(largest, abs(dq))
    return largest


@_jit
def admit(value, lower, upper, hinge):
    """`value` if the limits allow it, else the same hinge angle a turn away, else the nearer limit."""
    if lower <= value <= upper:
        return value
    if hinge:
        turned = value - _TWO_PI if value > upper else value + _TWO_PI
        if lower <= turned <= upper:
            return turned
    return min(max(value, lower), upper)


@_jit
def sweep(joints, ends, scale, goal, weight, mode, q, work):
    """One combined sweep, tip to base: each joint takes the exact minimiser of |R|^2 + weight sum |a_k - t_k|^2.

    This joins the three stages of paper 003, formulas (2), (4) and (5), into one. Joints above the moving one keep
    their axes and points, so only the tip point and the tool axes are carried: O(n). `mode` as in `descend`.

    Returns the squared position error and the orientation error before the sweep.
    """
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
    error_r = rotation_error(goal, xx, xy, xz, yx, yy, yz, zx, zy, zz)[3]
    gx, gy, gz = goal[0, 0], goal[0, 1], goal[0, 2]
    p2 = (gx - px) ** 2 + (gy - py) ** 2 + (gz - pz) ** 2
    tx, ty, tz = goal[1, 0], goal[1, 1], goal[1, 2]
    ux, uy, uz = goal[2, 0], goal[2, 1], goal[2, 2]
    vx, vy, vz = goal[3, 0], goal[3, 1], goal[3, 2]
    for i in range(joints.shape[0] - 1, -1, -1):
        kind = joints[i, KIND]
        lower, upper = joints[i, LOWER], joints[i, UPPER]
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]
        if kind == SLIDE:
            wanted = q[i] + (ex * (gx - px) + ey * (gy - py) + ez * (gz - pz)) / scale
            moved = min(max(wanted, lower), upper)
            d = scale * (moved - q[i])
            q[i] = moved
            px += d * ex
            py += d * ey
            pz += d * ez
            continue
        if kind == HINGE:
            sx, sy, sz = px - work[i, POINT], py - work[i, POINT + 1], pz - work[i, POINT + 2]
        else:
            sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
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
        if length < 1e-14:  # the joint cannot change the objective
            continue
        c, s = near / length, across / length
        wanted = q[i] + math.atan2(across, near)
        moved = wanted if mode == THROUGH else admit(wanted, lower, upper, mode == WITHIN)
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
    return p2, error_r


@_jit
def turn(vx, vy, vz, ex, ey, ez, c, s):
    """The vector v turned about the unit axis e (paper 003, formula (5))."""
    along = (1.0 - c) * (ex * vx + ey * vy + ez * vz)
    return (
        c * vx + s * (ey * vz - ez * vy) + along * ex,
        c * vy + s * (ez * vx - ex * vz) + along * ey,
        c * vz + s * (ex * vy - ey * vx) + along * ez,
    )


@_jit
def restart_angle(restart, joint):
    """A number in [0, 1) that depends on nothing but its two arguments (splitmix64)."""
    z = (np.uint64(restart) << np.uint64(20)) + np.uint64(joint) + np.uint64(1)
    z *= np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return float(z >> np.uint64(11)) * 2.0**-53


@_jit
def scatter(joints, scale, restart, q0, q):
    """Start number `restart` into `q`: even over the limits, or a turn about q0 (one unit of length for a slide)."""
    for i in range(joints.shape[0]):
        lower, upper = joints[i, LOWER], joints[i, UPPER]
        half = math.pi if joints[i, KIND] != SLIDE else 1.0 / scale
        lower = max(lower, min(q0[i] - half, upper - 2.0 * half))
        upper = min(upper, lower + 2.0 * half)
        q[i] = lower + (upper - lower) * restart_angle(restart, i)


@_jit
def fold(joints, q):
    """Bring hinges that wound up within their limits by whole turns; False if a joint cannot be."""
    for i in range(joints.shape[0]):
        lower, upper = joints[i, LOWER], joints[i, UPPER]
        value = q[i]
        if joints[i, KIND] != SLIDE:
            if value < lower:
                value += _TWO_PI * math.ceil((lower - value) / _TWO_PI)
            elif value > upper:
                value -= _TWO_PI * math.ceil((value - upper) / _TWO_PI)
        if not lower <= value <= upper:
            return False
        q[i] = value
    return True


@_jit
def note(q, trail, row):
    """Joint values into a row of `trail`, if it has that row."""
    if row < trail.shape[0]:
        for i in range(q.shape[0]):
            trail[row, i] = q[i]


@_jit
def descend(joints, ends, scale, goal, tol_p, tol_r, limit, cap, stall, mode, best2, normal, work, q, trail, row):
    """Levenberg-Marquardt from `q` until the tolerances hold, the error stalls or `limit` steps are spent.

    `mode`: ALONG moves within the limits without leaps, WITHIN also leaps by whole turns, THROUGH lets hinges pass
    their limits on the way and only asks that the answer fits them. No joint steps by more than `cap`. A stall is a
    squared error that does not fall to `stall` times itself in STALL_WINDOW steps. `trail` takes the joint values from
    its row `row` on, one a step, as far as it has rows.

    Returns (code, steps, least squared error, position error, orientation error); `q` is where the last two were
    measured. `work[:, BEST]` takes the joint values of the least error if it is under `best2` and within the limits.
    """
    n = joints.shape[0]
    limited = mode != THROUGH
    mark = np.inf
    steps = 0
    while True:
        note(q, trail, row + steps)
        px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
        wx, wy, wz, error_r = rotation_error(goal, xx, xy, xz, yx, yy, yz, zx, zy, zz)
        ex, ey, ez = goal[0, 0] - px, goal[0, 1] - py, goal[0, 2] - pz
        p2 = ex * ex + ey * ey + ez * ez
        error2 = p2 + error_r * error_r
        if p2 <= tol_p * tol_p and error_r <= tol_r:
            code = CONVERGED if limited or fold(joints, q) else STALLED
            return code, steps, best2, math.sqrt(p2), error_r
        if limited and error2 < best2:
            best2 = error2
            for i in range(n):
                work[i, BEST] = q[i]
        if steps % STALL_WINDOW == 0:
            if not error2 < stall * mark:
                return STALLED, steps, best2, math.sqrt(p2), error_r
            mark = error2
        if steps >= limit:
            return EXHAUSTED, steps, best2, math.sqrt(p2), error_r
        columns(joints, scale, px, py, pz, work)
        largest = damped_step(joints, q, limited, DAMPING * error2 + 1e-14, ex, ey, ez, wx, wy, wz, normal, work)
        factor = 1.0 if largest <= cap else cap / largest
        for i in range(n):
            value = q[i] + factor * work[i, STEP]
            slide = joints[i, KIND] == SLIDE
            if limited or slide:
                value = admit(value, joints[i, LOWER], joints[i, UPPER], mode == WITHIN and not slide)
            q[i] = value
        steps += 1


def scratch_size(n: int) -> int:
    """Numbers of scratch memory that a chain of `n` joints needs; `partition` cuts it."""
    return 12 + 48 + n * (WORK + HISTORY)


@_jit
def partition(scratch, n):
    """`goal`, `normal`, `work` and `memory` (see above), as views."""
    after_work = 60 + n * WORK
    return (
        scratch[:12].reshape(4, 3),
        scratch[12:60].reshape(6, 8),
        scratch[60:after_work].reshape(n, WORK),
        scratch[after_work : after_work + n * HISTORY].reshape(n, HISTORY),
    )


@_jit
def begin(joints, ends, scale, X, q0, leaps, goal, q):
    """Set goal and start; returns BAD_TARGET, BAD_START, OUT_OF_REACH or CONVERGED (nothing is wrong)."""
    if not set_goal(ends, scale, X, goal):
        return BAD_TARGET
    for i in range(joints.shape[0]):
        if not math.isfinite(q0[i]):
            return BAD_START
        q[i] = admit(q0[i], joints[i, LOWER], joints[i, UPPER], leaps and joints[i, KIND] != SLIDE)
    x, y, z = goal[0, 0] - ends[0, 0, 3], goal[0, 1] - ends[0, 1, 3], goal[0, 2] - ends[0, 2, 3]
    return OUT_OF_REACH if math.sqrt(x * x + y * y + z * z) > ends[1, 0, 3] else CONVERGED


@_jit
def errors(joints, ends, scale, goal, q, work):
    """Position [scaled] and orientation error at `q`."""
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
    ex, ey, ez = goal[0, 0] - px, goal[0, 1] - py, goal[0, 2] - pz
    error_r = rotation_error(goal, xx, xy, xz, yx, yy, yz, zx, zy, zz)[3]
    return math.sqrt(ex * ex + ey * ey + ez * ez), error_r


@_jit
def recall(joints, ends, scale, goal, work, q):
    """The best joint values seen into `q`; returns their position and orientation errors."""
    for i in range(joints.shape[0]):
        q[i] = work[i, BEST]
    return errors(joints, ends, scale, goal, q, work)


@_jit
def settle(joints, ends, scale, goal, tol_p, tol_r, best2, normal, work, q, trail, row):
    """Go back to the best joint values seen and creep to the bottom of their valley."""
    for i in range(joints.shape[0]):
        q[i] = work[i, BEST]
    code, steps, best2, error_p, error_r = descend(
        joints,
        ends,
        scale,
        goal,
        tol_p,
        tol_r,
        SETTLE_STEPS,
        SHORT_STEP,
        1.0 - 1e-9,
        ALONG,
        best2,
        normal,
        work,
        q,
        trail,
        row,
    )
    if code != CONVERGED:
        error_p, error_r = recall(joints, ends, scale, goal, work, q)
    return code, steps, error_p, error_r


@_jit
def solve_hybrid(joints, ends, scale, X, q0, tol_p, tol_r, limit, restarts, scratch, q, trail):
    """A combined sweep from a far start, then Levenberg-Marquardt, then restarts, every other one THROUGH the limits.

    Returns (code, steps, restarts, position error [scaled], orientation error).
    """
    goal, normal, work, _ = partition(scratch, joints.shape[0])
    fault = begin(joints, ends, scale, X, q0, True, goal, q)
    if fault in (BAD_TARGET, BAD_START):
        return fault, 0, 0, 0.0, 0.0
    if fault == OUT_OF_REACH:
        restarts = min(restarts, 4)
    steps = 0
    best2 = np.inf
    restart = 0
    while True:
        mode = WITHIN if restart % 2 == 0 else THROUGH
        if restart == 0 and ends[1, 1, 3] > 0.0:
            error_p, error_r = errors(joints, ends, scale, goal, q, work)
            if error_p * error_p + error_r * error_r > FAR:
                note(q, trail, steps)
                sweep(joints, ends, scale, goal, FAR_WEIGHT, mode, q, work)
                steps += 1
        code, spent, best2, error_p, error_r = descend(
            joints, ends, scale, goal, tol_p, tol_r, limit - steps, LONG_STEP, STALL_FACTOR, mode, best2,
            normal, work, q, trail, steps,
        )  # fmt: skip
        steps += spent
        if code == CONVERGED:
            return code, steps, restart, error_p, error_r
        if steps >= limit or restart >= restarts:
            break
        restart += 1
        scatter(joints, scale, restart, q0, q)
    code, spent, error_p, error_r = settle(
        joints, ends, scale, goal, tol_p, tol_r, best2, normal, work, q, trail, steps
    )
    if code != CONVERGED:
        code = OUT_OF_REACH if fault == OUT_OF_REACH else EXHAUSTED if steps >= limit else STALLED
    return code, steps + spent, restart, error_p, error_r


@_jit
def handedness(joints, ends, scale, q, work, normal):
    """Sign of det J of a six-joint chain at `q` (0 if singular): it is the same all over a branch."""
    px, py, pz, _, _, _, _, _, _, _, _, _ = trace(joints, ends, scale, q, work)
    columns(joints, scale, px, py, pz, work)
    for i in range(6):
        for k in range(6):
            normal[i, k] = work[i, k]
    sign = 1.0
    for k in range(6):
        pivot = k
        for i in range(k + 1, 6):
            if abs(normal[i, k]) > abs(normal[pivot, k]):
                pivot = i
        if abs(normal[pivot, k]) < 1e-9:
            return 0.0
        if pivot != k:
            sign = -sign
            for c in range(k, 6):
                normal[k, c], normal[pivot, c] = normal[pivot, c], normal[k, c]
        if normal[k, k] < 0.0:
            sign = -sign
        for i in range(k + 1, 6):
            factor = normal[i, k] / normal[k, k]
            for c in range(k + 1, 6):
                normal[i, c] -= factor * normal[k, c]
    return sign


@_jit
def branch_left(joints, ends, scale, q, work, normal):
    """Whether `q` went far from `work[:, START]` and beyond a singular configuration (tested for six joints only)."""
    far = 0.0
    for i in range(joints.shape[0]):
        far = max(far, abs(q[i] - work[i, START]))
    if joints.shape[0] != 6 or far <= SHORT_STEP:
        return False
    end = handedness(joints, ends, scale, q, work, normal)
    return end * handedness(joints, ends, scale, work[:, START], work, normal) < 0.0


@_jit
def solve_keep(joints, ends, scale, X, q0, tol_p, tol_r, limit, scratch, q, trail):
    """Levenberg-Marquardt by short steps from `q0`, without leaps or restarts. Returns as `solve_hybrid`."""
    goal, normal, work, _ = partition(scratch, joints.shape[0])
    fault = begin(joints, ends, scale, X, q0, False, goal, q)
    if fault in (BAD_TARGET, BAD_START):
        return fault, 0, 0, 0.0, 0.0
    for i in range(joints.shape[0]):
        work[i, START] = q[i]
    code, steps, best2, error_p, error_r = descend(
        joints,
        ends,
        scale,
        goal,
        tol_p,
        tol_r,
        limit,
        SHORT_STEP,
        STALL_FACTOR,
        ALONG,
        np.inf,
        normal,
        work,
        q,
        trail,
        0,
    )
    if code != CONVERGED:
        code, spent, error_p, error_r = settle(
            joints, ends, scale, goal, tol_p, tol_r, best2, normal, work, q, trail, steps
        )
        steps += spent
    if code != CONVERGED:
        code = fault if fault == OUT_OF_REACH else code
    elif branch_left(joints, ends, scale, q, work, normal):
        code = BRANCH_LOST
    return code, steps, 0, error_p, error_r


@_jit
def mix(residuals, steps, n, count, memory, normal, q):
    """Anderson's step: g - dG argmin |f - dF y|, from `count` pairs of differences, by regularised normal equations."""
    top = 0.0
    for a in range(count):
        for b in range(a + 1):
            t = 0.0
            for i in range(n):
                t += memory[i, residuals + a] * memory[i, residuals + b]
            normal[a, b] = t
        t = 0.0
        for i in range(n):
            t += memory[i, residuals + a] * memory[i, RESIDUAL]
        normal[a, 6] = t
        top = max(top, normal[a, a])
    for a in range(count):
        for b in range(a):
            t = normal[a, b]
            for k in range(b):
                t -= normal[a, k] * normal[b, k]
            normal[a, b] = t
        d = normal[a, a] + 1e-12 * top + 1e-300
        for k in range(a):
            ld = normal[a, k]
            lower = ld * normal[k, 7]
            d -= lower * ld
            normal[a, 6] -= lower * normal[k, 6]
            normal[a, k] = lower
        normal[a, 7] = 1.0 / d
    for a in range(count - 1, -1, -1):
        t = normal[a, 6] * normal[a, 7]
        for k in range(a + 1, count):
            t -= normal[k, a] * normal[k, 6]
        normal[a, 6] = t
    for i in range(n):
        value = memory[i, SWEPT]
        for a in range(count):
            value -= normal[a, 6] * memory[i, steps + a]
        q[i] = value


@_jit
def accelerate(joints, ends, scale, goal, tol_p, tol_r, limit, mode, best2, normal, work, memory, q, trail, row):
    """Combined sweeps as a fixed-point map g(q) under Anderson acceleration. Arguments and returns as `descend`.

    A mixed step that raises the objective, which plain sweeps never do, is taken back and the memory dropped.
    """
    n = joints.shape[0]
    sweeps, count, slot = 0, 0, 0
    known = False  # whether the memory holds the sweep before this one
    reference, mark = np.inf, np.inf
    while True:
        note(q, trail, row + sweeps)
        for i in range(n):
            memory[i, AT] = q[i]
        p2, error_r = sweep(joints, ends, scale, goal, SWEEP_WEIGHT, mode, q, work)
        error2 = p2 + error_r * error_r
        if p2 <= tol_p * tol_p and error_r <= tol_r:
            for i in range(n):
                q[i] = memory[i, AT]
            code = CONVERGED if mode != THROUGH or fold(joints, q) else STALLED
            return code, sweeps, best2, math.sqrt(p2), error_r
        if mode != THROUGH and error2 < best2:
            best2 = error2
            for i in range(n):
                work[i, BEST] = memory[i, AT]
        if sweeps >= limit:
            return EXHAUSTED, sweeps, best2, math.sqrt(p2), error_r
        sweeps += 1
        objective = p2 + SWEEP_WEIGHT * 8.0 * math.sin(0.5 * error_r) ** 2
        if objective > reference * (1.0 + 1e-9):
            for i in range(n):
                q[i] = memory[i, SWEPT]
            known, count, slot, reference = False, 0, 0, np.inf
            continue
        if sweeps % SWEEP_WINDOW == 1:
            if not objective < SWEEP_FACTOR * mark:
                return STALLED, sweeps, best2, math.sqrt(p2), error_r
            mark = objective
        reference = objective
        for i in range(n):
            residual = q[i] - memory[i, AT]
            memory[i, TURNS + slot] = residual - memory[i, RESIDUAL]
            memory[i, STEPS + slot] = q[i] - memory[i, SWEPT]
            memory[i, RESIDUAL] = residual
            memory[i, SWEPT] = q[i]
        if known:
            count = min(count + 1, DEPTH)
            slot = (slot + 1) % DEPTH
            mix(TURNS, STEPS, n, count, memory, normal, q)
            for i in range(n):
                if mode != THROUGH or joints[i, KIND] == SLIDE:
                    q[i] = min(max(q[i], joints[i, LOWER]), joints[i, UPPER])
        known = True


@_jit
def solve_jacobian_free(joints, ends, scale, X, q0, tol_p, tol_r, limit, restarts, keep, scratch, q, trail):
    """Accelerated combined sweeps with restarts, every other one THROUGH the limits. Returns as `solve_hybrid`."""
    goal, normal, work, memory = partition(scratch, joints.shape[0])
    fault = begin(joints, ends, scale, X, q0, not keep, goal, q)
    if fault in (BAD_TARGET, BAD_START):
        return fault, 0, 0, 0.0, 0.0
    if fault == OUT_OF_REACH:
        restarts = min(restarts, 4)
    for i in range(joints.shape[0]):
        work[i, START] = q[i]
    sweeps, restart, best2 = 0, 0, np.inf
    while True:
        mode = ALONG if keep else WITHIN if restart % 2 == 0 else THROUGH
        code, spent, best2, error_p, error_r = accelerate(
            joints, ends, scale, goal, tol_p, tol_r, limit - sweeps, mode, best2, normal, work, memory, q, trail, sweeps
        )
        sweeps += spent
        if code == CONVERGED:
            if keep and branch_left(joints, ends, scale, q, work, normal):
                code = BRANCH_LOST
            return code, sweeps, restart, error_p, error_r
        if sweeps >= limit or restart >= restarts:
            break
        restart += 1
        scatter(joints, scale, restart, q0, q)
    error_p, error_r = recall(joints, ends, scale, goal, work, q)
    if fault == OUT_OF_REACH:
        code = fault
    return code, sweeps, restart, error_p, error_r


@_jit
def place(joints, ends, scale, goal, tol_p, q, work):
    """One sweep of the position stage, base to tip: formulas (2) to (4) of paper 003; returns |R|^2.

    The target is carried instead of the links: turning all that lies beyond a joint by d is turning the target by -d.
    """
    px, py, pz, _, _, _, _, _, _, _, _, _ = trace(joints, ends, scale, q, work)
    rx, ry, rz = goal[0, 0] - px, goal[0, 1] - py, goal[0, 2] - pz
    for i in range(joints.shape[0]):
        if rx * rx + ry * ry + rz * rz <= tol_p * tol_p:
            break
        lower, upper = joints[i, LOWER], joints[i, UPPER]
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]
        if joints[i, KIND] == SLIDE:
            moved = min(max(q[i] + (ex * rx + ey * ry + ez * rz) / scale, lower), upper)
            d = scale * (moved - q[i])
            q[i] = moved
            rx, ry, rz = rx - d * ex, ry - d * ey, rz - d * ez
            continue
        sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
        if joints[i, KIND] == HINGE:
            sx, sy, sz = px - sx, py - sy, pz - sz
        kx, ky, kz = sx + rx, sy + ry, sz + rz
        near = sx * kx + sy * ky + sz * kz - (ex * sx + ey * sy + ez * sz) * (ex * kx + ey * ky + ez * kz)
        across = ex * (sy * kz - sz * ky) + ey * (sz * kx - sx * kz) + ez * (sx * ky - sy * kx)
        if near * near + across * across < 1e-28:
            continue
        moved = min(max(q[i] + math.atan2(across, near), lower), upper)
        c, s = math.cos(moved - q[i]), math.sin(moved - q[i])
        q[i] = moved
        if joints[i, KIND] == PANTOGRAPH:
            lx, ly, lz = turn(sx, sy, sz, ex, ey, ez, c, s)
            rx, ry, rz = kx - lx, ky - ly, kz - lz
        else:
            kx, ky, kz = turn(kx, ky, kz, ex, ey, ez, c, -s)
            rx, ry, rz = kx - sx, ky - sy, kz - sz
    return rx * rx + ry * ry + rz * rz


@_jit
def align(joints, ends, scale, ux, uy, uz, tx, ty, tz, tolerance, q, work):
    """One sweep of an axis stage, tip to base: bring the axis u of the last joint frame to t; returns their angle."""
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
    ax, ay, az = xx * ux + yx * uy + zx * uz, xy * ux + yy * uy + zy * uz, xz * ux + yz * uy + zz * uz
    angle = angle_between(ax, ay, az, tx, ty, tz)
    for i in range(joints.shape[0] - 1, -1, -1):
        if angle <= tolerance:
            break
        if joints[i, KIND] != HINGE:
            continue
        ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]
        near = ax * tx + ay * ty + az * tz - (ex * ax + ey * ay + ez * az) * (ex * tx + ey * ty + ez * tz)
        across = ex * (ay * tz - az * ty) + ey * (az * tx - ax * tz) + ez * (ax * ty - ay * tx)
        if near * near + across * across < 1e-28:
            continue
        moved = min(max(q[i] + math.atan2(across, near), joints[i, LOWER]), joints[i, UPPER])
        ax, ay, az = turn(ax, ay, az, ex, ey, ez, math.cos(moved - q[i]), math.sin(moved - q[i]))
        q[i] = moved
        angle = angle_between(ax, ay, az, tx, ty, tz)
    return angle


@_jit
def angle_between(ax, ay, az, tx, ty, tz):
    cx, cy, cz = ay * tz - az * ty, az * tx - ax * tz, ax * ty - ay * tx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), ax * tx + ay * ty + az * tz)


@_jit
def goal_axis(goal, ux, uy, uz):
    """The axis u of the last joint frame, where the goal wants it."""
    return (
        ux * goal[1, 0] + uy * goal[2, 0] + uz * goal[3, 0],
        ux * goal[1, 1] + uy * goal[2, 1] + uz * goal[3, 1],
        ux * goal[1, 2] + uy * goal[2, 2] + uz * goal[3, 2],
    )


@_jit
def solve_plain(joints, ends, scale, X, q0, tol_p, tol_r, limit, keep, scratch, q, trail):
    """The stages of paper 003, chapter 3, in turn until all three of formula (6) hold. Returns as `solve_hybrid`.

    The tool axes are those of the last joint frame, whose z is the last joint's axis e_n: unless one tool axis is
    parallel to e_n, the two axis stages undo each other.
    """
    goal, normal, work, _ = partition(scratch, joints.shape[0])
    fault = begin(joints, ends, scale, X, q0, not keep, goal, q)
    if fault in (BAD_TARGET, BAD_START):
        return fault, 0, 0, 0.0, 0.0
    n = joints.shape[0]
    for i in range(n):
        work[i, START] = q[i]
    last = n - 1
    while last > 0 and joints[last, KIND] != HINGE:
        last -= 1
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
    ex, ey, ez = work[last, AXIS], work[last, AXIS + 1], work[last, AXIS + 2]
    # E_z of the paper: the last hinge's axis in the last joint frame. It is z unless slides lie beyond the hinge.
    ux, uy, uz = ex * xx + ey * xy + ez * xz, ex * yx + ey * yy + ez * yz, ex * zx + ey * zy + ez * zz
    if abs(ux) < 0.6:  # E_x: any axis across it
        length = math.sqrt(uy * uy + uz * uz)
        lx, ly, lz = length, -ux * uy / length, -ux * uz / length
    else:
        length = math.sqrt(ux * ux + uy * uy)
        lx, ly, lz = -uy / length, ux / length, 0.0
    tx, ty, tz = goal_axis(goal, ux, uy, uz)
    mx, my, mz = goal_axis(goal, lx, ly, lz)
    tol_a = tol_r * math.sqrt(0.5)  # two axes within tol_a leave the frame within tol_r
    sweeps, best2 = 0, np.inf
    while True:
        note(q, trail, sweeps)
        px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(joints, ends, scale, q, work)
        p2 = (goal[0, 0] - px) ** 2 + (goal[0, 1] - py) ** 2 + (goal[0, 2] - pz) ** 2
        error_r = rotation_error(goal, xx, xy, xz, yx, yy, yz, zx, zy, zz)[3]
        if p2 <= tol_p * tol_p and error_r <= tol_r:
            code = BRANCH_LOST if keep and branch_left(joints, ends, scale, q, work, normal) else CONVERGED
            return code, sweeps, 0, math.sqrt(p2), error_r
        error2 = p2 + error_r * error_r
        if error2 < best2:
            best2 = error2
            for i in range(n):
                work[i, BEST] = q[i]
        if sweeps >= limit:
            error_p, error_r = recall(joints, ends, scale, goal, work, q)
            return (OUT_OF_REACH if fault == OUT_OF_REACH else EXHAUSTED), sweeps, 0, error_p, error_r
        for _ in range(STAGE_SWEEPS):
            note(q, trail, sweeps)
            sweeps += 1
            if place(joints, ends, scale, goal, tol_p, q, work) <= tol_p * tol_p:
                break
        for _ in range(STAGE_SWEEPS):
            note(q, trail, sweeps)
            sweeps += 1
            if align(joints, ends, scale, lx, ly, lz, mx, my, mz, tol_a, q, work) <= tol_a:
                break
        for _ in range(STAGE_SWEEPS):
            note(q, trail, sweeps)
            sweeps += 1
            if align(joints, ends, scale, ux, uy, uz, tx, ty, tz, tol_a, q, work) <= tol_a:
                break


@_jit
def solve_range(method, joints, ends, scale, X, q0, tol_p, tol_r, limit, restarts, keep, first, last, scratch, q, out):
    """Solve targets `first` to `last` of `X` (N, 4, 4) from `q0` (N, n) into `q` (N, n) and `out` (N, 5).

    A row of `out` is what the solver of one target returns.
    """
    trail = q[:0]
    for i in range(first, last):
        if method == JACOBIAN_FREE:
            code, spent, again, error_p, error_r = solve_jacobian_free(
                joints, ends, scale, X[i], q0[i], tol_p, tol_r, limit, restarts, keep, scratch, q[i], trail
            )
        elif method == PLAIN:
            code, spent, again, error_p, error_r = solve_plain(
                joints, ends, scale, X[i], q0[i], tol_p, tol_r, limit, keep, scratch, q[i], trail
            )
        elif keep:
            code, spent, again, error_p, error_r = solve_keep(
                joints, ends, scale, X[i], q0[i], tol_p, tol_r, limit, scratch, q[i], trail
            )
        else:
            code, spent, again, error_p, error_r = solve_hybrid(
                joints, ends, scale, X[i], q0[i], tol_p, tol_r, limit, restarts, scratch, q[i], trail
            )
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = code, spent, again, error_p / scale, error_r

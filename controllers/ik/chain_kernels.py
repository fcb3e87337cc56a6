"""Compiled kinematics of a serial chain for `uuv.controllers.ik`; allocation-free.

A chain and its solver's working memory are one array, `memory`, of `memory_size(n)` numbers, for
one thread at a time. Its type, float64 or float32, is the precision of all arithmetic. `partition`
cuts it into views:

- `table` (HEAD + n, COLUMNS): the chain. Row 0 is the pose of the first joint frame in the base (3
  rows of 4), row 1 the rotation of the tip in the last joint frame (3 rows of 3). Both end with the
  scalars named below. Then one row per joint, its columns named below.
- `goal` (4, 3): the scaled tip position, then the wanted axes of the last joint frame, one per row.
- `normal` (6, 8): normal equations.
- `work` (n, WORK): scratch values per joint, columns named below.
- `past` (n, PAST): values of earlier iterations, kept by a solver.
- `q` (n,): the joint values.

The frame of a joint turns about its z axis by offset + q, moves by the link vector, then turns
about its x axis by alpha to reach the next joint axis. With a free link vector this form describes
any two axes, also parallel ones, and costs two plane rotations per joint.

Lengths are multiplied by `table[0, SCALE]`, a power of two that makes the arm about one unit long.
Metres and radians can then share one norm. A `trail` takes the joint values of every iteration that
it has a row for. A `tip` is the pose
that `trace` returns: position [scaled] and axes x, y, z, each by its three components in base axes.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from uuv.controllers.ik.sine_cosine import cosine_and_sine
from uuv.sim.interfaces.kernels import kernel

# columns of a joint's row of `table`
KIND = 0  # HINGE, SLIDE or PANTOGRAPH
OFFSET = 1  # [rad] constant part of the turn about z
COS_ALPHA = 2  # of the turn about x, to the next joint axis
SIN_ALPHA = 3  # likewise
LINK = 4  # link vector [scaled], three columns; of a pantograph link the part that swings
LOWER = 7  # [rad] or [m]
UPPER = 8  # [rad] or [m]
COS_OFFSET = 9  # of the constant turn about z
SIN_OFFSET = 10  # likewise
AFTER = 11  # part of a pantograph link that does not swing [scaled], three columns
TRAVEL = 11  # of a slide: [m] by which the tip moves per [m] of joint value, 1 without followers
COLUMNS = 14  # their number
HEAD = 2  # rows of `table` before those of the joints
SCALE = 12  # column of row 0: factor of lengths
REACH = 13  # column of row 0: largest distance [scaled] of the tip from the first joint
SWEEPS = 9  # column of row 1: 1 where a sweep from a far start pays off
HINGE, SLIDE, PANTOGRAPH = 0.0, 1.0, 2.0  # values of column KIND

# columns of `work`, and their number
COLUMN, AXIS, POINT, STEP, BEST, START, WORK = 0, 6, 9, 12, 13, 14, 15
PAST = 15  # columns of `past`

CONVERGED, STALLED, EXHAUSTED, BRANCH_LOST, OUT_OF_REACH = 0, 1, 2, 3, 4  # why a solver ended
BAD_TARGET, BAD_START, BAD_OPTION = 5, 6, 7  # input that a solver refuses
HYBRID, JACOBIAN_FREE, PLAIN, PRIORITY = 0, 1, 2, 3  # methods, in `Settings`
# treatment of the limits, see `uuv.controllers.ik.damped_descent.descend`
ALONG, WITHIN, THROUGH = 0, 1, 2

TWO_PI = 2.0 * math.pi  # [rad]
_WALK = 0.1  # [rad] longest step of a joint between two Jacobians that `branch_left` compares
jit = kernel(nogil=True, error_model="numpy", fastmath={"contract"})
# into the caller's loop
inlined = kernel(nogil=True, error_model="numpy", fastmath={"contract"}, inline="always")


class Memory(NamedTuple):
    """Views of a chain's `memory`, described in the module."""

    table: Any
    goal: Any
    normal: Any
    work: Any
    past: Any
    q: Any


class Settings(NamedTuple):
    """Settings of a solver."""

    method: int  # HYBRID, JACOBIAN_FREE, PLAIN or PRIORITY
    tol_p: float  # [m] position tolerance
    # [rad] orientation tolerance; of PLAIN the rotation error that suffices in place of the next
    # two
    tol_r: float
    tol_1: float  # [rad] tolerance of F_alpha1; PLAIN only
    tol_2: float  # [rad] tolerance of F_alpha2; PLAIN only
    limit: int  # largest number of steps or sweeps, restarts included
    restarts: int  # largest number of restarts
    keep: bool  # keep the branch of the start: no restart, no jump by a whole turn
    tip_axes: bool  # see `uuv.controllers.ik.paper_stages.stage_axes`; PLAIN only


class Near(NamedTuple):
    """Squared errors within which a pose is met."""

    p2: Any  # squared position error [scaled]
    chord2: Any  # squared chord of the orientation error


def memory_size(n: int) -> int:
    """Length of the `memory` of a chain of `n` joints."""
    return (HEAD + n) * COLUMNS + 12 + 48 + n * (WORK + PAST + 1)


@jit
def partition(memory, n):
    """Views of `memory`, the array of a chain of `n` joints."""
    goal = (HEAD + n) * COLUMNS
    work = goal + 60
    past = work + n * WORK
    q = past + n * PAST

    return Memory(
        memory[:goal].reshape(HEAD + n, COLUMNS),
        memory[goal : goal + 12].reshape(4, 3),
        memory[goal + 12 : work].reshape(6, 8),
        memory[work:past].reshape(n, WORK),
        memory[past:q].reshape(n, PAST),
        memory[q : q + n],
    )


@jit
def trace(table, q, work):
    """Forward kinematics at `q`: joint axes and points into `work`; returns the tip.

    For a pantograph link, `work[i, POINT:]` holds its link vector instead of its joint's point.
    """
    # Pose of the frame so far: axes x, y, z and origin p, each by its components in base axes
    xx, yx, zx, px = table[0, 0], table[0, 1], table[0, 2], table[0, 3]
    xy, yy, zy, py = table[0, 4], table[0, 5], table[0, 6], table[0, 7]
    xz, yz, zz, pz = table[0, 8], table[0, 9], table[0, 10], table[0, 11]
    for i in range(q.shape[0]):
        row = table[HEAD + i]
        kind = row[KIND]

        # The joint's axis and point, for the Jacobian
        work[i, AXIS] = zx
        work[i, AXIS + 1] = zy
        work[i, AXIS + 2] = zz
        work[i, POINT] = px
        work[i, POINT + 1] = py
        work[i, POINT + 2] = pz

        # Turn about z by offset + q
        if kind == HINGE:
            c, s = cosine_and_sine(q[i] + row[OFFSET])
        else:
            c, s = row[COS_OFFSET], row[SIN_OFFSET]
        xx, yx = c * xx + s * yx, c * yx - s * xx
        xy, yy = c * xy + s * yy, c * yy - s * xy
        xz, yz = c * xz + s * yz, c * yz - s * xz

        # Move by the link vector
        lx, ly, lz = row[LINK], row[LINK + 1], row[LINK + 2]
        if kind == SLIDE:
            lz += table[0, SCALE] * row[TRAVEL] * q[i]
        elif kind == PANTOGRAPH:
            c, s = cosine_and_sine(q[i])
            lx, ly = c * lx - s * ly, s * lx + c * ly
            work[i, POINT] = lx * xx + ly * yx + lz * zx
            work[i, POINT + 1] = lx * xy + ly * yy + lz * zy
            work[i, POINT + 2] = lx * xz + ly * yz + lz * zz
            lx += row[AFTER]
            ly += row[AFTER + 1]
            lz += row[AFTER + 2]
        px += lx * xx + ly * yx + lz * zx
        py += lx * xy + ly * yy + lz * zy
        pz += lx * xz + ly * yz + lz * zz

        # Turn about x by alpha, to the next joint's axis
        c, s = row[COS_ALPHA], row[SIN_ALPHA]
        yx, zx = c * yx + s * zx, c * zx - s * yx
        yy, zy = c * yy + s * zy, c * zy - s * yy
        yz, zz = c * yz + s * zz, c * zz - s * yz

    return px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz


@jit
def column(table, work, i, px, py, pz):
    """Column of the Jacobian (linear; angular) at the tip, from the values that `trace` wrote.

    Args:
        table: the chain.
        work: scratch values, filled by `trace`.
        i: index of the joint.
        px: x of the tip position [scaled], base axes.
        py: y of the tip position [scaled].
        pz: z of the tip position [scaled].

    Returns:
        Six numbers; the first three in scaled length per [rad] or [m].
    """
    kind = table[HEAD + i, KIND]
    ex, ey, ez = work[i, AXIS], work[i, AXIS + 1], work[i, AXIS + 2]

    # Hinge: e x s, with s from the joint to the tip
    if kind == HINGE:
        sx, sy, sz = px - work[i, POINT], py - work[i, POINT + 1], pz - work[i, POINT + 2]
        return ey * sz - ez * sy, ez * sx - ex * sz, ex * sy - ey * sx, ex, ey, ez

    # Slide: along e
    none = px - px
    if kind == SLIDE:
        scale = table[0, SCALE] * table[HEAD + i, TRAVEL]
        return scale * ex, scale * ey, scale * ez, none, none, none

    # Pantograph link: e x s, with s the link; the tip does not turn
    sx, sy, sz = work[i, POINT], work[i, POINT + 1], work[i, POINT + 2]
    return ey * sz - ez * sy, ez * sx - ex * sz, ex * sy - ey * sx, none, none, none


@jit
def forward(table, q, work, X, J):
    """Write tip pose and Jacobian, both unscaled.

    Args:
        table: the chain.
        q: (n,) [rad] or [m] joint values.
        work: scratch values, overwritten.
        X: (4, 4) tip pose in the base frame, out.
        J: (6, n) Jacobian (linear; angular) at the tip in base axes, out.
    """
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = trace(table, q, work)

    scale = table[0, SCALE]
    for i in range(q.shape[0]):
        cx, cy, cz, J[3, i], J[4, i], J[5, i] = column(table, work, i, px, py, pz)
        J[0, i], J[1, i], J[2, i] = cx / scale, cy / scale, cz / scale

    # Axes of the tip, by its rotation in the last joint frame
    for k in range(3):
        wx, wy, wz = table[1, k], table[1, 3 + k], table[1, 6 + k]
        X[0, k] = xx * wx + yx * wy + zx * wz
        X[1, k] = xy * wx + yy * wy + zy * wz
        X[2, k] = xz * wx + yz * wy + zz * wz
        X[3, k] = 0.0
    X[0, 3], X[1, 3], X[2, 3], X[3, 3] = px / scale, py / scale, pz / scale, 1.0


@inlined
def skew_left(goal, tip):
    """Skew part and angle of the rotation from the axes of `tip` to those of the goal.

    Returns:
        Rotation axis times sine, three components in base axes, and the cosine.
    """
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = tip
    real = goal.dtype.type
    half = real(0.5)
    unit = real(1.0)
    tx, ty, tz = goal[1, 0], goal[1, 1], goal[1, 2]
    ux, uy, uz = goal[2, 0], goal[2, 1], goal[2, 2]
    vx, vy, vz = goal[3, 0], goal[3, 1], goal[3, 2]

    # Half the sum of tip axis x goal axis: axis times sine
    wx = half * (xy * tz - xz * ty + yy * uz - yz * uy + zy * vz - zz * vy)
    wy = half * (xz * tx - xx * tz + yz * ux - yx * uz + zz * vx - zx * vz)
    wz = half * (xx * ty - xy * tx + yx * uy - yy * ux + zx * vy - zy * vx)

    # (trace R - 1) / 2
    cosine = half * (
        xx * tx
        + xy * ty
        + xz * tz
        + yx * ux
        + yy * uy
        + yz * uz
        + zx * vx
        + zy * vy
        + zz * vz
        - unit
    )
    return wx, wy, wz, cosine


@jit
def turn_left(goal, tip):
    """Orientation error from the axes of `tip` to those of the goal: axis times chord, and chord^2.

    The chord is 2 sin(angle/2). Near the goal this is the rotation vector; farther away it is
    shorter, and cheaper to compute.

    Returns:
        The three components of the error in base axes, and the squared chord.
    """
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = tip
    real = goal.dtype.type
    unit = real(1.0)
    tx, ty, tz = goal[1, 0], goal[1, 1], goal[1, 2]
    ux, uy, uz = goal[2, 0], goal[2, 1], goal[2, 2]
    vx, vy, vz = goal[3, 0], goal[3, 1], goal[3, 2]

    wx, wy, wz, cosine = skew_left(goal, tip)
    sine2 = wx * wx + wy * wy + wz * wz
    if cosine > real(-0.99):
        factor2 = real(2.0) / (unit + cosine)  # chord^2 / sine^2
        factor = math.sqrt(factor2)
        return wx * factor, wy * factor, wz * factor, sine2 * factor2

    # Near half a turn the skew part vanishes, and R + 1 is nearly 2 a a^T: take its longest column
    # as the axis.
    rx = unit + xx * tx + yx * ux + zx * vx
    ry = unit + xy * ty + yy * uy + zy * vy
    rz = unit + xz * tz + yz * uz + zz * vz

    if rx >= ry and rx >= rz:
        ax, ay, az = rx, ty * xx + uy * yx + vy * zx, tz * xx + uz * yx + vz * zx
    elif ry >= rz:
        ax, ay, az = tx * xy + ux * yy + vx * zy, ry, tz * xy + uz * yy + vz * zy
    else:
        ax, ay, az = tx * xz + ux * yz + vx * zz, ty * xz + uy * yz + vy * zz, rz

    # The axis or its opposite: that along the skew part
    if ax * wx + ay * wy + az * wz < sine2 - sine2:
        ax, ay, az = -ax, -ay, -az

    chord2 = real(2.0) - real(2.0) * cosine
    factor = math.sqrt(chord2 / (ax * ax + ay * ay + az * az))
    return ax * factor, ay * factor, az * factor, chord2


@jit
def pose_error(goal, tip):
    """Error from `tip` to the goal.

    Returns:
        Six numbers in base axes: position error [scaled] and orientation error (see `turn_left`);
            the squared position error and the squared chord.
    """
    ex, ey, ez = goal[0, 0] - tip[0], goal[0, 1] - tip[1], goal[0, 2] - tip[2]
    wx, wy, wz, chord2 = turn_left(goal, tip)
    return (ex, ey, ez, wx, wy, wz), ex * ex + ey * ey + ez * ez, chord2


@jit
def angle_of(chord2):
    """Angle [rad] of a squared chord `chord2`, by atan2."""
    return 2.0 * math.atan2(math.sqrt(chord2), math.sqrt(max(4.0 - chord2, 0.0)))


@jit
def chord_squared(angle):
    """Squared chord of `angle` [rad], to compare with that of `turn_left`."""
    chord = 2.0 * math.sin(0.5 * min(angle, math.pi))
    return chord * chord


@jit
def squared_tolerances(table, settings):
    """Tolerances of `settings`, to compare with the errors of `pose_error`."""
    real = table.dtype.type
    return Near((real(settings.tol_p) * table[0, SCALE]) ** 2, real(chord_squared(settings.tol_r)))


@jit
def set_goal(table, X, goal):
    """Write the target into `goal`, the tip's rotation and the scale folded in.

    Args:
        table: the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        goal: (4, 3) out.

    Returns:
        False if `X` is not a finite pose.
    """
    # Axes orthonormal to 1e-6 and right-handed. A NaN fails every comparison, so it is rejected
    # too.
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

    # Scaled position, and axes of the last joint frame
    for k in range(3):
        goal[0, k] = X[k, 3] * table[0, SCALE]
        wx, wy, wz = table[1, 3 * k], table[1, 3 * k + 1], table[1, 3 * k + 2]
        goal[1 + k, 0] = xx * wx + yx * wy + zx * wz
        goal[1 + k, 1] = xy * wx + yy * wy + zy * wz
        goal[1 + k, 2] = xz * wx + yz * wy + zz * wz
    return good


@jit
def begin(table, X, q0, options_good, leaps, goal, work, q):
    """Validate the input of a solver and set goal and start.

    Args:
        table: the chain.
        X: (4, 4) target pose of the tip in the base frame, [m].
        q0: (n,) [rad] or [m] start.
        options_good: False if an option is out of its range.
        leaps: a hinge beyond its limits may be turned by a whole turn; else it is clamped.
        goal: (4, 3) out.
        work: scratch values; its column START takes the start.
        q: (n,) out, the start within the limits.

    Returns:
        A BAD_ code, OUT_OF_REACH, or CONVERGED if the input is valid.
    """
    if not options_good:
        return BAD_OPTION

    if X.shape[0] != 4 or X.shape[1] != 4 or not set_goal(table, X, goal):
        return BAD_TARGET
    if q0.shape[0] != q.shape[0]:
        return BAD_START

    # The start, within the limits
    for i in range(q.shape[0]):
        if not math.isfinite(q0[i]):
            return BAD_START
        row = table[HEAD + i]
        q[i] = q0[i]
        q[i] = admit(
            q[i], row[LOWER], row[UPPER], leaps and row[KIND] != SLIDE, q.dtype.type(TWO_PI)
        )
        work[i, START] = q[i]

    return reach_fault(table, goal, 0.0)


@inlined
def reach_fault(table, goal, slack):
    """OUT_OF_REACH for a goal farther away than the chain's length plus `slack` [m], else
    CONVERGED.
    """
    x, y, z = goal[0, 0] - table[0, 3], goal[0, 1] - table[0, 7], goal[0, 2] - table[0, 11]
    most = table[0, REACH] + slack * table[0, SCALE]
    return OUT_OF_REACH if math.sqrt(x * x + y * y + z * z) > most else CONVERGED


@jit
def admit(value, lower, upper, hinge, full_turn):
    """Bring a joint value within its limits.

    Args:
        value: [rad] or [m].
        lower: [rad] or [m] lower limit.
        upper: [rad] or [m] upper limit.
        hinge: the joint may be turned by a whole turn.
        full_turn: 2 pi in the precision of the chain.

    Returns:
        `value` if the limits allow it, else the same hinge angle a `full_turn` away, else the
        nearer limit.
    """
    if lower <= value <= upper:
        return value

    if hinge:
        turned = value - full_turn if value > upper else value + full_turn
        if lower <= turned <= upper:
            return turned
    return min(max(value, lower), upper)


@jit
def fold(table, q):
    """Bring wound-up hinges of `q` within their limits by whole turns; False if one stays out."""
    turn = q.dtype.type(TWO_PI)
    for i in range(q.shape[0]):
        lower, upper = table[HEAD + i, LOWER], table[HEAD + i, UPPER]
        value = q[i]

        if table[HEAD + i, KIND] != SLIDE:
            if value < lower:
                value += turn * q.dtype.type(math.ceil((lower - value) / turn))
            elif value > upper:
                value -= turn * q.dtype.type(math.ceil((value - upper) / turn))

        if not lower <= value <= upper:
            return False
        q[i] = value
    return True


@jit
def drawn_in(table, q, most):
    """Move joints of `q` that are up to `most` beyond their limits to the limits; False if one is
    farther.
    """
    turn = q.dtype.type(TWO_PI)
    for i in range(q.shape[0]):
        lower, upper = table[HEAD + i, LOWER], table[HEAD + i, UPPER]
        value = q[i]

        if table[HEAD + i, KIND] != SLIDE:
            if value > upper + most:
                value -= turn * q.dtype.type(math.ceil((value - upper - most) / turn))
            elif value < lower - most:
                value += turn * q.dtype.type(math.ceil((lower - most - value) / turn))

        if not lower - most <= value <= upper + most:
            return False
        q[i] = min(max(value, lower), upper)
    return True


@jit
def restart_angle(restart, joint):
    """Pseudorandom number in [0, 1) of its two arguments only (splitmix64 [Steele 2014])."""
    z = (np.uint64(restart) << np.uint64(20)) + np.uint64(joint) + np.uint64(1)
    z *= np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return float(z >> np.uint64(11)) * 2.0**-53


@jit
def scatter(table, restart, work, q):
    """Write the start of a restart into `q`, spread evenly over the limits.

    The range is at most one turn about the first start (for a slide: one unit of length to either
    side).

    Args:
        table: the chain.
        restart: number of the restart.
        work: scratch values; column START holds the first start.
        q: (n,) out.
    """
    for i in range(q.shape[0]):
        lower, upper = table[HEAD + i, LOWER], table[HEAD + i, UPPER]
        half = math.pi if table[HEAD + i, KIND] != SLIDE else 1.0 / table[0, SCALE]

        # A range of 2 half about the first start, moved where a limit is nearer
        lower = max(lower, min(work[i, START] - half, upper - 2.0 * half))
        upper = min(upper, lower + 2.0 * half)
        q[i] = lower + (upper - lower) * restart_angle(restart, i)


@jit
def at_corner(table, corner, q):
    """Joint values `q` (n,) on their limits: the upper one where bit i of `corner` is set."""
    for i in range(q.shape[0]):
        q[i] = table[HEAD + i, UPPER] if (corner >> i) & 1 else table[HEAD + i, LOWER]


@jit
def note(q, trail, row):
    """Copy joint values into a row of a trail, if the trail has that row.

    Args:
        q: (n,) joint values.
        trail: (rows, n) out.
        row: index of the row.
    """
    if row < trail.shape[0]:
        for i in range(q.shape[0]):
            trail[row, i] = q[i]


@jit
def errors(table, goal, q, work):
    """Squared pose errors at `q`.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        q: (n,) joint values.
        work: scratch values, overwritten.

    Returns:
        Squared position error [scaled] and squared chord of the orientation error.
    """
    _, p2, chord2 = pose_error(goal, trace(table, q, work))
    return p2, chord2


@jit
def recall(table, goal, work, q):
    """Copy the best joint values so far into `q`.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        work: scratch values; column BEST holds the best joint values.
        q: (n,) out.

    Returns:
        Their `errors`.
    """
    for i in range(q.shape[0]):
        q[i] = work[i, BEST]
    return errors(table, goal, q, work)


@jit
def turned_over(work, past, normal, n):
    """Test for a singular configuration between two Jacobians, by a change of orientation.

    The test is the sign of det(J_past J^T), for n < 6 of det(J_past^T J). By Cauchy and Binet it is
    the product of the two determinants for n = 6. Otherwise it is the inner product of their
    minors, which changes sign only across a singular configuration if the two are close together.

    Args:
        work: (n, WORK) the new Jacobian in its first six columns, transposed.
        past: (n, PAST) the Jacobian before, likewise.
        normal: (6, 8) scratch values.
        n: number of joints.

    Returns:
        True if the sign is negative; False if it is positive or cannot be told (a pivot under
        1e-12).
    """
    m = min(n, 6)
    # J_past J^T, for n < 6 J_past^T J
    for a in range(m):
        for b in range(m):
            t = 0.0
            for i in range(max(n, 6)):
                t += past[i, a] * work[i, b] if n >= 6 else past[a, i] * work[b, i]
            normal[a, b] = t

    # Sign of its determinant, by elimination with partial pivoting
    over = False
    for k in range(m):
        pivot = k
        for a in range(k + 1, m):
            if abs(normal[a, k]) > abs(normal[pivot, k]):
                pivot = a
        if abs(normal[pivot, k]) < 1e-12:
            return False

        # A swap of rows changes the sign
        if pivot != k:
            over = not over
            for b in range(k, m):
                normal[k, b], normal[pivot, b] = normal[pivot, b], normal[k, b]
        if normal[k, k] < 0.0:
            over = not over

        for a in range(k + 1, m):
            factor = normal[a, k] / normal[k, k]
            for b in range(k + 1, m):
                normal[a, b] -= factor * normal[k, b]
    return over


@jit
def hand_over(table, q, p2, chord2, code, iterations, restarts, out):
    """Copy the solution into `out` and convert its errors to [m] and [rad].

    Args:
        table: the chain.
        q: (n,) joint values.
        p2: squared position error [scaled].
        chord2: squared chord of the orientation error.
        code: why the solver ended.
        iterations: steps or sweeps.
        restarts: other starts tried.
        out: (n,) out, float64.

    Returns:
        (code, iterations, restarts, position error [m], orientation error [rad]).
    """
    for i in range(q.shape[0]):
        out[i] = q[i]

    return (
        code,
        iterations,
        restarts,
        math.sqrt(p2) / float(table[0, SCALE]),
        angle_of(float(chord2)),
    )


@jit
def branch_left(table, q, near, work, past, normal):
    """Test for a singular configuration on the straight line in joint space from start to `q`.

    A line on which no joint moves more than `near` counts as clear without this test. Where the
    Jacobian is singular everywhere (a planar arm of four joints) no crossing can be detected.

    Args:
        table: the chain.
        q: (n,) joint values of the solution; unchanged on return.
        near: [rad] or [scaled length] joint motion up to which the branch counts as kept.
        work: scratch values; column START holds the start, column BEST is overwritten.
        past: scratch values, overwritten.
        normal: scratch values, overwritten.

    Returns:
        True if the line crosses a singular configuration.
    """
    n = q.shape[0]

    # Longest joint motion; column BEST takes the solution
    far = 0.0
    for i in range(n):
        work[i, BEST] = q[i]
        if table[HEAD + i, KIND] != SLIDE:
            far = max(far, abs(q[i] - work[i, START]))
        else:
            far = max(far, table[0, SCALE] * abs(q[i] - work[i, START]))
    if far <= near:
        return False

    # Along the line in pieces, each Jacobian compared with the one before
    pieces = math.ceil(far / _WALK)
    left = False
    for piece in range(pieces + 1):
        for i in range(n):
            for k in range(6):
                past[i, k] = work[i, COLUMN + k]
            q[i] = work[i, START] + (work[i, BEST] - work[i, START]) * (piece / pieces)

        px, py, pz, _, _, _, _, _, _, _, _, _ = trace(table, q, work)
        for i in range(n):
            work[i, 0], work[i, 1], work[i, 2], work[i, 3], work[i, 4], work[i, 5] = column(
                table, work, i, px, py, pz
            )

        if piece > 0 and turned_over(work, past, normal, n):
            left = True
            break

    for i in range(n):
        q[i] = work[i, BEST]
    return left

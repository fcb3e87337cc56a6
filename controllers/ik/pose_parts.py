"""Parts of a pose error, with tolerances of their own: position, tool axis, turn about it.

The tool axis is the z axis of the tip. A part whose tolerance is infinite does not count: its
weight is zero, and the steps of a descent are free in it. Where every part counts alike, `weights`
is None; the code for weights is then left out when a kernel is compiled.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from uuv.controllers.ik.chain_kernels import (
    BAD_TARGET,
    SCALE,
    Near,
    angle_of,
    at_corner,
    chord_squared,
    inlined,
    jit,
    partition,
    pose_error,
    skew_left,
    squared_tolerances,
    trace,
)

# least share of a weight in the largest one: the squares of both must fit into one matrix
LIGHTEST = 1e-3
# [scaled m/rad], [rad/scaled m] ratio of tolerances from which the parts of a pose have weights
LOPSIDED = 300.0
OPPOSITE = -0.99  # cosine under which two axes count as nearly opposite


class PartTolerances(NamedTuple):
    """Tolerances that split the orientation; infinite ones do not count."""

    axis: float  # [rad] between the tool axis and that wanted
    turn: float  # [rad] about the tool axis


class PartsNear(NamedTuple):
    """Squared errors within which a pose is met part by part; see `measured`."""

    p2: Any  # squared position error [scaled]
    chord2: Any  # squared chord of the whole rotation
    axis2: Any  # squared chord between the tool axes
    turn2: Any  # squared chord of the turn about the tool axis


class Weights(NamedTuple):
    """Factors of the parts of an error, the largest of them 1."""

    position: Any  # of the scaled position
    axis: Any  # [1/rad]
    turn: Any  # [1/rad]


@jit
def counts(angle):
    """True if an orientation tolerance [rad] excludes some rotation: none is longer than pi."""
    return angle < math.pi


def count_alike(scale, tol_p, tol_r):
    """True if position and whole rotation both count, and neither of them far less than the other.

    Args:
        scale: [1/m] by which lengths are multiplied.
        tol_p: [m] position tolerance.
        tol_r: [rad] tolerance of the whole rotation.

    Returns:
        False for a pose that is to be solved for by parts.
    """
    p = scale * tol_p
    return tol_r < math.pi and p <= LOPSIDED * tol_r and tol_r <= LOPSIDED * p


alike = jit(count_alike)  # the same, compiled


@inlined
def options_good(settings, parts):
    """True if the options are in range; without `parts`, position and rotation must both count."""
    good = (
        settings.tol_p > 0.0
        and settings.tol_r > 0.0
        and settings.limit >= 1
        and settings.restarts >= 0
    )
    if parts is None:
        return good and settings.tol_p < np.inf and counts(settings.tol_r)
    return good and parts.axis > 0.0 and parts.turn > 0.0


@jit
def squared_parts(table, settings, parts):
    """Squared tolerances of every part, infinite for those that do not count.

    Args:
        table: the chain.
        settings: with the tolerances of the position and of the whole rotation.
        parts: `PartTolerances`.

    Returns:
        `PartsNear` in the precision of the chain.
    """
    real = table.dtype.type
    whole = settings.tol_r
    axis = parts.axis
    turn = parts.turn

    return PartsNear(
        (real(settings.tol_p) * table[0, SCALE]) ** 2,
        real(chord_squared(whole) if counts(whole) else np.inf),
        real(chord_squared(axis) if counts(axis) else np.inf),
        real(chord_squared(turn) if counts(turn) else np.inf),
    )


@jit
def scaled_weights(table, position2, axis2, turn2):
    """Weights of the parts of an error whose squares are in proportion to three numbers.

    Args:
        table: the chain, for its precision.
        position2: for the position; of these numbers, 0 stands for a part that does not count.
        axis2: for the tool axis.
        turn2: for the turn about the tool axis.

    Returns:
        `Weights`, the largest of them 1, none that counts under LIGHTEST.
    """
    real = table.dtype.type
    none = real(0.0)
    least = real(LIGHTEST)
    largest = max(max(position2, axis2), max(turn2, np.finfo(table.dtype).tiny))

    return Weights(
        max(math.sqrt(position2 / largest), least) if position2 > none else none,
        max(math.sqrt(axis2 / largest), least) if axis2 > none else none,
        max(math.sqrt(turn2 / largest), least) if turn2 > none else none,
    )


@jit
def weights_of(table, near):
    """Weights by which errors count in proportion to their tolerances.

    Args:
        table: the chain.
        near: `PartsNear`.

    Returns:
        `Weights`; a part counts as the tighter of its own tolerance and that of the whole rotation.
    """
    unit = table.dtype.type(1.0)
    return scaled_weights(
        table,
        unit / near.p2,
        unit / min(near.axis2, near.chord2),
        unit / min(near.turn2, near.chord2),
    )


def judged_by(table, settings, parts):
    """Errors within which a pose is met, and the weights of its parts in a descent.

    Args:
        table: the chain.
        settings: with the tolerances of the position and of the whole rotation.
        parts: `PartTolerances`, or None: position and whole rotation count alike.

    Returns:
        `Near` and None, or `PartsNear` and `Weights`.
    """
    if parts is None:
        return squared_tolerances(table, settings), None
    near = squared_parts(table, settings, parts)
    return near, weights_of(table, near)


@overload(judged_by, inline="always")
def _compiled_judged_by(table, settings, parts):
    """Compiled `judged_by`, which has results of two types."""
    del table, settings  # the parts alone decide which
    if isinstance(parts, types.NoneType):
        return lambda table, settings, parts: (squared_tolerances(table, settings), parts)

    def by_parts(table, settings, parts):
        near = squared_parts(table, settings, parts)
        return near, weights_of(table, near)

    return by_parts


@jit
def tool_axis(table, tip):
    """Tool axis, the z axis of the tip, in base axes: three numbers."""
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = tip
    wx, wy, wz = table[1, 2], table[1, 5], table[1, 8]
    return xx * wx + yx * wy + zx * wz, xy * wx + yy * wy + zy * wz, xz * wx + yz * wy + zz * wz


@jit
def tilt_left(table, goal, z):
    """Error between the tool axis and that wanted: rotation axis times chord, and chord^2.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        z: (3,) the tool axis, in base axes.

    Returns:
        Three numbers in base axes, perpendicular to `z`, and the squared chord.
    """
    real = goal.dtype.type
    unit = real(1.0)
    two = real(2.0)

    # The tool axis of the goal
    wx, wy, wz = table[1, 2], table[1, 5], table[1, 8]
    ax = goal[1, 0] * wx + goal[2, 0] * wy + goal[3, 0] * wz
    ay = goal[1, 1] * wx + goal[2, 1] * wy + goal[3, 1] * wz
    az = goal[1, 2] * wx + goal[2, 2] * wy + goal[3, 2] * wz

    tx, ty, tz = z[1] * az - z[2] * ay, z[2] * ax - z[0] * az, z[0] * ay - z[1] * ax
    sine2 = tx * tx + ty * ty + tz * tz
    cosine = z[0] * ax + z[1] * ay + z[2] * az
    if cosine > real(OPPOSITE):
        factor2 = two / (unit + cosine)  # chord^2 / sine^2
        factor = math.sqrt(factor2)
        return tx * factor, ty * factor, tz * factor, sine2 * factor2

    # Opposite axes leave the rotation axis open: any that is perpendicular to both.
    if sine2 < np.finfo(goal.dtype).eps:
        if abs(z[0]) < abs(z[1]):
            tx, ty, tz = z[0] - z[0], z[2], -z[1]
        else:
            tx, ty, tz = -z[2], z[1] - z[1], z[0]
        sine2 = tx * tx + ty * ty + tz * tz

    chord2 = two - two * cosine
    factor = math.sqrt(chord2 / sine2)
    return tx * factor, ty * factor, tz * factor, chord2


@jit
def turn_about(goal, tip, z, axis2):
    """Turn about the tool axis that precedes the shortest rotation to the tool axis wanted.

    In tip axes its sine and cosine are as R10 - R01 to R00 + R11, of the rotation R from the tip to
    the goal. Both vanish where the axes are opposite and the turn is open; it is then 0.

    Args:
        goal: (4, 3) the goal.
        tip: the tip, as of `trace`.
        z: (3,) the tool axis, in base axes.
        axis2: squared chord between the tool axes.

    Returns:
        The chord with its sign, and its square.
    """
    real = goal.dtype.type
    unit = real(1.0)
    two = real(2.0)
    wx, wy, wz, cosine = skew_left(goal, tip)

    # Sine and cosine of the turn, up to a common factor
    s = two * (z[0] * wx + z[1] * wy + z[2] * wz)
    c = two * cosine + real(0.5) * axis2  # trace R - R22
    length = math.sqrt(s * s + c * c)
    if length < real(4.0) * np.finfo(goal.dtype).eps:
        return s - s, s - s

    s, c = s / length, c / length
    turn = (
        s * math.sqrt(two / (unit + c))
        if c > real(OPPOSITE)
        else math.copysign(math.sqrt(two - two * c), s)
    )
    return turn, turn * turn


def measured(table, goal, tip, weights):
    """Error from `tip` to the goal as a descent sees it, and as tolerances judge it.

    With weights, the rotation is split into the turn about the tool axis and the tilt of that axis
    after it.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        tip: the tip, as of `trace`.
        weights: `Weights`, or None: position and whole rotation, each by 1.

    Returns:
        Six numbers in base axes, position and rotation error times their weights; the sum of their
        squares; and the squared errors without weights, as in `Near`, or with weights as in
        `PartsNear`.
    """
    return whole_error(goal, tip) if weights is None else parts_error(table, goal, tip, weights)


@overload(measured, inline="always")
def _compiled_measured(table, goal, tip, weights):
    """Compiled `measured`, which has results of two types."""
    del table, goal, tip  # the weights alone decide which
    if isinstance(weights, types.NoneType):
        return lambda table, goal, tip, weights: whole_error(goal, tip)  # noqa: ARG005
    return lambda table, goal, tip, weights: parts_error(table, goal, tip, weights)


@inlined
def whole_error(goal, tip):
    """`measured` without weights."""
    error, p2, chord2 = pose_error(goal, tip)
    return error, p2 + chord2, (p2, chord2)


@jit
def parts_error(table, goal, tip, weights):
    """`measured` with weights."""
    (px, py, pz, _, _, _), p2, chord2 = pose_error(goal, tip)
    z = tool_axis(table, tip)
    tx, ty, tz, axis2 = tilt_left(table, goal, z)
    turn, turn2 = turn_about(goal, tip, z, axis2)

    a = weights.position
    b = weights.axis
    c = weights.turn * turn
    error = (a * px, a * py, a * pz, b * tx + c * z[0], b * ty + c * z[1], b * tz + c * z[2])
    return error, a * a * p2 + b * b * axis2 + c * c, (p2, chord2, axis2, turn2)


def within(left, near):
    """True if no squared error of `left` exceeds its squared tolerance in `near`."""
    return whole_within(left, near) if len(left) == len(Near._fields) else parts_within(left, near)


@overload(within, inline="always")
def _compiled_within(left, near):
    """Compiled `within`: an index that varies would cost a test of its bounds."""
    del near
    if len(left) == len(Near._fields):
        return lambda left, near: whole_within(left, near)
    return lambda left, near: parts_within(left, near)


@inlined
def whole_within(left, near):
    """`within` for `Near`."""
    return left[0] <= near.p2 and left[1] <= near.chord2


@jit
def parts_within(left, near):
    """`within` for `PartsNear`."""
    return (
        left[0] <= near.p2
        and left[1] <= near.chord2
        and left[2] <= near.axis2
        and left[3] <= near.turn2
    )


@jit
def weighted_column(column, z, weights):
    """Column of the Jacobian (six numbers, linear; angular) of the weighted error.

    Args:
        column: as of `chain_kernels.column`.
        z: (3,) the tool axis, in base axes.
        weights: `Weights`.

    Returns:
        Six numbers.
    """
    c0, c1, c2, c3, c4, c5 = column
    a = weights.position
    b = weights.axis

    turn = (weights.turn - b) * (z[0] * c3 + z[1] * c4 + z[2] * c5)
    return a * c0, a * c1, a * c2, b * c3 + turn * z[0], b * c4 + turn * z[1], b * c5 + turn * z[2]


@jit
def parts_at(table, goal, q, work):
    """Squared errors at `q`, as in `PartsNear`."""
    unit = table.dtype.type(1.0)
    return measured(table, goal, trace(table, q, work), Weights(unit, unit, unit))[2]


@jit
def nearest_corner(table, goal, weights, above, work, q):
    """Write into `q` the corner of the joint limits whose pose error is the least above `above`.

    Args:
        table: the chain.
        goal: (4, 3) the goal.
        weights: of the parts of the error, or None.
        above: squared error, as of `measured`.
        work: scratch values.
        q: (n,) out.

    Returns:
        Its squared error; infinite without such a corner.
    """
    n = q.shape[0]
    least = q.dtype.type(np.inf)
    nearest = 0

    for corner in range(1 << n):
        at_corner(table, corner, q)
        _, error2, _ = measured(table, goal, trace(table, q, work), weights)
        if above < error2 < least:
            least = error2
            nearest = corner

    at_corner(table, nearest, q)
    return least


@jit
def split(memory, code, q):
    """Angle between the tool axes and turn about the tool axis [rad]; zeros for a refused input.

    Args:
        memory: kernel memory of the chain, which holds the goal.
        code: of the solver.
        q: (n,) joint values.
    """
    if code >= BAD_TARGET:
        return 0.0, 0.0

    views = partition(memory, q.shape[0])
    for i in range(q.shape[0]):
        views.q[i] = q[i]

    _, _, axis2, turn2 = parts_at(views.table, views.goal, views.q, views.work)
    return angle_of(float(axis2)), angle_of(float(turn2))

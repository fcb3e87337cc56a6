"""Poses, rotations and wrenches on plain numpy arrays, and validation of numerical input.

A pose `X_AB` is a (4, 4) homogeneous matrix that takes coordinates in B to coordinates in A.
Quaternions are `wxyz` and say so in their name. Six-vectors are (linear; angular), at the
body-frame origin, in body axes.
"""

import math
import reprlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean, one_line

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_FLOAT64 = np.dtype(np.float64)

GRAVITY = 9.81  # [m/s^2], along -z of W
FARTHEST = 1e9  # [m] largest accepted coordinate; float64 resolves a micrometre up to there
_EYE = np.eye(3)
_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])


def readonly(values: ArrayLike) -> Array:
    """Read-only float64 copy of `values`."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def shown(value: Any) -> str:
    """Text of any `value` for an error message, in one line of at most 80 characters."""
    try:
        if isinstance(value, np.ndarray | np.generic):
            small = value.size <= _FEW
            text = (
                repr(value.tolist()) if small else (f"{value.dtype} numbers of shape {value.shape}")
            )
        else:
            text = _REPR.repr(value)
    except (
        Exception
    ):  # the __repr__ of another package failed, or an int has more digits than Python prints
        text = f"a {type(value).__name__}"
    return one_line(text, _MOST_SHOWN)


_MOST_SHOWN = 80  # [characters] longest text of a value in a message
_FEW = 16  # largest array that is printed in full, which is a pose
_REPR = reprlib.Repr()
_REPR.maxlist = _REPR.maxtuple = _REPR.maxdict = _REPR.maxset = 6
_REPR.maxlong = 30
_REPR.maxstring = _MOST_SHOWN
_REPR.maxother = _MOST_SHOWN


def unit_vector(values: ArrayLike, name: str) -> Array:
    """Read-only unit vector (3,) along `values` (3,).

    Raises:
        ConfigurationError: `values` is not a finite vector (3,), or it is zero; the message begins
            with `name`.
    """
    vector = checked(values, (3,), name)

    largest = float(np.abs(vector).max())
    if not largest > 1e-9:
        raise ConfigurationError(f"{name}: must not be zero")
    vector = vector / largest  # the square of a very long vector would overflow
    return readonly(vector / np.linalg.norm(vector))


def checked_place(
    values: ArrayLike, shape: tuple[int, ...], name: str, farthest: float = FARTHEST
) -> Array:
    """Read-only copy of positions, validated as by `checked` and for their distance from the
    frame's origin.

    Args:
        values: Positions [m].
        shape: Required shape.
        name: Begins the error message.
        farthest: Largest coordinate [m].

    Returns:
        Positions [m], float64.

    Raises:
        ConfigurationError: `checked` refuses the values, or a coordinate is larger than `farthest`.
    """
    points = checked(values, shape, name)
    if points.size and np.abs(points).max() > farthest:
        raise ConfigurationError(
            f"{name}: must be within {farthest:g} m of the origin, got {np.abs(points).max():g} m"
        )
    return points


def real_array(values: Any, name: str, wanted: str = "numbers") -> Array:
    """New float64 array of `values`, of any shape.

    Args:
        values: Anything that numpy can convert; inf and NaN are accepted.
        name: Begins the error message.
        wanted: Description of the expected input for the message.

    Returns:
        The array.

    Raises:
        ConfigurationError: `values` are no real numbers; complex numbers, strings and dates are
            refused.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biufO":
            raise TypeError(f"{array.dtype} is not a real number")
        with np.errstate(over="ignore"):  # a float beyond float64 becomes infinite
            return np.array(array, dtype=np.float64)
    except Exception as error:  # a foreign `__array__` or `__float__` can raise anything
        raise ConfigurationError(f"{name}: expected {wanted}, got {shown(values)}") from error


def checked(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Read-only float64 copy of `values`, validated for shape and finiteness.

    Args:
        values: Real numbers; complex numbers and strings are refused.
        shape: Required shape.
        name: Begins the error message.

    Returns:
        The copy.

    Raises:
        ConfigurationError: The shape differs, or a number is not finite.
    """
    array = real_array(values, name, f"{shape} numbers")
    if array.shape != shape:
        raise ConfigurationError(f"{name}: expected shape {shape}, got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ConfigurationError(f"{name}: every number must be finite, got {shown(array)}")
    array.setflags(write=False)
    return array


def checked_rows(values: ArrayLike, width: int, name: str, least: int = 1) -> Array:
    """Read-only float64 copy of `values` (n, `width`).

    Args:
        values: Finite real numbers.
        width: Required number of columns.
        name: Begins the error message.
        least: Smallest number of rows.

    Returns:
        The copy.

    Raises:
        ConfigurationError: The shape differs, there are too few rows, or a number is not finite.
    """
    array = real_array(values, name, f"(n, {width}) numbers")
    if array.ndim != 2 or array.shape[1] != width or len(array) < least:
        raise ConfigurationError(
            f"{name}: expected shape (n, {width}), n >= {least}, got {array.shape}"
        )
    return checked(array, array.shape, name)


def checked_pose(values: ArrayLike, name: str) -> Array:
    """Read-only copy of the pose `values` (4, 4).

    Raises:
        ConfigurationError: `values` is no pose, or its position is beyond FARTHEST.
    """
    X = checked(values, (4, 4), name)
    R = X[:3, :3]

    # Plain differences of finite numbers, since np.allclose takes ten times as long.
    rigid = (
        np.abs(R).max() < 2.0 and np.abs(R.T @ R - _EYE).max() <= 1e-6 and np.linalg.det(R) > 0.0
    )
    if not (rigid and np.abs(X[3] - _LAST_ROW).max() <= 1e-9):
        raise not_a_pose(name, X)
    if np.abs(X[:3, 3]).max() > FARTHEST:
        raise ConfigurationError(
            f"{name}: its position must be within {FARTHEST:g} m of the origin, got "
            f"{shown(X[:3, 3])}"
        )
    return X


def not_a_pose(name: str, X: Array) -> ConfigurationError:
    """Error for a matrix `X` (4, 4) that is no pose."""
    return ConfigurationError(
        f"{name}: expected a pose (right-handed rotation to 1e-6, translation, last row 0 0 0 1), "
        f"got {shown(X)}"
    )


def fitting(values: Array, shape: tuple[int, ...], name: str) -> Array:
    """Validated array for loops, in about 1 us: `values` itself if `checked` returned it before,
    otherwise a checked copy.

    Args:
        values: Real numbers.
        shape: Required shape.
        name: Begins the error message.

    Returns:
        Float64 array; it may be `values` itself.

    Raises:
        ConfigurationError: `checked` refuses the values.
    """
    plain = type(values) is np.ndarray and values.shape == shape and values.dtype == _FLOAT64
    if plain and math.isfinite(np.vdot(values, values)):
        return values
    return checked(values, shape, name).copy()


def number(value: Any, name: str) -> float:
    """`value` as a float; inf and NaN are accepted.

    Raises:
        ConfigurationError: `value` is not one real number that a float can hold.
    """
    if type(value) is float:
        return value
    try:
        array = np.asarray(value)
        if array.ndim or array.dtype.kind not in "iuf":
            raise TypeError
        with np.errstate(over="ignore"):
            return float(array)
    except Exception as error:
        raise ConfigurationError(f"{name}: expected a number, got {shown(value)}") from error


def spread_directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly over the sphere: the six axes first, then a Fibonacci
    spiral.
    """
    axes = np.vstack([np.eye(3), -np.eye(3)])

    rest = count - len(axes)
    if rest <= 0:
        return axes[:count]

    # Equal steps of height have equal areas. Steps of the golden angle spread neighbouring points.
    k = np.arange(rest) + 0.5
    z = 1.0 - 2.0 * k / rest
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.vstack([axes, np.column_stack([r * np.cos(turn), r * np.sin(turn), z])])


def finite_number(
    value: Any,
    name: str,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
) -> float:
    """`value` as a finite float within bounds.

    Args:
        value: Candidate.
        name: Begins the error message.
        above: Exclusive lower bound.
        least: Inclusive lower bound.
        most: Inclusive upper bound.

    Returns:
        The float.

    Raises:
        ConfigurationError: `value` is not finite or out of bounds.
    """
    scalar = number(value, name)
    if math.isfinite(scalar) and scalar > above and least <= scalar <= most:
        return scalar

    word = "positive and finite" if above == 0.0 else "finite"
    bounds = ((">", above if above else -math.inf), (">=", least), ("<=", most))
    limits = "".join(f", {sign} {bound:g}" for sign, bound in bounds if math.isfinite(bound))
    raise ConfigurationError(f"{name}: must be {word}{limits}, got {scalar:g}")


def whole_number(value: Any, name: str, *, least: int = 0, most: int | None = None) -> int:
    """`value` as an int within bounds; True and 2.0 are refused.

    Args:
        value: Candidate.
        name: Begins the error message.
        least: Inclusive lower bound.
        most: Inclusive upper bound; None: unbounded.

    Returns:
        The int.

    Raises:
        ConfigurationError: `value` is no int or out of bounds.
    """
    kind = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not kind or value < least or (most is not None and value > most):
        allowed = f">= {least}" if most is None else f"in {least}..{most}"
        raise ConfigurationError(f"{name}: must be a whole number {allowed}, got {shown(value)}")
    return int(value)


def one_of(value: Any, allowed: Iterable[str], name: str) -> str:
    """`value`, if it is one of the words `allowed`.

    Args:
        value: Candidate.
        allowed: Permitted words.
        name: Begins the error message.

    Returns:
        The word.

    Raises:
        ConfigurationError: `value` is none of them.
    """
    words = tuple(allowed)
    if not isinstance(value, str) or value not in words:
        suggestion = did_you_mean(value, words)
        raise ConfigurationError(
            f"{name}: allowed {', '.join(words)}, got {shown(value)}{suggestion}"
        )
    return value


def pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """Pose (4, 4) with rotation `R` (3, 3), default identity, and position `p` (3,) [m], default
    zero.
    """
    X = np.eye(4)
    if R is not None:
        X[:3, :3] = R
    if p is not None:
        X[:3, 3] = p
    return X


def inverse(X_AB: Array) -> Array:
    """Inverse pose X_BA (4, 4)."""
    X_BA = np.eye(4)
    R_BA = X_AB[:3, :3].T
    X_BA[:3, :3] = R_BA
    X_BA[:3, 3] = -R_BA @ X_AB[:3, 3]
    return X_BA


def transform_points(X_AB: Array, p_B: Array) -> Array:
    """Points (N, 3) or (3,) [m] in B, expressed in A."""
    return p_B @ X_AB[:3, :3].T + X_AB[:3, 3]


def skew(v: ArrayLike) -> Array:
    """Cross-product matrix S (3, 3) of `v`: S @ u = v x u."""
    x, y, z = np.asarray(v, dtype=np.float64).tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Array, b: Array) -> tuple[float, float, float]:
    """Cross product of two vectors (3,) with the bits of `np.cross`, which takes as long as a
    physics step.
    """
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def exp_so3(phi: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of the rotation vector `phi` (3,) [rad] (Rodrigues' formula)."""
    x, y, z = np.asarray(phi, dtype=np.float64).tolist()
    square = x * x + y * y + z * z
    # Scalars throughout, since numpy's calls on three numbers cost ten times as much as the sums.
    if square < 1e-12:
        s, c = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = math.sqrt(square)
        s = math.sin(angle) / angle
        c = (1.0 - math.cos(angle)) / square

    # R = I + s [phi] + c [phi]^2
    rows = (
        1.0 - c * (y * y + z * z),
        c * x * y - s * z,
        c * x * z + s * y,
        c * x * y + s * z,
        1.0 - c * (x * x + z * z),
        c * y * z - s * x,
        c * x * z - s * y,
        c * y * z + s * x,
        1.0 - c * (x * x + y * y),
    )
    return np.array(rows).reshape(3, 3)  # converting nested lists takes twice as long


def log_so3(R: Array) -> Array:
    """Rotation vector (3,) [rad] of `R`, of length in [0, pi]; exact near 0 and near pi."""
    return np.array(rotation_vector_of(quaternion_of(R.tolist())))


def rotation_vector_of(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Rotation vector [rad] of a unit quaternion (w, x, y, z); also called from compiled code."""
    w, x, y, z = quaternion
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z

    # sin(angle/2) is the length of the vector part. The ratio of this length to the angle tends to
    # 1/2.
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    return scale * x, scale * y, scale * z


def rotation_angle(R_a: Array, R_b: Array) -> float:
    """Angle [rad] of the rotation from `R_a` to `R_b`."""
    return float(np.linalg.norm(log_so3(R_a.T @ R_b)))


def rotation_from_quat_wxyz(quat_wxyz: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z), which is normalised first."""
    q = np.asarray(quat_wxyz, dtype=np.float64)
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_wxyz_from_rotation(R: Array) -> Array:
    """Unit quaternion (w, x, y, z) of `R`, computed from its largest component [Shepperd 1978] and
    therefore exact near pi.
    """
    return np.array(quaternion_of(R.tolist()))


def quaternion_of(rows: Sequence[Sequence[float]]) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z) from the three rows of a rotation; also called from compiled
    code.
    """
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rows

    # Division is by the largest of the four components, so that no near numbers are subtracted.
    trace = r00 + r11 + r22
    if trace >= max(r00, r11, r22):
        w, x, y, z = 1.0 + trace, r21 - r12, r02 - r20, r10 - r01
    elif r00 >= max(r11, r22):
        w, x, y, z = r21 - r12, 1.0 + r00 - r11 - r22, r10 + r01, r20 + r02
    elif r11 >= r22:
        w, x, y, z = r02 - r20, r01 + r10, 1.0 + r11 - r00 - r22, r21 + r12
    else:
        w, x, y, z = r10 - r01, r02 + r20, r12 + r21, 1.0 + r22 - r00 - r11

    length = math.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length


def rotation_from_z(z: ArrayLike, x_hint: ArrayLike) -> Array:
    """Rotation (3, 3) whose z axis is `z` (3,) and whose x axis is `x_hint` (3,) made perpendicular
    to it.

    Raises:
        ConfigurationError: `z` or `x_hint` is zero, or they are parallel.
    """
    z_axis = np.asarray(z, dtype=np.float64)
    z_axis = z_axis / max(float(np.linalg.norm(z_axis)), 1e-300)

    x_axis = np.asarray(x_hint, dtype=np.float64)
    x_axis = x_axis - (x_axis @ z_axis) * z_axis
    length = float(np.linalg.norm(x_axis))
    if not length > 1e-9:
        raise ConfigurationError(f"x_hint {x_hint} must not be zero or parallel to z {z}")
    x_axis /= length

    R = np.empty((3, 3))
    R[:, 0] = x_axis
    R[:, 1] = cross(z_axis, x_axis)
    R[:, 2] = z_axis
    return R

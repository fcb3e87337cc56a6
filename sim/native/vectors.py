"""Vectors of three numbers as tuples, inlined into the kernels of the water.

Plain tuples stay in registers, while numba's arrays would go through memory. A number is one float,
or four lanes (`uuv.sim.native.simd4`), so that the same function works for one body or four. An
address is an integer.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from numba import njit

from uuv.sim.native.native_memory import f64, put

P = ParamSpec("P")
T = TypeVar("T")
Number = Any
Vector = tuple[Number, Number, Number]
Matrix = tuple[Vector, Vector, Vector]  # rows


def inline(function: Callable[P, T]) -> Callable[P, T]:
    """Compile into the callers. A multiply and an add may be fused, but sums are not reordered."""
    return njit(function, forceinline=True, error_model="numpy", fastmath={"contract"})


@inline
def load3(address: int, index: int) -> Vector:
    """Three float64 that begin 8 * `index` bytes after `address`."""
    return f64(address, index), f64(address, index + 1), f64(address, index + 2)


@inline
def plus(a: Vector, b: Vector) -> Vector:
    """Sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inline
def minus(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def scaled(s: Number, a: Vector) -> Vector:
    """Multiple s a."""
    return s * a[0], s * a[1], s * a[2]


@inline
def dot(a: Vector, b: Vector) -> Number:
    """Inner product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a: Vector, b: Vector) -> Vector:
    """Cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def load6(address: int, index: int) -> tuple[Vector, Vector]:
    """Six float64 that begin 8 * `index` bytes after `address`."""
    return load3(address, index), load3(address, index + 3)


@inline
def put3(address: int, index: int, v: Vector) -> None:
    """Store three float64, beginning 8 * `index` bytes after `address`."""
    put(address, index, v[0])
    put(address, index + 1, v[1])
    put(address, index + 2, v[2])


@inline
def times(R: Matrix, v: Vector) -> Vector:
    """Product R v."""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


@inline
def transposed(R: Matrix) -> Matrix:
    """R^T."""
    return (R[0][0], R[1][0], R[2][0]), (R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2])


@inline
def turned(R: Matrix, X: Matrix) -> Matrix:
    """Rotated matrix R X R^T."""
    X = transposed(X)
    Y = transposed((times(R, X[0]), times(R, X[1]), times(R, X[2])))

    return times(R, Y[0]), times(R, Y[1]), times(R, Y[2])


@inline
def symmetric(a: Number, b: Number, c: Number, d: Number, e: Number, f: Number) -> Matrix:
    """Symmetric matrix from its upper triangle, by rows."""
    return (a, b, c), (b, d, e), (c, e, f)


@inline
def turned_symmetric(R: Matrix, X: Matrix) -> Matrix:
    """R X R^T of a symmetric X."""
    Y = times(R, X[0]), times(R, X[1]), times(R, X[2])
    a, b, c = transposed(Y)
    first = dot(R[0], a), dot(R[1], a), dot(R[2], a)

    # The other entries of the upper triangle.
    return symmetric(*first, dot(R[1], b), dot(R[2], b), dot(R[2], c))


@inline
def rows(address: int, index: int) -> Matrix:
    """Matrix of nine float64 that begin 8 * `index` bytes after `address`."""
    return load3(address, index), load3(address, index + 3), load3(address, index + 6)

"""Vectors of three numbers as tuples, inlined into the kernels of the water.

Plain tuples stay in registers; numba's arrays would go through memory. A number is one float, or four lanes
(`uuv.sim.water.simd4`): the same function then serves one body or four. An address is an integer.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from numba import njit

from uuv.sim.water.native_memory import f64

P = ParamSpec("P")
T = TypeVar("T")
Number = Any
Vector = tuple[Number, Number, Number]


def inline(function: Callable[P, T]) -> Callable[P, T]:
    """Compile into the callers; a multiply and an add may be fused, but sums are not reordered."""
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

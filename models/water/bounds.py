"""Validation of hydrodynamic coefficients: shape, sign, and bounds larger than for any real
body.
"""

import warnings
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError, PhysicsWarning
from uuv.sim.interfaces.spatial import Array, checked, readonly

SEA_WATER: Final = 1025.0  # [kg/m^3] default density of the water
LARGEST: Final = 1e15  # [SI] bound of any coefficient, larger than for any real body
LONGEST: Final = 1e5  # [m] largest extent of a shape
SHORTEST: Final = 1e-6  # [m] smallest extent of a shape
THINNEST: Final = 1e-6  # smallest ratio of a shape's shortest to its longest extent
# largest asymmetry of an added mass that counts as rounding, as a share of its largest number
UNEVEN: Final = 1e-3


def bounded(
    values: ArrayLike, shape: tuple[int, ...], name: str, largest: float = LARGEST
) -> Array:
    """Read-only copy of `values`, of a shape and within `largest`; else ConfigurationError."""
    array = checked(values, shape, name)
    if np.any(np.abs(array) > largest):
        raise ConfigurationError(f"{name}: must not exceed {largest:g}, got {array.tolist()}")
    return array


def lengths(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Read-only copy of positive lengths [m] of one shape; else ConfigurationError."""
    array = bounded(values, shape, name, LONGEST)
    if np.any(array <= 0.0):
        raise ConfigurationError(f"{name}: must be positive, got {array.tolist()}")

    if array.min() < max(SHORTEST, THINNEST * array.max()):
        raise ConfigurationError(
            f"{name}: must be at least {SHORTEST:g} and {THINNEST:g} of the longest, got "
            f"{array.tolist()}"
        )

    return array


def not_negative(value: float, name: str) -> float:
    """`value` as a float >= 0; else ConfigurationError."""
    number = float(bounded([value], (1,), name)[0])
    if number < 0.0:
        raise ConfigurationError(f"{name}: must not be negative, got {number}")
    return number


def positive(value: float, name: str) -> float:
    """`value` as a float of at least 1 / LARGEST; else ConfigurationError."""
    number = not_negative(value, name)
    if number == 0.0:
        raise ConfigurationError(f"{name}: must be positive, got {number}")
    if number < 1.0 / LARGEST:
        raise ConfigurationError(f"{name}: must be at least {1.0 / LARGEST:g}, got {number}")
    return number


def segment(start: ArrayLike, end: ArrayLike, name: str) -> tuple[Array, Array]:
    """Ends (3,) [m] of a segment; ConfigurationError if they coincide."""
    first = bounded(start, (3,), f"{name} start", LONGEST)
    last = bounded(end, (3,), f"{name} end", LONGEST)

    if not float(np.linalg.norm(last - first)) > 1e-9:
        raise ConfigurationError(f"{name}: start {first.tolist()} and end {last.tolist()} coincide")
    return first, last


def inertia_matrix(values: ArrayLike) -> Array:
    """Added mass (6, 6), symmetric and positive semidefinite; else ConfigurationError.

    An asymmetry of up to UNEVEN times the largest number is averaged out, with a PhysicsWarning.
    """
    matrix = bounded(values, (6, 6), "added_mass")
    largest = float(np.max(np.abs(matrix)))
    uneven = np.abs(matrix - matrix.T)

    i, j = np.unravel_index(np.argmax(uneven), (6, 6))

    if uneven[i, j] > 1e-9 * largest:
        fault = (
            f"added_mass: not symmetric, [{i}, {j}] = {matrix[i, j]}, [{j}, {i}] = {matrix[j, i]}"
        )
        if uneven[i, j] > UNEVEN * largest:
            raise ConfigurationError(fault)
        warnings.warn(f"{fault}; the mean of the two is used", PhysicsWarning, 4)

    return _semidefinite(readonly(0.5 * (matrix + matrix.T)), "added_mass")


def damping_matrix(values: ArrayLike) -> Array:
    """Linear damping (6, 6) from (6,) or (6, 6) values; ConfigurationError unless it is
    dissipative.
    """
    try:
        shape = np.shape(values)
    except ValueError as error:
        raise ConfigurationError(
            f"linear_damping: expected shape (6,) or (6, 6), got {values!r}"
        ) from error
    if shape not in ((6,), (6, 6)):
        raise ConfigurationError(f"linear_damping: expected shape (6,) or (6, 6), got {shape}")

    matrix = bounded(values, shape, "linear_damping")
    if shape == (6,):
        if np.any(matrix < 0.0):
            raise ConfigurationError(f"linear_damping: must not be negative, got {matrix.tolist()}")
        return readonly(np.diag(matrix))

    return _semidefinite(matrix, "symmetric part of linear_damping")


def _semidefinite(matrix: Array, name: str) -> Array:
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if eigenvalues[0] < -1e-9 * max(float(eigenvalues[-1]), 1e-300):
        raise ConfigurationError(
            f"{name}: has a negative eigenvalue, {eigenvalues[0]:.6g}; it would add energy"
        )
    return matrix

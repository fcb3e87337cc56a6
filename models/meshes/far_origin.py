"""Shift of the origin of a mesh with large coordinates, so that single precision and squared
lengths stay exact.
"""

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.spatial import Array

_FAR = 8.0  # [sizes] distance of the middle from the origin, above which rounding errors matter


def middle_if_far(points: ArrayLike) -> Array:
    """Middle (3,) [m] of the bounding box of points (n, 3) many sizes from the origin; else zero.

    Such coordinates lose digits in single precision: 0.5 mm at 10 km. Subtract this middle before
    working on the points. For points near the origin it is zero, so that they stay unchanged to the
    last bit. Points that are not finite are ignored.
    """
    coordinates = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    finite = (
        coordinates
        if np.isfinite(coordinates).all()
        else coordinates[np.isfinite(coordinates).all(axis=1)]
    )
    if not len(finite):
        return np.zeros(3)

    low = finite.min(axis=0)
    high = finite.max(axis=0)
    middle = 0.5 * low + 0.5 * high
    far = float(np.abs(middle).max()) > _FAR * float(np.linalg.norm(high - low))
    return middle if far else np.zeros(3)

"""Solid angle of a triangle from a point, compiled; panels and winding numbers are sums of it."""

import math

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array


@kernel(error_model="numpy")
def half_solid_angle(r: Array, d: Array) -> float:
    """Half the signed solid angle [sr] of a triangle, by [Oosterom 1983].

    Args:
        r: (3, 3) [m] corners relative to the point, one per row.
        d: (3,) [m] distances of the corners from the point.

    Returns:
        The half solid angle, positive if the corners are counterclockwise seen from the other side
            of the triangle.
    """
    triple = (
        r[0, 0] * (r[1, 1] * r[2, 2] - r[1, 2] * r[2, 1])
        + r[0, 1] * (r[1, 2] * r[2, 0] - r[1, 0] * r[2, 2])
        + r[0, 2] * (r[1, 0] * r[2, 1] - r[1, 1] * r[2, 0])
    )

    d01 = r[0, 0] * r[1, 0] + r[0, 1] * r[1, 1] + r[0, 2] * r[1, 2]
    d12 = r[1, 0] * r[2, 0] + r[1, 1] * r[2, 1] + r[1, 2] * r[2, 2]
    d20 = r[2, 0] * r[0, 0] + r[2, 1] * r[0, 1] + r[2, 2] * r[0, 2]
    return math.atan2(triple, d[0] * d[1] * d[2] + d01 * d[2] + d12 * d[0] + d20 * d[1])

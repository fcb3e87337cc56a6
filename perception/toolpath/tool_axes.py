"""Tool axes into a deviating surface, from the deviation's slopes and from the scan alone."""

import numpy as np
from scipy.spatial import cKDTree

from uuv.models.objects.targets import ModelPath
from uuv.perception.registration.evidence import Evidence
from uuv.perception.toolpath.path_deviation import NOISE_PATCH, SAME_FACE, SPREAD, Deviation
from uuv.sim.interfaces.spatial import Array

_SLOPE_NOISE = 0.035  # [rad] noise of an axis from the scan alone
_WIDTHS = (0.008, 0.03)  # [m] least and largest width of the Gaussian for an axis
_FITTED = 12  # least number of points for an axis
# [-] condition of the parabola's normal equations, beyond which the points are on one side or on a
# line
_ILL_CONDITIONED = 1e4


def tilted_axis(path: ModelPath, deviation: Deviation) -> Array:
    """Tool axes (n, 3) into the deviating surface, from the surface's slopes along and across the
    path.
    """
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p, axis=0), axis=1))])
    along, across = np.gradient(deviation.along_o, s), deviation.share * deviation.across
    c = np.cross(path.a, path.b)
    normal = np.cross(path.b + along[:, None] * deviation.o, c + across[:, None] * deviation.o)
    # a x b = c, so b x c = a: the same side as the transformed axis.
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def scanned_axis(evidence: Evidence, p: Array, z: Array) -> tuple[Array, np.ndarray]:
    """Axes into the scanned surface at points of a path, by a parabola around each.

    The parabola is weighted by a Gaussian as narrow as the sensor's noise allows, because a wide
    one is biased where the surface bends.

    Args:
        evidence: Scan of the object.
        p: (n, 3) [m] points on the surface, in S.
        z: (n, 3) approximate unit axes into the surface, in S.

    Returns:
        Unit axes (n, 3) in S, and the mask (n,) of axes that enough points determine; the other
            axes are those of `z`.
    """
    # Points of the scan, and the width of the Gaussian at each point of the path
    part = evidence.scan.part(evidence.scan.window(p, 0.1, 10**6))
    points = part.points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    patch = NOISE_PATCH * p[:, 2] / evidence.sensor.focal
    widths = np.sqrt(
        SPREAD * evidence.sensor.sigma(p[:, 2]) * patch / (np.sqrt(2.0) * _SLOPE_NOISE)
    )
    widths = np.clip(widths, *_WIDTHS)

    axes = z.copy()
    known = np.zeros(len(p), dtype=bool)
    if len(points) < _FITTED:
        return axes, known
    tree = cKDTree(points)
    for i, near in enumerate(tree.query_ball_point(p, 2.5 * widths)):
        # Points in the axes of the path, with distances across it in widths
        u, v = _perpendicular(z[i])
        to = points[near] - p[i]
        x = to @ u / widths[i]
        y = to @ v / widths[i]
        depth = to @ z[i]
        weight = np.exp(-0.5 * (x * x + y * y)) * (np.abs(depth) < SAME_FACE)

        # Weighted least squares of a parabola
        terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
        normal = terms.T @ (weight[:, None] * terms)
        if np.count_nonzero(weight > 0.1) < _FITTED or np.linalg.cond(normal) > _ILL_CONDITIONED:
            continue

        # Its slopes tilt the axis
        rise = np.linalg.solve(normal, terms.T @ (weight * depth))[1:3] / widths[i]
        axis = z[i] - rise[0] * u - rise[1] * v
        axes[i] = axis / np.linalg.norm(axis)
        known[i] = True
    return axes, known


def _perpendicular(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) perpendicular to the unit vector `axis` and to each other."""
    across = np.zeros(3)
    across[np.abs(axis).argmin()] = 1.0
    u = np.asarray(np.cross(axis, across), dtype=float)
    u /= np.linalg.norm(u)
    return u, np.asarray(np.cross(axis, u), dtype=float)

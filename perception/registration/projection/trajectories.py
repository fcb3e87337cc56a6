"""Trajectories of the check, which are curves in a plane before the object [Konoplin 2022, eq. 2].

Curves in a plane perpendicular to o = -(S - H_D)/|S - H_D| are projected along o on scan and model.
"""

import numpy as np

from uuv.sim.interfaces.spatial import Array

_RAY_STEP = 0.006  # [m] spacing of rays along the curves
_LINES = 8  # number of straight lines through the centre, evenly distributed over 180 deg
_CIRCLES = (0.35, 0.7)  # [-] radii as a share of the object's extent across the line of sight


def direction(points: Array) -> tuple[Array, Array]:
    """Centroid H_D (3,) [m] of model points (m, 3) [m] in S, and the line of sight o (3,) to it."""
    H_D = points.mean(axis=0)
    return H_D, H_D / np.linalg.norm(H_D)  # S is the origin: o = -(S - H_D)/|S - H_D|


def across(o: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) perpendicular to `o` (3,) and to each other."""
    u = np.cross(o, [0.0, 1.0, 0.0] if abs(o[1]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    return u, np.cross(o, u)


def curves(H_D: Array, o: Array, points: Array) -> Array:
    """Points c_i of lines and circles in a plane perpendicular to `o`, in front of the object.

    Args:
        H_D: (3,) [m] centroid of the visible model in S.
        o: (3,) unit line of sight.
        points: (m, 3) [m] visible model points in S.

    Returns:
        Points (n, 3) [m] in S.
    """
    reach = lateral_reach(H_D, o, points)
    s = np.arange(-reach, reach + _RAY_STEP, _RAY_STEP)

    flat = [
        np.outer(s, [np.cos(angle), np.sin(angle)])
        for angle in np.linspace(0.0, np.pi, _LINES, endpoint=False)
    ]
    flat += [
        circle(share * reach, max(8, round(2.0 * np.pi * share * reach / _RAY_STEP)))
        for share in _CIRCLES
    ]
    return in_plane(H_D, o, points, np.vstack(flat))


def circle(radius: float, n: int) -> Array:
    """Points (n, 2) [m] of a circle about the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def lateral_reach(H_D: Array, o: Array, points: Array) -> float:
    """Distance [m] of the outermost of `points` (m, 3) from the line through H_D along `o`."""
    offset = points - H_D
    return float(np.linalg.norm(offset - np.outer(offset @ o, o), axis=1).max())


def in_plane(H_D: Array, o: Array, points: Array, flat: Array) -> Array:
    """Points (n, 3) [m] in S of `flat` (n, 2) [m] in a plane perpendicular to `o`, before all
    `points`.
    """
    before = min(float(((points - H_D) @ o).min()) - 0.3, -0.05)
    return H_D + before * o + flat @ np.stack(across(o))

"""Line around an object at a set distance from the object's outline, as seen from above."""

import math

import numpy as np
from scipy.interpolate import BSpline, splprep
from scipy.spatial import ConvexHull

from uuv.sim.interfaces.spatial import Array, rotation_from_z

_STEP = 0.02  # [m] distance between samples of the line
_SMOOTH = 0.002  # [m] RMS distance of the spline from the line


def offset_outline(vertices_T: Array, up_T: Array, distance: float) -> tuple[Array, Array]:
    """Closed line at a set horizontal distance around an object, at half its height.

    Args:
        vertices_T: (V, 3) [m] vertices of the object in T.
        up_T: (3,) vertical direction in T.
        distance: [m] horizontal distance from the outline.

    Returns:
        The line (N, 3) [m] in T, counter-clockwise from above, with the last point equal to the
            first; and the horizontal unit directions (N, 3) to the outline.
    """
    axes = rotation_from_z(up_T, np.eye(3)[int(np.argmin(np.abs(up_T)))]).T
    upright = vertices_T @ axes.T
    outline = upright[ConvexHull(upright[:, :2]).vertices, :2]

    sides = np.roll(outline, -1, axis=0) - outline
    out = np.arctan2(-sides[:, 0], sides[:, 1])  # [rad] direction of each side's outward normal

    # Arcs around the corners, straight lines along the sides
    points: list[Array] = []
    for corner, side, before, after in zip(outline, sides, np.roll(out, 1), out, strict=True):
        turn = (after - before) % (2.0 * np.pi)
        angles = before + np.linspace(0.0, turn, 1 + math.ceil(turn * distance / _STEP))
        points.append(corner + distance * np.column_stack([np.cos(angles), np.sin(angles)]))
        shares = (
            np.arange(1, math.ceil(np.linalg.norm(side) / _STEP))[:, None]
            * _STEP
            / np.linalg.norm(side)
        )
        points.append(points[-1][-1] + shares * side)

    # A smooth curve through them, evenly sampled
    raw = np.vstack(points)
    raw = np.vstack([raw[np.linalg.norm(raw - np.roll(raw, 1, axis=0), axis=1) > 1e-6], raw[:1]])
    (knots, coefficients, degree), _ = splprep(raw.T, per=True, s=len(raw) * _SMOOTH**2)
    curve = BSpline(knots, np.transpose(coefficients), degree)
    length = float(np.linalg.norm(np.diff(raw, axis=0), axis=1).sum())
    u = np.linspace(0.0, 1.0, 1 + math.ceil(length / _STEP))
    line = curve(u)
    way = curve(u, 1)
    line[-1] = line[0]
    way[-1] = way[0]

    # Directions to the outline, all at the height of the object's middle
    inward = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1, keepdims=True)
    middle = 0.5 * (upright[:, 2].min() + upright[:, 2].max())
    return np.column_stack([line, np.full(len(line), middle)]) @ axes, inward @ axes[:2]

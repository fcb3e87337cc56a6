"""Block with rounded edges, with tool paths over an edge and around a corner on its top."""

from itertools import product

import numpy as np

from uuv.models.objects.target_model import (
    PATH_STEP,
    SHARPEST_CORNER,
    ModelPath,
    Symmetry,
    TargetModel,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, finite_number

SIZE = (0.7, 0.5, 0.4)  # [m] size along x_T, y_T, z_T
RADIUS = 0.02  # [m] radius of the edges
_ARCS = 24  # steps of a quarter circle; the facets deviate from it by r / 900


def over_edge(radius: float, length: float = 0.2) -> ModelPath:
    """Path along y_T over the top, around its edge, down the side; `length` [m] on each face."""
    flat = 0.5 * SIZE[1] - radius
    down = 0.5 * SIZE[2] - radius
    arc = 0.5 * np.pi * radius
    total = 2.0 * length + 0.5 * np.pi * radius

    s = np.linspace(0.0, total, max(4, 1 + round(total / PATH_STEP)))
    angle = np.clip((s - length) / radius, 0.0, 0.5 * np.pi)
    along = _in_plane(np.cos(angle), -np.sin(angle))
    outward = _in_plane(np.sin(angle), np.cos(angle))

    # Path lengths on the two faces, before and after the arc.
    before = np.minimum(s - length, 0.0)
    after = np.maximum(s - length - arc, 0.0)
    p = _in_plane(np.full_like(s, flat) + before, np.full_like(s, down) - after) + radius * outward
    return ModelPath(p=p, a=-outward, b=along)


def around_corner(corner: float, length: float = 0.15) -> ModelPath:
    """Two lines of `length` [m] that meet in the top's middle; the path turns there by `corner`
    [rad].
    """
    finite_number(corner, "block corner [rad]", least=0.0, most=SHARPEST_CORNER)
    n = max(4, 1 + round(length / PATH_STEP))

    before = np.linspace(-length, 0.0, n)[:, None] * [1.0, 0.0, 0.0]
    after = np.linspace(0.0, length, n)[1:, None] * [np.cos(corner), np.sin(corner), 0.0]
    p = np.vstack([before, after]) + np.array([0.0, 0.0, 0.5 * SIZE[2]])

    b = np.vstack(
        [
            np.tile([1.0, 0.0, 0.0], (n, 1)),
            np.tile([np.cos(corner), np.sin(corner), 0.0], (n - 1, 1)),
        ]
    )
    return ModelPath(p=p, a=np.tile([0.0, 0.0, -1.0], (len(p), 1)), b=b)


def block(radius: float = RADIUS, corner: float = 0.5 * np.pi) -> TargetModel:
    """Block as a target: origin in its middle, z_T up.

    The paths are "edge" (`over_edge`) and "corner" (`around_corner`). The shape is symmetric under
    half a turn about each axis.

    Args:
        radius: [m] of all edges.
        corner: [rad] by which the path "corner" turns.

    Raises:
        ConfigurationError: a radius or corner out of range.
    """
    radius = finite_number(radius, "block edge radius [m]", least=1e-3, most=0.4 * min(SIZE))

    vertices, triangles = _rounded_box(radius)
    turns = [np.eye(3), *(exp_so3(np.pi * axis) for axis in np.eye(3))]
    return TargetModel(
        name="block",
        vertices=vertices,
        triangles=triangles,
        symmetry=Symmetry(rotations=np.stack(turns)),
        paths={"edge": over_edge(radius), "corner": around_corner(corner)},
        hulls=(vertices,),
    )


def _in_plane(y: Array, z: Array) -> Array:
    return np.column_stack([np.zeros_like(y), y, z])


def _rounded_box(radius: float) -> tuple[Array, np.ndarray]:
    """Convex hull of eighths of spheres at all corners: vertices (V, 3) [m], triangles (T, 3)."""
    from scipy.spatial import ConvexHull

    angle = np.linspace(0.0, 0.5 * np.pi, _ARCS + 1)
    polar, around = (grid.ravel() for grid in np.meshgrid(angle, angle, indexing="ij"))
    eighth = np.column_stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    )

    core = 0.5 * np.array(SIZE) - radius
    points = np.vstack(
        [np.array(signs) * (core + radius * eighth) for signs in product((-1.0, 1.0), repeat=3)]
    )
    points = np.unique(np.round(points, 9), axis=0)

    # Facets, counter-clockwise from outside, and the points that they use.
    hull = ConvexHull(points)
    outward = np.einsum("ij,ij->i", _cross(points, hull.simplices), hull.equations[:, :3]) > 0.0
    triangles = np.where(outward[:, None], hull.simplices, hull.simplices[:, ::-1])
    used, index = np.unique(triangles, return_inverse=True)
    vertices = points[used]
    triangles = index.reshape(-1, 3)
    return vertices, triangles


def _cross(points: Array, triangles: np.ndarray) -> Array:
    a, b, c = points[triangles].transpose(1, 0, 2)
    return np.cross(b - a, c - a)

"""Smooth normals and closest points of triangle meshes, for metrics and drawing."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from uuv.models.objects.target_model import TargetModel
from uuv.sim.interfaces.spatial import Array

# [rad] between normals; triangles that differ less are facets of one curved face
CREASE = np.radians(30.0)
TOGETHER = 32  # neighbouring points, for which what is near is sought at once
SLACK = 1e-12  # [m] on what is near, for rounding


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """Triangle mesh with a normal at each corner: smooth on curved faces, sharp at edges."""

    corners: Array  # (T, 3, 3) [m]
    normals: Array  # (T, 3, 3) unit, outward, one per corner

    @classmethod
    def of(cls, vertices: Array, triangles: np.ndarray, crease: float = CREASE) -> "Surface":
        """Build the surface; triangles without area are left out.

        Args:
            vertices: (V, 3) [m]
            triangles: (T, 3), counter-clockwise seen from outside.
            crease: Largest angle between facets of one curved face [rad].

        Returns:
            The surface.
        """
        corners = np.asarray(vertices, dtype=np.float64)[triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(cross, axis=1)
        keep = size > 1e-12 * size.max()
        corners = corners[keep]
        flat = cross[keep] / size[keep, None]
        index = np.asarray(triangles)[keep]

        # Weighted by the corner's angle, the mean does not depend on how a face is triangulated.
        edges = np.roll(corners, -1, axis=1) - corners
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        angle = np.arccos(np.clip(-np.sum(edges * np.roll(edges, 1, axis=1), axis=2), -1.0, 1.0))

        # Corners at one vertex, in their order; vertices with as many corners together.
        vertex = index.ravel()
        order = np.argsort(vertex, kind="stable")
        begin = np.flatnonzero(np.diff(vertex[order], prepend=-1))
        count = np.diff(begin, append=len(order))

        normals = np.zeros_like(corners)
        rows = normals.reshape(-1, 3)
        for number in np.unique(count):
            alike = order[begin[count == number][:, None] + np.arange(number)]
            n = flat[alike // 3]
            smooth = (n @ n.transpose(0, 2, 1)) >= np.cos(crease)
            rows[alike] = smooth @ (angle.ravel()[alike][..., None] * n)

        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        return cls(corners=corners, normals=normals)

    def closest(self, points: Array) -> tuple[Array, Array]:
        """Closest points on the surface and the unit normals there.

        Fast when neighbours in `points` are neighbours in space, as along a path.

        Args:
            points: (N, 3) [m]

        Returns:
            Closest points (N, 3) [m] and normals (N, 3).
        """
        low = self.corners.min(axis=1)
        high = self.corners.max(axis=1)
        closest = np.empty_like(points)
        normals = np.empty_like(points)
        best = 0

        for first in range(0, len(points), TOGETHER):
            rows = slice(first, first + TOGETHER)
            group = points[rows]
            middle = 0.5 * (group.min(axis=0) + group.max(axis=0))
            off = np.linalg.norm(group - middle, axis=1)

            # Distance of the middle: the last triangle bounds it, so that only nearer boxes need be
            # tested.
            reach = _distances(self.corners[best][None], middle).min()
            near = np.flatnonzero(_gaps(low, high, middle) <= reach + SLACK)
            reach = _distances(self.corners[near], middle).min()

            # Each point is at most so much farther away as it lies off the middle.
            near = np.flatnonzero(_gaps(low, high, middle) <= reach + 2.0 * off.max() + SLACK)
            gaps = _gaps(low[near], high[near], group[:, None])
            point, column = np.nonzero(gaps <= (reach + off + SLACK)[:, None])
            triangle = near[column]

            weights = _closest_barycentric(self.corners[triangle], group[point])
            candidates = np.einsum("tk,tkj->tj", weights, self.corners[triangle])
            distance = np.full(gaps.shape, np.inf)
            distance[point, column] = np.sum((candidates - group[point]) ** 2, axis=1)
            pair = np.zeros(gaps.shape, dtype=np.int64)
            pair[point, column] = np.arange(len(point))
            choice = pair[np.arange(len(group)), distance.argmin(axis=1)]

            best = int(triangle[choice[-1]])
            closest[rows] = candidates[choice]
            normal = np.einsum("tk,tkj->tj", weights[choice], self.normals[triangle[choice]])
            normals[rows] = normal / np.linalg.norm(normal, axis=1, keepdims=True)

        return closest, normals


@lru_cache(maxsize=1)
def surface_of(model: TargetModel) -> Surface:
    """Surface of an object; the last one is kept, for several figures of a run need it."""
    return Surface.of(np.asarray(model.vertices), model.triangles)


def closest_on_curve(points: Array, curve: Array) -> tuple[Array, Array]:
    """Closest points on a polyline and their arc lengths.

    Args:
        points: (N, 3) [m]
        curve: Vertices (M, 3) [m].

    Returns:
        Closest points (N, 3) [m] and arc lengths (N,) [m].
    """
    # Edges with a length, and the arc lengths at their starts.
    every_edge = np.diff(curve, axis=0)
    every_length = np.linalg.norm(every_edge, axis=1)
    long = every_length > 0.0
    start = curve[:-1][long]
    edge = every_edge[long]
    length = every_length[long]
    arc = np.concatenate([[0.0], np.cumsum(every_length)])[:-1][long]
    if not len(edge):
        return np.tile(curve[0], (len(points), 1)), np.zeros(len(points))

    closest = np.empty_like(points)
    at = np.empty(len(points))
    for first in range(0, len(points), TOGETHER):
        rows = slice(first, first + TOGETHER)
        group = points[rows]
        middle = 0.5 * (group.min(axis=0) + group.max(axis=0))
        off = np.linalg.norm(group - middle, axis=1).max()

        # Edges that are the closest of one of the points, at most so much farther from the middle.
        share = np.clip(_dot(middle - start, edge) / length**2, 0.0, 1.0)
        gap = np.linalg.norm(start + share[:, None] * edge - middle, axis=1)
        near = np.flatnonzero(gap <= gap.min() + 2.0 * off + SLACK)

        away = group[:, None] - start[near]
        share = np.clip(_dot(away, edge[near]) / length[near] ** 2, 0.0, 1.0)
        candidates = start[near] + share[..., None] * edge[near]
        choice = np.sum((candidates - group[:, None]) ** 2, axis=2).argmin(axis=1)
        every = np.arange(len(group))
        closest[rows] = candidates[every, choice]
        at[rows] = arc[near[choice]] + share[every, choice] * length[near[choice]]

    return closest, at


def _distances(corners: Array, point: Array) -> Array:
    """Distances (T,) [m] of a point (3,) from triangles (T, 3, 3)."""
    weights = _closest_barycentric(corners, np.broadcast_to(point, corners[:, 0].shape))
    return np.linalg.norm(np.einsum("tk,tkj->tj", weights, corners) - point, axis=1)


def _gaps(low: Array, high: Array, points: Array) -> Array:
    """Distances [m] of points (..., 1, 3) from boxes between corners `low` and `high` (T, 3)."""
    gap = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.sqrt(_dot(gap, gap))


def _closest_barycentric(corners: Array, points: Array) -> Array:
    """Barycentric weights (T, 3) of the point of each triangle (T, 3, 3) that is closest to its
    point (T, 3).
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    ab = b - a
    ac = c - a
    ap = points - a
    d11 = _dot(ab, ab)
    d12 = _dot(ab, ac)
    d22 = _dot(ac, ac)
    e1 = _dot(ab, ap)
    e2 = _dot(ac, ap)

    area = d11 * d22 - d12**2
    v = (d22 * e1 - d12 * e2) / area
    w = (d11 * e2 - d12 * e1) / area
    weights = np.stack([1.0 - v - w, v, w], axis=1)

    outside = np.flatnonzero(weights.min(axis=1) < 0.0)
    best = np.full(len(outside), np.inf)
    # outside the face, the closest point lies on one of its edges
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start = corners[outside, i]
        edge = corners[outside, j] - corners[outside, i]
        share = np.clip(_dot(points[outside] - start, edge) / _dot(edge, edge), 0.0, 1.0)
        distance = np.sum((start + share[:, None] * edge - points[outside]) ** 2, axis=1)

        closer = distance < best
        best[closer] = distance[closer]
        rows = outside[closer]
        weights[rows] = 0.0
        weights[rows, i] = 1.0 - share[closer]
        weights[rows, j] = share[closer]

    return weights


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...k,...k->...", a, b)

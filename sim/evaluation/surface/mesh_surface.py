"""Smooth normals and closest points of triangle meshes, for metrics and drawing."""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.spatial import Array

# [rad] between normals; triangles that differ less are facets of one curved face
CREASE = np.radians(30.0)


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

        normals = np.zeros_like(corners)
        owner = np.repeat(np.arange(len(index)), 3)
        vertex = index.ravel()
        weight = angle.ravel()
        order = np.argsort(vertex, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(vertex[order])) + 1)
        rows = normals.reshape(-1, 3)
        for group in groups:
            n = flat[owner[group]]
            smooth = (n @ n.T) >= np.cos(crease)
            rows[group] = smooth @ (weight[group, None] * n)

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

        for i, point in enumerate(points):
            # The last triangle bounds the distance, so that only nearer boxes need be tested.
            held = self.corners[best]
            reach = np.linalg.norm(_closest_barycentric(held[None], point)[0] @ held - point)
            gap = np.maximum(np.maximum(low - point, point - high), 0.0)
            near = np.flatnonzero(np.einsum("tk,tk->t", gap, gap) <= (reach + 1e-12) ** 2)

            weights = _closest_barycentric(self.corners[near], point)
            candidates = np.einsum("tk,tkj->tj", weights, self.corners[near])
            choice = int(np.argmin(np.sum((candidates - point) ** 2, axis=1)))

            best = int(near[choice])
            closest[i] = candidates[choice]
            normal = weights[choice] @ self.normals[best]
            normals[i] = normal / np.linalg.norm(normal)

        return closest, normals


def closest_on_curve(points: Array, curve: Array) -> tuple[Array, Array]:
    """Closest points on a polyline and their arc lengths.

    Args:
        points: (N, 3) [m]
        curve: Vertices (M, 3) [m].

    Returns:
        Closest points (N, 3) [m] and arc lengths (N,) [m].
    """
    start = curve[:-1]
    edge = np.diff(curve, axis=0)
    length = np.linalg.norm(edge, axis=1)
    arc = np.concatenate([[0.0], np.cumsum(length)])

    best = np.full(len(points), np.inf)
    closest = np.empty_like(points)
    at = np.empty(len(points))

    for i in range(len(edge)):
        if length[i] == 0.0:
            continue
        share = np.clip((points - start[i]) @ edge[i] / length[i] ** 2, 0.0, 1.0)
        candidate = start[i] + share[:, None] * edge[i]
        distance = np.sum((points - candidate) ** 2, axis=1)

        closer = distance < best
        best[closer] = distance[closer]
        closest[closer] = candidate[closer]
        at[closer] = (arc[i] + share * length[i])[closer]

    return closest, at


def _closest_barycentric(corners: Array, point: Array) -> Array:
    """Barycentric weights (T, 3) of the point of each triangle (T, 3, 3) that is closest to `point`
    (3,).
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    ab = b - a
    ac = c - a
    ap = point - a
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
        share = np.clip(_dot(point - start, edge) / _dot(edge, edge), 0.0, 1.0)
        distance = np.sum((start + share[:, None] * edge - point) ** 2, axis=1)

        closer = distance < best
        best[closer] = distance[closer]
        rows = outside[closer]
        weights[rows] = 0.0
        weights[rows, i] = 1.0 - share[closer]
        weights[rows, j] = share[closer]

    return weights


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1)

"""Convex decomposition of a surface for collision, since MuJoCo replaces a mesh by its convex hull.

Each part is the convex hull of a patch of triangles and of a copy of that patch, shrunk and sunk
into the solid. All triangles belong to some part, so the collision surface has no holes. A patch is
halved until its hull nowhere protrudes from the surface by more than a tolerance. Parts are
therefore large where the surface is flat or convex, and small where it is concave.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from uuv.models.meshes.closed_shells import vertex_normals, welded
from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, readonly

TOLERANCE = 5e-4  # [m] by which a part may protrude from the surface
SUNK = 0.012  # [m] largest depth to which a patch is sunk into the solid
_SAMPLE = 0.006  # [m] spacing of the surface samples at which protrusion is measured
_UNDER = 1e-5  # [m] depth below the surface at which rays out of a part begin
_MANY = 400_000  # largest number of samples; larger objects get a coarser spacing


def parts(
    vertices: Array, triangles: np.ndarray, tolerance: float = TOLERANCE
) -> tuple[Array, ...]:
    """Corners (n, 3) [m] of convex parts whose union reproduces the surface of a mesh.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3), counter-clockwise from outside; need not be closed. Triangles without
            area are left out.
        tolerance: [m] largest protrusion of a part from the surface.

    Returns:
        One array of corners per part.

    Raises:
        ConfigurationError: a tolerance that is not positive, or a mesh without area.
    """
    if not tolerance > 0.0:
        raise ConfigurationError(f"convex parts: tolerance must be > 0 m, got {tolerance}")
    return _parts(
        np.ascontiguousarray(vertices, dtype=np.float64).tobytes(),
        np.ascontiguousarray(triangles, dtype=np.int64).tobytes(),
        float(tolerance),
    )


@lru_cache(maxsize=8)  # stored, since studies build the same scene many times
def _parts(vertices: bytes, triangles: bytes, tolerance: float) -> tuple[Array, ...]:
    points, faces = welded(
        np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(triangles, np.int64).reshape(-1, 3)
    )
    faces = _with_area(points, faces)
    judged = _Judged.of(points, faces)
    middles = points[faces].mean(axis=1)
    hulls: list[Array] = []

    waiting = [np.arange(len(faces))]
    while waiting:
        patch = waiting.pop()
        hull = judged.hull(patch, tolerance)
        if hull is not None:
            hulls.append(readonly(hull))
            continue

        # Halve the patch across its principal axis, with equally many triangles on each side.
        spread = middles[patch] - middles[patch].mean(axis=0)
        along = spread @ np.linalg.eigh(spread.T @ spread)[1][:, -1]
        order = np.argsort(along, kind="stable")
        waiting += [patch[order[: len(order) // 2]], patch[order[len(order) // 2 :]]]

    return tuple(hulls)


def _with_area(points: Array, faces: np.ndarray) -> np.ndarray:
    """Triangles (T, 3) with nonzero area."""
    a, b, c = points[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    faces = faces[area > 1e-12 * area.max(initial=0.0)]
    if not len(faces):
        raise ConfigurationError("convex parts: no triangle of the mesh has an area")
    return faces


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """A mesh with samples of its surface, at which the protrusion of convex parts is measured."""

    points: Array  # (V, 3) [m]
    faces: np.ndarray  # (T, 3)
    normals: Array  # (T, 3) unit, outward
    samples: Array  # (S, 3) [m], sorted by x
    sample_normals: Array  # (S, 3)

    @classmethod
    def of(cls, points: Array, faces: np.ndarray) -> "_Judged":
        """Sample the surface of a mesh evenly."""
        a, b, c = points[faces].transpose(1, 0, 2)
        cross = np.cross(b - a, c - a)
        double_area = np.linalg.norm(cross, axis=1)
        normals = cross / double_area[:, None]
        step = max(_SAMPLE, float(np.sqrt(0.5 * double_area.sum() / _MANY)))
        samples = [points]
        owners = [vertex_normals(points, faces)]

        # Even barycentric grids, finer for larger triangles.
        longest = np.sqrt(
            np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
        )
        level = np.clip(np.ceil(longest / step), 1, 60).astype(int)
        for n in np.unique(level):
            rows = np.flatnonzero(level == n)
            i, j = np.nonzero(np.add.outer(np.arange(n), np.arange(n)) < n)
            u = (i + 1.0 / 3.0) / n
            v = (j + 1.0 / 3.0) / n
            grid = (
                a[rows, None]
                + u[None, :, None] * (b - a)[rows, None]
                + v[None, :, None] * (c - a)[rows, None]
            )
            samples.append(grid.reshape(-1, 3))
            owners.append(np.repeat(normals[rows], len(u), axis=0))

        spread = np.vstack(samples)
        facing = np.vstack(owners)
        known = np.linalg.norm(facing, axis=1) > 0.5
        spread = spread[known]
        facing = facing[known]
        order = np.argsort(spread[:, 0], kind="stable")
        return cls(points, faces, normals, spread[order], facing[order])

    def hull(self, patch: np.ndarray, tolerance: float) -> Array | None:
        """Corners of the sunk hull of triangles `patch` (K,), or None if it protrudes."""
        faces = self.faces[patch]
        corners = self.points[np.unique(faces)]
        normal = self.normals[patch].mean(axis=0)
        length = float(np.linalg.norm(normal))

        if len(patch) > 200:
            # Quick rejection: some corner is far outside the plane of some triangle.
            some = patch[:: len(patch) // 100]
            over = (corners - self.points[self.faces[some, 0]][:, None]) @ self.normals[some][
                :, :, None
            ]
            if float(over.max()) > 20.0 * tolerance:
                return None

        normal = normal / length if length > 0.1 else np.zeros(3)
        middle = corners.mean(axis=0)
        for depth in SUNK * 0.5 ** np.arange(5):
            sunk = middle + 0.6 * (corners - middle) - depth * normal if normal.any() else corners
            solid = np.vstack([corners, sunk])
            try:
                shape = ConvexHull(solid)
            except QhullError:
                return _wedge(corners, self.normals[patch[0]], tolerance)
            if self._stands_out(shape, solid, tolerance) <= tolerance:
                return solid[shape.vertices]
            if len(patch) > 4:
                return None

        # One or a few triangles of a thin object: the part is made as thin as possible.
        return None if len(patch) > 1 else _wedge(corners, self.normals[patch[0]], tolerance)

    def _stands_out(self, shape: ConvexHull, solid: Array, enough: float) -> float:
        """Largest protrusion [m] of the hull from the surface, along the normals of samples inside.

        The search ends once it exceeds `enough` [m].
        """
        low = solid.min(axis=0)
        high = solid.max(axis=0)
        start, end = np.searchsorted(self.samples[:, 0], [low[0], high[0]], side="left")
        inside = (
            (self.samples[start:end, 1:] > low[1:]) & (self.samples[start:end, 1:] < high[1:])
        ).all(axis=1)
        rows = start + np.flatnonzero(inside)
        if not len(rows):
            return 0.0

        # Rays from just below each sample along its normal to the exit from the hull.
        faces = shape.simplices
        a, b, c = solid[faces].transpose(1, 0, 2)
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), shape.equations[:, :3]) < 0.0
        faces = np.where(inward[:, None], faces[:, ::-1], faces)
        scene = RayScene(solid - solid[0], faces)

        worst = 0.0
        for some in (rows[::40], rows):  # most hulls are rejected after a few samples
            facing = self.sample_normals[some]
            start = self.samples[some] - solid[0] - _UNDER * facing
            first = scene.cast(start, facing)
            leaves = np.isfinite(first["t"]) & (
                np.einsum("ij,ij->i", first["normal"], facing) > 1e-6
            )
            worst = float(first["t"][leaves].max(initial=_UNDER)) - _UNDER

            # Over a concavity the hull bridges the surface from outside, and such a ray enters the
            # hull first.
            enters = np.flatnonzero(~leaves & (first["t"] < _UNDER + enough))
            if len(enters):
                way = first["t"][enters] + _UNDER
                onward = scene.cast(start[enters] + way[:, None] * facing[enters], facing[enters])
                through = np.isfinite(onward["t"])
                worst = max(worst, float((way + onward["t"])[through].max(initial=_UNDER)) - _UNDER)

            if worst > enough:
                break
        return worst


def _wedge(corners: Array, normal: Array, thickness: float) -> Array:
    """Body under a flat patch, with the corners of the patch and its middle sunk by `thickness`
    [m].
    """
    return np.vstack([corners, corners.mean(axis=0) - thickness * normal])

"""How far points are from a closed mesh, and on which side."""

import numpy as np

from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.spatial import Array


def signed_distance(vertices: Array, triangles: np.ndarray, points: Array) -> Array:
    """Distance (N,) [m] of points (N, 3) from a closed mesh whose triangles wind outwards; negative
    inside.
    """
    away = NearestSurface.of(vertices, triangles).query(points).distance
    # along no axis: rays along edges count for nothing
    way = np.broadcast_to([0.36, 0.48, 0.8], points.shape)
    hit = RayScene(vertices, triangles).cast(points, way)
    inside = np.isfinite(hit["t"]) & (np.einsum("ij,ij->i", hit["normal"], way) > 0.0)
    return np.where(inside, -away, away)

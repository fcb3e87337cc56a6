"""Part of a mesh's surface that cameras see: in the image, facing the camera, not occluded by the
mesh.
"""

from dataclasses import dataclass

import numpy as np

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

_PIECES = 4000  # number of surface samples
# cosine of the largest incidence at which a surface counts as visible
_TURNED = np.cos(np.radians(75.0))
# [m] largest distance of a ray's hit from the sample, at which the hit is the sample itself and no
# occluder
_SKIN = 2e-3


@dataclass(frozen=True, slots=True)
class View:
    """View of a camera whose z is the optical axis: field of view and range."""

    half_view: tuple[float, float]  # tangents of half the fields of view, horizontal and vertical
    far: float  # [m] range limit


class SurfaceSamples:
    """Samples of a mesh's surface, uniform over its area, with a test of which samples cameras see.

    `points` (N, 3) [m] and outward unit `normals` (N, 3) are in the mesh's frame.
    """

    def __init__(self, vertices: Array, triangles: np.ndarray) -> None:
        corner = vertices[triangles]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        area = 0.5 * np.linalg.norm(normal, axis=1)

        rng = np.random.default_rng(0)
        which = rng.choice(len(area), _PIECES, p=area / area.sum())
        weight = rng.dirichlet(np.ones(3), _PIECES)
        self.points = np.einsum("ni,nij->nj", weight, corner[which])
        self.normals = normal[which] / (2.0 * area[which, None])
        self._scene = RayScene(vertices, triangles)

    def seen(self, X_TC: Array, view: View) -> np.ndarray:
        """Mask (N,) of the samples that at least one of the cameras at `X_TC` (n, 4, 4) sees, T the
        mesh's frame.
        """
        visible = np.zeros(len(self.points), dtype=bool)
        for X in X_TC:
            left = np.flatnonzero(~visible)
            p_C = transform_points(inverse(X), self.points[left])
            away = self.points[left] - X[:3, 3]
            distance = np.linalg.norm(away, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                inside = np.all(np.abs(p_C[:, :2] / p_C[:, 2:]) < view.half_view, axis=1)
            facing = -np.einsum("ni,ni->n", away, self.normals[left]) > _TURNED * distance
            candidates = np.flatnonzero(inside & (p_C[:, 2] > 0.0) & (distance < view.far) & facing)

            if len(candidates):
                starts = np.broadcast_to(X[:3, 3], (len(candidates), 3))
                hit = self._scene.cast(starts, away[candidates] / distance[candidates, None])["t"]
                visible[left[candidates]] = hit > distance[candidates] - _SKIN

        return visible

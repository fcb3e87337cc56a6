"""Which surface a camera sees by MuJoCo's ray caster: a judge that shares no code with
uuv.models.meshes.visibility.
"""

from copy import copy

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array

_INCIDENCE = np.radians(75.0)  # largest at which a surface counts as seen
_SKIN = 2e-3  # [m] a hit this close to the sample is the sample


class MujocoVisibility:
    """Surface samples of an object at its place in W, and the cameras that see them, by MuJoCo's
    rays.

    Nothing is shared with `SurfaceSamples`: samples are stratified over the area instead of drawn
    at random, the object is posed in W instead of the cameras in T, and rays are those of MuJoCo in
    double precision instead of Embree's.
    """

    def __init__(
        self, vertices_T: Array, triangles: np.ndarray, X_WT: Array, number: int = 2000
    ) -> None:
        a, b, c = (vertices_T[triangles[:, k]] @ X_WT[:3, :3].T + X_WT[:3, 3] for k in range(3))
        normal = np.cross(b - a, c - a)
        twice_area = np.linalg.norm(normal, axis=1)
        rng = np.random.default_rng(1)
        share = (np.arange(number) + rng.uniform(size=number)) / number
        which = np.minimum(
            np.searchsorted(np.cumsum(twice_area) / twice_area.sum(), share), len(triangles) - 1
        )
        u, v = rng.uniform(size=(2, number, 1))
        self.points_W = a[which] + np.sqrt(u) * ((1.0 - v) * (b - a)[which] + v * (c - a)[which])
        self.normals_W = normal[which] / twice_area[which, None]
        spec = mujoco.MjSpec()
        spec.add_mesh(
            name="object", uservert=vertices_T.ravel(), userface=triangles.astype(np.int32).ravel()
        )
        quat_WT = np.empty(4)
        mujoco.mju_mat2Quat(quat_WT, X_WT[:3, :3].ravel())
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname="object", pos=X_WT[:3, 3].copy(), quat=quat_WT
        )
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)

    def at(self, points_W: Array, normals_W: Array) -> "MujocoVisibility":
        """The same object with other samples: points [m] and unit normals (N, 3)."""
        other = copy(self)
        other.points_W, other.normals_W = points_W, normals_W
        return other

    def seen(self, X_WC: Array, half_view: tuple[float, float], far: float) -> np.ndarray:
        """Samples (N,) that at least one of the cameras at `X_WC` (n, 4, 4) sees.

        Args:
            X_WC: poses, z the camera's axis.
            half_view: tangents of half the fields of view.
            far: [m] range limit.
        """
        visible = np.zeros(len(self.points_W), dtype=bool)
        widest = np.arctan(half_view)
        for X in X_WC:
            left = np.flatnonzero(~visible)
            way = self.points_W[left] - X[:3, 3]
            x, y, z = (way @ X[:3, :3]).T
            distance = np.linalg.norm(way, axis=1)
            way /= distance[:, None]
            incidence = np.arccos(np.clip(-np.sum(way * self.normals_W[left], axis=1), -1.0, 1.0))
            inside = (np.abs(np.arctan2(x, z)) < widest[0]) & (np.abs(np.arctan2(y, z)) < widest[1])
            candidates = np.flatnonzero(inside & (distance < far) & (incidence < _INCIDENCE))
            if len(candidates):
                hit = self._first_hits(X[:3, 3], way[candidates], far)
                visible[left[candidates]] = np.abs(hit - distance[candidates]) < _SKIN
        return visible

    def _first_hits(self, start_W: Array, ways_W: Array, far: float) -> Array:
        hit = np.full(len(ways_W), -1.0)
        geom = np.full(len(ways_W), -1, dtype=np.int32)
        rays = np.ascontiguousarray(ways_W).ravel()
        mujoco.mj_multiRay(
            self._model,
            self._data,
            start_W.copy(),
            rays,
            None,
            1,
            -1,
            geom,
            hit,
            None,
            len(ways_W),
            far,
        )
        return hit

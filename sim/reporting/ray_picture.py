"""Pictures of a scene by ray casting, without OpenGL: plain shading, one light from above."""

import math

import mujoco
import numpy as np

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.spatial import Array
from uuv.sim.reporting.rerun_scene import body_mesh

# direction to the light, W
_LIGHT = np.array([0.25, -0.35, 0.9]) / np.linalg.norm([0.25, -0.35, 0.9])
# Shares of the light:
_AMBIENT = 0.35  # from all sides
_HEAD = 0.3  # from the camera
_TOP = 0.45  # from above


class RayPicture:
    """Draws a model's visible geoms as `mujoco.Renderer` does, without OpenGL."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        """Take the shapes of a compiled model, and the size of the pictures [px].

        Raises:
            MissingLibraryError: The ray caster is not installed.
        """
        self._size = height, width
        self._fovy = math.radians(float(model.vis.global_.fovy))
        shapes = [
            (body, mesh)
            for body in range(model.nbody)
            if (mesh := body_mesh(model, body)) is not None
        ]

        self._of = np.concatenate([np.full(len(mesh[0]), body) for body, mesh in shapes])
        self._corners = np.concatenate([mesh[0] for _, mesh in shapes])
        self._colours = np.concatenate([mesh[2][::3, :3] for _, mesh in shapes]) / 255.0
        self._triangles = np.arange(len(self._corners)).reshape(-1, 3)

    def render(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> tuple[np.ndarray, Array]:
        """Colours (h, w, 3), 0 to 255, and depth (h, w) [m] along the view; empty: black and inf.

        Args:
            data: With up-to-date kinematics.
            camera: Free camera.
        """
        R_WB = data.xmat[self._of].reshape(-1, 3, 3)
        corners = np.einsum("nij,nj->ni", R_WB, self._corners) + data.xpos[self._of]

        ahead, rays = self._rays(camera)
        eye = np.asarray(camera.lookat) - camera.distance * ahead
        hit = RayScene(corners - eye, self._triangles).cast(np.zeros(3), rays.reshape(-1, 3))

        # Light: from all sides, from the camera, from above.
        visible = np.isfinite(hit["t"])
        ways = rays.reshape(-1, 3) / np.linalg.norm(rays.reshape(-1, 3), axis=1, keepdims=True)
        facing = -np.einsum("ij,ij->i", hit["normal"], ways)
        normal = hit["normal"] * np.sign(facing)[:, None]
        light = _AMBIENT + _HEAD * np.abs(facing) + _TOP * np.clip(normal @ _LIGHT, 0.0, None)

        picture = np.zeros((len(ways), 3))
        picture[visible] = 255.0 * np.minimum(
            1.0, self._colours[hit["triangle"][visible]] * light[visible, None]
        )

        return picture.astype(np.uint8).reshape(*self._size, 3), hit["t"].reshape(self._size)

    def _rays(self, camera: mujoco.MjvCamera) -> tuple[Array, Array]:
        """Direction of the view (3,), and rays (h, w, 3) whose length along it is 1; W."""
        azimuth = math.radians(camera.azimuth)
        elevation = math.radians(camera.elevation)
        ahead = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )

        right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
        down = np.cross(ahead, right)

        height, width = self._size
        half = math.tan(0.5 * self._fovy)
        v = half * (2.0 * (np.arange(height) + 0.5) / height - 1.0)
        u = half * (2.0 * (np.arange(width) + 0.5) - width) / height

        return ahead, ahead + u[None, :, None] * right + v[:, None, None] * down

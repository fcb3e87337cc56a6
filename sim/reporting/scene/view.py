"""View of a free camera onto a scene, and the framing of given points."""

import math
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array

FOVY = 36.0  # [deg] vertical field of view
_ROUNDS = 12  # of centring; the last ones change nothing that can be seen


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """Free camera that looks at a point, z up."""

    lookat_W: Array  # (3,) [m]
    distance: float  # [m]
    azimuth: float  # [deg] of the view's direction, about z from x
    elevation: float  # [deg] of the view's direction, negative: from above

    @classmethod
    def framing(
        cls, points_W: Array, azimuth: float, elevation: float, aspect: float, fill: float = 0.86
    ) -> Self:
        """The nearest view from a direction that contains all points.

        Args:
            points_W: (N, 3) [m]
            azimuth: [deg]
            elevation: [deg]
            aspect: Width over height of the picture.
            fill: Share of the picture's height and width that they may take.
        """
        view = cls(points_W.mean(axis=0), 1.0, azimuth, elevation)
        across, down, ahead = view.axes_W
        steep = fill * math.tan(math.radians(0.5 * FOVY))
        flat = steep * aspect

        lookat = view.lookat_W
        distance = 1.0
        for _ in range(_ROUNDS):
            x, y, z = ((points_W - lookat) @ axis for axis in (across, down, ahead))
            distance = float(max((abs(x) / flat - z).max(), (abs(y) / steep - z).max(), 0.1))

            # To the centre of the points in the picture, at the depth of the point looked at.
            u = x / (z + distance)
            v = y / (z + distance)
            lookat = lookat + 0.5 * distance * (
                (u.min() + u.max()) * across + (v.min() + v.max()) * down
            )

        return cls(lookat, distance, azimuth, elevation)

    @property
    def axes_W(self) -> tuple[Array, Array, Array]:
        """Directions (3,) across to the right, down, and ahead, in W."""
        azimuth = math.radians(self.azimuth)
        elevation = math.radians(self.elevation)
        ahead = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )
        across = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
        return across, np.cross(ahead, across), ahead

    @property
    def eye_W(self) -> Array:
        """Position (3,) [m] of the camera, W."""
        return self.lookat_W - self.distance * self.axes_W[2]

    def rays_W(self, height: int, width: int) -> Array:
        """Ray (h, w, 3) of each pixel, of length 1 along the view."""
        across, down, ahead = self.axes_W
        half = math.tan(math.radians(0.5 * FOVY))
        v = half * (2.0 * (np.arange(height) + 0.5) / height - 1.0)
        u = half * (2.0 * (np.arange(width) + 0.5) - width) / height
        return ahead + u[None, :, None] * across + v[:, None, None] * down

    def camera(self) -> mujoco.MjvCamera:
        """The view as MuJoCo's free camera."""
        camera = mujoco.MjvCamera()
        camera.lookat[:] = self.lookat_W
        camera.distance = self.distance
        camera.azimuth = self.azimuth
        camera.elevation = self.elevation
        return camera

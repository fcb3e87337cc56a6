"""Picture of a model without motion: a vehicle or an object over sand."""

from collections.abc import Iterable

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array
from uuv.sim.reporting.scene.captions import Captions
from uuv.sim.reporting.scene.marks import line
from uuv.sim.reporting.scene.ray_picture import RayPicture
from uuv.sim.reporting.scene.sea import SeaLook
from uuv.sim.reporting.scene.view import CameraView

_AZIMUTH = 125.0  # [deg] of the view
_ELEVATION = -24.0  # [deg]
_BELOW = 0.35  # height over the sand, over the size of what is drawn
_SAND = [0.55, 0.5, 0.4, 1.0]
_PATH = (0.10, 0.78, 0.45)  # colour
_THICK = 0.006  # radius of a path over the size of what is drawn


def portrait(
    spec: mujoco.MjSpec, title: str, size: tuple[int, int], paths_W: Iterable[Array] = ()
) -> np.ndarray:
    """Picture (h, w, 3), 0 to 255, of a model in its initial pose.

    Args:
        spec: The model; a ground without a part of it is added below.
        title: Written into it.
        size: [px] width and height.
        paths_W: (N, 3) [m] lines on it.

    Raises:
        MissingLibraryError: The ray caster, or what draws text, is not installed.
    """
    bare = spec.compile()
    data = mujoco.MjData(bare)
    mujoco.mj_kinematics(bare, data)
    points = _extent(bare, data)
    tall = float(np.linalg.norm(np.ptp(points, axis=0)))

    # On sand, where it is not in its own world.
    drawn = spec.copy()
    ground = drawn.worldbody.add_geom()
    ground.type = mujoco.mjtGeom.mjGEOM_PLANE
    ground.size = [1.0, 1.0, 0.1]
    ground.pos = [0.0, 0.0, points[:, 2].min() - _BELOW * tall]
    ground.rgba = _SAND
    model = drawn.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)

    width, height = size
    view = CameraView.framing(points, _AZIMUTH, _ELEVATION, width / height, fill=0.72)
    marks = [
        mark
        for path in paths_W
        for mark in line(path, _THICK * tall, np.tile(_PATH, (len(path) - 1, 1)))
    ]
    sea = SeaLook(model, view.distance)
    picture = RayPicture(model, height, width).render(data, view, sea, marks)
    return Captions(height, width, title, most_force=0.0, error_scale=None).titled(picture)


def _extent(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Corners (N, 3) [m] of the boxes about all visible geoms."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return np.concatenate(
        [
            data.geom_xpos[geom]
            + (model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:])
            @ data.geom_xmat[geom].reshape(3, 3).T
            for geom in range(model.ngeom)
            if model.geom_rgba[geom, 3] > 0.0
        ]
    )

"""Pictures of a scene by MuJoCo's renderer, which needs OpenGL."""

from collections.abc import Sequence

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import MissingLibraryError, one_line
from uuv.sim.interfaces.spatial import Array
from uuv.sim.reporting.scene.marks import Mark, add_to
from uuv.sim.reporting.scene.sea import SUN_W, SeaLook, drawn_model
from uuv.sim.reporting.scene.view import FOVY, CameraView

_MOST_GEOMS = 20_000  # with the marks
_SHADOWS = 8192  # [px] of the map of shadows
_SHADOWED = 2.0  # half its width over the model's extent
# Colours of the light: from all sides, of the camera's lamp, of the sun.
_AROUND = [0.355, 0.425, 0.435]
_LAMP = [0.30, 0.27, 0.24]
_SUN = [0.90, 0.86, 0.78]


class GlPicture:
    """Draws a model's visible geoms, and marks, by MuJoCo's renderer."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        """Open a renderer without a screen.

        Raises:
            MissingLibraryError: There is no OpenGL.
        """
        model = drawn_model(model)
        visual = model.vis
        visual.global_.offwidth = width
        visual.global_.offheight = height
        visual.global_.fovy = FOVY
        visual.quality.shadowsize = _SHADOWS
        visual.map.shadowclip = _SHADOWED
        visual.headlight.ambient[:] = _AROUND
        visual.headlight.diffuse[:] = _LAMP
        visual.headlight.specular[:] = 0.05
        model.mat_reflectance[:] = 0.0

        try:
            self._renderer = mujoco.Renderer(model, height, width, max_geom=_MOST_GEOMS)
        except Exception as error:  # of any type: it depends on what is missing
            raise MissingLibraryError(f"no OpenGL here: {one_line(str(error), 80)}") from error
        self._size = height, width

    def render(
        self,
        data: mujoco.MjData,
        view: CameraView,
        sea: SeaLook,
        marks: Sequence[Mark] = (),
        *,
        size: tuple[int, int] | None = None,
    ) -> np.ndarray:
        """Picture (h, w, 3) of 0 to 255.

        Args:
            data: With the poses of bodies and geoms.
            view: The camera's.
            sea: The water.
            marks: What is drawn into it.
            size: [px] height and width, scaled down from the usual ones; None: these.
        """
        renderer = self._renderer
        renderer.update_scene(data, view.camera())
        add_to(renderer.scene, marks)
        self._light(view.lookat_W)

        colours = renderer.render().reshape(-1, 3).astype(np.float32) / 255.0
        renderer.enable_depth_rendering()
        depth = renderer.render().reshape(-1)
        renderer.disable_depth_rendering()
        depth = np.where(depth < self._horizon, depth, np.inf)

        # The same water and sand as by rays.
        height, width = self._size
        rays = view.rays_W(height, width).astype(np.float32).reshape(-1, 3)
        length = np.linalg.norm(rays, axis=1)
        visible = np.isfinite(depth)
        colours[visible] *= sea.sand(view.eye_W + depth[visible, None] * rays[visible])[:, None]

        picture = sea.seen(colours, rays / length[:, None], depth * length)
        picture = np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)
        picture = picture.reshape(height, width, 3)
        return picture if size is None else _scaled(picture, size)

    def close(self) -> None:
        """Free the resources of OpenGL."""
        self._renderer.close()

    @property
    def _horizon(self) -> float:
        """Depth [m] just before the end of what MuJoCo draws."""
        model = self._renderer.model
        return 0.99 * float(model.vis.map.zfar * model.stat.extent)

    def _light(self, middle_W: Array) -> None:
        """Adds the sun to MuJoCo's scene."""
        scene = self._renderer.scene
        sun = scene.lights[scene.nlight]
        sun.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        sun.pos[:] = middle_W + 4.0 * SUN_W
        sun.dir[:] = -SUN_W
        sun.ambient[:] = 0.0
        sun.diffuse[:] = _SUN
        sun.specular[:] = 0.05
        sun.headlight = 0
        sun.castshadow = 1
        scene.nlight += 1


def _scaled(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The middle of a picture, cropped and scaled to height and width [px]."""
    from PIL import Image, ImageOps

    height, width = size
    return np.asarray(ImageOps.fit(Image.fromarray(picture), (width, height)))

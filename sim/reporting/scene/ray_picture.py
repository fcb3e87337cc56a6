"""Pictures of a scene by ray casting, without OpenGL: shadows, one light from above."""

from collections.abc import Sequence

import mujoco
import numpy as np

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.reporting.rerun_scene import body_mesh
from uuv.sim.reporting.scene.marks import Mark, triangles
from uuv.sim.reporting.scene.sea import SUN_W, Floats, SeaLook, drawn_model
from uuv.sim.reporting.scene.view import CameraView

# Colours of the light: of the water around, paler from above; of the sun; of the camera's lamp.
_AROUND = np.array([0.30, 0.36, 0.37], dtype=np.float32)
_ABOVE = np.array([0.10, 0.13, 0.13], dtype=np.float32)
_SUN = np.array([0.90, 0.86, 0.78], dtype=np.float32)
_LAMP = np.array([0.30, 0.27, 0.24], dtype=np.float32)

_OFF = 2e-3  # [m] off the surface at which a ray to the sun begins
_NOTHING = 1e3  # [m] depth that stands for none
_OTHER = 0.15  # difference of a normal's or a colour's component at an edge
_EDGE = 0.02  # share of the distance by which neighbouring pixels differ at an edge
_INSIDE = np.array([[-0.25, -0.125], [0.125, -0.25], [0.25, 0.125], [-0.125, 0.25]])  # [pixel]


class RayPicture:
    """Draws a model's visible geoms, and marks, by ray casting."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        """Take the shapes of a compiled model, and the usual size of the pictures [px].

        Raises:
            MissingLibraryError: The ray caster is not installed.
        """
        self._size = height, width
        model = drawn_model(model)
        shapes = [
            (body, mesh)
            for body in range(model.nbody)
            if (mesh := body_mesh(model, body, plane=np.inf)) is not None
        ]

        # There may be none.
        bodies = [np.full(len(mesh[0]), body) for body, mesh in shapes]
        self._of = np.concatenate([np.zeros(0, dtype=np.int64), *bodies])
        self._corners = np.concatenate([np.zeros((0, 3)), *(mesh[0] for _, mesh in shapes)])
        colours = [np.zeros((0, 3)), *(mesh[2][::3, :3] / 255.0 for _, mesh in shapes)]
        self._colours = np.concatenate(colours).astype(np.float32)
        # Poses of the last picture, and its shapes: those of the tool from near are the same.
        self._poses: tuple[bytes, bytes] | None = None
        self._shapes = _Shapes(np.zeros((0, 3)), np.zeros(3))

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
            data: With the poses of the bodies.
            view: The camera's.
            sea: The water.
            marks: What is drawn into it.
            size: [px] height and width; None: the usual ones.
        """
        poses = data.xpos.tobytes(), data.xmat.tobytes()
        if poses != self._poses:
            R_WB = data.xmat[self._of].reshape(-1, 3, 3)
            corners = np.einsum("nij,nj->ni", R_WB, self._corners) + data.xpos[self._of]
            self._shapes = _Shapes(corners, view.eye_W)
            self._poses = poses
        marked, tints = triangles(marks)
        scene = _LitScene(
            self._shapes,
            _Shapes(marked, view.eye_W),
            np.concatenate([self._colours, tints.astype(np.float32)]),
            view.eye_W,
            sea,
        )

        height, width = size or self._size
        rays = view.rays_W(height, width).astype(np.float32)
        seen = scene.look(rays.reshape(-1, 3))
        picture, surface, depth = (array.reshape(height, width, -1) for array in seen)

        # Edges are smoothed by more rays.
        edge = _edges(surface, depth[..., 0])
        right = rays[0, 1] - rays[0, 0]
        down = rays[1, 0] - rays[0, 0]
        shifts = (_INSIDE @ np.stack([right, down])).astype(np.float32)
        finer = (rays[edge][:, None] + shifts).reshape(-1, 3)
        picture[edge] = scene.look(finer)[0].reshape(-1, len(_INSIDE), 3).mean(axis=1)

        return np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)

    def close(self) -> None:
        """Do nothing, since there are no resources to free."""


class _Shapes:
    """Triangles for rays, held relative to an origin near the camera."""

    def __init__(self, corners_W: Floats, origin_W: Floats) -> None:
        """Prepare the triangles of corners (3 T, 3) [m] in W."""
        self.count = len(corners_W) // 3
        self.origin_W = np.array(origin_W)
        self.rays = RayScene(corners_W - self.origin_W, np.arange(len(corners_W)).reshape(-1, 3))


class _LitScene:
    """Triangles about the camera, in the light of the sea."""

    def __init__(
        self, solid: _Shapes, marks: _Shapes, colours: Floats, eye_W: Floats, sea: SeaLook
    ) -> None:
        """Prepares the rays.

        Args:
            solid: Shapes that cast shadows.
            marks: Shapes that cast none, held relative to the camera.
            colours: (T, 3) of the triangles, those of the marks last.
            eye_W: (3,) [m]
            sea: The water.
        """
        self._solid = solid
        self._marks = marks
        self._colours = colours
        self._eye_W = eye_W
        self._eye = eye_W - solid.origin_W  # as `solid` is held
        self._sea = sea

    def look(self, rays: Floats) -> tuple[Floats, Floats, Floats]:
        """Surfaces that rays (N, 3) hit.

        Returns:
            Colours (N, 3) as seen; normal, own colour and sun (N, 7) of the surface; depth (N,).
        """
        hit = self._solid.rays.cast(self._eye, rays)
        depth = hit["t"]

        # Marks before them.
        if self._marks.count:
            before = np.flatnonzero(self._marks.rays.distance(np.zeros(3), rays) < depth)
            marked = self._marks.rays.cast(np.zeros(3), rays[before])
            depth[before] = marked["t"]
            hit["triangle"][before] = self._solid.count + marked["triangle"]
            hit["normal"][before] = marked["normal"]
        length = np.linalg.norm(rays, axis=1)
        ways = rays / length[:, None]

        visible = np.flatnonzero(np.isfinite(depth))
        triangle = hit["triangle"][visible]
        normal = hit["normal"][visible]
        facing = -np.einsum("ij,ij->i", normal, ways[visible])
        normal *= np.sign(facing)[:, None]

        colours = np.zeros((len(rays), 3), dtype=np.float32)
        points = depth[visible, None] * rays[visible]
        light, sunny = self._light(points, normal, abs(facing))
        light[triangle >= self._solid.count] = 1.0
        colours[visible] = self._colours[triangle] * light

        surface = np.zeros((len(rays), 7), dtype=np.float32)
        surface[visible] = np.column_stack([normal, self._colours[triangle], sunny])
        return self._sea.seen(colours, ways, depth * length), surface, depth

    def _light(self, points: Floats, normal: Floats, facing: Floats) -> tuple[Floats, np.ndarray]:
        """Light (N, 3) on points (N, 3) [m] relative to the camera, and mask (N,) of those in the
        sun.
        """
        steep = np.clip(normal @ SUN_W.astype(np.float32), 0.0, None)
        towards = np.flatnonzero(steep > 0.0)
        sun = np.tile(SUN_W, (len(towards), 1))
        starts = self._eye + points[towards] + _OFF * normal[towards]
        free = ~np.isfinite(self._solid.rays.distance(starts, sun))
        steep[towards] *= free
        sunny = np.zeros(len(points), dtype=bool)
        sunny[towards] = free

        around = _AROUND + (0.5 + 0.5 * normal[:, 2:]) * _ABOVE
        light = around + steep[:, None] * _SUN + facing[:, None] * _LAMP
        light *= self._sea.sand(points + self._eye_W)[:, None]
        return light, sunny


def _edges(surface: Floats, depth: Floats) -> np.ndarray:
    """Mask (h, w) of pixels next to another surface, which differs in colour, normal, shadow or
    depth.
    """
    edge = np.zeros(depth.shape, dtype=bool)
    near = np.where(np.isfinite(depth), depth, _NOTHING)

    for before, after in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        step = abs(surface[after] - surface[before]).max(axis=-1) > _OTHER
        step |= abs(near[after] - near[before]) > _EDGE * np.minimum(near[after], near[before])
        edge[before] |= step
        edge[after] |= step

    return edge

"""Survey of an object: depth frames around it, fused to a mesh and compared with its model."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ply_files import write_ply
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects.targets import TargetModel
from uuv.perception.clouds.surface_fusion import SurfaceFusion, SurfaceMesh
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array, inverse, transform_points
from uuv.sim.loop.rollout import Moment, Observer
from uuv.sim.sensors.depth_camera import DepthCamera

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EVERY = 1000  # ticks between two frames, 2 s
# [m] from the model within which a surface is the object's: growth of 4 cm, and errors
REACH = 0.06
_GROUND = 0.03  # [m] above the seabed below which nothing is kept
_COLOURS = "RdBu_r"  # colour map; red: outside the model, blue: inside
_WIDTH = 700  # [px] of a picture
_VIEWS = {"from +x": (1.0, 0.0, 0.0), "from -y": (0.0, -1.0, 0.0), "from above": (0.0, 0.0, 1.0)}


class SurveyStory:
    """Observer that logs the mesh of a survey when the work is done, and passes all to `story`."""

    slow_ticks = ()

    def __init__(self, story: Observer, survey: "SurfaceSurvey", log: Any) -> None:
        self._story = story
        self._survey = survey
        self._log = log

    def observe(self, moment: Moment) -> None:
        """Add the mesh once the work is done."""
        self._story.observe(moment)
        if (
            self._log is None
            or moment.reference.state is not WorkState.DONE
            or self._survey.X_WT is None
        ):
            return

        mesh = self._survey.mesh
        X_WT = self._survey.X_WT
        self._log.log_mesh(
            "survey",
            transform_points(X_WT, mesh.vertices),
            mesh.triangles,
            moment.truth.time,
            colours(mesh),
        )
        self._log = None


class SurfaceSurvey:
    """Observer that fuses a depth frame at the estimated pose every `EVERY` ticks of the work."""

    slow_ticks = (EVERY,)

    def __init__(self, model: TargetModel, floor_W: float, seed: int) -> None:
        """Set up the survey.

        Args:
            model: Of the object, as the vehicle knows it.
            floor_W: [m] height of the seabed in W.
            seed: Of the noise of the frames.

        Raises:
            MissingLibraryError: Open3D is not installed.
        """
        # Normals of the model's triangles.
        vertices = np.asarray(model.vertices)
        corners = vertices[model.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

        self._surface = NearestSurface.of(vertices, model.triangles)
        self._fusion = SurfaceFusion([vertices.min(axis=0) - REACH, vertices.max(axis=0) + REACH])
        self._floor = floor_W + _GROUND
        self._rng = np.random.default_rng([seed, EVERY])

        self._camera: DepthCamera | None = None
        self._state: Any = None  # of the camera
        self._mesh: SurfaceMesh | None = None
        self.X_WT: Array | None = None  # (4, 4) pose that was found

    def look_through(self, camera: DepthCamera) -> None:
        """Take the frames with `camera`."""
        self._camera = camera
        self._state = camera.init(self._rng)

    def observe(self, moment: Moment) -> None:
        """Add a frame, if one is due."""
        due = moment.tick % EVERY == 0 and moment.reference.state is WorkState.WORK
        if not due or self._camera is None or moment.target is None:
            return

        self.X_WT = moment.target.X_WT
        self._state, image = self._camera.step(self._state, moment.truth)
        self._fusion.add(image, inverse(self.X_WT) @ moment.estimate.X_WB @ image.X_BC)
        self._mesh = None

    def save(self) -> tuple[Array | None, Any]:
        """Identified pose, and state of the camera.

        Raises:
            ConfigurationError: There are frames already; Open3D's field cannot be copied.
        """
        if self.frames:
            raise ConfigurationError(
                "saved run: a mesh that has begun cannot be copied; save an earlier phase than work"
            )
        return self.X_WT, self._state

    def resume(self, saved: tuple[Array | None, Any]) -> None:
        """Continue from the state that `save` of an equal survey returned."""
        self.X_WT, self._state = saved

    @property
    def frames(self) -> int:
        """Number of frames so far."""
        return self._fusion.frames

    @property
    def mesh(self) -> SurfaceMesh:
        """Mesh in T of all frames so far, without the seabed."""
        if self._mesh is None:
            whole = self._fusion.mesh(self._surface, self._normals, REACH)
            height = (
                np.zeros(len(whole.vertices))
                if self.X_WT is None
                else whole.vertices @ self.X_WT[2, :3]
            )
            above = height + (0.0 if self.X_WT is None else self.X_WT[2, 3]) > self._floor

            # What is left of the mesh, and only the vertices that it uses.
            triangles = whole.triangles[above[whole.triangles].all(axis=1)]
            used, index = np.unique(triangles, return_inverse=True)
            self._mesh = SurfaceMesh(
                vertices=whole.vertices[used],
                triangles=index.reshape(-1, 3),
                deviation=whole.deviation[used],
            )
        return self._mesh

    def write(self, file: Path) -> None:
        """Write the mesh, coloured by its deviation, as a PLY file in T [m]."""
        mesh = self.mesh
        write_ply(file, mesh.vertices, mesh.triangles, colours=colours(mesh))

    def pictures(self) -> Iterator[tuple[str, str, "Figure"]]:
        """Picture of the mesh from three sides, in the colours of its deviation."""
        from matplotlib.figure import Figure

        mesh = self.mesh
        if not len(mesh.triangles):
            return

        figure = Figure(figsize=(10.0, 4.2), layout="constrained")
        scene = RayScene(mesh.vertices, mesh.triangles)
        most = 1e3 * _most(mesh)

        for axes, (title, way) in zip(figure.subplots(1, 3), _VIEWS.items(), strict=True):
            picture, extent = _seen_from(scene, mesh, np.array(way))
            axes.imshow(
                1e3 * picture,
                cmap=_COLOURS,
                vmin=-most,
                vmax=most,
                extent=extent,
                interpolation="nearest",
            )
            axes.set(title=title, xlabel="[m]", facecolor="0.85")

        figure.colorbar(
            figure.axes[0].images[0],
            ax=figure.axes,
            label="deviation from the model, outside positive [mm]",
            shrink=0.8,
        )

        yield (
            "Surface that was measured",
            f"Mesh of {self.frames} depth frames at the estimated poses of the vehicle, in the "
            "object's own frame; grey: not seen.",
            figure,
        )


def colours(mesh: SurfaceMesh) -> Array:
    """Colours (V, 3) in [0, 1] of the vertices by their deviation."""
    from matplotlib import colormaps

    return np.asarray(colormaps[_COLOURS](0.5 + 0.5 * mesh.deviation / _most(mesh)))[:, :3]


def _most(mesh: SurfaceMesh) -> float:
    """Deviation [m] at the ends of the colour scale."""
    return (
        max(0.003, float(np.percentile(np.abs(mesh.deviation), 98.0)))
        if len(mesh.deviation)
        else 0.003
    )


def _seen_from(
    scene: RayScene, mesh: SurfaceMesh, way: Array
) -> tuple[Array, tuple[float, float, float, float]]:
    """Deviation (h, w) [m] as seen from `way` (3,) at infinity, NaN off the mesh; extent [m]."""
    up = np.array([0.0, 0.0, 1.0]) if abs(way[2]) < 0.5 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, way)

    # A grid of rays across the mesh, in the axes of the picture.
    x, y, z = mesh.vertices @ right, mesh.vertices @ up, mesh.vertices @ way
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    pitch = float((high - low).max()) / _WIDTH
    columns, rows = np.arange(low[0], high[0], pitch), np.arange(high[1], low[1], -pitch)
    starts = columns[None, :, None] * right + rows[:, None, None] * up + (z.max() + 0.1) * way
    hit = scene.cast(starts.reshape(-1, 3), np.broadcast_to(-way, (starts.size // 3, 3)))

    deviation = np.full(len(hit["t"]), np.nan)
    met = np.isfinite(hit["t"])
    deviation[met] = mesh.deviation[mesh.triangles[hit["triangle"][met]]].mean(axis=1)
    return deviation.reshape(len(rows), len(columns)), (low[0], high[0], low[1], high[1])

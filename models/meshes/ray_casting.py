"""Ray casting on a triangle mesh by Embree, with exact first hits and without screen, GL or system
library.

Embree is used through the package `embreex`. On Linux on ARM, for which `embreex` has no wheel,
Open3D's binding of the same library is used. The module is in `models` because `sim` (depth camera,
sonar) and `perception` both need it and do not import each other.
"""

from functools import cache
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.meshes import open3d_loader
from uuv.models.meshes.far_origin import middle_if_far
from uuv.sim.interfaces.errors import MissingLibraryError

Engine = Literal["embree", "open3d"]

_NO_HIT = 9e36  # initial length of Embree's rays; a ray without a hit keeps it


class RayScene:
    """A triangle mesh prepared for ray casting."""

    __slots__ = ("_engine", "_middle", "_scene")

    def __init__(
        self, vertices: ArrayLike, triangles: ArrayLike, engine: Engine | None = None
    ) -> None:
        """Build the scene; rays never hit triangles without area or with a vertex that is not
        finite.

        Args:
            vertices: (V, 3) [m], stored in single precision, relative to their middle if it is far
                from the origin.
            triangles: (T, 3) indices.
            engine: None: the installed engine.

        Raises:
            MissingLibraryError: no engine is installed.
        """
        self._engine = engine or installed()

        vertices = np.asarray(vertices)
        middle = middle_if_far(vertices)
        self._middle = middle if middle.any() else None
        corners = np.ascontiguousarray(
            vertices if self._middle is None else vertices - middle, dtype=np.float32
        )

        if self._engine == "open3d":
            self._scene = open3d_loader.load().t.geometry.RaycastingScene()
            self._scene.add_triangles(corners, np.ascontiguousarray(triangles, dtype=np.uint32))
            return
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        faces = np.ascontiguousarray(triangles, dtype=np.int32)
        # otherwise Embree would read beyond the array
        if faces.size and not 0 <= faces.min() <= faces.max() < len(corners):
            raise IndexError(
                f"triangles: must refer to vertices 0 to {len(corners) - 1}, got {faces.min()} to "
                f"{faces.max()}"
            )

        # Without the robust mode, 13 % of the rays aimed at an edge miss it.
        self._scene = EmbreeScene(_device(), robust=True)
        if len(faces):
            TriangleMesh(self._scene, corners, faces)

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> dict[str, np.ndarray]:
        """Cast N rays.

        Args:
            origins: (N, 3) or (3,) [m].
            directions: (N, 3), of any length.

        Returns:
            `t` (N,) in units of the direction's length (inf without a hit), `triangle` (N,) index,
            and `normal` (N, 3) unit normal of the triangle by its winding. Without a hit the latter
            two are undefined.
        """
        starts, ways = self._rays(origins, directions)
        if self._engine == "open3d":
            rays = np.concatenate([starts, ways], axis=-1)
            hit = self._scene.cast_rays(open3d_loader.load().core.Tensor.from_numpy(rays))
            return {
                "t": hit["t_hit"].numpy(),
                "triangle": hit["primitive_ids"].numpy(),
                "normal": hit["primitive_normals"].numpy(),
            }

        hit = self._scene.run(starts.reshape(-1, 3), ways.reshape(-1, 3), output=1)
        missed = hit["primID"] < 0
        hit["tfar"][missed] = np.inf
        normal = hit["Ng"]
        normal[missed] = 0.0
        length = np.sqrt(np.einsum("ij,ij->i", normal, normal, dtype=np.float64))
        normal /= np.where(length > 0.0, length, 1.0)[:, None].astype(np.float32)

        shape = ways.shape[:-1]
        return {
            "t": hit["tfar"].reshape(shape),
            "triangle": hit["primID"].reshape(shape),
            "normal": normal.reshape(ways.shape),
        }

    def distance(self, origins: ArrayLike, directions: ArrayLike) -> np.ndarray:
        """Only the `t` of `cast`, in half the time.

        Args:
            origins: (N, 3) or (3,) [m].
            directions: (N, 3), of any length.

        Returns:
            Distances (N,) in units of the direction's length, inf without a hit.
        """
        if self._engine == "open3d":
            return self.cast(origins, directions)["t"]
        starts, ways = self._rays(origins, directions)
        t = self._scene.run(starts.reshape(-1, 3), ways.reshape(-1, 3), query="DISTANCE")
        t[t > _NO_HIT] = np.inf
        return t.reshape(ways.shape[:-1])

    def _rays(self, origins: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Origins relative to the middle, one for each direction, and directions, in single
        precision.
        """
        ways = np.ascontiguousarray(directions, dtype=np.float32)
        starts = np.empty_like(ways)
        starts[...] = origins if self._middle is None else np.asarray(origins) - self._middle
        return starts, ways


class OneSidedScene(RayScene):
    """A surface that is known from outside only; a hit from behind counts as no hit."""

    __slots__ = ()

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> dict[str, np.ndarray]:
        """As `RayScene.cast`."""
        hit = super().cast(origins, directions)
        behind = np.einsum("...i,...i->...", hit["normal"], np.asarray(directions)) > 0.0
        hit["t"] = np.where(behind, np.inf, hit["t"]).astype(hit["t"].dtype)
        return hit

    def distance(self, origins: ArrayLike, directions: ArrayLike) -> np.ndarray:
        """As `RayScene.distance`."""
        return self.cast(origins, directions)["t"]


@cache
def installed() -> Engine:
    """Name of the installed engine, embree before open3d.

    Raises:
        MissingLibraryError: neither `embreex` nor Open3D is installed.
    """
    if find_spec("embreex"):
        return "embree"
    if find_spec("open3d"):
        return "open3d"
    raise MissingLibraryError(
        "cameras and sonars need the package embreex: pip install 'uuv-arm[perception]'"
    )


@cache
def _device() -> Any:
    """Embree's device, shared by all scenes, since each device starts threads of its own."""
    from embreex.rtcore import EmbreeDevice

    return EmbreeDevice()

"""First hits of rays on a triangle mesh, by Embree: exact, and with no need of a screen, GL or a system library.

Embree itself is used, by `embreex`. It has no wheel for Linux on ARM: there, Open3D's binding of the same library is.
This lives in `models` because `sim` (depth camera, sonar) and `perception` both need it and do not import each other.
"""

from functools import cache
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from models.meshes import open3d_loader
from sim.interfaces.errors import MissingLibraryError

Engine = Literal["embree", "open3d"]


class RayScene:
    """One mesh, ready for rays."""

    __slots__ = ("_engine", "_scene")

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, engine: Engine | None = None) -> None:
        """Vertices (V, 3) [m], held in single precision, so best near the origin; triangles (T, 3) indices.

        Triangles without area, or with a vertex that is not finite, are never hit. `engine`: None, what is installed.
        Raises MissingLibraryError if that is nothing.
        """
        self._engine = engine or installed()
        corners = np.ascontiguousarray(vertices, dtype=np.float32)
        if self._engine == "open3d":
            self._scene = open3d_loader.load().t.geometry.RaycastingScene()
            self._scene.add_triangles(corners, np.ascontiguousarray(triangles, dtype=np.uint32))
            return
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        faces = np.ascontiguousarray(triangles, dtype=np.int32)
        if faces.size and not 0 <= faces.min() <= faces.max() < len(corners):  # Embree would read beyond the array
            raise IndexError(f"triangles point at vertices {faces.min()} to {faces.max()} of {len(corners)}")
        # Not robust, it loses rays at edges: 13 % of those aimed at one.
        self._scene = EmbreeScene(_device(), robust=True)
        if len(faces):
            TriangleMesh(self._scene, corners, faces)

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> dict[str, np.ndarray]:
        """Cast N rays: origins (N, 3) or (3,) [m], directions (N, 3).

        Returns `t` (N,) (inf where nothing is hit, in units of the direction's length), `triangle` (N,) index and
        `normal` (N, 3) unit normal of the triangle hit, by its winding; where nothing is hit these mean nothing.
        """
        ways = np.ascontiguousarray(directions, dtype=np.float32)
        starts = np.empty_like(ways)
        starts[...] = origins
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


@cache
def installed() -> Engine:
    """The engine that is used.

    Raises MissingLibraryError without `embreex` and Open3D.
    """
    if find_spec("embreex"):
        return "embree"
    if find_spec("open3d"):
        return "open3d"
    raise MissingLibraryError(
        "rays need the package embreex (pip install embreex), or where it has no wheel Open3D (pip install open3d)"
    )


@cache
def _device() -> Any:
    """Embree's device, one for all scenes: each new one would start threads of its own."""
    from embreex.rtcore import EmbreeDevice

    return EmbreeDevice()

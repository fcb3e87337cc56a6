"""The one place that imports Open3D: late, libusb preloaded, with a clear error where the system lacks a library.

It lives in `models` because `sim` (depth camera) and `perception` both need it and do not import each other.
"""

import ctypes
import warnings
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim.interfaces.errors import MissingLibraryError

DEBIAN_PACKAGES = "libgl1 libegl1 libx11-6 libudev1 libidn2-0"


@cache
def load() -> Any:
    """The `open3d` module, imported on the first call (about 1-2 s).

    Raises MissingLibraryError, with the Debian packages to install, if Open3D or a system library it needs is missing.
    """
    try:
        import libusb_package

        # Open3D's extension wants libusb-1.0.so.0 although no camera is used; bare machines do not have it.
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import open3d  # pyright: ignore[reportMissingImports]
    except (ImportError, OSError) as error:
        raise MissingLibraryError(
            f"Open3D cannot be imported ({error}). Physics and control run without it; depth frames and "
            f"identification do not. On Debian or Ubuntu: apt install {DEBIAN_PACKAGES}"
        ) from error
    # Its warnings go to stdout; everything that matters comes back to our callers as an error.
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def ray_scene(vertices: ArrayLike, triangles: ArrayLike) -> Any:
    """An Open3D RaycastingScene of one mesh: vertices (V, 3) [m], triangles (T, 3) indices.

    Raises MissingLibraryError as `load`.
    """
    o3d = load()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        np.ascontiguousarray(vertices, dtype=np.float32), np.ascontiguousarray(triangles, dtype=np.uint32)
    )
    return scene


def cast_rays(scene: Any, origins: ArrayLike, directions: ArrayLike) -> dict[str, np.ndarray]:
    """Cast N rays: origins (N, 3) or (3,) [m], directions (N, 3).

    Returns `t` (N,) (inf where nothing is hit, in units of the direction's length), `triangle` (N,) index and
    `normal` (N, 3) unit normal of the triangle hit, by its winding.
    """
    o3d = load()
    way = np.asarray(directions, dtype=np.float32)
    rays = np.empty((*way.shape[:-1], 6), dtype=np.float32)
    rays[..., :3] = origins
    rays[..., 3:] = way
    hit = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
    return {
        "t": hit["t_hit"].numpy(),
        "triangle": hit["primitive_ids"].numpy(),
        "normal": hit["primitive_normals"].numpy(),
    }

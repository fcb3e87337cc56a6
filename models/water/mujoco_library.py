"""MuJoCo's C library, for functions that its Python package does not expose."""

import ctypes
from pathlib import Path

import mujoco

from uuv.sim.interfaces.errors import HydrodynamicsError


def library() -> ctypes.CDLL:
    """MuJoCo's C library, as loaded by the Python package.

    Raises:
        HydrodynamicsError: No library file is there.
    """
    folder = Path(str(mujoco.__file__)).parent
    patterns = ("libmujoco.so.*", "libmujoco.*.dylib", "mujoco.dll")
    files = [path for pattern in patterns for path in folder.glob(pattern)]
    if not files:
        raise HydrodynamicsError(
            f"there is no MuJoCo library in {folder}; searched for {', '.join(patterns)}"
        )
    return ctypes.CDLL(str(files[0]))

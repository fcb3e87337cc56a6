"""MJCF text of a spec with every digit, and MuJoCo's C library, which can write it."""

import ctypes
from pathlib import Path

import mujoco

from uuv.sim.interfaces.errors import HydrodynamicsError

_DIGITS = 17  # with which a double survives being written


def library() -> ctypes.CDLL:
    """MuJoCo's C library, as loaded by the Python package.

    Raises:
        HydrodynamicsError: No library file was found.
    """
    folder = Path(str(mujoco.__file__)).parent
    patterns = ("libmujoco.so.*", "libmujoco.*.dylib", "mujoco.dll")
    found = [path for pattern in patterns for path in folder.glob(pattern)]
    if not found:
        raise HydrodynamicsError(f"no MuJoCo library in {folder}; looked for {', '.join(patterns)}")
    return ctypes.CDLL(str(found[0]))


def exact_xml(spec: mujoco.MjSpec) -> str:
    """MJCF of a spec; numbers keep all their digits where this MuJoCo can write them, else six."""
    native = library()
    try:
        get, put = native._mjPRIVATE__get_xml_precision, native._mjPRIVATE__set_xml_precision
    except AttributeError:
        return spec.to_xml()
    get.restype, put.argtypes = ctypes.c_int, [ctypes.c_int]
    before = get()
    put(_DIGITS)
    try:
        return spec.to_xml()
    finally:
        put(before)

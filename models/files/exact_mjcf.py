"""MJCF text of a spec with all digits, written by MuJoCo's C library."""

import ctypes

import mujoco

from uuv.models.water.mujoco_library import library

_DIGITS = 17  # number of digits with which a double is written without loss


def exact_xml(spec: mujoco.MjSpec) -> str:
    """MJCF of a spec, with all digits if this version of MuJoCo can write them, else with six."""
    native = library()
    try:
        get = native._mjPRIVATE__get_xml_precision
        put = native._mjPRIVATE__set_xml_precision
    except AttributeError:
        return spec.to_xml()

    get.restype = ctypes.c_int
    put.argtypes = [ctypes.c_int]

    before = get()
    put(_DIGITS)
    try:
        return spec.to_xml()
    finally:
        put(before)

"""MJCF text of a spec with every digit, which MuJoCo's C library can write."""

import ctypes

import mujoco

from uuv.models.water.mujoco_library import library

_DIGITS = 17  # with which a double survives being written


def exact_xml(spec: mujoco.MjSpec) -> str:
    """MJCF of a spec; numbers keep all their digits where this MuJoCo can write them, else six."""
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

"""Mark of specs whose water or gears need native code: MuJoCo alone refuses to read their MJCF.

The mark is the declaration of a plug-in by the name of the module that brings the code,

    <extension> <plugin plugin="uuv.sim.hydrodynamics"/> </extension>

and an import of this module makes the name known. Elsewhere MuJoCo says "plugin
uuv.sim.hydrodynamics not found" instead of moving the model dry. The plug-in has no instance and
does nothing: a compiled model, and so an MJB, holds no trace of it.

An instance would be no remedy for MJB (MuJoCo 3.17.0 and 4.0.0). The file stores its number, not
its name. Where the number is free, `mj_makeData` ends the process by a segmentation fault; where
another plug-in has it, that one runs instead. `MjSpec.attach` and `MjSpec.copy` keep an instance
only if it has a name and a body refers to it. They make an invalid model of a plug-in that stands
within a body, and drop an instance without a body in silence.
"""

import ctypes
import re
from typing import Any

import mujoco

from uuv.models.water.mujoco_library import library

PLUGIN = "uuv.sim.hydrodynamics"

_LINE = re.compile(rf'\s*<plugin plugin="{re.escape(PLUGIN)}"/>(?=\s)')
_EMPTY = re.compile(r"\s*<extension>\s*</extension>|\s*<extension/>")


def _refuse_instance(_model: int, _data: int, _instance: int) -> int:
    # MuJoCo then makes no data: an MJB of another process may mean another plug-in by our number.
    return -1


def _no_state(_model: int, _instance: int) -> int:
    return 0


_INSTANCES = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int)
_INIT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)


class _Plugin(ctypes.Structure):
    """Beginning of `mjpPlugin`, in mjplugin.h; the rest is zero."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.c_void_p),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        ("nstate", _INSTANCES),
        ("nsensordata", ctypes.c_void_p),
        ("init", _INIT),
        ("others", ctypes.c_void_p * 16),
    )


def mark(spec: mujoco.MjSpec) -> None:
    """Mark a spec; its copies, its MJCF and the specs that it is attached to have the mark too."""
    spec.activate_plugin(PLUGIN)


def without_mark(xml: str) -> str:
    """MJCF without the mark, for a file that MuJoCo alone shall read."""
    return _EMPTY.sub("", _LINE.sub("", xml))


def _registered() -> Any:
    """Make the name known to MuJoCo; returns what must live as long as the process."""
    functions = {"nstate": _INSTANCES(_no_state), "init": _INIT(_refuse_instance)}
    plugin = _Plugin(name=PLUGIN.encode(), **functions)
    library().mjp_registerPlugin(ctypes.byref(plugin))
    return plugin


_PLUGIN = _registered()

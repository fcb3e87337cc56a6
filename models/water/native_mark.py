"""Mark for specs whose water or gears need native code; MuJoCo alone then refuses to read their
MJCF.

The mark is the declaration of a plug-in with the name of the module that contains the code,

    <extension> <plugin plugin="uuv.sim.hydrodynamics"/> </extension>

and an import of this module registers the name. In a process without it MuJoCo raises the error
"plugin uuv.sim.hydrodynamics not found" instead of simulating the model without water. The plug-in
has no instance and no effect, so a compiled model, and therefore an MJB, does not contain the mark.

An instance would not mark an MJB safely (MuJoCo 3.17.0 and 4.0.0). An MJB stores the number of a
plug-in, not its name. If no plug-in has that number, `mj_makeData` ends the process by a
segmentation fault; if another plug-in has it, the other plug-in runs instead. `MjSpec.attach` and
`MjSpec.copy` keep an instance only if it has a name and a body refers to it. If the plug-in is
within a body, they produce an invalid model. If an instance has no body, they drop it without a
message.
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
    # MuJoCo then creates no data, since in an MJB of another process this number may mean another
    # plug-in.
    return -1


def _no_state(_model: int, _instance: int) -> int:
    return 0


_INSTANCES = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_int)
_INIT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)


class _Plugin(ctypes.Structure):
    """First fields of `mjpPlugin` in mjplugin.h; the other fields are zero."""

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
    """MJCF without the mark, for a file that MuJoCo alone can read."""
    return _EMPTY.sub("", _LINE.sub("", xml))


def _registered() -> Any:
    """Register the name with MuJoCo; returns the objects that must live as long as the process."""
    functions = {"nstate": _INSTANCES(_no_state), "init": _INIT(_refuse_instance)}
    plugin = _Plugin(name=PLUGIN.encode(), **functions)
    library().mjp_registerPlugin(ctypes.byref(plugin))
    return plugin


_PLUGIN = _registered()

"""Calibration of a serial arm from touch data: kinematic and elastic parameters with their uncertainty.

Names are imported on first use, so that `from uuv import calib` loads neither numba nor SciPy.
"""

if __name__ != "uuv.calib":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.calib")


from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uuv.calib.identification import Calibration, MapFit, identify
    from uuv.calib.loads import Loads
    from uuv.models.arms.serial_arm import SerialArm as Arm

_HOME = {  # of each name: the module, and the name there
    "Arm": ("uuv.models.arms.serial_arm", "SerialArm"),
    "Calibration": ("uuv.calib.identification", "Calibration"),
    "Loads": ("uuv.calib.loads", "Loads"),
    "MapFit": ("uuv.calib.identification", "MapFit"),
    "identify": ("uuv.calib.identification", "identify"),
}
__all__ = ["Arm", "Calibration", "Loads", "MapFit", "identify"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'calib' has no attribute {name!r}; it has {__all__}")
    module, own = _HOME[name]
    return getattr(import_module(module), own)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

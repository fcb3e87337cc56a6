"""Calibration of a serial arm from touches: kinematic and elastic parameters with intervals.

Names are imported on first use, so that `from uuv import calib` loads neither numba nor SciPy.
"""

if __name__ != "uuv.calib":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.calib")

from uuv.sim.interfaces.lazy_names import names_of_stub

__getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)

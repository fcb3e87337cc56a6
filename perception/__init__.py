"""Perception: clouds, target poses, surfaces and tool paths from depth frames and sonar scans.

Names are imported on first use, so that `from uuv import perception` needs neither Embree nor
SciPy.
"""

if __name__ != "uuv.perception":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.perception")

from uuv.sim.interfaces.lazy_names import names_of_stub

__getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)

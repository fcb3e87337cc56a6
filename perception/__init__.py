"""Perception: point clouds, target poses, surfaces and tool paths from depth frames and sonar scans.

Names are imported on first use, so that `from uuv import perception` needs neither Embree nor SciPy.
"""

if __name__ != "uuv.perception":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.perception")


from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uuv.perception.clouds.scan import Scan, SensorModel
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.perception.registration.identification import Identification, identify
    from uuv.perception.registration.recognition import Recognition, identify_together, recognise
    from uuv.perception.toolpath.path_planner import plan_path

_HOME = {
    "Identification": "uuv.perception.registration.identification",
    "KnownObjectFinder": "uuv.perception.finding.target_finder",
    "Recognition": "uuv.perception.registration.recognition",
    "Scan": "uuv.perception.clouds.scan",
    "SensorModel": "uuv.perception.clouds.scan",
    "identify": "uuv.perception.registration.identification",
    "identify_together": "uuv.perception.registration.recognition",
    "plan_path": "uuv.perception.toolpath.path_planner",
    "recognise": "uuv.perception.registration.recognition",
}
__all__ = [
    "Identification",
    "KnownObjectFinder",
    "Recognition",
    "Scan",
    "SensorModel",
    "identify",
    "identify_together",
    "plan_path",
    "recognise",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'perception' has no attribute {name!r}; it has {__all__}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

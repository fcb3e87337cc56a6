"""Perception: point clouds, target poses, surfaces and tool paths from depth frames and sonar scans.

Names are imported on first use, so that `import perception` needs neither Embree nor SciPy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from perception.clouds.scan import Scan, SensorModel
    from perception.registration.identification import Identification, identify
    from perception.registration.recognition import Recognition, identify_together, recognise
    from perception.target_finder import KnownObjectFinder
    from perception.toolpath.path_planner import plan_path

_HOME = {
    "Identification": "perception.registration.identification",
    "KnownObjectFinder": "perception.target_finder",
    "Recognition": "perception.registration.recognition",
    "Scan": "perception.clouds.scan",
    "SensorModel": "perception.clouds.scan",
    "identify": "perception.registration.identification",
    "identify_together": "perception.registration.recognition",
    "plan_path": "perception.toolpath.path_planner",
    "recognise": "perception.registration.recognition",
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

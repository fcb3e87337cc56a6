"""The vehicle in dm_control: entities, tasks and experts for composer, and the same tasks in Gymnasium.

    from uuv import environments as composer

    environment = composer.load("barrel", "press", seed=0)
    policy = composer.expert(environment)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))

docs/environments.md tells the rest. Names are imported on first use.
"""

import os
import sys
from ctypes.util import find_library
from importlib import import_module
from typing import TYPE_CHECKING, Any

from uuv.sim.interfaces.extras import check_dm_control_physics, without_dm_control

_BACKENDS = {"EGL": "egl", "OSMesa": "osmesa"}  # by library, that draw without a screen


def _choose_renderer() -> None:
    """Without a screen, choose a renderer that needs none; else dm_control takes GLFW, which then warns and fails."""
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    chosen = "MUJOCO_GL" in os.environ or "dm_control" in sys.modules  # by the user, or by dm_control already
    if chosen or screen or sys.platform != "linux":
        return
    found = (backend for library, backend in _BACKENDS.items() if find_library(library))
    os.environ["MUJOCO_GL"] = next(found, "off")


_choose_renderer()
try:
    import_module("dm_control.composer")
except Exception as error:  # of any type: dm_control generates its classes from MuJoCo's names
    raise without_dm_control(error) from error
check_dm_control_physics()

if TYPE_CHECKING:
    from uuv.environments.entities import ArmEntity, Sea, ToolEntity, VehicleEntity, WorkObjectEntity
    from uuv.environments.episodes import record_episodes, score
    from uuv.environments.experts import at_random, expert, zero
    from uuv.environments.pictures import picture, view
    from uuv.environments.suite import ALL_TASKS, BY_TAG, environment, load
    from uuv.environments.vehicle_task import VehicleTask

_HOME = {
    "ALL_TASKS": "suite",
    "ArmEntity": "entities",
    "BY_TAG": "suite",
    "Sea": "entities",
    "ToolEntity": "entities",
    "VehicleEntity": "entities",
    "VehicleTask": "vehicle_task",
    "WorkObjectEntity": "entities",
    "at_random": "experts",
    "environment": "suite",
    "expert": "experts",
    "load": "suite",
    "picture": "pictures",
    "record_episodes": "episodes",
    "score": "episodes",
    "view": "pictures",
    "zero": "experts",
}
__all__ = [
    "ALL_TASKS",
    "BY_TAG",
    "ArmEntity",
    "Sea",
    "ToolEntity",
    "VehicleEntity",
    "VehicleTask",
    "WorkObjectEntity",
    "at_random",
    "environment",
    "expert",
    "load",
    "picture",
    "record_episodes",
    "score",
    "view",
    "zero",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'uuv.environments' has no attribute {name!r}; it has {__all__}")
    return getattr(import_module(f"uuv.environments.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

"""The vehicle in dm_control: entities, tasks and experts for composer, and Gymnasium tasks.

    from uuv import environments as composer

    environment = composer.load("barrel", "press", seed=0)
    policy = composer.expert(environment)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))

See docs/environments.md for the rest. Names are imported on first use.
"""

import os
import sys
from ctypes.util import find_library
from importlib import import_module

from uuv.sim.interfaces.extras import check_dm_control_physics, without_dm_control
from uuv.sim.interfaces.lazy_names import names_of_stub

_BACKENDS = {"EGL": "egl", "OSMesa": "osmesa"}  # renderers that draw without a screen, by library


def _choose_renderer() -> None:
    """Without a screen, choose a renderer that needs none, since dm_control's GLFW would fail."""
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    # set by the user, or by dm_control already
    chosen = "MUJOCO_GL" in os.environ or "dm_control" in sys.modules
    if chosen or screen or sys.platform != "linux":
        return

    backends = (backend for library, backend in _BACKENDS.items() if find_library(library))
    os.environ["MUJOCO_GL"] = next(backends, "off")


_choose_renderer()
try:
    import_module("dm_control.composer")
# an exception of any type, since dm_control generates its classes from MuJoCo's names
except Exception as error:
    raise without_dm_control(error) from error
check_dm_control_physics()

__getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)

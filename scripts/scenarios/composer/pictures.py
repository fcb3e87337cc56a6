"""Pictures of an environment by dm_control's renderer, where there is a GL, and its viewer."""

import os
import sys
from typing import Any

import numpy as np
from dm_control import mjcf

from sim.interfaces.errors import MissingLibraryError

SIZE = 240, 320  # [px] height and width
CAMERA = "overview"  # of the sea


def picture(physics: mjcf.Physics, *, size: tuple[int, int] = SIZE, camera: str | int = CAMERA) -> np.ndarray:
    """Picture (height, width, 3) uint8 of a scene.

    Args:
        physics: Of the environment.
        size: [px] height and width.
        camera: Name or number of a camera of the scene.

    Raises:
        MissingLibraryError: There is no GL to draw with.
    """
    try:
        return physics.render(*size, camera_id=camera)
    except Exception as error:  # of any type: dm_control's backends raise their own
        if isinstance(error, KeyError | ValueError):  # the camera
            raise
        raise MissingLibraryError(_no_gl(error)) from error


def view(environment: Any, policy: Any = None) -> None:
    """Open dm_control's viewer on an environment, with a policy of `scenarios.composer.experts`.

    Raises:
        MissingLibraryError: There is no screen or no GL.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MissingLibraryError(
            "no viewer: there is no screen (DISPLAY is not set); xvfb-run makes one, picture() needs none"
        )
    try:
        from dm_control import viewer

        viewer.launch(environment, policy=policy, title="uuv-arm")
    except Exception as error:  # of any type: GLFW and GL raise their own
        raise MissingLibraryError(_no_gl(error)) from error


def _no_gl(error: Exception) -> str:
    backend = os.environ.get("MUJOCO_GL", "not set")
    why = str(error).strip().splitlines()
    return (
        f"no picture: dm_control finds no GL (MUJOCO_GL is {backend}): install libegl1 for MUJOCO_GL=egl, or "
        f"libosmesa6 for MUJOCO_GL=osmesa ({type(error).__name__}{f': {why[0]}' if why else ''})"
    )

"""Images of an environment by dm_control's renderer, if a GL is available, and dm_control's
viewer.
"""

import os
import sys
from typing import Any

import numpy as np
from dm_control import mjcf

from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.spatial import shown, whole_number

SIZE = 240, 320  # [px] height and width
CAMERA = "vehicle/overview"  # next to the vehicle, moving with it
MOST = 1080, 1920  # [px] largest height and width


def picture(
    physics: mjcf.Physics, *, size: tuple[int, int] = SIZE, camera: str | int = CAMERA
) -> np.ndarray:
    """Image (height, width, 3) uint8 of a scene.

    Args:
        physics: Physics of the environment.
        size: [px] height and width.
        camera: Name or number of a camera of the scene.

    Raises:
        ConfigurationError: There is no such camera, or the size is out of range.
        MissingLibraryError: No GL is available for rendering.
    """
    height, width = (
        whole_number(pixels, "size [px]", least=1, most=most)
        for pixels, most in zip(size, MOST, strict=True)
    )

    model = physics.model.ptr
    names = [model.camera(i).name for i in range(model.ncam)]
    if camera not in names and camera not in range(model.ncam):
        raise ConfigurationError(f"camera: must be one of {', '.join(names)}, got {shown(camera)}")

    try:
        return physics.render(height, width, camera_id=camera)
    # an exception of any type, since dm_control's backends raise their own
    except Exception as error:
        raise MissingLibraryError(_no_gl(error)) from error


def view(environment: Any, policy: Any = None) -> None:
    """Open dm_control's viewer on an environment, with a policy of `uuv.environments.experts`.

    Raises:
        MissingLibraryError: No screen or no GL is available.
    """
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise MissingLibraryError(
            "no viewer: there is no screen (DISPLAY is not set); xvfb-run makes one, picture() "
            "needs none"
        )
    try:
        from dm_control import viewer

        viewer.launch(environment, policy=policy, title="uuv-arm")
    except Exception as error:  # an exception of any type, since GLFW and GL raise their own
        raise MissingLibraryError(_no_gl(error)) from error


def _no_gl(error: Exception) -> str:
    backend = os.environ.get("MUJOCO_GL", "not set")
    why = str(error).strip().splitlines()
    return (
        f"no picture: dm_control finds no GL (MUJOCO_GL is {backend}): install libegl1 for "
        "MUJOCO_GL=egl, or libosmesa6 for MUJOCO_GL=osmesa "
        f"({type(error).__name__}{f': {why[0]}' if why else ''})"
    )

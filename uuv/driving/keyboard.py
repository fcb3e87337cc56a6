"""MuJoCo's viewer as an operator's window, which shows the vehicle and takes the operator's
keys.
"""

import copy
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from uuv.controllers.driving.key_inputs import HELP
from uuv.controllers.driving.live_inputs import LiveInputs
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.rollout import Moment
from uuv.sim.plant.plant import Plant

_PERIOD = 0.04  # [s] wall time between two images, at least
_CLOSING = 5.0  # [s] wall time that the viewer's threads have to end, at most
_NO_SCREEN = (
    "drive: keyboard control needs MuJoCo's viewer and a screen (DISPLAY); without them give "
    "--inputs FILE"
)


def has_screen() -> bool:
    """Whether a window can be opened."""
    try:
        import glfw
        import mujoco.viewer

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return bool(mujoco.viewer) and bool(glfw.init())
    except (ImportError, OSError):
        return False


def refuse_without_screen() -> None:
    """Refuse keyboard control if no window can be opened.

    Raises:
        ConfigurationError: There is no screen, or no viewer.
    """
    if not has_screen():
        raise ConfigurationError(_NO_SCREEN)


class ViewerLook:
    """Drawing settings of a viewer, restored after the viewer's own keys: digits hide groups,
    letters toggle flags.
    """

    def __init__(self, option: mujoco.MjvOption, scene: mujoco.MjvScene | None) -> None:
        """Keep the present state of an option, and of the flags of a scene."""
        arrays = [option.geomgroup, option.sitegroup, option.flags]
        arrays += [] if scene is None else [scene.flags]
        self._kept = [(array, array.copy()) for array in arrays]

    def restore(self) -> None:
        """Undo all changes since."""
        for array, kept in self._kept:
            array[:] = kept


class Window:
    """Observer that shows the run in a window; closing the window ends the inputs."""

    slow_ticks = (10,)

    def __init__(
        self,
        plant: Plant,
        X_WB: Array,
        inputs: LiveInputs,
        *,
        press: Callable[[int], None] | None = None,
        help_lines: Sequence[str] = HELP,
    ) -> None:
        """Open the window on a copy of the plant's model.

        Args:
            plant: Plant that is shown.
            X_WB: (4, 4) hull pose to look at.
            inputs: Inputs that end when the window is closed.
            press: Takes the keys that are pressed.
            help_lines: How the vehicle is driven.
        """
        import mujoco.viewer

        self._plant = plant
        self._inputs = inputs
        self._help = help_lines
        self._model = copy.copy(plant.model)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = plant.data.qpos
        self._shown = 0.0  # [s] wall time of the last image
        before = set(threading.enumerate())
        self._viewer: Any = mujoco.viewer.launch_passive(
            self._model, self._data, key_callback=press, show_left_ui=False, show_right_ui=False
        )
        self._drawing = set(threading.enumerate()) - before
        self._viewer.cam.lookat[:] = X_WB[:3, 3]
        self._viewer.cam.distance = 4.0
        self._viewer.sync()
        self._kept = ViewerLook(self._viewer.opt, self._viewer.user_scn)

    def observe(self, moment: Moment) -> None:
        """Show the vehicle, and a line about it."""
        if not self._viewer.is_running():
            self._inputs.end()
            return
        if time.perf_counter() - self._shown < _PERIOD:
            return

        # The plant's pose in the window's copy of the data
        self._shown = time.perf_counter()
        with self._viewer.lock():
            self._data.qpos[:] = self._plant.data.qpos
            self._data.time = self._plant.data.time
            mujoco.mj_kinematics(self._model, self._data)
            self._kept.restore()

        # Information for the operator
        if hasattr(self._viewer, "set_texts"):  # from MuJoCo 3.3 on
            font = mujoco.mjtFontScale.mjFONTSCALE_150
            corner = mujoco.mjtGridPos.mjGRID_TOPLEFT
            self._viewer.set_texts((font, corner, "\n".join([*_panel(moment), *self._help]), ""))
        self._viewer.sync()

    def close(self) -> None:
        """Close the window, and wait for its drawing thread, which must end before the screen is
        closed.
        """
        self._viewer.close()
        for thread in self._drawing:
            thread.join(_CLOSING)


def _panel(moment: Moment) -> tuple[str, ...]:
    """Information for the operator: phase, force, thrust."""
    reference = moment.reference
    command = moment.command
    felt = command.contact.normal
    thrust = float(np.abs(command.thrusters).max(initial=0.0))
    return (
        f"{moment.truth.time:.1f} s  {reference.state}  {reference.note}",
        f"force: {felt:.0f} N estimated, {reference.set_force:.0f} N set; "
        f"largest thruster at {thrust:.0%}",
    )

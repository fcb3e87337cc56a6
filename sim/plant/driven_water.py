"""The water that drives one plant: its current, and where that writes velocity and acceleration."""

import mujoco
import numpy as np

from uuv.models.hydrodynamics import LAYOUT
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown
from uuv.sim.plant.compiled_step import Flow
from uuv.sim.water.current import Current


class DrivenWater:
    """Writes the current of a plant into MuJoCo's options, the hydrodynamics and the truth."""

    def __init__(self, model: mujoco.MjModel, water: Array, current_W: Array) -> None:
        """Take what is written to.

        Args:
            model: Of the plant.
            water: Row of the world in the hydrodynamics of `model` (`uuv.models.hydrodynamics`).
            current_W: (3,) [m/s] of the truth.
        """
        self._model = model

        # Views, which compiled steps write too.
        self._wind = model.opt.wind
        self._acceleration = water[LAYOUT.current_acceleration :][:3]
        self._current_W = current_W
        self.current = Current(np.zeros(3))

    def start(self, current: Current) -> Flow:
        """Take a current over, and return the record of its rows for compiled steps."""
        current.place(self._model)
        self.current = current
        rows = current.velocity, current.acceleration, current.row
        return Flow(*rows, self._wind, self._acceleration, self._current_W)

    def write(self, p_WB: Array, time: float) -> None:
        """Write the water of the next step, before its forces are computed.

        Args:
            p_WB: Place (3,) [m] of the hull's origin then.
            time: [s] since the start of the run.
        """
        velocity, acceleration = self.current.at(p_WB.copy(), time)
        self._wind[:] = velocity
        self._acceleration[:] = acceleration
        self._current_W[:] = velocity

    def check(self) -> None:
        """Refuse water that something else has written.

        Raises:
            ConfigurationError: The next step would overwrite it.
        """
        if self._wind.tolist() != self._current_W.tolist():
            raise ConfigurationError(
                f"plant: opt.wind is {shown(self._wind)} m/s, which the plant did not write and "
                "overwrites at every step; water of your own goes in by `on_water` of a "
                "perturbation, or by site.flow"
            )


def check_current(current: Current, timestep: float) -> None:
    """Refuse what is no current, or is one for another timestep [s].

    Raises:
        ConfigurationError: What was given.
    """
    if not isinstance(current, Current):
        raise ConfigurationError(f"current: expected a uuv.sim.water.current.Current, got {current!r}")
    if current.timestep not in (None, timestep):
        raise ConfigurationError(
            f"current: its timestep is {current.timestep} s, but the plant's, at which it gusts, {timestep} s"
        )

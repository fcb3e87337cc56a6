"""The water that drives one plant: its current, and where that writes velocity and acceleration."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.hydrodynamics import LAYOUT
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, shown
from uuv.sim.plant.compiled_step import Flow
from uuv.sim.water.current import Current
from uuv.sim.water.flow_field import total_velocity


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

    def at(self, p_W: Array, p_WB: Array, time: float) -> Array:
        """Velocity (3,) [m/s] at a place in the present step.

        That at the hull was written for this step; elsewhere the flow fields differ from it.

        Args:
            p_W: Place (3,) [m].
            p_WB: Place (3,) [m] of the hull's origin.
            time: [s] since the start of the run.
        """
        current = self.current
        velocity = self._current_W.copy()
        if not current.flows:
            return velocity

        # What is the same everywhere cancels.
        share = 1.0 if current.profile is None else current.profile(time)[0]
        here = total_velocity(current.flows, p_WB, time)
        return velocity + share * (total_velocity(current.flows, p_W, time) - here)

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


class WithWater:
    """Base of a plant: what may be asked of its water, which is not its own to replace."""

    _water: DrivenWater
    _tick: int
    data: mujoco.MjData
    timestep: float
    vehicle: Vehicle

    @property
    def current(self) -> Current:
        """The current of the run, as `on_water` of the perturbations left it."""
        return self._water.current

    @current.setter
    def current(self, value: object) -> None:
        raise ConfigurationError(
            f"plant.current: cannot be set, got {shown(value)}; the current of a run is what "
            "`on_water(current)` of a perturbation returns (docs/own_current.md)"
        )

    def water_at(self, p_W: ArrayLike) -> Array:
        """Velocity (3,) [m/s] of the water at a place in W now, by all that moves it.

        Changes nothing, so that it may be asked as often as one likes.

        Args:
            p_W: Place (3,) [m].

        Raises:
            ConfigurationError: It is no place, or a flow field gives no velocity there.
        """
        at = self.vehicle.hull_qpos
        p_WB = np.array(self.data.qpos[at : at + 3])
        return self._water.at(checked(p_W, (3,), "p_W [m]"), p_WB, self._tick * self.timestep)


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

"""The water that drives one plant: its current, and where that writes velocity and acceleration."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.hydrodynamics import LAYOUT, is_wet, world_row
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, shown
from uuv.sim.plant.compiled_step import Flow, Watch
from uuv.sim.water.current import Current
from uuv.sim.water.flow_field import total_velocity
from uuv.sim.water.water_motion import FLOW, place_of, set_current

_UNIFORM = float(FLOW.uniform)
_HOOK = "water of your own goes in by `on_water` of a perturbation, or by site.flow"


class DrivenWater:
    """Writes the current of a plant into its simulation and the truth.

    A model without coefficients has no place in its data: then the current is that of MuJoCo's own
    fluid, `opt.wind`, as in a model that `uuv.sim.hydrodynamics.compile` has not compiled.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, current_W: Array) -> None:
        """Take what is written to.

        Args:
            model: Of the plant.
            data: Of the plant.
            current_W: (3,) [m/s] of the truth.
        """
        self._model = model
        self._data = data
        wet = is_wet(model)
        water = world_row(model) if wet else np.zeros(LAYOUT.size)
        first = place_of(model)

        self._in_data = first >= 0

        # Views, which compiled steps write too.

        self._model_wind = model.opt.wind
        self._model_flow = water[LAYOUT.current_acceleration :][:6]
        if self._in_data:
            row = data.userdata[first : first + FLOW.size]
            self._head = row[FLOW.kind : FLOW.velocity + 3]
            self._wind = row[FLOW.velocity :][:3]
            self._acceleration = row[FLOW.acceleration :][:3]
        else:
            self._wind = self._model_wind
            self._acceleration = self._model_flow[:3]

        self._current_W = current_W
        self._defaults = b""  # numbers of the model, at the start
        self.current = Current(np.zeros(3))

    def start(self, current: Current) -> Flow:
        """Take a current over, and return the record of its rows for compiled steps."""
        current.place(self._model)
        self.current = current
        if self._in_data:
            still = np.zeros(3)
            set_current(self._model, self._data, still, still, self._model_flow[3:])

        self._defaults = self._of_model()
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
        velocity_there = total_velocity(current.flows, p_WB, time)

        return velocity + share * (total_velocity(current.flows, p_W, time) - velocity_there)

    def check(self) -> None:
        """Refuse water that something else has written.

        Raises:
            ConfigurationError: The next step would overwrite it, or it has no effect.
        """
        velocity = self._current_W.tolist()
        if not self._in_data:
            if self._wind.tolist() != velocity:
                raise _overwritten("opt.wind", self._wind)
            return

        # MuJoCo has reset the data if they have no kind of motion: see `check_reset`.
        kind, *written = self._head.tolist()
        if kind == 0.0:
            return
        if kind != _UNIFORM or written != velocity:
            raise _overwritten("the current in its data", self._wind)

        if self._of_model() != self._defaults:
            raise self._without_effect()

    def check_reset(self) -> None:
        """Refuse data that have been reset since the start, and their current with them.

        Raises:
            ConfigurationError: They have.
        """
        if self._in_data and self._head[0] == 0.0:
            raise ConfigurationError(
                "plant: its data was reset, and the current in it; call its reset() or start()"
            )

    def _of_model(self) -> bytes:
        return self._model_wind.tobytes() + self._model_flow.tobytes()

    def _without_effect(self) -> ConfigurationError:
        acceleration = shown(self._model_flow[:3])
        shear = shown(self._model_flow[3:])

        return ConfigurationError(
            f"plant: opt.wind is {shown(self._model_wind)} m/s, its acceleration {acceleration} "
            f"m/s^2, its shear {shear} 1/s, which are not those at the start and have no "
            f"effect: the plant keeps its current in its data; {_HOOK}"
        )


def _overwritten(what: str, velocity_W: Array) -> ConfigurationError:
    why = "which the plant did not write and overwrites at every step"
    return ConfigurationError(f"plant: {what} is {shown(velocity_W)} m/s, {why}; {_HOOK}")


class WithWater:
    """Base of a plant: what may be asked of its water, which is not its own to replace."""

    _water: DrivenWater
    _watch: Watch
    data: mujoco.MjData
    timestep: float
    vehicle: Vehicle

    @property
    def current(self) -> Current:
        """The current of the run, as `on_water` of the perturbations left it."""
        return self._water.current

    @current.setter
    def current(self, value: object) -> None:
        """Refuse another current.

        Raises:
            ConfigurationError: Always; it names where a current is set.
        """
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
        return self._water.at(
            checked(p_W, (3,), "p_W [m]"), p_WB, int(self._watch.tick[0]) * self.timestep
        )


def check_current(current: Current, timestep: float) -> None:
    """Refuse what is no current, or is one for another timestep [s].

    Raises:
        ConfigurationError: What was given.
    """
    if not isinstance(current, Current):
        raise ConfigurationError(
            f"current: expected a uuv.sim.water.current.Current, got {current!r}"
        )

    if current.timestep not in (None, timestep):
        raise ConfigurationError(
            f"current: its timestep is {current.timestep} s, but the plant's, at which it gusts, "
            f"{timestep} s"
        )

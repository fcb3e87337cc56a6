"""Water of one plant: its current, and the arrays that its velocity and acceleration are written
to.
"""

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
_HOOK = "a current of your own is set by `on_water` of a perturbation, or by site.flow"


class DrivenWater:
    """Writes the current of a plant into its simulation and the truth.

    A model without coefficients, or one that `uuv.sim.hydrodynamics.compile` has not compiled, has
    no place for the current in its data. The current is then written to `opt.wind`, where MuJoCo's
    own fluid model reads it.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, current_W: Array) -> None:
        """Take the arrays that the current is written to.

        Args:
            model: Model of the plant.
            data: Data of the plant.
            current_W: (3,) [m/s] Current in the truth.
        """
        self._model = model
        self._data = data
        wet = is_wet(model)
        water = world_row(model) if wet else np.zeros(LAYOUT.size)
        first = place_of(model)

        self._in_data = first >= 0

        # Views that compiled steps write to as well.

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
        self._defaults = b""  # values of the model at the start
        self.current = Current(np.zeros(3))

    def start(self, current: Current) -> Flow:
        """Set a current, and return the record of its rows for compiled steps."""
        current.place(self._model)
        self.current = current
        if self._in_data:
            still = np.zeros(3)
            set_current(self._model, self._data, still, still, self._model_flow[3:])

        self._defaults = self._of_model()
        rows = current.velocity, current.acceleration, current.row
        return Flow(*rows, self._wind, self._acceleration, self._current_W)

    def write(self, p_WB: Array, time: float) -> None:
        """Write the current of the next step, before its forces are computed.

        Args:
            p_WB: Position (3,) [m] of the hull's origin in that step.
            time: [s] since the start of the run.
        """
        velocity, acceleration = self.current.at(p_WB.copy(), time)
        self._wind[:] = velocity
        self._acceleration[:] = acceleration
        self._current_W[:] = velocity

    def at(self, p_W: Array, p_WB: Array, time: float) -> Array:
        """Velocity (3,) [m/s] of the water at a point, in the present step.

        The velocity at the hull was written for this step. At other points the flow fields are
        evaluated.

        Args:
            p_W: Position (3,) [m] of the point.
            p_WB: Position (3,) [m] of the hull's origin.
            time: [s] since the start of the run.
        """
        current = self.current
        velocity = self._current_W.copy()
        if not current.flows:
            return velocity

        # Terms that are the same everywhere cancel.

        share = 1.0 if current.profile is None else current.profile(time)[0]
        velocity_there = total_velocity(current.flows, p_WB, time)

        return velocity + share * (total_velocity(current.flows, p_W, time) - velocity_there)

    def check(self) -> None:
        """Refuse a current that other code has written.

        Raises:
            ConfigurationError: The next step would overwrite that current, or it has no effect.
        """
        velocity = self._current_W.tolist()
        if not self._in_data:
            if self._wind.tolist() != velocity:
                raise _overwritten("opt.wind", self._wind)
            return

        # The data have no kind of motion after a reset by MuJoCo: see `check_reset`.
        kind, *written = self._head.tolist()
        if kind == 0.0:
            return
        if kind != _UNIFORM or written != velocity:
            raise _overwritten("the current in its data", self._wind)

        if self._of_model() != self._defaults:
            raise self._without_effect()

    def check_reset(self) -> None:
        """Refuse data that have been reset since the start, since their current was reset with
        them.

        Raises:
            ConfigurationError: The data were reset.
        """
        if self._in_data and self._head[0] == 0.0:
            raise ConfigurationError(
                "plant: its data were reset by other code, and with them the current; call "
                "reset() or start() of the plant instead"
            )

    def _of_model(self) -> bytes:
        return self._model_wind.tobytes() + self._model_flow.tobytes()

    def _without_effect(self) -> ConfigurationError:
        acceleration = shown(self._model_flow[:3])
        shear = shown(self._model_flow[3:])

        return ConfigurationError(
            f"plant: opt.wind is {shown(self._model_wind)} m/s, its acceleration {acceleration} "
            f"m/s^2, its shear {shear} 1/s, which were changed since the start and have no effect, "
            f"since the plant keeps its current in its data; {_HOOK}"
        )


def _overwritten(what: str, velocity_W: Array) -> ConfigurationError:
    why = "which the plant did not write and overwrites at every step"
    return ConfigurationError(f"plant: {what} is {shown(velocity_W)} m/s, {why}; {_HOOK}")


class WithWater:
    """Base of a plant, with its current for reading; the current cannot be set here."""

    _water: DrivenWater
    _watch: Watch
    data: mujoco.MjData
    timestep: float
    vehicle: Vehicle

    @property
    def current(self) -> Current:
        """The current of the run, as returned by `on_water` of the perturbations."""
        return self._water.current

    @current.setter
    def current(self, value: object) -> None:
        """Refuse to replace the current.

        Raises:
            ConfigurationError: Always; the message states where a current is set.
        """
        raise ConfigurationError(
            f"plant.current: cannot be set, got {shown(value)}; set it by `on_water(current)` of a "
            "perturbation, which returns the current of a run (docs/own_current.md)"
        )

    def water_at(self, p_W: ArrayLike) -> Array:
        """Present velocity (3,) [m/s] of the water at a point in W, from the current and all flow
        fields.

        The call changes nothing, so that it may be repeated.

        Args:
            p_W: Position (3,) [m] of the point.

        Raises:
            ConfigurationError: `p_W` is not a position, or a flow field gives no velocity there.
        """
        at = self.vehicle.hull_qpos

        p_WB = np.array(self.data.qpos[at : at + 3])
        return self._water.at(
            checked(p_W, (3,), "p_W [m]"), p_WB, int(self._watch.tick[0]) * self.timestep
        )


def check_current(current: Current, timestep: float) -> None:
    """Refuse a value that is not a Current, or a current for another timestep [s].

    Raises:
        ConfigurationError: `current` is such a value.
    """
    if not isinstance(current, Current):
        raise ConfigurationError(
            f"current: expected a uuv.sim.water.current.Current, got {current!r}"
        )

    if current.timestep not in (None, timestep):
        raise ConfigurationError(
            f"current: its timestep must be that of the plant, {timestep} s, got "
            f"{current.timestep} s"
        )

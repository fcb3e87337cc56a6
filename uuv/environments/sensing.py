"""Observables of vehicle, arm and tool: the true state, and readings of the project's own sensors.

A reading has the rate, delay, bias and noise of its sensor. The updater of composer calls the
sensor at its period and delivers the reading after its delay. All numbers of one sensor's message
come from one sample.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from typing import Any, Protocol

import mujoco
import numpy as np
from dm_control import composer
from dm_control.composer.observation import observable
from dm_env import specs

from uuv.own_vehicle import OwnVehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Measurement
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.rollout import ticks_per_period
from uuv.sim.plant.truth import Truth

FARTHEST = 100.0  # [m] bound of positions, which no episode reaches
FARTHEST_TURN = 2.0 * np.pi  # [rad] bound of rotation vectors
FASTEST = 20.0  # [m/s, rad/s] bound of velocities
STRONGEST = 1e4  # [N, N m] bound of forces and torques
_NOT_NUMBERS = ("time", "noise")  # fields of a message that are not readings


class SensedVehicle(Protocol):
    """Interface of a vehicle that readings need.

    Attributes:
        own: Model of the vehicle, compiled alone.
        spec: Specification of this model, not compiled.
        truth: Present state of the vehicle.
        readings: Sensors of the vehicle.
    """

    own: OwnVehicle
    spec: mujoco.MjSpec
    truth: Truth
    readings: "SensorReadings"


class SensorReadings:
    """The sensors of one vehicle, and the newest message of each."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        """Take the sensors, at most one of each class.

        Raises:
            ConfigurationError: Two sensors have the same class, or a sensor takes images of a scene
                on request.
        """
        names = [type(sensor).__name__ for sensor in sensors]
        if len(set(names)) < len(names):
            raise ConfigurationError(
                f"sensors: there may be one of each class only, got {', '.join(names)}"
            )

        for sensor, name in zip(sensors, names, strict=True):
            if not sensor.period > 0.0:
                raise ConfigurationError(
                    f"sensor {name}: cannot be used here, since it takes images on request; use a "
                    "camera of the physics"
                )

        self.sensors = tuple(sensors)
        self._states: list[Any] = []
        self._newest: list[tuple[float, Measurement | None]] = []

    def start(self, truth: Truth, random_state: np.random.RandomState) -> None:
        """Draw the biases of an episode, and take the first readings."""
        rng = np.random.default_rng(random_state.randint(2**31))
        streams = rng.spawn(len(self.sensors))
        self._states = [
            sensor.init(stream) for sensor, stream in zip(self.sensors, streams, strict=True)
        ]

        self._newest = [(-1.0, None)] * len(self.sensors)
        for index in range(len(self.sensors)):
            self.read(index, truth)

    def read(self, index: int, truth: Truth) -> Measurement | None:
        """Message of a sensor at the time of `truth`, with one sample for each time."""
        if not self._states:
            self.start(truth, np.random.RandomState(0))
        time, message = self._newest[index]

        if truth.time != time:
            self._states[index], measured = self.sensors[index].step(self._states[index], truth)
            message = measured or message
            self._newest[index] = truth.time, message
        return message


def readings(vehicle: SensedVehicle) -> dict[str, observable.Observable]:
    """Observables of a vehicle's sensors, by SENSOR_FIELD; for `Observables.add_observable`."""
    observables: dict[str, observable.Observable] = {}
    timestep = float(vehicle.own.model.opt.timestep)

    for index, sensor in enumerate(vehicle.readings.sensors):
        name = type(sensor).__name__
        every = ticks_per_period(sensor.period, timestep, name)
        late = (
            ticks_per_period(sensor.delay, timestep, f"delay of {name}")
            if sensor.delay > 0.0
            else 0
        )

        for field in _fields(sensor, vehicle):
            observables[f"{_snake(name)}_{field}"] = observable.Generic(
                _reading(vehicle, index, field), update_interval=every, delay=late
            )

    return observables


def _fields(sensor: Sensor, vehicle: SensedVehicle) -> Iterable[str]:
    """Names of the numbers in a sensor's message, from one sample of a resting vehicle."""
    message = _sample(sensor, vehicle)
    return [field.name for field in fields(message) if field.name not in _NOT_NUMBERS]


def _sample(sensor: Sensor, vehicle: SensedVehicle) -> Any:
    from uuv.sim import hydrodynamics
    from uuv.sim.plant.plant import Plant
    from uuv.sim.water.current import Current

    plant = Plant(hydrodynamics.compile(vehicle.spec.copy()), current=Current(np.zeros(3)))
    _, message = sensor.step(sensor.init(np.random.default_rng(0)), plant.observe())
    return message


def _reading(vehicle: SensedVehicle, index: int, field: str) -> Callable[[Any], Array]:
    def read(physics: Any) -> Array:
        del physics
        return np.ravel(
            np.asarray(
                getattr(vehicle.readings.read(index, vehicle.truth), field), dtype=np.float64
            )
        )

    return read


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() and i else c.lower() for i, c in enumerate(name))


class BoundedNumbers(observable.Generic):
    """Observable with numbers (k,) within bounds, which are in its specification."""

    def __init__(self, read: Callable[[Any], Array], size: int, bound: float) -> None:
        """Take the function of the physics, the number of values, and their largest magnitude."""
        super().__init__(lambda physics: np.minimum(np.maximum(read(physics), -bound), bound))
        self._spec = specs.BoundedArray((size,), np.float64, minimum=-bound, maximum=bound)

    @property
    def array_spec(self) -> specs.BoundedArray:
        """Specification of the numbers."""
        return self._spec


def _true(
    entity: Any, value: Callable[[Truth], Array], size: int, bound: float
) -> observable.Observable:
    """Observable of the true state; `entity` is the vehicle, or a part of it."""
    carriers: list[SensedVehicle] = []

    def read(physics: Any) -> Array:
        del physics
        if not carriers:
            carriers.append(_vehicle_of(entity))
        return value(carriers[0].truth)

    return BoundedNumbers(read, size, bound)


def _joints(arm: Any) -> int:
    return len(arm.actuators)


def _thrusters(vehicle: Any) -> int:
    return len(vehicle.own.vehicle.thruster_names)


def _vehicle_of(entity: Any) -> SensedVehicle:
    while not hasattr(entity, "readings"):
        if entity.parent is None:
            raise ConfigurationError(
                f"{entity.mjcf_model.model}: must be attached to a vehicle, which has its true "
                "state"
            )
        entity = entity.parent
    return entity


class VehicleObservables(composer.Observables):
    """True state of the hull, and readings of the vehicle's sensors; all are disabled until
    enabled.
    """

    def __init__(self, entity: Any) -> None:
        super().__init__(entity)
        self.of_sensors = readings(entity)
        for name, reading in self.of_sensors.items():
            self.add_observable(name, reading, enabled=False)

    @composer.observable
    def position(self) -> observable.Observable:
        """Position (3,) [m] of the hull, world axes."""
        return _true(self._entity, lambda truth: truth.p_WB, 3, FARTHEST)

    @composer.observable
    def orientation(self) -> observable.Observable:
        """Rotation (9,) of the hull to world axes, by rows."""
        return _true(self._entity, lambda truth: truth.R_WB.ravel(), 9, 1.0)

    @composer.observable
    def velocity(self) -> observable.Observable:
        """Velocity (3,) [m/s] over ground, hull axes."""
        return _true(self._entity, lambda truth: truth.R_WB.T @ truth.v_WB_W, 3, FASTEST)

    @composer.observable
    def angular_velocity(self) -> observable.Observable:
        """Angular velocity (3,) [rad/s], hull axes."""
        return _true(self._entity, lambda truth: truth.w_WB_B, 3, FASTEST)

    @composer.observable
    def propeller_speed(self) -> observable.Observable:
        """Propeller speeds (m,), normalised."""
        return _true(
            self._entity, lambda truth: truth.propeller_speed, _thrusters(self._entity), 1.0
        )


class ArmObservables(composer.Observables):
    """True state of an arm on a vehicle."""

    @composer.observable
    def joints(self) -> observable.Observable:
        """Joint angles (n,) [rad]."""
        return _true(
            self._entity, lambda truth: truth.q, _joints(self._entity), 2.0 * FARTHEST_TURN
        )

    @composer.observable
    def joint_velocity(self) -> observable.Observable:
        """Joint velocities (n,) [rad/s]."""
        return _true(self._entity, lambda truth: truth.qd, _joints(self._entity), FASTEST)

    @composer.observable
    def joint_torque(self) -> observable.Observable:
        """Torques (n,) [N m] of the motors."""
        return _true(self._entity, lambda truth: truth.tau_drive, _joints(self._entity), STRONGEST)


class ToolObservables(composer.Observables):
    """True state of a tool on the arm of a vehicle."""

    @composer.observable
    def tip_position(self) -> observable.Observable:
        """Position (3,) [m] of the tip in the hull, hull axes."""
        return _true(
            self._entity, lambda truth: truth.R_WB.T @ (truth.p_WG - truth.p_WB), 3, FARTHEST
        )

    @composer.observable
    def tip_orientation(self) -> observable.Observable:
        """Rotation (9,) of the tool to hull axes, by rows."""
        return _true(self._entity, lambda truth: (truth.R_WB.T @ truth.R_WG).ravel(), 9, 1.0)

    @composer.observable
    def contact_force(self) -> observable.Observable:
        """Force (3,) [N] on the tool, tool axes; z is negative when the tool presses."""
        return _true(self._entity, lambda truth: truth.R_WG.T @ truth.contact_force_W, 3, STRONGEST)

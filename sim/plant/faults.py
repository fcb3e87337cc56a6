"""Fault injection: wrappers around plant, sensors and finder that keep the interface of the wrapped
component.

- `FaultyPlant`: a thruster that fails, sticks or weakens.
- `FaultySensor`: any sensor that sends nothing, freezes, drifts, jumps, spikes, rotates or gives
  NaN.
- `MisplacedFinder`: a finder that reports the wrong place with full confidence.
- `changing`: a current that changes, for `uuv.sim.water.current.Current`.

Each fault acts while its `Onset` is active. Perception and control receive a fault through
measurements only. A wrapped component draws the same random numbers as without the wrapper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.thruster_curves import command_for, thrust_at
from uuv.models.water.thrusters import curves
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels.slots import gives_kernel
from uuv.sim.interfaces.messages import Command, ImuMeasurement, Measurement, Target
from uuv.sim.interfaces.protocols import Sensor, TargetFinder
from uuv.sim.interfaces.spatial import Array, checked, exp_so3, readonly
from uuv.sim.plant.compiled_step import PlantRecord
from uuv.sim.plant.onset import Onset
from uuv.sim.plant.plant import NO_HOOKS, Plant, PlantHooks, PlantState
from uuv.sim.plant.truth import Truth

# -- sensors ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Input of a sensor fault: the measurement and the state of the fault."""

    measurement: Any  # output of the sensor without the fault
    sound: Any  # last measurement before the fault
    elapsed: float  # [s] since the fault began
    rng: np.random.Generator  # random stream of the fault


class SensorFault(Protocol):
    """Fault model of a sensor: maps a reading to the faulty measurement, or to None if no message
    is sent.
    """

    def __call__(self, reading: Reading) -> Measurement | None:
        """Measurement with the fault; None: no message."""
        ...


@dataclass(frozen=True, slots=True)
class Lost:
    """Loss of all messages."""

    def __call__(self, reading: Reading) -> None:
        """Return None: no message is sent."""


@dataclass(frozen=True, slots=True)
class Frozen:
    """Fields, or one element of each, keep their last value from before the fault; time
    advances.
    """

    fields: tuple[str, ...]
    index: int | None = None

    def __call__(self, reading: Reading) -> Any:
        """Measurement with the frozen fields."""
        measurement = reading.measurement
        for name in self.fields:
            frozen = getattr(reading.sound, name, None)
            measurement = _changed(
                measurement, name, self.index, lambda _, sound=frozen: _part(sound, self.index)
            )
        return measurement


@dataclass(frozen=True, slots=True)
class Fixed:
    """Field, or one element of it, has a constant value: zero, a limit, or `nan`."""

    field: str
    index: int | None = None
    value: float = 0.0

    def __call__(self, reading: Reading) -> Any:
        """Measurement with the constant field."""
        return _changed(
            reading.measurement, self.field, self.index, lambda old: np.full_like(old, self.value)
        )


@dataclass(frozen=True, slots=True)
class Offset:
    """Field, or one element of it, is offset by `jump` at once and by `rate` more in every
    second.
    """

    field: str
    index: int | None = None
    jump: float = 0.0
    rate: float = 0.0  # [1/s]

    def __call__(self, reading: Reading) -> Any:
        """Measurement with the offset field."""
        return _changed(
            reading.measurement,
            self.field,
            self.index,
            lambda old: old + self.jump + self.rate * reading.elapsed,
        )


@dataclass(frozen=True, slots=True)
class Turned:
    """Attitude of the inertial unit is rotated about an axis of the hull, by `jump` at once and by
    `rate` more in every second.
    """

    index: int  # axis of the hull: 0, 1 or 2
    jump: float = 0.0  # [rad]
    rate: float = 0.0  # [rad/s]

    def __call__(self, reading: Reading) -> ImuMeasurement:
        """Measurement with the rotated attitude."""
        angle = np.zeros(3)
        angle[self.index] = self.jump + self.rate * reading.elapsed
        return replace(
            reading.measurement, R_WB=readonly(reading.measurement.R_WB @ exp_so3(angle))
        )


@dataclass(frozen=True, slots=True)
class Spikes:
    """Measurement is off by plus or minus `size` with a given probability."""

    field: str
    index: int | None = None
    size: float = 0.0
    probability: float = 0.05

    def __call__(self, reading: Reading) -> Any:
        """Measurement with or without a spike."""
        hit = reading.rng.uniform() < self.probability
        way = 1.0 if reading.rng.uniform() < 0.5 else -1.0
        return _changed(
            reading.measurement, self.field, self.index, lambda old: old + hit * way * self.size
        )


def _part(value: Any, index: int | None) -> Any:
    return value if index is None else value[index]


def _changed(measurement: Any, name: str, index: int | None, change: Callable[[Any], Any]) -> Any:
    """Copy of `measurement` with `change` applied to field `name`, or to element `index` of it.

    Raises ConfigurationError for a field or an element that the measurement does not have.
    """
    kind = type(measurement).__name__
    names = [attribute.name for attribute in fields(measurement)]
    if name not in names:
        raise ConfigurationError(
            f"fault: field must be one of {', '.join(names)} of a {kind}, got {name!r}"
        )

    old = np.asarray(getattr(measurement, name))
    if index is None:
        new = np.array(change(old), dtype=np.float64)
    elif old.ndim and 0 <= index < len(old):
        new = np.array(old, dtype=np.float64)
        new[index] = change(old[index])
    else:
        raise ConfigurationError(
            f"fault: {name} of a {kind} has shape {old.shape}, no element {index}"
        )

    new.setflags(write=False)
    return replace(measurement, **{name: new if old.ndim else float(new)})


@dataclass(slots=True, eq=False)
class FaultySensorState:
    """State of the wrapped sensor, random stream of the fault, and last measurement before the
    fault.
    """

    sensor: Any
    rng: np.random.Generator
    sound: Measurement | None = None


class FaultySensor:
    """Sensor (`uuv.sim.interfaces.protocols.Sensor`) with one fault; wrap the result again for more
    faults.
    """

    def __init__(self, sensor: Sensor, fault: SensorFault, onset: Onset) -> None:
        self._sensor = sensor
        self._fault = fault
        self._onset = onset
        self.sound: Sensor = sensor.sound if isinstance(sensor, FaultySensor) else sensor
        self.period = sensor.period
        self.delay = sensor.delay

    def init(self, rng: np.random.Generator) -> FaultySensorState:
        """Initial state; the fault's random stream is separate from the sensor's."""
        inner = self._sensor.init(rng)
        # spawned last, so that the sensor's streams do not change
        return FaultySensorState(inner, rng.spawn(1)[0])

    def channel(self) -> str:
        """Index of the sensor's measurements among those of every tick, the same as for the wrapped
        sensor.
        """
        sensor: Any = self._sensor
        return sensor.channel() if gives_kernel(sensor, "channel") else ""

    def resume(
        self, fresh: FaultySensorState, saved: Any, last: Measurement | None
    ) -> FaultySensorState:
        """State that continues from `saved`.

        `saved` is a state of this sensor, or of the wrapped sensor before this fault began.

        Args:
            fresh: State from `init`.
            saved: State to continue from.
            last: Last message of the sensor that `saved` belongs to.
        """
        if _layers(saved) == _layers(fresh):
            return saved
        inner = self._sensor
        wrapped = isinstance(inner, FaultySensor)
        fresh.sensor = inner.resume(fresh.sensor, saved, last) if wrapped else saved
        fresh.sound = last
        return fresh

    def step(
        self, state: FaultySensorState, truth: Truth
    ) -> tuple[FaultySensorState, Measurement | None]:
        """Measurement of the wrapped sensor, changed by the fault while it is active."""
        state.sensor, measurement = self._sensor.step(state.sensor, truth)
        if measurement is None:
            return state, None

        # The message that a fault may repeat is the last one before its onset.
        elapsed = self._onset.elapsed(float(truth.time))
        if not self._onset.active(float(truth.time)):
            if elapsed < 0.0:
                state.sound = measurement
            return state, measurement
        if state.sound is None:
            state.sound = measurement
        return state, self._fault(Reading(measurement, state.sound, elapsed, state.rng))


def _layers(state: Any) -> int:
    """Number of faults around the state of a sensor."""
    return 1 + _layers(state.sensor) if isinstance(state, FaultySensorState) else 0


# -- plant -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ThrusterFault:
    """Thruster that gives `share` of the commanded thrust (0: none) or, if `stuck`, keeps one
    command.
    """

    thruster: int
    onset: Onset
    share: float = 0.0
    stuck: bool = False
    # [-] command that a stuck thruster keeps, in [-1, 1]; None: the last one
    command: float | None = None


class FaultyPlant:
    """Plant (`uuv.sim.loop.rollout.SteppedPlant`) with thruster faults."""

    def __init__(self, plant: Plant, faults: Sequence[ThrusterFault]) -> None:
        """Wrap `plant`.

        Raises:
            ConfigurationError: A thruster does not exist, or a share or command is out of its
                range.
        """
        self.plant = plant
        self.faults = tuple(faults)
        self.timestep = plant.timestep
        self._sound = plant

        names = plant.vehicle.thruster_names
        for fault in self.faults:
            if not 0 <= fault.thruster < len(names):
                raise ConfigurationError(
                    f"fault: there is no thruster {fault.thruster}; there are {len(names)}: {names}"
                )
            if not 0.0 <= fault.share <= 1.0:
                raise ConfigurationError(
                    f"fault: share of a thruster's thrust must be in [0, 1], got {fault.share}"
                )
            if fault.command is not None and not -1.0 <= fault.command <= 1.0:
                raise ConfigurationError(
                    f"fault: command of a stuck thruster must be in [-1, 1], got {fault.command}"
                )

        self._curves = curves(plant.vehicle.thruster_table)
        self._last = np.zeros(len(names))

    def observe(self) -> Truth:
        """Same as `Plant.observe`."""
        return self.plant.observe()

    def spans(self) -> str:
        """Same as `Plant.spans`."""
        return self.plant.spans()

    def record(self, hooks: PlantHooks = NO_HOOKS) -> PlantRecord:
        """Same as `Plant.record`, with the active faults."""
        return self.plant.record(
            replace(hooks, commanded=(*hooks.commanded, self._in_compiled_step))
        )

    def step(self, command: Command) -> None:
        """Same as `Plant.step`, with the thruster commands changed by the active faults."""
        self.plant.step(replace(command, thrusters=self._changed(command.thrusters)))

    def _in_compiled_step(self) -> None:
        self._sound.commanded[:] = self._changed(self._sound.commanded)

    def _changed(self, command: Array) -> Array:
        """Commands (m,) that the thrusters follow."""
        thrusters = np.array(command)
        time = self._sound.time
        for fault in self.faults:
            i = fault.thruster
            if not fault.onset.active(time):
                continue
            if fault.stuck:
                thrusters[i] = self._last[i] if fault.command is None else fault.command
            elif fault.share < 1.0:
                # The share refers to thrust, so the curve is inverted to get the command.
                setpoint = float(np.clip(thrusters[i], -1.0, 1.0))
                thrusters[i] = command_for(
                    self._curves[i], fault.share * thrust_at(self._curves[i], setpoint)
                )
        self._last = thrusters
        return thrusters

    def save(self) -> "FaultyPlantState":
        """Everything that changes, as in `Plant.save`."""
        return FaultyPlantState(self.plant.save(), self._last)

    def resume(self, saved: "FaultyPlantState | PlantState", command: Command | None) -> None:
        """Continue from a result of `save`, of an equal plant or of the wrapped plant before any
        fault.

        Args:
            saved: State to continue from.
            command: Command of the tick before the one of `saved`; None if `saved` is from the
                first tick.
        """
        if isinstance(saved, FaultyPlantState):
            self.plant.resume(saved.plant)
            self._last = saved.last
        else:
            self.plant.resume(saved)
            commanded = np.zeros_like(self._last) if command is None else command.thrusters
            self._last = np.array(commanded)


@dataclass(frozen=True, slots=True, eq=False)
class FaultyPlantState:
    """State of the wrapped plant, and the thruster commands of the last step."""

    plant: PlantState
    last: Array


def changing(onset: Onset, factor: float, ramp: float) -> Callable[[float], tuple[float, float]]:
    """Profile for a `Current`: smooth change from 1 to `factor` at the onset, and back at its end.

    Args:
        onset: Time of the change.
        factor: Factor on the whole current.
        ramp: Duration of each change [s].

    Returns:
        Function of time [s] that gives the factor and its rate of change [1/s].

    Raises:
        ConfigurationError: The ramp is not positive.
    """
    if not (np.isfinite(ramp) and ramp > 0.0 and np.isfinite(factor)):
        raise ConfigurationError(
            f"changing current: ramp must be > 0 s and factor finite, got {ramp} s and {factor}"
        )

    def rise(elapsed: float) -> tuple[float, float]:
        # Cubic step with zero slope at both ends.
        x = min(max(elapsed / ramp, 0.0), 1.0)
        return x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / ramp

    def profile(time: float) -> tuple[float, float]:
        elapsed = onset.elapsed(time)
        (up, growth), (down, fall) = rise(elapsed), rise(elapsed - onset.duration)
        return 1.0 + (factor - 1.0) * (up - down), (factor - 1.0) * (growth - fall)

    return profile


# -- perception ------------------------------------------------------------------------------------


class MisplacedFinder:
    """Finder (`uuv.sim.interfaces.protocols.TargetFinder`) whose targets are shifted, with
    unchanged stated confidence.
    """

    def __init__(self, finder: TargetFinder, shift_W: ArrayLike, onset: Onset) -> None:
        """Shift all targets found in frames within the onset's time.

        Args:
            finder: The finder to wrap.
            shift_W: (3,) [m]
            onset: Time of the fault.
        """
        self._finder = finder
        self._shift_W = checked(shift_W, (3,), "shift of the target [m]")
        self._onset = onset

    def init(self) -> Any:
        """Initial state of the wrapped finder."""
        return self._finder.init()

    def step(self, state: Any, estimate: Any, measurement: Any) -> tuple[Any, Target | None]:
        """Process one frame.

        Args:
            state: State of the wrapped finder.
            estimate: Vehicle state at the time of the frame.
            measurement: Depth frame or sonar scan.

        Returns:
            Next state, and the target, shifted while the fault is active.
        """
        state, target = self._finder.step(state, estimate, measurement)
        if target is None or not self._onset.active(target.time):
            return state, target
        X_WT: Array = np.array(target.X_WT)
        X_WT[:3, 3] += self._shift_W
        path = (
            None if target.path is None else replace(target.path, p=target.path.p + self._shift_W)
        )
        return state, replace(target, X_WT=X_WT, path=path)

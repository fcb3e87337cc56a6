"""Perturbations of the loop: misplaced surface, failure of a thruster or of a sensor."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import mujoco
import numpy as np

from uuv.models.vehicle import thruster_names
from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Measurement, StateEstimate, Target, WorkState
from uuv.sim.interfaces.protocols import TargetFinder
from uuv.sim.interfaces.spatial import finite_number, readonly, shown
from uuv.sim.loop.rollout import Observer
from uuv.sim.plant.onset import Onset

if TYPE_CHECKING:
    from uuv.sim.plant.faults import SensorFault

SENSORS = {  # modules of `uuv.sim.sensors`, and their classes
    "encoders": ("proprioception", "Encoders"),
    "torque": ("proprioception", "JointTorqueSensors"),
    "imu": ("proprioception", "Imu"),
    "dvl": ("proprioception", "Dvl"),
    "vision": ("proprioception", "VisionDrift"),
    "jaws": ("jaws", "JawSensor"),
}


@dataclass(frozen=True, kw_only=True)
class MisplacedSurface(Perturbation):
    """The surface is farther away along the tool axis than identified."""

    offset: float = 0.0  # [m]

    def __post_init__(self) -> None:
        finite_number(self.offset, "MisplacedSurface offset [m]")

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the finder."""
        if not self.offset:
            return loop
        if loop.parts.finder is None:
            raise ConfigurationError("MisplacedSurface: needs a task that identifies an object")

        return replace(
            loop, parts=replace(loop.parts, finder=ShiftedFinder(loop.parts.finder, self.offset))
        )


@dataclass(frozen=True, slots=True, eq=False)
class ShiftedFinder:
    """Wrapper of a TargetFinder that shifts pose and path against the direction of the tool's
    approach.
    """

    finder: TargetFinder
    offset: float  # [m] distance of the identified surface in front of the true one

    def init(self) -> Any:
        """Initial state of the wrapped finder."""
        return self.finder.init()

    def step(
        self, state: Any, estimate: StateEstimate, measurement: Measurement
    ) -> tuple[Any, Target | None]:
        """Step of the wrapped finder, with its target shifted.

        Args:
            state: State of the wrapped finder.
            estimate: State estimate of the vehicle.
            measurement: Measurements of this step.

        Returns:
            New state, and the shifted target or None.
        """
        state, target = self.finder.step(state, estimate, measurement)
        if target is None or target.path is None:
            return state, target

        way = target.path.z[len(target.path.z) // 2]
        X_WT = np.array(target.X_WT)
        X_WT[:3, 3] -= self.offset * way
        path = replace(target.path, p=readonly(target.path.p - self.offset * way))
        return state, replace(target, X_WT=readonly(X_WT), path=path)


@dataclass(frozen=True, kw_only=True)
class Failure(Perturbation):
    """Failure that begins at a time, or when the planner enters a state."""

    at: float | None = None  # [s] time of the beginning
    state: str | None = None  # name of a WorkState, such as "work"
    force: float = 0.0  # [N] smallest set force of the event
    after: float = 0.0  # [s] delay after time or event
    duration: float | None = None  # [s] None: until the end of the run

    def __post_init__(self) -> None:
        if (self.at is None) == (self.state is None):
            raise ConfigurationError(f"{type(self).__name__}: must have either `at` [s] or `state`")

        if self.state is not None and self.state not in (
            states := [str(state) for state in WorkState]
        ):
            raise ConfigurationError(
                f"{type(self).__name__} state: allowed {', '.join(states)}, got {shown(self.state)}"
            )

        self.onset()

    def onset(self) -> Onset:
        """A new onset."""
        return Onset(
            at=self.at,
            state=None if self.state is None else WorkState(self.state),
            force=self.force,
            after=self.after,
            duration=np.inf if self.duration is None else self.duration,
        )

    def _observers(self, onset: Onset) -> tuple[Observer, ...]:
        return () if self.state is None else (onset,)


@dataclass(frozen=True, kw_only=True)
class ThrusterFailure(Failure):
    """Fault of a thruster: it gives `share` of the commanded thrust, or keeps its last command.

    The command is changed, before the thruster's lag, slew rate and saturation apply.
    """

    joins: ClassVar[bool] = True
    # a name of `Vehicle.thruster_names`: the actuator's name without "thruster_", such as
    # "heave_front"
    thruster: str
    share: float = 0.0  # from 0 to 1
    stuck: bool = False

    def check_inputs(self, spec: mujoco.MjSpec) -> None:
        """Refuse a thruster that the vehicle does not have."""
        self._index(thruster_names(spec.compile()))

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the plant."""
        from uuv.sim.plant.faults import FaultyPlant, ThrusterFault
        from uuv.sim.plant.plant import Plant

        plant = loop.plant
        sound: Any = plant
        while isinstance(sound, FaultyPlant):
            sound = sound.plant
        if not isinstance(sound, Plant):
            raise ConfigurationError(
                "ThrusterFailure: must be listed before perturbations that wrap the plant, which "
                f"is already wrapped in {type(sound).__name__}"
            )

        index = self._index(sound.vehicle.thruster_names)
        onset = self.onset()
        fault = ThrusterFault(index, onset, self.share, self.stuck)
        faulty: Any = FaultyPlant(
            sound, [*(plant.faults if isinstance(plant, FaultyPlant) else ()), fault]
        )
        return replace(loop, plant=faulty, observers=(*loop.observers, *self._observers(onset)))

    def _index(self, names: Sequence[str]) -> int:
        """Index of the thruster in `names`."""
        if self.thruster not in names:
            raise ConfigurationError(
                f"ThrusterFailure thruster: allowed {', '.join(names)}, got {shown(self.thruster)}"
            )
        return names.index(self.thruster)


@dataclass(frozen=True, kw_only=True)
class SensorFailure(Failure):
    """Fault of a sensor: no messages, or a field that freezes, has a constant value, or has an
    offset.

    The effect "turned" rotates the attitude of the inertial unit about axis `index` of the hull by
    `value` [rad].
    """

    joins: ClassVar[bool] = True
    sensor: Literal["encoders", "torque", "imu", "dvl", "vision", "jaws"]
    effect: Literal["lost", "frozen", "fixed", "offset", "turned"] = "lost"
    # field of the sensor's message, such as "tau"; not used by the effects lost and turned
    field: str = ""
    index: int | None = None  # element of the field; None: all
    value: float = 0.0
    rate: float = 0.0  # [1/s] rate at which an offset or a rotation grows

    def __post_init__(self) -> None:
        super().__post_init__()
        finite_number(self.rate, "SensorFailure rate [1/s]")
        if self.rate and self.effect not in ("offset", "turned"):
            raise ConfigurationError(
                f"SensorFailure rate: only allowed for the effects 'offset' and 'turned', "
                f"got {self.effect!r}"
            )

        if self.effect != "turned":
            return

        finite_number(self.value, "SensorFailure value [rad]")
        if self.sensor != "imu" or self.index not in (0, 1, 2):
            raise ConfigurationError(
                "SensorFailure turned: allowed for sensor 'imu' about index 0, 1 or 2 (axis of "
                f"the hull), got {shown(self.sensor)} and {shown(self.index)}"
            )

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the sensor."""
        from uuv.sim.plant.faults import FaultySensor

        onset = self.onset()
        module, name = SENSORS[self.sensor]
        kind = getattr(import_module(f"uuv.sim.sensors.{module}"), name)
        sensors = [
            FaultySensor(sensor, self._fault(), onset)
            if isinstance(getattr(sensor, "sound", sensor), kind)
            else sensor
            for sensor in loop.parts.sensors
        ]

        return replace(
            loop,
            parts=replace(loop.parts, sensors=sensors),
            observers=(*loop.observers, *self._observers(onset)),
        )

    def _fault(self) -> "SensorFault":
        from uuv.sim.plant.faults import Fixed, Frozen, Lost, Offset, Turned

        match self.effect:
            case "lost":
                return Lost()
            case "frozen":
                return Frozen((self.field,), self.index)
            case "fixed":
                return Fixed(self.field, self.index, self.value)
            case "offset":
                return Offset(self.field, self.index, jump=self.value, rate=self.rate)
            case "turned":
                assert self.index is not None
                return Turned(self.index, jump=self.value, rate=self.rate)

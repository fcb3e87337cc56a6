"""Sensors in plain Python that measure at every tick; compiled ticks call them as one slot."""

import math
from collections.abc import Mapping
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels.slots import PythonSlots
from uuv.sim.interfaces.messages import (
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    TorqueMeasurement,
)
from uuv.sim.loop.rollout import Rollout
from uuv.sim.plant.plant import Plant

MEASURED = {"encoders": EncoderMeasurement, "torques": TorqueMeasurement, "imu": ImuMeasurement}


class PythonSensors:
    """Steps sensors of a run, and passes their measurements to navigation."""

    def __init__(
        self, run: Rollout, plant: Plant, navigation: Any, numbers: Mapping[str, int]
    ) -> None:
        """Take the sensors.

        Args:
            run: Run whose states change as if its own step had run.
            plant: Plant of the run, without wrappers.
            navigation: Records of the estimator.
            numbers: Indices of the sensors among those of the run, by their channels in MEASURED.
        """
        self._run = run
        self._plant = plant
        self._navigation = navigation
        self._numbers = dict(numbers)
        self.names = tuple(type(run.parts.sensors[i]).__name__ for i in numbers.values())

    def slot(self, slots: PythonSlots) -> int:
        """Address of the slot that calls the sensors; 0 if there are none."""
        return slots.add(self._sense) if self._numbers else 0

    def _sense(self) -> None:
        run = self._run
        sample = self._navigation.sample
        self._plant.publish()

        # Newest time stamp: that of the compiled sensors, if there are any.
        newest = -math.inf if len(self._numbers) == len(MEASURED) else float(sample.time[0])
        if "imu" in self._numbers:
            sample.time[0] = -math.inf
        for channel, i in self._numbers.items():
            state, measurement = run.parts.sensors[i].step(run.sensor_states[i], run.truth)
            run.sensor_states[i] = state
            if measurement is not None:
                run.measured[i] = measurement
                self._deliver(channel, measurement)
                newest = max(newest, measurement.time)

        # The estimator's clock, set as by the estimator's own step.
        clock = self._navigation.memory["clock"]
        clock[0] = max(clock[0], newest)

    def _deliver(self, channel: str, measurement: Measurement) -> None:
        """Write a measurement into the memory of the compiled sensor of its channel.

        Raises:
            ConfigurationError: The message type does not fit the channel.
        """
        m = measurement
        joints = self._navigation.joints
        sample = self._navigation.sample

        if not isinstance(m, MEASURED[channel]):
            raise ConfigurationError(
                f"sensor of channel {channel!r}: must send {MEASURED[channel].__name__}, got "
                f"{type(m).__name__}"
            )

        if isinstance(m, EncoderMeasurement):
            joints.q[:] = m.q
            joints.qd[:] = m.qd
        elif isinstance(m, TorqueMeasurement):
            joints.tau[:] = m.tau
        elif isinstance(m, ImuMeasurement):
            sample.time[0] = m.time
            sample.specific_force_B[:] = m.specific_force_B
            sample.w_WB_B[:] = m.w_WB_B
            sample.R_WB[:] = m.R_WB

"""Joint torque sensors with coloured noise and drift, as a wrapper of sensors with a constant
bias.
"""

from dataclasses import dataclass, replace

import numpy as np

from uuv.sim.interfaces.messages import TorqueMeasurement
from uuv.sim.interfaces.spatial import Array, finite_number
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.proprioception import FastState, JointTorqueSensors


@dataclass(slots=True, eq=False)
class DriftState:
    """State of drifting torque sensors."""

    sensors: FastState
    walk: np.random.Generator
    rate: Array | None = None  # (n,) [N m/s] drift of this run; drawn with the first sample
    coloured: Array | None = None  # (n,) [N m] present coloured error


class DriftingTorqueSensors:
    """Torque sensors (`uuv.sim.interfaces.protocols.Sensor`) whose readings have coloured noise and
    drift.
    """

    def __init__(
        self, sensors: JointTorqueSensors, *, sigma: float, time: float, drift: float
    ) -> None:
        """Wrap `sensors`.

        Args:
            sensors: Sensors with white noise and bias; they draw the same random numbers as without
                the wrapper.
            sigma: [N m] standard deviation of the coloured noise (first-order Gauss-Markov),
                independent for each sensor.
            time: [s] Correlation time of this noise.
            drift: [N m/s] Standard deviation of a constant rate of change, drawn for each sensor.

        Raises:
            ConfigurationError: A number is not finite or out of range.
        """
        self.sound = sensors
        self.period = sensors.period
        self.delay = sensors.delay

        self._sigma = finite_number(sigma, "torque sensors: sigma [N m]", least=0.0)
        self._kept = float(
            np.exp(-sensors.period / finite_number(time, "torque sensors: time [s]", above=0.0))
        )
        self._drift = finite_number(drift, "torque sensors: drift [N m/s]", least=0.0)

    def init(self, rng: np.random.Generator) -> DriftState:
        """Draw the biases of this run."""
        inner = self.sound.init(rng)
        return DriftState(inner, rng.spawn(1)[0])

    def step(self, state: DriftState, truth: Truth) -> tuple[DriftState, TorqueMeasurement]:
        """Measure the torques at the gear outputs, and advance the slow errors."""
        state.sensors, sound = self.sound.step(state.sensors, truth)
        count = len(sound.tau)
        if state.coloured is None or state.rate is None:
            state.rate = self._drift * state.walk.standard_normal(count)
            state.coloured = self._sigma * state.walk.standard_normal(count)

        error = state.coloured + state.rate * sound.time
        state.coloured = self._kept * state.coloured + self._sigma * np.sqrt(
            1.0 - self._kept**2
        ) * state.walk.standard_normal(count)
        return state, replace(sound, tau=sound.tau + error)

"""Sensor of a gripper's drive: opening from its encoder, force from the motor's current."""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import JawMeasurement
from uuv.sim.interfaces.spatial import finite_number
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.proprioception import SensorState


@dataclass(frozen=True, slots=True, kw_only=True)
class JawSensor:
    """Opening and force as the drive of a gripper reports them."""

    period: float = 0.02  # [s]
    delay: float = 0.0  # [s]
    resolution: float = 5e-5  # [m] of the opening
    speed_noise: float = 2e-4  # [m/s] white, per reading
    force_noise: float = 0.03  # white, share of the reading
    force_bias: float = 0.05  # constant over a run, share of the reading, standard deviation

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a number out of range."""
        finite_number(self.period, "jaw sensor: period [s]", above=0.0)
        for name in ("delay", "resolution", "speed_noise", "force_noise", "force_bias"):
            finite_number(getattr(self, name), f"jaw sensor: {name}", least=0.0)

    def init(self, rng: np.random.Generator) -> SensorState:
        """Draw the scale error of the force."""
        return SensorState(rng=rng, bias=self.force_bias * rng.standard_normal(1))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, JawMeasurement]:
        """Measure opening, speed and force.

        Raises:
            ConfigurationError: The vehicle has no gripper.
        """
        if not len(truth.jaws.opening):
            raise ConfigurationError("jaw sensor: the vehicle has no gripper")

        noise = state.normal(2)
        opening = float(truth.jaws.opening[0])
        if self.resolution:
            opening = self.resolution * round(opening / self.resolution)
        scale = 1.0 + float(state.bias[0]) + self.force_noise * float(noise[1])

        return state, JawMeasurement(
            time=truth.time,
            opening=opening,
            speed=float(truth.jaws.speed[0]) + self.speed_noise * float(noise[0]),
            force=-scale * float(truth.jaws.force[0]),
        )

"""Perturbations of the sensors: slow error of vision, drifting torque sensors, attitude error."""

from dataclasses import dataclass, replace

from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.sim.interfaces.spatial import finite_number


@dataclass(frozen=True, kw_only=True)
class WanderingVision(Perturbation):
    """The position from vision has a slow error (first-order Gauss-Markov) in addition to white
    noise.
    """

    sigma: float = 3e-3  # [m] standard deviation per axis
    time: float = 60.0  # [s] correlation time

    def __post_init__(self) -> None:
        finite_number(self.sigma, "WanderingVision sigma [m]", least=0.0)
        finite_number(self.time, "WanderingVision time [s]", above=0.0)

    def on_loop(self, loop: Loop) -> Loop:
        """Replace the vision sensor; the messages of the new one state the slow error."""
        from uuv.sim.sensors.proprioception import VisionDrift

        sensors = [
            replace(sensor, bias=self.sigma, bias_time=self.time)
            if isinstance(sensor, VisionDrift)
            else sensor
            for sensor in loop.parts.sensors
        ]
        return replace(loop, parts=replace(loop.parts, sensors=sensors))


@dataclass(frozen=True, kw_only=True)
class DriftingTorque(Perturbation):
    """The torque sensors have coloured noise (first-order Gauss-Markov) and, in addition, a
    drift.
    """

    # [N m] standard deviation of the coloured noise, independent for each sensor
    sigma: float = 0.3
    time: float = 2.0  # [s] correlation time of this noise
    drift: float = 0.0  # [N m/s] standard deviation of a constant rate, drawn for each sensor

    def __post_init__(self) -> None:
        finite_number(self.sigma, "DriftingTorque sigma [N m]", least=0.0)
        finite_number(self.time, "DriftingTorque time [s]", above=0.0)
        finite_number(self.drift, "DriftingTorque drift [N m/s]", least=0.0)

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the torque sensors."""
        from uuv.sim.sensors.proprioception import JointTorqueSensors
        from uuv.sim.sensors.torque_drift import DriftingTorqueSensors

        sensors = [
            DriftingTorqueSensors(sensor, sigma=self.sigma, time=self.time, drift=self.drift)
            if isinstance(sensor, JointTorqueSensors)
            else sensor
            for sensor in loop.parts.sensors
        ]
        return replace(loop, parts=replace(loop.parts, sensors=sensors))


@dataclass(frozen=True, kw_only=True)
class AttitudeError(Perturbation):
    """The inertial unit's attitude has a constant error, with the standard deviation that it
    states.
    """

    sigma: float = 1.7e-3  # [rad] per axis: 0.1 deg

    def __post_init__(self) -> None:
        finite_number(self.sigma, "AttitudeError sigma [rad]", least=0.0)

    def on_loop(self, loop: Loop) -> Loop:
        """Replace the inertial unit."""
        from uuv.sim.sensors.proprioception import Imu

        sensors = [
            replace(sensor, attitude_bias=self.sigma) if isinstance(sensor, Imu) else sensor
            for sensor in loop.parts.sensors
        ]
        return replace(loop, parts=replace(loop.parts, sensors=sensors))

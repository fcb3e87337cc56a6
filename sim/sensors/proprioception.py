"""Navigation and joint sensors: each has a rate, a delay, noise, bias and quantisation."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    DvlNoise,
    EncoderMeasurement,
    ImuMeasurement,
    ImuNoise,
    PressureMeasurement,
    TorqueMeasurement,
    VisionMeasurement,
    VisionNoise,
)
from uuv.sim.interfaces.spatial import GRAVITY, Array, checked, number
from uuv.sim.plant.truth import Truth

SEA_LEVEL = 101325.0  # [Pa] standard atmosphere
_MOST_JOINTS = 64  # largest number of joints of an arm
# number of normal numbers drawn at a time, since single draws cost more than the sensor
_BLOCK = 8192


@dataclass(slots=True, eq=False)
class SensorState:
    """Random stream of one sensor, with the bias drawn for this run."""

    rng: np.random.Generator
    bias: Array
    drawn: Array = field(default_factory=lambda: np.zeros(0))
    used: int = 0
    stated: Any = None  # noise according to the data sheet, attached to every measurement

    def normal(self, count: int) -> Array:
        """Next `count` standard normal numbers of the stream."""
        if self.used + count > len(self.drawn):
            self.drawn = self.rng.standard_normal(max(_BLOCK, count))
            self.used = 0
        self.used += count
        return self.drawn[self.used - count : self.used]


_CONSTANTS = [("bias", np.float64, _MOST_JOINTS)]  # drawn for this run, in the sensor's units
# standard normal numbers, and the number of those that have been used
_NOISE = [("drawn", np.float64, _BLOCK), ("used", np.int64)]

ENCODERS = np.dtype(
    (
        np.record,
        [
            *_CONSTANTS,
            ("resolution", np.float64),
            ("rate_noise", np.float64),
            ("rate_resolution", np.float64),
            *_NOISE,
        ],
    )
)
TORQUE_SENSORS = np.dtype(
    (np.record, [*_CONSTANTS, ("noise", np.float64), ("resolution", np.float64), *_NOISE])
)
IMU = np.dtype(
    (
        np.record,
        [
            *_CONSTANTS,  # accelerometer (3,) [m/s^2], attitude (3,) [rad], gyro (3,) [rad/s]
            ("acceleration_noise", np.float64),
            ("rate_noise", np.float64),
            ("attitude_noise", np.float64),
            ("acceleration_resolution", np.float64),
            ("rate_resolution", np.float64),
            *_NOISE,
        ],
    )
)


class FastState:
    """State of a sensor that samples at every step of the loop: a compiled record and a random
    stream.
    """

    __slots__ = ("_count", "_drawn", "_rng", "_used", "record", "stated")

    def __init__(self, kind: np.dtype, sensor: Any, rng: np.random.Generator, bias: Array) -> None:
        """Copy bias and constants into a record.

        Args:
            kind: Type of the record, which is ENCODERS, TORQUE_SENSORS or IMU.
            sensor: Sensor with the record's constants.
            rng: Random stream of the noise.
            bias: (k,) drawn for this run.
        """
        self.record = np.zeros(1, kind)  # changed in place
        self.record["bias"][0, : len(bias)] = bias
        for name in kind.names or ():
            if hasattr(sensor, name) and name != "bias":
                self.record[name] = getattr(sensor, name)
        self.stated: Any = None  # noise according to the data sheet, attached to every measurement

        self._rng = rng
        self._count = 0
        self._drawn = self.record["drawn"][0]
        self._used = self.record["used"]
        self._used[0] = _BLOCK

    @property
    def bias(self) -> Array:
        """Biases of this run, padded with zeros."""
        return self.record["bias"][0]

    def ready(self) -> int:
        """Number of samples for which noise has been drawn; 0 before the first sample."""
        return int(_BLOCK - self._used[0]) // max(self._count, 1)

    def draw(self, count: int) -> Array:
        """Draw noise of `count` numbers for the next sample if needed, and return the record."""
        self._count = count
        if self._used[0] + count > _BLOCK:
            self._rng.standard_normal(out=self._drawn)
            self._used[0] = 0
        return self.record


def _check(sensor: Any, above: Iterable[str] = ("period",)) -> None:
    """Raise ConfigurationError unless numbers of `sensor` are finite and >= 0, or > 0 for those in
    `above`.
    """
    for entry in fields(sensor):
        if entry.type is not float:
            continue

        name = f"{type(sensor).__name__} {entry.name}"
        figure = number(getattr(sensor, entry.name), name)

        if not (
            np.isfinite(figure) and figure >= 0.0 and (figure > 0.0 or entry.name not in above)
        ):
            bound = "> 0" if entry.name in above else ">= 0"
            raise ConfigurationError(f"{name}: must be finite and {bound}, got {figure}")
        object.__setattr__(sensor, entry.name, figure)


def _constant(rng: np.random.Generator, count: int) -> Array:
    """Standard normal numbers from a separate stream, so that the stream of the noise is
    unchanged.
    """
    return rng.spawn(1)[0].standard_normal(count)


def _white(noise: float, resolution: float) -> float:
    """Standard deviation of white noise and rounding combined."""
    return float(np.hypot(noise, resolution / np.sqrt(12.0)))


def _quantised(value: Array, resolution: float) -> Array:
    """`value` rounded to multiples of `resolution`; unchanged if the resolution is zero."""
    return np.round(value / resolution) * resolution if resolution > 0.0 else value


@kernel
def _in_steps(value, resolution):
    """`_quantised` for one number."""
    return np.rint(value / resolution) * resolution if resolution > 0.0 else value


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoders:
    """Joint encoders: quantised angle, and velocity from the drive."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    resolution: float = 2.0 * np.pi / 2**19  # [rad] 19 bits per turn
    bias: float = 0.0  # [rad] of the zero position, constant over a run, standard deviation
    rate_noise: float = 2e-4  # [rad/s] white, per sample
    rate_resolution: float = 0.0  # [rad/s]; 0 for none

    def __post_init__(self) -> None:
        _check(self, ("period", "resolution"))

    def init(self, rng: np.random.Generator) -> FastState:
        """Draw the biases of this run."""
        return FastState(ENCODERS, self, rng, self.bias * _constant(rng, _MOST_JOINTS))

    def channel(self) -> str:
        """Index of the sensor's record among those that the compiled ticks sample."""
        return "encoders"

    def step(self, state: FastState, truth: Truth) -> tuple[FastState, EncoderMeasurement]:
        """Measure joint angles and velocities."""
        n = len(truth.q)
        q = np.empty(n)
        qd = np.empty(n)

        encode(state.draw(n), truth.q, truth.qd, q, qd)
        return state, EncoderMeasurement(time=truth.time, q=q, qd=qd)


@kernel
def encode(record, q, qd, q_read, qd_read):
    """Sample the encoders, with noise from their record.

    Args:
        record: (1,) of ENCODERS.
        q: (n,) [rad] true angles.
        qd: (n,) [rad/s] true velocities.
        q_read: (n,) [rad] result.
        qd_read: (n,) [rad/s] result.
    """
    sensor = record[0]

    for j in range(len(q)):
        q_read[j] = _in_steps(q[j] + sensor.bias[j], sensor.resolution)
        noise = sensor.rate_noise * sensor.drawn[sensor.used + j]
        qd_read[j] = _in_steps(qd[j] + noise, sensor.rate_resolution)
    sensor.used += len(q)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTorqueSensors:
    """One-component torque sensors on the gear outputs [Konoplin 2022]."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    noise: float = 0.01  # white, share of the reading, per sample
    bias: float = 0.5  # [N m] constant over a run, uniform in +-bias
    resolution: float = 0.0  # [N m]; 0 for none

    def __post_init__(self) -> None:
        _check(self)

    def init(self, rng: np.random.Generator) -> FastState:
        """Draw the biases of this run."""
        return FastState(
            TORQUE_SENSORS, self, rng, rng.uniform(-self.bias, self.bias, _MOST_JOINTS)
        )

    def channel(self) -> str:
        """Index of the sensor's record among those that the compiled ticks sample."""
        return "torques"

    def step(self, state: FastState, truth: Truth) -> tuple[FastState, TorqueMeasurement]:
        """Measure the torques at the gear outputs."""
        n = len(truth.q)
        tau = np.empty(n)
        transmit(
            state.draw(n),
            truth.tau_drive,
            truth.tau_friction,
            truth.armature,
            truth.qdd,
            truth.joint_damping,
            truth.qd,
            tau,
        )
        return state, TorqueMeasurement(time=truth.time, tau=tau)


@kernel
def transmit(record, tau_drive, tau_friction, armature, qdd, damping, qd, tau_read):
    """Sample the torque at the gear outputs, which is the motor torque minus rotor inertia,
    friction and damping.

    Args:
        record: (1,) of TORQUE_SENSORS.
        tau_drive: (n,) [N m] of the motors.
        tau_friction: (n,) [N m] of dry friction in the gears, on the joint.
        armature: (n,) [kg m^2] inertia of the rotors.
        qdd: (n,) [rad/s^2] true accelerations.
        damping: (n,) [N m s/rad] of the joints.
        qd: (n,) [rad/s] true velocities.
        tau_read: (n,) [N m] result.
    """
    sensor = record[0]

    for j in range(len(tau_read)):
        true = tau_drive[j] + tau_friction[j] - armature[j] * qdd[j] - damping[j] * qd[j]
        noise = sensor.noise * sensor.drawn[sensor.used + j]
        tau_read[j] = _in_steps(true * (1.0 + noise) + sensor.bias[j], sensor.resolution)
    sensor.used += len(tau_read)


@dataclass(frozen=True, slots=True, kw_only=True)
class Imu:
    """Inertial unit with fibre-optic gyros: specific force, rate, attitude at the hull's origin."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    # [m/s^2] white, per sample: 9 ug per root Hz, a quartz accelerometer
    acceleration_noise: float = 2e-3
    acceleration_bias: float = 0.005  # [m/s^2] constant over a run, standard deviation
    acceleration_resolution: float = 0.0  # [m/s^2]; 0 for none
    rate_noise: float = 2e-4  # [rad/s] white, per sample
    rate_bias: float = 0.0  # [rad/s] constant over a run, standard deviation
    rate_resolution: float = 0.0  # [rad/s]; 0 for none
    attitude_noise: float = 5e-5  # [rad] white, per sample
    attitude_bias: float = 3e-4  # [rad] constant over a run, standard deviation

    def __post_init__(self) -> None:
        _check(self)

    def init(self, rng: np.random.Generator) -> FastState:
        """Draw the biases of this run."""
        bias = rng.standard_normal(6)
        rate = self.rate_bias * _constant(rng, 3)
        errors = np.concatenate(
            [self.acceleration_bias * bias[:3], self.attitude_bias * bias[3:], rate]
        )

        state = FastState(IMU, self, rng, errors)
        state.stated = ImuNoise(
            acceleration=_white(self.acceleration_noise, self.acceleration_resolution),
            acceleration_bias=self.acceleration_bias,
            rate=_white(self.rate_noise, self.rate_resolution),
            rate_bias=self.rate_bias,
            attitude=self.attitude_noise,
            attitude_bias=self.attitude_bias,
        )
        return state

    def channel(self) -> str:
        """Index of the sensor's record among those that the compiled ticks sample."""
        return "imu"

    def step(self, state: FastState, truth: Truth) -> tuple[FastState, ImuMeasurement]:
        """Measure specific force, angular velocity and attitude."""
        force_B = np.empty(3)
        w_B = np.empty(3)
        R = np.empty((3, 3))
        sense_motion(state.draw(9), truth.R_WB, truth.acceleration, truth.w_WB_B, force_B, w_B, R)
        return state, ImuMeasurement(
            time=truth.time, specific_force_B=force_B, w_WB_B=w_B, R_WB=R, noise=state.stated
        )


@kernel
def sense_motion(record, R_WB, acceleration, w_B, force_read, w_read, R_read):
    """Sample the inertial unit; the attitude error is about hull axes.

    Args:
        record: (1,) of IMU.
        R_WB: (3, 3) true attitude.
        acceleration: (6,) or (3,) [m/s^2] true acceleration of the hull's origin in W; only the
            first three entries count.
        w_B: (3,) [rad/s] true angular velocity in B.
        force_read: (3,) [m/s^2] result, in B.
        w_read: (3,) [rad/s] result, in B.
        R_read: (3, 3) result.
    """
    sensor = record[0]
    phi = np.empty(3)
    bias = sensor.bias
    noise = sensor.drawn[sensor.used : sensor.used + 9]
    sensor.used += 9

    # Specific force and angular velocity in hull axes; error of the attitude.
    for i in range(3):
        force = bias[i] + sensor.acceleration_noise * noise[i]
        for j in range(3):
            force += R_WB[j, i] * (acceleration[j] + (GRAVITY if j == 2 else 0.0))
        force_read[i] = _in_steps(force, sensor.acceleration_resolution)
        w_read[i] = _in_steps(
            w_B[i] + bias[6 + i] + sensor.rate_noise * noise[3 + i], sensor.rate_resolution
        )
        phi[i] = bias[3 + i] + sensor.attitude_noise * noise[6 + i]

    # Second order in the error, which is below a milliradian. The result is a rotation to 1e-10,
    # far below the noise.
    for j in range(3):
        k = (j + 1) % 3
        m = (j + 2) % 3
        diagonal = 1.0 - 0.5 * (phi[k] ** 2 + phi[m] ** 2)
        next_ = phi[m] + 0.5 * phi[j] * phi[k]
        last = 0.5 * phi[j] * phi[m] - phi[k]
        for i in range(3):
            R_read[i, j] = R_WB[i, j] * diagonal + R_WB[i, k] * next_ + R_WB[i, m] * last


@dataclass(frozen=True, slots=True, kw_only=True)
class Dvl:
    """Doppler velocity log (DVL): velocity over ground in hull axes."""

    period: float = 0.1  # [s]
    delay: float = 0.0  # [s]
    noise: float = 3e-3  # [m/s] white, per sample
    bias: float = 0.0  # [m/s] constant over a run, standard deviation
    resolution: float = 0.0  # [m/s]; 0 for none

    def __post_init__(self) -> None:
        _check(self)

    def init(self, rng: np.random.Generator) -> SensorState:
        """Draw the bias of this run."""
        stated = DvlNoise(white=_white(self.noise, self.resolution), bias=self.bias)
        return SensorState(rng, self.bias * _constant(rng, 3), stated=stated)

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, DvlMeasurement]:
        """Measure the velocity over ground."""
        v = truth.R_WB.T @ truth.v_WB_W + state.bias + self.noise * state.normal(3)
        return state, DvlMeasurement(
            time=truth.time, v_WB_B=_quantised(v, self.resolution), noise=state.stated
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureDepth:
    """Pressure gauge: absolute pressure at a point of the hull, and the depth computed from it."""

    period: float = 0.05  # [s]
    delay: float = 0.0  # [s]
    noise: float = 20.0  # [Pa] white, per sample: 2 mm of water
    bias: float = 100.0  # [Pa] constant over a run, standard deviation: 1 cm
    resolution: float = 20.0  # [Pa]; 0 for none
    p_BS: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] position of the gauge in the hull
    water_density: float = 1025.0  # [kg/m^3] true density
    surface: float = SEA_LEVEL  # [Pa] true pressure at depth zero, z = 0 of the world
    assumed_density: float = 1025.0  # [kg/m^3] density that the gauge assumes
    assumed_surface: float = SEA_LEVEL  # [Pa] pressure at which the gauge was zeroed
    gravity: float = GRAVITY  # [m/s^2]

    def __post_init__(self) -> None:
        _check(self, ("period", "water_density", "assumed_density", "gravity"))
        checked(self.p_BS, (3,), "PressureDepth p_BS")

    def init(self, rng: np.random.Generator) -> SensorState:
        """Draw the bias of this run."""
        return SensorState(rng, self.bias * _constant(rng, 1))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, PressureMeasurement]:
        """Measure pressure and depth."""
        depth = -float(truth.p_WB[2] + truth.R_WB[2] @ self.p_BS)

        # above the surface the gauge is in air
        water = self.water_density * self.gravity * max(depth, 0.0)
        pressure = self.surface + water + state.bias + self.noise * state.normal(1)
        pressure = float(_quantised(pressure, self.resolution)[0])
        depth = (pressure - self.assumed_surface) / (self.assumed_density * self.gravity)
        return state, PressureMeasurement(time=truth.time, pressure=pressure, depth=depth)


@dataclass(slots=True, eq=False)
class WanderState:
    """State of a sensor whose error is a Gauss-Markov process."""

    noise: SensorState
    walk: np.random.Generator
    error: Array  # (3,) [m] present value


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionDrift:
    """Position of the hull in the scene from cameras, with a delay, white noise and a Gauss-Markov
    error.
    """

    period: float = 0.1  # [s]
    delay: float = 0.1  # [s]
    noise: float = 2e-3  # [m] white, per sample
    bias: float = 0.0  # [m] standard deviation of the slow error (first-order Gauss-Markov)
    bias_time: float = 60.0  # [s] its correlation time
    resolution: float = 0.0  # [m]; 0 for none

    def __post_init__(self) -> None:
        _check(self, ("period", "bias_time"))

    def init(self, rng: np.random.Generator) -> WanderState:
        """Draw the initial slow error."""
        walk = rng.spawn(1)[0]
        stated = VisionNoise(
            white=_white(self.noise, self.resolution), wander=self.bias, wander_time=self.bias_time
        )
        return WanderState(
            SensorState(rng, np.zeros(0), stated=stated), walk, self.bias * walk.standard_normal(3)
        )

    def step(self, state: WanderState, truth: Truth) -> tuple[WanderState, VisionMeasurement]:
        """Measure the position of the hull and advance the slow error."""
        p = truth.p_WB + state.error + self.noise * state.noise.normal(3)
        if self.bias > 0.0:
            decay = np.exp(-self.period / self.bias_time)
            state.error = decay * state.error + self.bias * np.sqrt(
                1.0 - decay**2
            ) * state.walk.standard_normal(3)

        return state, VisionMeasurement(
            time=truth.time, p_WB=_quantised(p, self.resolution), noise=state.noise.stated
        )

"""Navigation and joint sensors: each with its rate, delay, noise, bias and quantisation."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any

import numba
import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.kernels import keyed_by_imports
from sim.interfaces.messages import (
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
from sim.interfaces.spatial import GRAVITY, Array, checked, number
from sim.plant.plant import Truth

SEA_LEVEL = 101325.0  # [Pa] standard atmosphere
_MOST_JOINTS = 64  # largest number of joints of an arm
_BLOCK = 8192  # normal numbers drawn at a time: drawn singly they cost more than the sensor


@dataclass(slots=True, eq=False)
class SensorState:
    """Random stream of one sensor, with the bias drawn for this run."""

    rng: np.random.Generator
    bias: Array
    drawn: Array = field(default_factory=lambda: np.zeros(0))
    used: int = 0
    stated: Any = None  # noise by the data sheet, attached to every measurement

    def normal(self, count: int) -> Array:
        """Next `count` standard normal numbers of the stream."""
        if self.used + count > len(self.drawn):
            self.drawn, self.used = self.rng.standard_normal(max(_BLOCK, count)), 0
        self.used += count
        return self.drawn[self.used - count : self.used]


def _check(sensor: Any, above: Iterable[str] = ("period",)) -> None:
    """Raise ConfigurationError unless all numbers of `sensor` are finite and >= 0, and those named in `above` > 0."""
    for item in fields(sensor):
        if item.type is not float:
            continue
        name = f"{type(sensor).__name__} {item.name}"
        value = number(getattr(sensor, item.name), name)
        if not (np.isfinite(value) and value >= 0.0 and (value > 0.0 or item.name not in above)):
            bound = "> 0" if item.name in above else ">= 0"
            raise ConfigurationError(f"{name}: must be finite and {bound}, got {value}")
        object.__setattr__(sensor, item.name, value)


def _constant(rng: np.random.Generator, count: int) -> Array:
    """Standard normal numbers of a stream separate from the noise, so that drawing them does not change the noise."""
    return rng.spawn(1)[0].standard_normal(count)


def _white(noise: float, resolution: float) -> float:
    """Standard deviation of white noise and rounding combined."""
    return float(np.hypot(noise, resolution / np.sqrt(12.0)))


def _quantised(value: Array, resolution: float) -> Array:
    """Round `value` to multiples of `resolution`; unchanged if that is zero."""
    return np.round(value / resolution) * resolution if resolution > 0.0 else value


@numba.njit(cache=True)
@keyed_by_imports
def _in_steps(value, resolution):
    """`_quantised` of one number."""
    return np.rint(value / resolution) * resolution if resolution > 0.0 else value


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoders:
    """Joint encoders: quantised angle, and speed from the drive."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    resolution: float = 2.0 * np.pi / 2**19  # [rad] 19 bits per turn
    bias: float = 0.0  # [rad] of the zero position, constant over a run, standard deviation
    rate_noise: float = 2e-4  # [rad/s] white, per sample
    rate_resolution: float = 0.0  # [rad/s]; 0 for none

    def __post_init__(self) -> None:
        _check(self, ("period", "resolution"))

    def init(self, rng: np.random.Generator) -> SensorState:
        """Draw the biases of this run."""
        return SensorState(rng, self.bias * _constant(rng, _MOST_JOINTS))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, EncoderMeasurement]:
        """Measure joint angles and velocities."""
        q, qd = _encode(
            truth.q,
            truth.qd,
            state.bias,
            state.normal(len(truth.q)),
            self.resolution,
            self.rate_noise,
            self.rate_resolution,
        )
        return state, EncoderMeasurement(time=truth.time, q=q, qd=qd)


@numba.njit(cache=True)
@keyed_by_imports
def _encode(q, qd, bias, noise, resolution, rate_noise, rate_resolution):
    angle, rate = np.empty_like(q), np.empty_like(qd)
    for j in range(len(q)):
        angle[j] = _in_steps(q[j] + bias[j], resolution)
        rate[j] = _in_steps(qd[j] + rate_noise * noise[j], rate_resolution)
    return angle, rate


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

    def init(self, rng: np.random.Generator) -> SensorState:
        """Draw the biases of this run."""
        return SensorState(rng, rng.uniform(-self.bias, self.bias, _MOST_JOINTS))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, TorqueMeasurement]:
        """Measure the torques at the gear outputs."""
        tau = _transmitted(
            truth.tau_drive,
            truth.tau_friction,
            truth.armature,
            truth.qdd,
            truth.joint_damping,
            truth.qd,
            state.normal(len(truth.q)),
            self.noise,
            state.bias,
            self.resolution,
        )
        return state, TorqueMeasurement(time=truth.time, tau=tau)


@numba.njit(cache=True)
@keyed_by_imports
def _transmitted(tau_drive, tau_friction, armature, qdd, damping, qd, noise, share, bias, resolution):
    """Torque at the gear outputs, with sensor errors: drive torque less rotor inertia, gear friction and damping."""
    tau = np.empty_like(tau_drive)
    for j in range(len(tau)):
        true = tau_drive[j] + tau_friction[j] - armature[j] * qdd[j] - damping[j] * qd[j]
        tau[j] = _in_steps(true * (1.0 + share * noise[j]) + bias[j], resolution)
    return tau


@dataclass(frozen=True, slots=True, kw_only=True)
class Imu:
    """Inertial unit with fibre-optic gyros: specific force, angular velocity and attitude at the hull's origin."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    acceleration_noise: float = 2e-3  # [m/s^2] white, per sample: 9 ug per root Hz, a quartz accelerometer
    acceleration_bias: float = 0.005  # [m/s^2] constant over a run, standard deviation
    acceleration_resolution: float = 0.0  # [m/s^2]; 0 for none
    rate_noise: float = 2e-4  # [rad/s] white, per sample
    rate_bias: float = 0.0  # [rad/s] constant over a run, standard deviation
    rate_resolution: float = 0.0  # [rad/s]; 0 for none
    attitude_noise: float = 5e-5  # [rad] white, per sample
    attitude_bias: float = 3e-4  # [rad] constant over a run, standard deviation

    def __post_init__(self) -> None:
        _check(self)

    def init(self, rng: np.random.Generator) -> SensorState:
        """Draw the biases of this run."""
        bias = rng.standard_normal(6)
        rate = self.rate_bias * _constant(rng, 3)
        errors = np.concatenate([self.acceleration_bias * bias[:3], self.attitude_bias * bias[3:], rate])
        stated = ImuNoise(
            acceleration=_white(self.acceleration_noise, self.acceleration_resolution),
            acceleration_bias=self.acceleration_bias,
            rate=_white(self.rate_noise, self.rate_resolution),
            rate_bias=self.rate_bias,
            attitude=self.attitude_noise,
            attitude_bias=self.attitude_bias,
        )
        return SensorState(rng, errors, stated=stated)

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, ImuMeasurement]:
        """Measure specific force, angular velocity and attitude."""
        force_B, w_B, R = _inertial(
            truth.R_WB,
            truth.acceleration,
            truth.w_WB_B,
            state.bias,
            state.normal(9),
            self.acceleration_noise,
            self.rate_noise,
            self.attitude_noise,
            self.acceleration_resolution,
            self.rate_resolution,
        )
        return state, ImuMeasurement(time=truth.time, specific_force_B=force_B, w_WB_B=w_B, R_WB=R, noise=state.stated)


@numba.njit(cache=True)
@keyed_by_imports
def _inertial(
    R_WB,
    acceleration,
    w_B,
    bias,
    noise,
    acceleration_noise,
    rate_noise,
    attitude_noise,
    acceleration_resolution,
    rate_resolution,
):
    """Specific force, angular velocity and attitude with their errors; the attitude error is about hull axes."""
    force_B, w, phi = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        force = bias[i] + acceleration_noise * noise[i]
        for j in range(3):
            force += R_WB[j, i] * (acceleration[j] + (GRAVITY if j == 2 else 0.0))
        force_B[i] = _in_steps(force, acceleration_resolution)
        w[i] = _in_steps(w_B[i] + bias[6 + i] + rate_noise * noise[3 + i], rate_resolution)
        phi[i] = bias[3 + i] + attitude_noise * noise[6 + i]
    # Second order in the error, which is below a milliradian: within 1e-10 of a rotation, far below the noise.
    R = np.empty((3, 3))
    for j in range(3):
        k, m = (j + 1) % 3, (j + 2) % 3
        own = 1.0 - 0.5 * (phi[k] ** 2 + phi[m] ** 2)
        next_, last = phi[m] + 0.5 * phi[j] * phi[k], 0.5 * phi[j] * phi[m] - phi[k]
        for i in range(3):
            R[i, j] = R_WB[i, j] * own + R_WB[i, k] * next_ + R_WB[i, m] * last
    return force_B, w, R


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
        return state, DvlMeasurement(time=truth.time, v_WB_B=_quantised(v, self.resolution), noise=state.stated)


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
        water = self.water_density * self.gravity * max(depth, 0.0)  # above the surface there is air
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
    """Position of the hull relative to the scene from the cameras: delayed, with white and Gauss-Markov errors."""

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
        stated = VisionNoise(white=_white(self.noise, self.resolution), wander=self.bias, wander_time=self.bias_time)
        return WanderState(SensorState(rng, np.zeros(0), stated=stated), walk, self.bias * walk.standard_normal(3))

    def step(self, state: WanderState, truth: Truth) -> tuple[WanderState, VisionMeasurement]:
        """Measure the position of the hull and advance the slow error."""
        p = truth.p_WB + state.error + self.noise * state.noise.normal(3)
        if self.bias > 0.0:
            kept = np.exp(-self.period / self.bias_time)
            state.error = kept * state.error + self.bias * np.sqrt(1.0 - kept**2) * state.walk.standard_normal(3)
        return state, VisionMeasurement(time=truth.time, p_WB=_quantised(p, self.resolution), noise=state.noise.stated)

"""Sensors of the plant, each with its rate, delay, noise, bias and quantisation beside it. Truth in, messages out."""

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

SEA_LEVEL = 101325.0  # [Pa] the standard atmosphere
_MOST_JOINTS = 64  # of an arm
_BLOCK = 8192  # normal numbers drawn at a time: one by one they cost more than the sensor


@dataclass(slots=True, eq=False)
class SensorState:
    """Random stream of one sensor, with the bias drawn for this run."""

    rng: np.random.Generator
    bias: Array
    drawn: Array = field(default_factory=lambda: np.zeros(0))
    used: int = 0
    stated: Any = None  # its noise as the maker states it, which travels with every measurement

    def normal(self, count: int) -> Array:
        """The next `count` standard normal numbers of the stream."""
        if self.used + count > len(self.drawn):
            self.drawn, self.used = self.rng.standard_normal(max(_BLOCK, count)), 0
        self.used += count
        return self.drawn[self.used - count : self.used]


def _check(sensor: Any, above: Iterable[str] = ("period",)) -> None:
    """ConfigurationError unless every number of `sensor` is finite and >= 0, and those named `above` are not zero."""
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
    """Standard normal numbers of a stream beside that of the noise, which is the same whether they are used or not."""
    return rng.spawn(1)[0].standard_normal(count)


def _white(noise: float, resolution: float) -> float:
    """Standard deviation of white noise and rounding together."""
    return float(np.hypot(noise, resolution / np.sqrt(12.0)))


def _quantised(value: Array, resolution: float) -> Array:
    """`value` in whole steps of `resolution`; as it is where that is zero."""
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
    resolution: float = 2.0 * np.pi / 2**19  # [rad] 19 bits a turn
    bias: float = 0.0  # [rad] of each zero, constant over a run, standard deviation
    rate_noise: float = 2e-4  # [rad/s] white, per sample
    rate_resolution: float = 0.0  # [rad/s]; 0 for none

    def __post_init__(self) -> None:
        _check(self, ("period", "resolution"))

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, self.bias * _constant(rng, _MOST_JOINTS))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, EncoderMeasurement]:
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
    """One-component torque sensors on the gear outputs (paper 002)."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    noise: float = 0.01  # white, share of the reading, per sample
    bias: float = 0.5  # [N m] constant over a run, uniform in +-bias
    resolution: float = 0.0  # [N m]; 0 for none

    def __post_init__(self) -> None:
        _check(self)

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, rng.uniform(-self.bias, self.bias, _MOST_JOINTS))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, TorqueMeasurement]:
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
    """What passes through the gear outputs (the drive's, less rotor inertia and gear friction), with its errors."""
    tau = np.empty_like(tau_drive)
    for j in range(len(tau)):
        true = tau_drive[j] + tau_friction[j] - armature[j] * qdd[j] - damping[j] * qd[j]
        tau[j] = _in_steps(true * (1.0 + share * noise[j]) + bias[j], resolution)
    return tau


@dataclass(frozen=True, slots=True, kw_only=True)
class Imu:
    """Accelerations, rates and attitude at the hull's origin: a navigation unit with fibre-optic gyros."""

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
    """Specific force, rates and attitude with their errors; the attitude's error turns about hull axes."""
    force_B, w, phi = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        force = bias[i] + acceleration_noise * noise[i]
        for j in range(3):
            force += R_WB[j, i] * (acceleration[j] + (GRAVITY if j == 2 else 0.0))
        force_B[i] = _in_steps(force, acceleration_resolution)
        w[i] = _in_steps(w_B[i] + bias[6 + i] + rate_noise * noise[3 + i], rate_resolution)
        phi[i] = bias[3 + i] + attitude_noise * noise[6 + i]
    # Second order in the error, which is below a milliradian: 1e-10 from a rotation, far below the noise.
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
    """Doppler log: velocity over ground in hull axes."""

    period: float = 0.1  # [s]
    delay: float = 0.0  # [s]
    noise: float = 3e-3  # [m/s] white, per sample
    bias: float = 0.0  # [m/s] constant over a run, standard deviation
    resolution: float = 0.0  # [m/s]; 0 for none

    def __post_init__(self) -> None:
        _check(self)

    def init(self, rng: np.random.Generator) -> SensorState:
        stated = DvlNoise(white=_white(self.noise, self.resolution), bias=self.bias)
        return SensorState(rng, self.bias * _constant(rng, 3), stated=stated)

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, DvlMeasurement]:
        v = truth.R_WB.T @ truth.v_WB_W + state.bias + self.noise * state.normal(3)
        return state, DvlMeasurement(time=truth.time, v_WB_B=_quantised(v, self.resolution), noise=state.stated)


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureDepth:
    """Absolute pressure at a point of the hull, and the depth that the instrument makes of it."""

    period: float = 0.05  # [s]
    delay: float = 0.0  # [s]
    noise: float = 20.0  # [Pa] white, per sample: 2 mm of water
    bias: float = 100.0  # [Pa] constant over a run, standard deviation: 1 cm
    resolution: float = 20.0  # [Pa]; 0 for none
    p_BS: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] the instrument in the hull
    water_density: float = 1025.0  # [kg/m^3] of the water
    surface: float = SEA_LEVEL  # [Pa] at depth zero, z = 0 of the world
    assumed_density: float = 1025.0  # [kg/m^3] what the instrument takes the water for
    assumed_surface: float = SEA_LEVEL  # [Pa] what it was zeroed at
    gravity: float = GRAVITY  # [m/s^2]

    def __post_init__(self) -> None:
        _check(self, ("period", "water_density", "assumed_density", "gravity"))
        checked(self.p_BS, (3,), "PressureDepth p_BS")

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, self.bias * _constant(rng, 1))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, PressureMeasurement]:
        depth = -float(truth.p_WB[2] + truth.R_WB[2] @ self.p_BS)
        water = self.water_density * self.gravity * max(depth, 0.0)  # above the surface there is air
        pressure = self.surface + water + state.bias + self.noise * state.normal(1)
        pressure = float(_quantised(pressure, self.resolution)[0])
        depth = (pressure - self.assumed_surface) / (self.assumed_density * self.gravity)
        return state, PressureMeasurement(time=truth.time, pressure=pressure, depth=depth)


@dataclass(slots=True, eq=False)
class WanderState:
    """Memory of a sensor whose error wanders."""

    noise: SensorState
    walk: np.random.Generator
    error: Array  # (3,) [m] now


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionDrift:
    """Position of the hull against the scene from the cameras: slow, late and noisy, with an error that wanders."""

    period: float = 0.1  # [s]
    delay: float = 0.1  # [s]
    noise: float = 2e-3  # [m] white, per sample
    bias: float = 0.0  # [m] standard deviation of an error that wanders (Gauss-Markov)
    bias_time: float = 60.0  # [s] over which it forgets itself
    resolution: float = 0.0  # [m]; 0 for none

    def __post_init__(self) -> None:
        _check(self, ("period", "bias_time"))

    def init(self, rng: np.random.Generator) -> WanderState:
        walk = rng.spawn(1)[0]
        stated = VisionNoise(white=_white(self.noise, self.resolution), wander=self.bias, wander_time=self.bias_time)
        return WanderState(SensorState(rng, np.zeros(0), stated=stated), walk, self.bias * walk.standard_normal(3))

    def step(self, state: WanderState, truth: Truth) -> tuple[WanderState, VisionMeasurement]:
        p = truth.p_WB + state.error + self.noise * state.noise.normal(3)
        if self.bias > 0.0:
            kept = np.exp(-self.period / self.bias_time)
            state.error = kept * state.error + self.bias * np.sqrt(1.0 - kept**2) * state.walk.standard_normal(3)
        return state, VisionMeasurement(time=truth.time, p_WB=_quantised(p, self.resolution), noise=state.noise.stated)

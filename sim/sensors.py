"""Sensors of the plant, each with its rate, delay, noise, bias and quantisation beside it. Truth in, messages out."""

from dataclasses import dataclass, field

import numba
import numpy as np

from sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    TorqueMeasurement,
    VisionMeasurement,
)
from sim.interfaces.spatial import GRAVITY, Array
from sim.plant import Truth

_BLOCK = 8192  # normal numbers drawn at a time: one by one they cost more than the sensor


@dataclass(slots=True, eq=False)
class SensorState:
    """Random stream of one sensor, with the bias drawn for this run."""

    rng: np.random.Generator
    bias: Array
    drawn: Array = field(default_factory=lambda: np.zeros(0))
    used: int = 0

    def normal(self, count: int) -> Array:
        """The next `count` standard normal numbers of the stream."""
        if self.used + count > len(self.drawn):
            self.drawn, self.used = self.rng.standard_normal(max(_BLOCK, count)), 0
        self.used += count
        return self.drawn[self.used - count : self.used]


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoders:
    """Joint encoders: quantised angle, and speed from the drive."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    resolution: float = 2.0 * np.pi / 2**19  # [rad] 19 bits a turn
    rate_noise: float = 2e-4  # [rad/s] white, per sample

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, np.zeros(0))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, EncoderMeasurement]:
        q, qd = _encode(truth.q, truth.qd, state.normal(len(truth.q)), self.resolution, self.rate_noise)
        return state, EncoderMeasurement(time=truth.time, q=q, qd=qd)


@numba.njit(cache=True)
def _encode(q, qd, noise, resolution, rate_noise):
    return np.round(q / resolution) * resolution, qd + rate_noise * noise


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTorqueSensors:
    """One-component torque sensors on the gear outputs (paper 002)."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    noise: float = 0.01  # white, share of the reading, per sample
    bias: float = 0.3  # [N m] constant over a run, uniform in +-bias

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, rng.uniform(-self.bias, self.bias, 64))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, TorqueMeasurement]:
        tau = _transmitted(
            truth.tau_drive, truth.armature, truth.qdd, truth.joint_damping, truth.qd, state.normal(len(truth.q)),
            self.noise, state.bias,
        )  # fmt: skip
        return state, TorqueMeasurement(time=truth.time, tau=tau)


@numba.njit(cache=True)
def _transmitted(tau_drive, armature, qdd, damping, qd, noise, share, bias):
    """What passes through the gear outputs (the drive's, less rotor inertia and gear friction), with its errors."""
    true = tau_drive - armature * qdd - damping * qd
    return true * (1.0 + share * noise) + bias[: len(true)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Imu:
    """Accelerations, rates and attitude at the hull's origin: a navigation unit with fibre-optic gyros."""

    period: float = 0.002  # [s]
    delay: float = 0.0  # [s]
    acceleration_noise: float = 2e-3  # [m/s^2] white, per sample: 9 ug per root Hz, a quartz accelerometer
    acceleration_bias: float = 0.005  # [m/s^2] constant over a run, standard deviation
    rate_noise: float = 2e-4  # [rad/s] white, per sample
    attitude_noise: float = 5e-5  # [rad] white, per sample
    attitude_bias: float = 3e-4  # [rad] constant over a run, standard deviation

    def init(self, rng: np.random.Generator) -> SensorState:
        bias = rng.standard_normal(6)
        return SensorState(rng, np.concatenate([self.acceleration_bias * bias[:3], self.attitude_bias * bias[3:]]))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, ImuMeasurement]:
        force_B, w_B, R = _inertial(
            truth.R_WB, truth.acceleration, truth.w_WB_B, state.bias, state.normal(9), self.acceleration_noise,
            self.rate_noise, self.attitude_noise,
        )  # fmt: skip
        return state, ImuMeasurement(time=truth.time, specific_force_B=force_B, w_WB_B=w_B, R_WB=R)


@numba.njit(cache=True)
def _inertial(R_WB, acceleration, w_B, bias, noise, acceleration_noise, rate_noise, attitude_noise):
    """Specific force, rates and attitude with their errors; the attitude's error turns about hull axes."""
    force_B, w, phi = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        force_B[i] = bias[i] + acceleration_noise * noise[i]
        for j in range(3):
            force_B[i] += R_WB[j, i] * (acceleration[j] + (GRAVITY if j == 2 else 0.0))
        w[i] = w_B[i] + rate_noise * noise[3 + i]
        phi[i] = bias[3 + i] + attitude_noise * noise[6 + i]
    # Second order in the error, which is below a milliradian: 1e-10 from a rotation, far below the noise.
    S = np.array([[0.0, -phi[2], phi[1]], [phi[2], 0.0, -phi[0]], [-phi[1], phi[0], 0.0]])
    return force_B, w, R_WB @ (np.eye(3) + S + 0.5 * S @ S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dvl:
    """Doppler log: velocity over ground in hull axes."""

    period: float = 0.1  # [s]
    delay: float = 0.0  # [s]
    noise: float = 3e-3  # [m/s] white, per sample

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, np.zeros(0))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, DvlMeasurement]:
        v = truth.R_WB.T @ truth.v_WB_W + self.noise * state.normal(3)
        return state, DvlMeasurement(time=truth.time, v_WB_B=v)


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionDrift:
    """Position of the hull against the scene from the cameras: slow, late and noisy."""

    period: float = 0.1  # [s]
    delay: float = 0.1  # [s]
    noise: float = 2e-3  # [m] white, per sample

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, np.zeros(0))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, VisionMeasurement]:
        return state, VisionMeasurement(time=truth.time, p_WB=truth.p_WB + self.noise * state.normal(3))

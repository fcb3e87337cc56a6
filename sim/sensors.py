"""Sensors of the plant, each with its rate, delay, noise, bias and quantisation beside it. Truth in, messages out."""

from dataclasses import dataclass

import numpy as np

from sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    TorqueMeasurement,
    VisionMeasurement,
)
from sim.interfaces.spatial import GRAVITY, Array, exp_so3
from sim.plant import Truth

_GRAVITY_W = np.array([0.0, 0.0, -GRAVITY])


@dataclass(frozen=True, slots=True, eq=False)
class SensorState:
    """Random stream of one sensor, with the bias drawn for this run."""

    rng: np.random.Generator
    bias: Array


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
        q = np.round(truth.q / self.resolution) * self.resolution
        qd = truth.qd + self.rate_noise * state.rng.standard_normal(len(q))
        return state, EncoderMeasurement(time=truth.time, q=q, qd=qd)


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
        true = truth.tau_gear()
        tau = true * (1.0 + self.noise * state.rng.standard_normal(len(true))) + state.bias[: len(true)]
        return state, TorqueMeasurement(time=truth.time, tau=tau)


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
        bias = np.concatenate([self.acceleration_bias * rng.standard_normal(3), self.attitude_bias * rng.standard_normal(3)])
        return SensorState(rng, bias)

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, ImuMeasurement]:
        noise = state.rng.standard_normal(9)
        R_BW = truth.R_WB.T
        force = R_BW @ (truth.acceleration[:3] - _GRAVITY_W) + state.bias[:3] + self.acceleration_noise * noise[:3]
        return state, ImuMeasurement(
            time=truth.time,
            specific_force_B=force,
            w_WB_B=truth.w_WB_B + self.rate_noise * noise[3:6],
            R_WB=truth.R_WB @ exp_so3(state.bias[3:] + self.attitude_noise * noise[6:]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Dvl:
    """Doppler log: velocity over ground in hull axes."""

    period: float = 0.1  # [s]
    delay: float = 0.0  # [s]
    noise: float = 3e-3  # [m/s] white, per sample

    def init(self, rng: np.random.Generator) -> SensorState:
        return SensorState(rng, np.zeros(0))

    def step(self, state: SensorState, truth: Truth) -> tuple[SensorState, DvlMeasurement]:
        v = truth.R_WB.T @ truth.v_WB_W + self.noise * state.rng.standard_normal(3)
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
        return state, VisionMeasurement(time=truth.time, p_WB=truth.p_WB + self.noise * state.rng.standard_normal(3))

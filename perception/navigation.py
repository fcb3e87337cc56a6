"""The vehicle's own state from IMU, DVL, late vision, encoders and torque sensors: a small documented filter.

Position, velocity and accelerometer bias are one Kalman filter of three states per world axis, equal for the three
axes, driven by the accelerometer at the IMU's rate. Vision arrives late: it is compared with the position that the
filter had when the picture was taken, and the correction also moves the stored past, so that two pictures that are
on their way together do not correct the same error twice. Attitude follows the gyro and leans slowly to the
attitude reference.

What matters to a tool in contact is smoothness: on a surface of 3e4 N/m a jump of 0.2 mm is 6 N. So corrections are
not handed on at once: each is held back and released over `release_time`, while the filter itself has it at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.kernels import keyed_by_imports
from sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    StateEstimate,
    TorqueMeasurement,
    VisionMeasurement,
)
from sim.interfaces.spatial import GRAVITY, Array

_HISTORY = 256  # past positions kept, at the IMU's rate: vision may be this many periods late


@numba.njit(cache=True)
@keyed_by_imports
def _predict(dt, specific_force_B, w_B, R_meas, noise, lean_time, smooth_time, release_time, R, x, P, a_B, held):
    """Advance R (3, 3), x (3 states, 3 axes), P (3, 3), smoothed acceleration a_B (3,) and `held` by one IMU sample.

    `noise`: of the acceleration per sample [m/s^2], of the bias per root second [m/s^2].
    """
    lean, smooth = min(1.0, dt / lean_time), min(1.0, dt / smooth_time)
    held *= np.exp(-dt / release_time)
    # Attitude: gyro, then a small step towards the measured attitude.
    angle = np.empty(3)
    err = np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        total = 0.0
        for m in range(3):  # vee of the antisymmetric part of R^T R_meas: small-angle error in body axes
            total += 0.5 * (R[m, k] * R_meas[m, j] - R[m, j] * R_meas[m, k])
        err[i] = total
        angle[i] = w_B[i] * dt + lean * (err[i] - w_B[i] * dt)  # R is that of the last sample, R_meas of this one
    theta = np.sqrt(angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2)
    s = 1.0 - theta * theta / 6.0 if theta < 1e-4 else np.sin(theta) / theta
    c = 0.5 - theta * theta / 24.0 if theta < 1e-4 else (1.0 - np.cos(theta)) / theta**2
    S = np.array([[0.0, -angle[2], angle[1]], [angle[2], 0.0, -angle[0]], [-angle[1], angle[0], 0.0]])
    new = R @ (np.eye(3) + s * S + c * (S @ S))
    new = 1.5 * new - 0.5 * new @ (new.T @ new)  # one Newton step keeps it orthonormal
    R[:, :] = new
    a_W = R @ specific_force_B
    a_W[2] -= GRAVITY
    for i in range(3):
        a = a_W[i] - x[2, i]
        x[0, i] += dt * x[1, i] + 0.5 * dt * dt * a
        x[1, i] += dt * a
        a_W[i] = a
    fresh = R.T @ a_W
    for i in range(3):
        a_B[i] += smooth * (fresh[i] - a_B[i])
    F = np.array([[1.0, dt, -0.5 * dt * dt], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    P[:, :] = F @ P @ F.T.copy()
    v = (noise[0] * dt) ** 2
    P[0, 0] += 0.25 * v * dt * dt
    P[1, 1] += v
    P[2, 2] += noise[1] ** 2 * dt


@numba.njit(cache=True)
@keyed_by_imports
def _output(R, x, held):
    """Pose (4, 4) and velocity (3,) in hull axes that are handed on."""
    X_WB, v_B = np.eye(4), np.zeros(3)
    for i in range(3):
        for j in range(3):
            X_WB[i, j] = R[i, j]
            v_B[i] += R[j, i] * (x[1, j] - held[1, j])
        X_WB[i, 3] = x[0, i] - held[0, i]
    return X_WB, v_B


@numba.njit(cache=True)
@keyed_by_imports
def _update(P, row, variance, gain):
    """Kalman gain (3,) for a scalar measurement of state `row`, and the covariance after it."""
    s = P[row, row] + variance
    for i in range(3):
        gain[i] = P[i, row] / s
    keep = P[row].copy()
    for i in range(3):
        for j in range(3):
            P[i, j] -= gain[i] * keep[j]


@dataclass(slots=True, eq=False)
class NavigationState:
    """Memory of the filter. Arrays are owned by it and change in place."""

    time: float
    R_WB: Array  # (3, 3)
    x: Array  # (3, 3) rows: position [m], velocity [m/s], acceleration bias [m/s^2]; columns: world axes
    P: Array  # (3, 3) covariance, the same for each axis
    held: Array  # (2, 3) corrections of position and velocity not yet handed on [m, m/s]
    a_B: Array  # (3,) smoothed acceleration [m/s^2]
    w_B: Array  # (3,) [rad/s]
    past_time: Array  # (_HISTORY,) [s]
    past_p: Array  # (_HISTORY, 3) [m]
    at: int  # next row of the history
    q: Array
    qd: Array
    tau: Array
    gain: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """Estimator (`sim.interfaces.protocols.Estimator`); the figures are what the filter believes of its sensors."""

    period: float = 0.002  # [s]
    acceleration_noise: float = 2.5e-3  # [m/s^2] white, per IMU sample
    bias: float = 7e-3  # [m/s^2] at the start, the tilt of the attitude reference included
    bias_walk: float = 2e-5  # [m/s^2] per square root of second
    dvl_noise: float = 3e-3  # [m/s]
    vision_noise: float = 2e-3  # [m]
    release_time: float = 0.4  # [s] over which a correction is handed on
    attitude_time: float = 1.0  # [s] over which attitude leans to the reference
    acceleration_time: float = 0.02  # [s] smoothing of the acceleration handed on

    def init(self, first: Sequence[Measurement]) -> NavigationState:
        """Start at rest from the first measurements of every sensor.

        Raises ConfigurationError if an IMU, a vision, an encoder or a torque measurement is not among them.
        """
        by_type = {type(m): m for m in first}
        try:
            imu, vision = by_type[ImuMeasurement], by_type[VisionMeasurement]
            encoders, torque = by_type[EncoderMeasurement], by_type[TorqueMeasurement]
        except KeyError as missing:
            raise ConfigurationError(f"navigation needs a first {missing.args[0].__name__}") from None
        assert isinstance(imu, ImuMeasurement)
        assert isinstance(vision, VisionMeasurement)
        assert isinstance(encoders, EncoderMeasurement)
        assert isinstance(torque, TorqueMeasurement)
        x = np.zeros((3, 3))
        x[0] = vision.p_WB
        return NavigationState(
            time=imu.time,
            R_WB=np.array(imu.R_WB),
            x=x,
            P=np.diag([self.vision_noise**2, 0.02**2, self.bias**2]),
            held=np.zeros((2, 3)),
            a_B=np.zeros(3),
            w_B=np.array(imu.w_WB_B),
            past_time=np.full(_HISTORY, -np.inf),
            past_p=np.zeros((_HISTORY, 3)),
            at=0,
            q=encoders.q,
            qd=encoders.qd,
            tau=torque.tau,
            gain=np.empty(3),
        )

    def step(
        self, state: NavigationState, measurements: Sequence[Measurement]
    ) -> tuple[NavigationState, StateEstimate]:
        """Take what has arrived, in any order, and give the estimate of now."""
        for m in measurements:  # the frequent ones first
            if isinstance(m, EncoderMeasurement):
                state.q, state.qd = m.q, m.qd
            elif isinstance(m, TorqueMeasurement):
                state.tau = m.tau
            elif isinstance(m, ImuMeasurement):
                self._inertial(state, m)
            elif isinstance(m, DvlMeasurement):
                _update(state.P, 1, self.dvl_noise**2, state.gain)
                error = state.R_WB @ m.v_WB_B - state.x[1]
                self._correct(state, error)
            elif isinstance(m, VisionMeasurement):
                then = np.argmin(np.abs(state.past_time - m.time))
                if abs(state.past_time[then] - m.time) > self.period:
                    continue  # older than the history: of no use
                _update(state.P, 0, self.vision_noise**2, state.gain)
                self._correct(state, m.p_WB - state.past_p[then])
        X_WB, v_B = _output(state.R_WB, state.x, state.held)
        return state, StateEstimate(
            time=state.time,
            X_WB=X_WB,
            v_WB_B=v_B,
            w_WB_B=state.w_B,
            a_WB_B=state.a_B.copy(),
            q=state.q,
            qd=state.qd,
            tau=state.tau,
        )

    def _inertial(self, state: NavigationState, m: ImuMeasurement) -> None:
        dt = m.time - state.time
        if dt > 0.0:
            _predict(
                dt, m.specific_force_B, m.w_WB_B, m.R_WB, (self.acceleration_noise, self.bias_walk), self.attitude_time,
                self.acceleration_time, self.release_time, state.R_WB, state.x, state.P, state.a_B, state.held,
            )  # fmt: skip
        state.time, state.w_B = m.time, m.w_WB_B
        state.past_time[state.at] = m.time
        state.past_p[state.at] = state.x[0]
        state.at = (state.at + 1) % _HISTORY

    @staticmethod
    def _correct(state: NavigationState, error: Array) -> None:
        state.x += np.outer(state.gain, error)
        state.held += np.outer(state.gain[:2], error)
        state.past_p += state.gain[0] * error

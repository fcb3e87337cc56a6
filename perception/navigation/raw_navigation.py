"""Navigation without fusion, each state from its own sensor: the baseline of `strapdown_filter`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuv.perception.navigation.first_measurements import first_of
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    StateEstimate,
    TorqueMeasurement,
    VisionMeasurement,
)
from uuv.sim.interfaces.spatial import GRAVITY, Array


@dataclass(slots=True, eq=False)
class RawState:
    """Last measurement of each sensor."""

    imu: ImuMeasurement
    vision: VisionMeasurement
    encoders: EncoderMeasurement
    torque: TorqueMeasurement
    v_WB_B: Array  # (3,) [m/s] of the DVL; zero before its first measurement


@dataclass(frozen=True, slots=True, kw_only=True)
class RawNavigation:
    """Estimator without fusion: the position is that of the last vision message, with its delay.

    Implements `uuv.sim.interfaces.protocols.Estimator`.
    """

    period: float = 0.002  # [s]

    def init(self, first: Sequence[Measurement]) -> RawState:
        """Initial state from the first measurements.

        Raises:
            ConfigurationError: `first` lacks an IMU, vision, encoder or torque measurement.
        """
        imu = first_of(ImuMeasurement, first)
        vision = first_of(VisionMeasurement, first)
        encoders = first_of(EncoderMeasurement, first)
        torque = first_of(TorqueMeasurement, first)

        return RawState(imu, vision, encoders, torque, np.zeros(3))

    def step(
        self, state: RawState, measurements: Sequence[Measurement]
    ) -> tuple[RawState, StateEstimate]:
        """Store the latest measurements and return them as the state estimate."""
        for m in measurements:
            if isinstance(m, ImuMeasurement):
                state.imu = m
            elif isinstance(m, VisionMeasurement):
                state.vision = m
            elif isinstance(m, EncoderMeasurement):
                state.encoders = m
            elif isinstance(m, TorqueMeasurement):
                state.torque = m
            elif isinstance(m, DvlMeasurement):
                state.v_WB_B = m.v_WB_B

        R_WB = state.imu.R_WB
        X_WB = np.eye(4)
        X_WB[:3, :3], X_WB[:3, 3] = R_WB, state.vision.p_WB
        return state, StateEstimate(
            time=state.imu.time,
            X_WB=X_WB,
            v_WB_B=state.v_WB_B,
            w_WB_B=state.imu.w_WB_B,
            a_WB_B=state.imu.specific_force_B - GRAVITY * R_WB[2],
            q=state.encoders.q,
            qd=state.encoders.qd,
            tau=state.torque.tau,
        )

"""Navigation without a filter: every figure is the last word of its sensor."""

from dataclasses import replace

import numpy as np
import pytest

from uuv.perception.navigation.raw_navigation import RawNavigation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    TorqueMeasurement,
    VisionMeasurement,
)
from uuv.sim.interfaces.spatial import GRAVITY, exp_so3

R = exp_so3([0.1, -0.2, 0.4])
ENCODERS = EncoderMeasurement(time=0.0, q=np.arange(6.0), qd=np.ones(6))
TORQUE = TorqueMeasurement(time=0.0, tau=np.full(6, 3.0))
IMU = ImuMeasurement(
    time=0.0, specific_force_B=R.T @ [0.3, 0.0, GRAVITY], w_WB_B=np.array([0.0, 0.0, 0.1]), R_WB=R
)
VISION = VisionMeasurement(time=0.0, p_WB=np.array([1.0, 2.0, 3.0]))


def test_position_jumps_to_what_vision_says_however_late():
    raw = RawNavigation()
    state, estimate = raw.step(raw.init([ENCODERS, TORQUE, IMU, VISION]), [])
    assert estimate.X_WB[:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert not estimate.v_WB_B.any()
    late = VisionMeasurement(time=0.1, p_WB=np.array([1.5, 2.0, 3.0]))
    dvl = DvlMeasurement(time=0.29, v_WB_B=np.array([0.2, 0.0, 0.0]))
    state, estimate = raw.step(state, [replace(IMU, time=0.3), late, dvl])
    assert estimate.time == 0.3
    assert estimate.X_WB[:3, 3].tolist() == [1.5, 2.0, 3.0]
    assert estimate.v_WB_B.tolist() == [0.2, 0.0, 0.0]
    assert estimate.q.tolist() == ENCODERS.q.tolist()


def test_acceleration_is_without_gravity(within):
    raw = RawNavigation()
    _, estimate = raw.step(raw.init([ENCODERS, TORQUE, IMU, VISION]), [])
    within("acceleration [m/s^2]", R @ estimate.a_WB_B - [0.3, 0.0, 0.0], 1e-12)


def test_a_missing_sensor_is_named():
    with pytest.raises(ConfigurationError, match="VisionMeasurement"):
        RawNavigation().init([ENCODERS, TORQUE, IMU])

"""Faults made of what the estimate says about its sensors."""

from dataclasses import replace

import numpy as np

from uuv.controllers.safety.sensor_checks import SENSOR_CHECKS, sensor_faults
from uuv.sim.interfaces.messages import Fault, FaultKind, StateEstimate
from uuv.sim.interfaces.spatial import exp_so3


def sound() -> StateEstimate:
    X_WB = np.eye(4)
    X_WB[:3, :3] = exp_so3([0.3, -0.2, 0.9])
    X_WB[:3, 3] = [1.0, 2.0, -8.0]
    three = np.full(3, 0.01)
    six = np.zeros(6)
    return StateEstimate(
        time=12.0, X_WB=X_WB, v_WB_B=three, w_WB_B=three, a_WB_B=three, q=six, qd=six, tau=six
    )


def told(estimate: StateEstimate) -> list[Fault]:
    return list(sensor_faults(estimate))


def test_a_sound_estimate_tells_of_none():
    assert told(sound()) == []


def test_each_axis_of_a_gyro_is_a_fault_of_its_own():
    x, z = told(replace(sound(), gyro_off_B=np.array([0.03, 0.0, -0.3])))
    assert (x.kind, x.part, x.index, x.time) == (FaultKind.GYRO, "x", 0, 12.0)
    assert x.figures == "+1.72 deg/s from the rate of the attitude"
    assert (z.part, z.index, z.figures) == ("z", 2, "-17.19 deg/s from the rate of the attitude")


def test_an_attitude_is_one_fault_with_all_its_axes():
    (fault,) = told(replace(sound(), attitude_off_B=np.array([0.01, 0.0, -0.02])))
    assert (fault.kind, fault.part, fault.index) == (FaultKind.ATTITUDE, "", -1)
    assert fault.figures == (
        "leaves the integral of the rate by +0.57 deg about x, -1.15 deg about z"
    )


def test_where_it_may_be_either_both_say_so():
    gyro, attitude = told(
        replace(sound(), gyro_off_B=np.eye(3)[1] * 0.01, attitude_off_B=np.eye(3)[1] * 0.001)
    )
    assert gyro.figures.endswith("unless the attitude drifts")
    assert attitude.figures.endswith("unless the gyro does")


def test_an_attitude_that_is_no_rotation_is_said_to_be_none():
    (fault,) = told(replace(sound(), attitude_off_B=np.full(3, np.nan)))
    assert fault.figures == "no rotation"


def test_the_accelerometer_is_named_at_the_time_of_its_jump():
    (fault,) = told(replace(sound(), imu_jump_age=0.5))
    assert (fault.kind, fault.part, fault.time) == (FaultKind.IMU, "accelerometer", 11.5)


def test_each_kind_has_one_row():
    kinds = [check.kind for check in SENSOR_CHECKS]
    assert len(set(kinds)) == len(kinds)

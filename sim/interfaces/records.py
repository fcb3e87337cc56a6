"""Records of arrays that sensors and estimator write in place at the rate of the loop; messages are made of copies.

Compiled functions take these records as they are. The arrays stay the same over a run, only their contents change.
"""

import math
from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array


class ImuRecord(NamedTuple):
    """One sample of the inertial unit, fields as in `ImuMeasurement`."""

    time: Array  # (1,) [s]; -inf: no new sample
    specific_force_B: Array  # (3,) [m/s^2]
    w_WB_B: Array  # (3,) [rad/s]
    R_WB: Array  # (3, 3)


class JointRecord(NamedTuple):
    """One sample of encoders and torque sensors, fields as in `EncoderMeasurement` and `TorqueMeasurement`."""

    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]
    tau: Array  # (n,) [N m]


class EstimateRecord(NamedTuple):
    """Estimated state of the vehicle, fields as in `StateEstimate`."""

    time: Array  # (1,) [s]
    X_WB: Array  # (4, 4)
    v_WB_B: Array  # (3,) [m/s]
    w_WB_B: Array  # (3,) [rad/s]
    a_WB_B: Array  # (3,) [m/s^2]
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]
    tau: Array  # (n,) [N m]
    position_sigma: Array  # (3,) [m]
    attitude_sigma: Array  # (1,) [rad]
    ages: Array  # (4,) [s] since the newest vision, DVL and IMU measurement that was used, and since a jump of the IMU
    object_moved_W: Array  # (3,) [m]
    gyro_off_B: Array  # (3,) [rad/s]
    attitude_off_B: Array  # (3,) [rad]


def imu_record() -> ImuRecord:
    """Record without a sample."""
    return ImuRecord(np.full(1, -math.inf), np.zeros(3), np.zeros(3), np.eye(3))


def joint_record(joints: int) -> JointRecord:
    """Record of zeros for so many joints."""
    return JointRecord(np.zeros(joints), np.zeros(joints), np.zeros(joints))


def estimate_record(joints: int) -> EstimateRecord:
    """Record of a vehicle at rest at the origin of the world, with so many joints."""
    v, w, a, sigma, moved, gyro, attitude = np.zeros((7, 3))
    unknown, ages = np.full(1, math.nan), np.zeros(4)
    joint = joint_record(joints)
    return EstimateRecord(np.zeros(1), np.eye(4), v, w, a, *joint, sigma, unknown, ages, moved, gyro, attitude)


def state_estimate(record: EstimateRecord) -> StateEstimate:
    """Message with copies of the arrays of `record`."""
    vision_age, dvl_age, imu_age, imu_jump_age = record.ages.tolist()
    return StateEstimate(
        time=record.time.item(),
        X_WB=record.X_WB.copy(),
        v_WB_B=record.v_WB_B.copy(),
        w_WB_B=record.w_WB_B.copy(),
        a_WB_B=record.a_WB_B.copy(),
        q=record.q.copy(),
        qd=record.qd.copy(),
        tau=record.tau.copy(),
        position_sigma=record.position_sigma.copy(),
        attitude_sigma=record.attitude_sigma.item(),
        vision_age=vision_age,
        dvl_age=dvl_age,
        imu_age=imu_age,
        imu_jump_age=imu_jump_age,
        object_moved_W=record.object_moved_W.copy(),
        gyro_off_B=record.gyro_off_B.copy(),
        attitude_off_B=record.attitude_off_B.copy(),
    )

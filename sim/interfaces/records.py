"""Records of arrays that the loop writes at the rate of the drives; messages contain copies of
them.

Compiled functions take these records directly. The arrays stay the same during a run; only their
contents change.
"""

import math
from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.messages import Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array


class ImuRecord(NamedTuple):
    """One sample of the inertial unit, fields as in `ImuMeasurement`."""

    time: Array  # (1,) [s]; -inf: no new sample
    specific_force_B: Array  # (3,) [m/s^2]
    w_WB_B: Array  # (3,) [rad/s]
    R_WB: Array  # (3, 3)


class JointRecord(NamedTuple):
    """One sample of encoders and torque sensors, fields as in `EncoderMeasurement` and
    `TorqueMeasurement`.
    """

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
    # (4,) [s] since the newest vision, DVL and IMU measurement that was used, and since a jump of
    # the IMU's bias
    ages: Array
    object_moved_W: Array  # (3,) [m]
    gyro_off_B: Array  # (3,) [rad/s]
    attitude_off_B: Array  # (3,) [rad]
    tau_doubt: Array  # (n,) [N m]; zeros: none


class ReferenceRecord(NamedTuple):
    """Fields of `Reference` that the drives follow."""

    time: Array  # (1,) [s]
    X_WB: Array  # (4, 4) hull pose to hold
    v_WB_W: Array  # (3,) [m/s] its velocity
    w_WB_W: Array  # (3,) [rad/s] its angular velocity
    X_WG: Array  # (4, 4) tool pose to follow
    v_WG_W: Array  # (3,) [m/s]
    w_WG_W: Array  # (3,) [rad/s]
    q: Array  # (n,) [rad] joint angles to hold
    qd: Array  # (n,) [rad/s]
    set_force: Array  # (1,) [N] normal force to press with
    flags: np.ndarray  # (6,) bool, entries from FOLLOWS to IN_CONTACT


# Entries of `ReferenceRecord.flags`: whether a tool pose is followed, and the fields of these names
FOLLOWS, CONTROLLED, TARE, COMPLIANT, STANDING, IN_CONTACT = range(6)


def imu_record() -> ImuRecord:
    """Record without a sample."""
    return ImuRecord(np.full(1, -math.inf), np.zeros(3), np.zeros(3), np.eye(3))


def joint_record(joints: int) -> JointRecord:
    """Record of zeros for `joints` joints."""
    return JointRecord(np.zeros(joints), np.zeros(joints), np.zeros(joints))


def estimate_record(joints: int) -> EstimateRecord:
    """Record of a vehicle with `joints` joints at rest at the origin of the world."""
    v, w, a, sigma, moved, gyro, attitude = np.zeros((7, 3))
    unknown = np.full(1, math.nan)
    ages = np.zeros(4)
    joint = joint_record(joints)
    off = gyro, attitude, np.zeros(joints)
    beside = sigma, unknown, ages, moved, *off
    return EstimateRecord(np.zeros(1), np.eye(4), v, w, a, *joint, *beside)


def reference_record(joints: int) -> ReferenceRecord:
    """Record for `joints` joints, to be filled by `take_reference`."""
    return ReferenceRecord(
        time=np.zeros(1),
        X_WB=np.eye(4),
        v_WB_W=np.zeros(3),
        w_WB_W=np.zeros(3),
        X_WG=np.eye(4),
        v_WG_W=np.zeros(3),
        w_WG_W=np.zeros(3),
        q=np.zeros(joints),
        qd=np.zeros(joints),
        set_force=np.zeros(1),
        flags=np.zeros(6, np.bool_),
    )


def take_estimate(record: EstimateRecord, estimate: StateEstimate) -> None:
    """Write the fields of a message into `record`."""
    e = estimate
    record.time[0] = e.time
    record.attitude_sigma[0] = e.attitude_sigma
    record.ages[:] = e.vision_age, e.dvl_age, e.imu_age, e.imu_jump_age
    record.tau_doubt[:] = 0.0 if e.tau_doubt is None else e.tau_doubt

    # Arrays that have the same names in both.
    for name in _ARRAYS:
        getattr(record, name)[:] = getattr(e, name)


_OTHER = "time", "attitude_sigma", "ages", "tau_doubt"
_ARRAYS = tuple(name for name in EstimateRecord._fields if name not in _OTHER)


def take_reference(record: ReferenceRecord, reference: Reference) -> None:
    """Write the set points of a message into `record`."""
    r = reference
    record.time[0] = r.time
    follows = r.X_WG is not None
    record.flags[:] = follows, r.force_control, r.tare, r.compliant, r.standing, r.in_contact

    # Hull.
    record.X_WB[:] = r.X_WB
    record.v_WB_W[:] = r.v_WB_W
    record.w_WB_W[:] = r.w_WB_W

    # Tool.
    if r.X_WG is not None:
        record.X_WG[:] = r.X_WG
    record.v_WG_W[:] = r.v_WG_W
    record.w_WG_W[:] = r.w_WG_W
    record.set_force[0] = r.set_force

    # Joints.
    record.q[:] = r.q
    record.qd[:] = r.qd


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
        tau_doubt=record.tau_doubt.copy() if np.count_nonzero(record.tau_doubt) else None,
    )

"""Residuals of torque sensors and encoders on single samples made by hand."""

import numpy as np
import pytest

from uuv.controllers.safety.joint_residuals import (
    JointResidualModel,
    JointResiduals,
    update_residuals,
)
from uuv.sim.interfaces.spatial import Array

DT = 0.002  # [s]
MODEL = JointResidualModel(
    armature=np.array([0.05, 0.0]),
    damping=np.array([3.0, 2.0]),
    floor=np.array([1.0, 2.0]),
    share=0.1,
    period=DT,
    torque_time=DT,  # no lag
    encoder_time=10.0,
    learning_time=1e9,  # nothing is learnt in these few samples
)


def stepped(q: Array, qd: Array, tau: Array, motor: Array, *, warm: bool = True) -> JointResiduals:
    """Residuals after the samples (k, 2) of angles, speeds, torques and commands of the motors."""
    residuals = JointResiduals.start(q[0], qd[0], tau[0])
    for k in range(1, len(tau)):
        residuals.tau_motor[:] = motor[k - 1]
        update_residuals(tuple(MODEL), (q[k], qd[k], tau[k]), DT * k, warm, tuple(residuals))
    return residuals


def test_a_gear_passes_the_motor_less_rotor_and_viscous_friction():
    """A joint that speeds up evenly and one that turns evenly: the sensors read just what is
    left.
    """
    time = DT * np.arange(20, dtype=np.float64)
    rate = np.array([4.0, 0.0])  # [rad/s^2]
    qd = np.array([0.1, -0.6]) + np.outer(time, rate)
    q = np.cumsum(DT * qd, axis=0)
    motor = np.tile([7.0, -5.0], (20, 1))
    tau = motor - MODEL.armature * rate - MODEL.damping * qd
    residuals = stepped(q, qd, tau, motor)
    assert residuals.excess == pytest.approx([0.0, 0.0], abs=1e-9)
    assert stepped(q, qd, np.add(tau, [0.0, 1.5]), motor).excess == pytest.approx(
        [0.0, 1.5], abs=1e-9
    )


def test_only_a_torque_that_stays_beyond_its_bound_adds_up():
    """Bounds of 1 N m and a tenth of the reading: every other sample beyond, and the last four."""
    k = np.arange(41)
    beyond = (k % 2 == 1) | (k >= 37)
    still, motor = np.zeros((41, 2)), np.zeros((41, 2))
    tau = np.column_stack([np.where(beyond, 1.2, 0.0), np.full(41, 0.3)])
    assert stepped(still, still, tau[:40], motor[:40]).beyond == pytest.approx([3 * DT, 0.0])
    assert stepped(still, still, tau[:36], motor[:36]).beyond == pytest.approx([DT, 0.0])
    assert stepped(still, still, tau[:35], motor[:35]).beyond == pytest.approx([0.0, 0.0])

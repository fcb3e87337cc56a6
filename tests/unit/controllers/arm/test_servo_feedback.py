"""The servo's feedback as matrices, against the servo itself."""

import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.joint_servo import (
    BorneLoad,
    JointServo,
    JointTarget,
    SeenArm,
    SoftAxis,
    hull_compensation,
    servo_feedback,
    servo_joints,
)
from uuv.controllers.tuning import DRIVE_PERIOD, ArmTuning
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import exp_so3, pose


@pytest.mark.parametrize("softness", [0.0, 0.7])
def test_the_torques_change_by_stiffness_and_damping(softness, within):
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    arm = ArmDynamics(model)
    servo = JointServo(vehicle, ArmTuning(), DRIVE_PERIOD)
    rng = np.random.default_rng(7)
    n = vehicle.joints.size
    q = np.array(vehicle.q_home) + 0.2 * rng.normal(size=n)
    soft = SoftAxis(rng.normal(size=(2, n)) / n, softness)
    hull = np.concatenate([np.eye(3).ravel(), np.zeros(15)])

    def torques(q_seen, qd_seen):
        return servo_joints(
            tuple(arm.parameters),
            tuple(servo.drives._replace(limits=np.full(n, np.inf))),
            tuple(SeenArm(q_seen, qd_seen, hull)),
            tuple(JointTarget(q, np.zeros(n), np.zeros(n), 0.0)),
            tuple(soft),
            tuple(BorneLoad(np.zeros(6), np.zeros(n))),
            np.zeros(n),
        )

    stiffness, damping = servo_feedback(arm, servo.drives, q, soft)
    still = np.zeros(n)
    step = 1e-6
    for j, unit in enumerate(np.eye(n)):
        # Gravity and drag, which the drives compensate at once anyway, are not of the feedback.
        by_angle = (torques(q - step * unit, still) - torques(q + step * unit, still)) / (2 * step)
        by_speed = (torques(q, still - step * unit) - torques(q, still + step * unit)) / (2 * step)
        within("stiffness", (by_angle - stiffness[:, j]) / np.abs(stiffness).max(), 0.01)
        within("damping", (by_speed - damping[:, j]) / np.abs(damping).max(), 3e-8)


def test_the_joints_keep_the_tool_at_rest_while_the_hull_moves(within):
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    arm = ArmDynamics(model)
    rng = np.random.default_rng(8)
    q = np.array(vehicle.q_home) + 0.2 * rng.normal(size=vehicle.joints.size)
    X_BG, J_B = arm.tip(q)
    C = hull_compensation(X_BG, J_B)

    step = 1e-4
    moved_B = step * rng.normal(size=6)
    X_WB = pose(exp_so3(moved_B[3:]), moved_B[:3])
    off = X_WB @ arm.tip(q + C @ moved_B)[0] - X_BG
    within("tool moved, over the hull's motion", off / step, 2e-2)  # measured 2e-3

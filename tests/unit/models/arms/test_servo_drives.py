"""A serial arm on proportional drives: the same kinematics as its chain, and the static error of
each drive.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from uuv.controllers.mkps import Chain
from uuv.models.arms.published_arms import SERVO_ARM
from uuv.models.arms.servo_drives import Servo, rest, servo_model, tip_pose
from uuv.sim.interfaces.errors import ConfigurationError

UP = (0.0, 1.0, 0.0)


def test_tip_is_that_of_the_chain(rng: np.random.Generator) -> None:
    model = servo_model(SERVO_ARM, Servo(), UP)
    chain = Chain.from_vectors(SERVO_ARM.M, SERVO_ARM.e, SERVO_ARM.p, SERVO_ARM.L)
    # axes of the chain's tip
    X_tip = tip_pose(model, np.zeros(8))[:3, :3].T @ chain.forward(np.zeros(8))[:3, :3]
    for q in rng.uniform(-1.0, 1.0, (5, 8)):
        X = tip_pose(model, q)
        expected = chain.forward(q)
        np.testing.assert_allclose(X[:3, 3], expected[:3, 3], atol=1e-12)
        np.testing.assert_allclose(X[:3, :3] @ X_tip, expected[:3, :3], atol=1e-12)


def test_each_drive_rests_beside_its_angle_by_the_weight_over_its_stiffness(
    rng: np.random.Generator,
) -> None:
    servo = Servo()
    model = servo_model(SERVO_ARM, servo, UP)
    data = mujoco.MjData(model)
    for q in rng.uniform(-1.0, 1.0, (5, 8)):
        data.qpos[:] = q_rest = rest(model, q)
        mujoco.mj_forward(model, data)
        weight = data.qfrc_bias  # [N m] at rest
        np.testing.assert_allclose(q_rest - q, -weight / servo.stiffness, atol=1e-5)
        assert np.abs(q_rest - q).max() > 0.01


def test_stiffer_drives_come_closer() -> None:
    q = np.full(8, 0.5)
    soft, stiff = (rest(servo_model(SERVO_ARM, Servo(stiffness=k), UP), q) for k in (10.0, 100.0))
    assert np.abs(stiff - q).max() < 0.2 * np.abs(soft - q).max()


def test_hanging_straight_down_costs_nothing() -> None:
    np.testing.assert_allclose(
        rest(servo_model(SERVO_ARM, Servo(), UP), np.zeros(8)), 0.0, atol=1e-9
    )


def test_slides_are_refused() -> None:
    slide = replace(SERVO_ARM, p=np.zeros(8))
    with pytest.raises(ConfigurationError, match="every joint must be a hinge"):
        servo_model(slide, Servo(), UP)

"""The arms' tables against figures that their makers publish, and their frames against MuJoCo."""

import mujoco
import numpy as np
import pytest

from controllers.mkps import Chain
from models.arms import published_arms as arms
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import pose, quat_wxyz_from_rotation


@pytest.mark.parametrize(
    ("name", "q_deg", "tip"),
    [
        ("puma560", [0, 0, 0, 0, 0, 0], [0.4521, -0.15005, 1.10363]),  # Corke's "zero angle" posture
        ("ur5", [0, 0, 0, 0, 0, 0], [-0.81725, -0.19145, -0.005491]),  # stretched out along -x
        ("ur10e", [0, -90, 0, -90, 0, 0], [0.0, -0.2907, 1.4848]),  # upright: d1 - a2 - a3 + d5, d4 + d6
        ("panda", [0, 0, 0, 0, 0, 0, 0], [0.088, 0.0, 0.926]),  # .333 + .316 + .384 - .107
        ("iiwa7", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0, 1.266]),  # .34 + .4 + .4 + .126
        ("gen3", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0246, -1.1873]),  # its base frame points down
        ("xarm7", [0, 0, 0, 0, 0, 0, 0], [0.206, 0.0, 0.1205]),  # the maker's zero pose
        ("irb140", [0, -90, 0, 0, 0, 0], [0.515, 0.0, 0.712]),  # upright upper arm: .07 + .38 + .065, .352 + .36
        ("era", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0, 11.28]),
    ],
)
def test_tip_stands_where_the_maker_says(name: str, q_deg: list[float], tip: list[float]) -> None:
    np.testing.assert_allclose(arms.load(name).joint_frames(np.radians(q_deg))[-1, :3, 3], tip, atol=1e-5)


@pytest.mark.parametrize("name", arms.available())
def test_frames_are_those_of_a_mujoco_model(name: str) -> None:
    """Each joint's frame as a body of MuJoCo's, which turns it; and the tip as the solver's chain has it."""
    arm = arms.load(name)
    spec = mujoco.MjSpec()
    body = spec.worldbody
    *joints, _ = arm.origins()
    for X, kind in zip(joints, arm.joint_types, strict=True):
        body = body.add_body(pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3]))
        slide = kind == "p"
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        body.add_geom(size=[0.01, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    q = np.random.default_rng(4).uniform(-1.0, 1.0, arm.n)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    frames = arm.joint_frames(q)
    for i in range(arm.n):
        X_mujoco = pose(data.xmat[i + 1].reshape(3, 3), data.xpos[i + 1])
        np.testing.assert_allclose(frames[i], X_mujoco, atol=1e-13)  # measured 2e-15
    np.testing.assert_allclose(frames[-1], Chain.from_arm(arm).forward(q), atol=1e-13)


@pytest.mark.parametrize("name", arms.available())
def test_tables_are_whole(name: str) -> None:
    arm = arms.load(name)
    assert arm.dh.shape == (arm.n, 4)
    assert arm.limits.shape == (arm.n, 2)
    assert np.all(arm.limits[:, 0] < arm.limits[:, 1])
    assert len(arm.source) > 10
    assert not any(array.flags.writeable for array in (arm.dh, arm.limits, arm.X_n_flange))


def test_the_european_arm_is_the_same_from_both_ends() -> None:
    """It walks end over end: turned round, its lengths and kinds of joints are the same."""
    points = arms.load("era").joint_frames(np.zeros(7))[:, :3, 3]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(np.sort(lengths[lengths > 0.0]), [0.34, 0.34, 1.228, 1.228, 4.072, 4.072], atol=1e-12)


def test_the_servo_arm_hangs_straight_down() -> None:
    arm = arms.SERVO_ARM
    chain = Chain.from_vectors(arm.M, arm.e, arm.p, arm.L)
    assert chain.n == 8
    np.testing.assert_allclose(chain.forward(np.zeros(8))[:3, 3], [0.0, -0.53, 0.0], atol=1e-12)


def test_an_unknown_arm_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match=r"unknown arm 'puma'; there are .*era.*puma560"):
        arms.load("puma")
    with pytest.raises(ConfigurationError, match="q: expected shape"):
        arms.load("panda").joint_frames(np.zeros(6))

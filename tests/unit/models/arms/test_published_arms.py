"""The arms' tables against figures that their makers publish, and their frames against MuJoCo."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize

from uuv.controllers.mkps import Chain
from uuv.models.arms import published_arms
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, quat_wxyz_from_rotation


@pytest.mark.parametrize(
    ("name", "q_deg", "tip"),
    [
        # Corke's "zero angle" posture
        ("puma560", [0, 0, 0, 0, 0, 0], [0.4521, -0.15005, 1.10363]),
        ("ur5", [0, 0, 0, 0, 0, 0], [-0.81725, -0.19145, -0.005491]),  # stretched out along -x
        # upright: d1 - a2 - a3 + d5, d4 + d6
        ("ur10e", [0, -90, 0, -90, 0, 0], [0.0, -0.2907, 1.4848]),
        ("panda", [0, 0, 0, 0, 0, 0, 0], [0.088, 0.0, 0.926]),  # .333 + .316 + .384 - .107
        ("iiwa7", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0, 1.266]),  # .34 + .4 + .4 + .126
        ("gen3", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0246, -1.1873]),  # its base frame points down
        ("xarm7", [0, 0, 0, 0, 0, 0, 0], [0.206, 0.0, 0.1205]),  # the maker's zero pose
        # upright upper arm: .07 + .38 + .065, .352 + .36
        ("irb140", [0, -90, 0, 0, 0, 0], [0.515, 0.0, 0.712]),
        ("era", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0, 11.28]),
    ],
)
def test_tip_stands_where_the_maker_says(name: str, q_deg: list[float], tip: list[float]) -> None:
    np.testing.assert_allclose(
        published_arms.load(name).joint_frames(np.radians(q_deg))[-1, :3, 3], tip, atol=1e-5
    )


@pytest.mark.parametrize("name", published_arms.available())
def test_frames_are_those_of_a_mujoco_model(name: str) -> None:
    """Each joint's frame as a body of MuJoCo's, which turns it; and the tip as the solver's chain
    has it.
    """
    arm = published_arms.load(name)
    spec = mujoco.MjSpec()
    body = spec.worldbody
    *joints, _ = arm.origins()
    for X, kind in zip(joints, arm.joint_types, strict=True):
        body = body.add_body(pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3]))
        slide = kind == "p"
        body.add_joint(
            type=mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
        )
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


@pytest.mark.parametrize("name", published_arms.available())
def test_tables_are_whole(name: str) -> None:
    arm = published_arms.load(name)
    assert arm.dh.shape == (arm.n, 4)
    assert arm.limits.shape == (arm.n, 2)
    assert np.all(arm.limits[:, 0] < arm.limits[:, 1])
    assert len(arm.source) > 10
    assert not any(array.flags.writeable for array in (arm.dh, arm.limits, arm.X_n_flange))


def test_the_european_arm_is_the_same_from_both_ends() -> None:
    """It walks end over end: turned round, its lengths and kinds of joints are the same."""
    points = published_arms.load("era").joint_frames(np.zeros(7))[:, :3, 3]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(
        np.sort(lengths[lengths > 0.0]), [0.34, 0.34, 1.228, 1.228, 4.072, 4.072], atol=1e-12
    )


def test_the_servo_arm_hangs_straight_down() -> None:
    arm = published_arms.SERVO_ARM
    chain = Chain.from_vectors(arm.M, arm.e, arm.p, arm.L)
    assert chain.n == 8
    np.testing.assert_allclose(chain.forward(np.zeros(8))[:3, 3], [0.0, -0.53, 0.0], atol=1e-12)


def test_an_unknown_arm_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match=r"unknown arm 'puma'; there are .*era.*puma560"):
        published_arms.load("puma")
    with pytest.raises(ConfigurationError, match="q: expected shape"):
        published_arms.load("panda").joint_frames(np.zeros(6))


def stretched(name: str, origin: int, frame: int, level: bool) -> float:
    """Largest distance [m] of a frame's origin from joint axis `origin` + 1, or from the base's
    axis where `level`.
    """
    arm = published_arms.load(name)
    limits = np.clip(arm.limits, -np.pi, np.pi)
    rng = np.random.default_rng(3)

    def near(q: Array) -> float:
        points = arm.joint_frames(q)[:, :3, 3]
        return -float(
            np.hypot(*points[frame, :2])
            if level
            else np.linalg.norm(points[frame] - points[origin])
        )

    starts = [limits.mean(axis=1) + 0.1, rng.uniform(*limits.T)]
    return -min(
        minimize(near, q, method="L-BFGS-B", bounds=limits, options={"maxiter": 12}).fun
        for q in starts
    )


@pytest.mark.parametrize(
    ("name", "origin", "frame", "level", "reach", "miss"),
    [
        # Franka Emika, Robot's technical data: maximum reach 855 mm
        ("panda", 0, -1, True, 0.855, 5e-3),
        ("iiwa7", 0, 5, True, 0.8, 1e-3),  # its name, R800: to the wrist
        ("irb140", 0, 4, True, 0.81, 1e-3),  # ABB, IRB 140 data sheet: reach of 5th axis 810 mm
        ("gen3", 1, -1, False, 0.902, 5e-3),  # Kinova, Gen3 data sheet: maximum reach 902 mm
        ("jaco", 1, -1, False, 0.9, 0.03),  # Kinova, Jaco data sheet: reach 90 cm
        # Universal Robots: 850 mm, without saying between which points
        ("ur5", 0, -2, True, 0.85, 0.07),
        ("ur10e", 0, -2, True, 1.3, 0.03),  # 1300 mm, likewise
        ("puma560", 0, 4, True, 0.864, 0.03),  # Unimation: 0.864 m to the wrist
        ("era", 0, -1, False, 11.3, 0.05),  # ESA: 11.3 m
    ],
)
def test_an_arm_reaches_as_far_as_its_maker_says(
    name: str, origin: int, frame: int, level: bool, reach: float, miss: float
) -> None:
    """Against reaches as they are commonly stated; the data sheets themselves were not read for
    this.
    """
    assert stretched(name, origin, frame, level) == pytest.approx(reach, abs=miss)


@pytest.mark.parametrize(
    ("name", "q", "tip"),
    [
        # Stretched out level, each of its three offsets one step further along or below.
        ("baxter", [0, 0, 0, 0, 0, 0, 0], [0.069 + 0.364 + 0.374 + 0.28, 0.0, 0.27 - 0.069 - 0.01]),
        # The slide points up at zero; a hand's breadth beside it the shoulder.
        ("stanford", [0, 0, 0.5, 0, 0, 0], [0.0, 0.154 - 0.0203, 0.412 + 0.5]),
    ],
)
def test_the_tip_at_zero_is_read_off_the_drawing(
    name: str, q: list[float], tip: list[float]
) -> None:
    np.testing.assert_allclose(
        published_arms.load(name).joint_frames(np.array(q))[-1, :3, 3], tip, atol=1e-12
    )


@pytest.mark.parametrize(
    ("name", "even", "alike"),
    [
        ("puma560", [0, 4, 5], []),
        ("stanford", [0, 1, 3, 4, 5], [(0, 1), (0, 3), (0, 5)]),
        ("ur5", range(6), [(0, i) for i in range(1, 6)]),
        ("ur10e", range(6), [(0, i) for i in range(1, 6)]),
        ("irb140", [0, 1, 3, 4, 5], []),
        ("general6r", range(6), [(0, i) for i in range(1, 6)]),
        ("panda", [0, 1, 2, 4, 6], [(0, 2), (0, 4), (0, 6)]),
        ("iiwa7", range(7), [(0, 2), (0, 4), (1, 3), (1, 5)]),
        ("gen3", [1, 3, 5], []),
        ("xarm7", [0, 2, 4, 6], [(0, 2), (0, 4), (0, 6)]),
        ("baxter", [0, 2, 4, 6], [(4, 6)]),
        ("era", range(7), [(0, 6), *((1, i) for i in range(2, 6))]),
    ],
)
def test_limits_are_even_where_the_maker_has_them_so(
    name: str, even: list[int], alike: list[tuple[int, int]]
) -> None:
    limits = published_arms.load(name).limits
    np.testing.assert_allclose(limits[even, 0], -limits[even, 1])
    for i, j in alike:
        np.testing.assert_allclose(limits[i], limits[j])


def test_the_limits_of_upper_and_forearm_mirror_each_other() -> None:
    """The PUMA's elbow bends by as much as its shoulder swings, the other way; the Jaco's stand
    even about straight.
    """
    puma, jaco = published_arms.load("puma560").limits, published_arms.load("jaco").limits
    np.testing.assert_allclose(puma[1], -puma[2, ::-1])
    np.testing.assert_allclose(jaco[1:3].sum(axis=1), 2.0 * np.pi)
    assert np.isinf(jaco[[0, 3, 4, 5]]).all()


def test_the_made_up_arm_has_no_two_axes_that_meet_or_are_parallel() -> None:
    frames = published_arms.load("general6r").joint_frames(np.zeros(6))[:6]
    for a, b in pairwise(frames):
        across = np.cross(a[:3, 2], b[:3, 2])
        assert np.linalg.norm(across) > 0.3
        assert abs((b[:3, 3] - a[:3, 3]) @ across) / np.linalg.norm(across) > 0.04


def test_the_made_up_tool_stands_off_the_wrist() -> None:
    puma, tool = published_arms.load("puma560"), published_arms.load("puma560_tool")
    np.testing.assert_array_equal(puma.dh, tool.dh)
    np.testing.assert_array_equal(puma.limits, tool.limits)
    p = tool.X_n_flange[:3, 3]
    assert np.all(p > 0.0)
    assert p[2] > 2.0 * np.hypot(p[0], p[1])  # along the last axis, rather than across
    np.testing.assert_array_equal(puma.X_n_flange, np.eye(4))

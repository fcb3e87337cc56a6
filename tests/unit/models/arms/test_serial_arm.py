"""The arm type: its table against products of elementary moves, its derivatives, and its other
descriptions.
"""

from dataclasses import replace

import numpy as np
import pytest

from dh_product import tips_here
from untyped import untyped
from uuv.controllers.mkps import Chain
from uuv.models.arms import published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, readonly

DEG = np.pi / 180
UR10E = published_arms.load("ur10e").dh
OFF_AXIS = np.array([0.08, 0.0, 0.15])  # [m] tool point


def tilted(rng: np.random.Generator) -> SerialArm:
    """A UR10e with errors in every number; its parallel axes are tilted by about a degree in both
    directions.
    """
    arm = SerialArm.from_dh(UR10E)
    scales = np.tile([1.0 * DEG, 5e-3, 5e-3, 1.0 * DEG, 0.0], (6, 1))
    scales[list(arm.near_parallel), 4] = 1.0 * DEG
    return arm.with_table(arm.table + scales * rng.standard_normal(scales.shape))


def random_arm(rng: np.random.Generator, types: str) -> SerialArm:
    """Joints anywhere and any way round, base and flange aside, uneven limits."""
    n = len(types)
    dh = np.column_stack(
        [rng.uniform(-3, 3, n), rng.uniform(-0.5, 0.5, (n, 2)), rng.uniform(-2, 2, n)]
    )
    base, flange = (
        readonly(pose(exp_so3(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))) for _ in range(2)
    )
    return replace(
        SerialArm.from_dh(dh, types, beta=rng.uniform(-0.1, 0.1, n)),
        X_base_0=base,
        X_n_flange=flange,
        limits=readonly(rng.uniform([-3, 0.1], [-0.1, 3], (n, 2))),
        joint_names=tuple(f"j{k}" for k in range(n)),
    )


def test_derivatives(within):
    rng = np.random.default_rng(1)
    nominal = SerialArm.from_dh(UR10E, "rrrprr")
    arm = nominal.with_table(nominal.table + 0.1 * rng.standard_normal(nominal.table.shape))
    q = rng.uniform(-1, 1, (4, 6))
    tcp = rng.uniform(-0.2, 0.2, 3)
    h = 1e-6
    _, J = arm.tips_and_jacobian(q, tcp)
    for i in range(arm.table.size + 3):
        step = np.zeros(arm.table.size + 3)
        step[i] = h
        ends = [
            arm.with_table(arm.table + s * step[:-3].reshape(-1, 5)).tips(q, tcp + s * step[-3:])
            for s in (1.0, -1.0)
        ]
        within("derivative", J[:, i] - (ends[0] - ends[1]) / (2 * h), 3e-9)


def test_table_without_beta_is_the_same_arm(within):
    rng = np.random.default_rng(2)
    arm = tilted(rng)
    assert np.abs(arm.table[1:3, 4]).min() > 1e-3
    q = rng.uniform(-3, 3, (20, 6))
    tcp = OFF_AXIS
    within("tips by plain DH", tips_here(arm.dh, q, tcp) - arm.tips(q, tcp), 2e-13)  # 2e-14


def test_arm_from_axes(within):
    rng = np.random.default_rng(3)
    true = tilted(rng)
    arm = SerialArm.from_axes(*true.axes())
    q = rng.uniform(-3, 3, (20, 6))
    within("tips by axes", arm.tips(q, OFF_AXIS) - true.tips(q, OFF_AXIS), 1e-14)  # 7e-16
    assert np.abs(arm.table[:, 1:3]).max() < 2.0
    assert arm.near_parallel == (1, 2)


@pytest.mark.parametrize("types", ["rrrrrr", "prrp"])
def test_every_description_is_the_same_arm(rng, types, within):
    """Joint frames, the chain of the inverse kinematics, and a tip taken into the flange; with beta
    and a base.
    """
    arm = random_arm(rng, types)
    tcp = rng.uniform(-0.2, 0.2, 3)
    q = rng.uniform(-1, 1, (10, arm.n))
    flanges = arm.flange(q)
    chain = Chain.from_arm(arm)
    assert (chain.joint_types, chain.names) == (types, arm.joint_names)
    np.testing.assert_array_equal(chain.limits, arm.limits)
    for angles, X in zip(q, flanges, strict=True):
        within("flange by joint frames [m, 1]", arm.joint_frames(angles)[-1] - X, 1e-14)  # 9e-16
        within("flange by the chain [m, 1]", chain.forward(angles) - X, 2e-14)  # 2e-15
    within("tips [m]", arm.with_tip(tcp).flange(q)[:, :3, 3] - arm.tips(q, tcp), 5e-15)  # 4e-16
    axes, points, _ = arm.axes()
    frames = arm.joint_frames(np.zeros(arm.n))[:-1]
    within("axes", frames[:, :3, 2] - axes, 5e-15)  # 4e-16
    within("points on them [m]", np.cross(frames[:, :3, 3] - points, axes), 2e-15)  # 2e-16
    steps = [inverse(a) @ b for a, b in zip([np.eye(4), *frames[:-1]], frames, strict=True)]
    within("origins [m, 1]", np.array(steps) - np.array(arm.origins())[:-1], 5e-15)  # 6e-16


def test_limits_and_names_by_default():
    arm = SerialArm.from_dh(UR10E)
    assert arm.joint_names == ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")
    np.testing.assert_array_equal(arm.limits, np.tile([-np.inf, np.inf], (6, 1)))
    arrays = (arm.table, arm.X_base_0, arm.X_n_flange, arm.limits, arm.dh)
    assert not any(array.flags.writeable for array in arrays)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"limits": np.zeros((5, 2))}, r"^limits: expected shape \(6, 2\), got \(5, 2\)"),
        ({"joint_names": ("a", "b")}, "^joint_names: expected 6 names"),
        ({"joint_types": "rrr"}, "^joint_types: expected 6 letters"),
        ({"joint_types": "rrrrro"}, "^joint_types: expected 6 letters"),
    ],
)
def test_other_numbers_of_joints_are_refused(change, said):
    with pytest.raises(ConfigurationError, match=said):
        replace(SerialArm.from_dh(UR10E), **change)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: SerialArm.from_dh(UR10E[:, :3]), r"^dh: expected shape \(n, 4\)"),
        (
            lambda: SerialArm.from_dh(np.rad2deg(UR10E), name="table"),
            "^table: alpha of joint 1 is 90 rad.*degrees",
        ),
        (
            lambda: SerialArm.from_dh(UR10E * [1, 1e3, 1e3, 1]),
            "^dh: a of joint 2 is -612.7 m.*millimetres",
        ),
        (lambda: SerialArm.from_dh(UR10E, beta=np.zeros(5)), "^beta: expected shape"),
        (
            lambda: SerialArm.from_axes(np.zeros((2, 3)), np.zeros((2, 3)), np.eye(4)),
            "^axes: .*row 0 is zero",
        ),
        (
            lambda: SerialArm.from_axes(np.eye(3), 1e3 * np.eye(3), np.eye(4)),
            "^points: .*1000 m; .*millimetres",
        ),
        (lambda: Chain.from_arm(untyped(UR10E)), "^arm: expected a SerialArm"),
        (lambda: SerialArm.from_dh(UR10E).flange(np.zeros((2, 5))), "^q: expected shape"),
        (lambda: SerialArm.from_dh(UR10E).joint_frames(np.zeros(5)), "^q: expected shape"),
    ],
)
def test_bad_input_is_refused_by_name(make, said):
    with pytest.raises(ConfigurationError, match=said):
        make()

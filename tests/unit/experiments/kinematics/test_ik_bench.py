"""The bench of inverse kinematics: its check of answers, what it gives the peers, its baseline."""

from importlib import import_module
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import exp_so3, pose


@pytest.fixture
def bench() -> ModuleType:
    return import_module("experiments.kinematics.ik_bench")


def targets_of(
    name: str, *, degrees: int = 180, start: str = "cold", bar: str = "A", count: int, seed: int = 0
) -> Any:
    bench = import_module("experiments.kinematics.ik_bench")
    return bench.targets_of(name, degrees=degrees, start=start, bar=bar, count=count, seed=seed)


@pytest.fixture
def fellows(bench: ModuleType) -> ModuleType:
    assert bench is not None
    return import_module("experiments.kinematics.ik_peers")


@pytest.mark.parametrize("name", published_arms.available())
def test_answers_are_checked_by_the_right_kinematics(bench: ModuleType, name: str) -> None:
    arm = published_arms.load(name)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (5, arm.n))
    frames = [arm.joint_frames(row)[-1] for row in q]
    np.testing.assert_allclose(
        bench.dh_forward(arm, q), frames, atol=1e-13 * (1.0 + np.abs(frames).max())
    )


def test_wrong_answers_are_not_counted(bench: ModuleType) -> None:
    case = targets_of("puma560", count=6)
    q = np.tile([0.2, 0.4, -0.3, 0.5, 0.6, 0.7], (6, 1))
    targets = bench.dh_forward(case.arm, q)
    targets[1, :3, 3] += [0.9e-4, 0.0, 0.0]  # within the bar
    targets[2, :3, 3] += [1.1e-4, 0.0, 0.0]  # not
    targets[3, :3, :3] = exp_so3([0.0, 1.1e-3, 0.0]) @ targets[3, :3, :3]
    q[4, 0] += 2.0 * np.pi  # the pose, but beyond the limits
    q[5] = np.nan
    moved = bench.IkTargets(
        arm=case.arm, bar="A", limits=case.limits, targets=targets, starts=case.starts
    )
    assert bench.reached(moved, q).tolist() == [True, True, False, False, False, False]


@pytest.mark.parametrize("name", ["puma560_tool", "stanford", "era"])
def test_peers_are_given_the_same_arm(fellows: ModuleType, name: str) -> None:
    """The URDF and the MuJoCo model that peers get, by MuJoCo's kinematics."""
    arm = published_arms.load(name)
    limits = np.where(np.isfinite(arm.limits), arm.limits, [-3.0, 3.0])
    task = fellows.SolverTask(arm=arm, limits=limits, bar=(1e-4, 1e-3))
    q = np.random.default_rng(2).uniform(*limits.T)
    tip = arm.joint_frames(q)[-1]
    model = fellows.mjcf(task)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(
        pose(data.site_xmat[0].reshape(3, 3), data.site_xpos[0]), tip, atol=1e-12
    )
    np.testing.assert_allclose(model.jnt_range, limits)
    inertia = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        'iyz="0"/></inertial>'
    )
    text = fellows.urdf(task).replace("/><joint", f">{inertia}</link><joint")
    text = text.replace(
        '<robot name="arm">', '<robot name="arm"><mujoco><compiler fusestatic="false"/></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    body = data.body("tip")
    np.testing.assert_allclose(pose(body.xmat.reshape(3, 3), body.xpos), tip, atol=1e-12)
    np.testing.assert_allclose(model.jnt_range, limits, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5", "stanford", "panda"])
@pytest.mark.parametrize("start", ["cold", "warm"])
def test_the_baseline_solves_within_the_limits(bench: ModuleType, name: str, start: str) -> None:
    """It must be worth comparing with: every one of 200 targets, at the close bar, limits kept."""
    case = targets_of(name, degrees=150, start=start, bar="B", count=200)
    solver = bench.baseline(case.task)
    answers = np.array([solver(X, q0) for X, q0 in zip(case.targets, case.starts, strict=True)])
    assert np.all(bench.reached(case, answers))


def test_targets_are_the_same_under_a_seed() -> None:
    def targets(seed: int) -> np.ndarray:
        return targets_of("iiwa7", count=3, seed=seed).targets

    np.testing.assert_array_equal(targets(1), targets(1))
    assert np.abs(targets(1) - targets(2)).max() > 1e-3


@pytest.mark.parametrize(
    "limits", [(47.0, 313.0), (-1.0, 215.0), (-225.0, 45.0), (-360.0, 360.0), (-400.0, -100.0)]
)
def test_angles_of_peers_are_turned_into_uneven_limits(
    fellows: ModuleType, limits: tuple[float, float]
) -> None:
    """Whatever whole turn a peer answers with, an angle that the joint can have is one within its
    limits.
    """
    arm = published_arms.load("puma560")
    task = fellows.SolverTask(arm=arm, limits=np.tile(np.radians(limits), (6, 1)), bar=(1e-4, 1e-3))
    q = np.random.default_rng(3).uniform(*task.limits.T, size=(200, 6))
    turned = q + 2.0 * np.pi * np.random.default_rng(4).integers(-2, 3, q.shape)
    angles = fellows.folded(turned, task)
    np.testing.assert_allclose(np.exp(1j * angles), np.exp(1j * q), atol=1e-12)
    assert np.all((angles >= task.limits[:, 0] - 1e-12) & (angles <= task.limits[:, 1] + 1e-12))
    assert np.all(np.isfinite(fellows._nearest(turned[:1], task, q[0])))


@pytest.mark.parametrize("pitch", [90.0, -90.0, 90.0 - 1e-7, 89.9, 20.0])
def test_a_urdf_says_every_rotation(fellows: ModuleType, pitch: float) -> None:
    for roll, yaw in np.radians(np.random.default_rng(5).uniform(-180.0, 180.0, (50, 2))):
        R = (
            exp_so3([0.0, 0.0, yaw])
            @ exp_so3([0.0, np.radians(pitch), 0.0])
            @ exp_so3([roll, 0.0, 0.0])
        )
        r, p, y = fellows.roll_pitch_yaw(R)
        R_urdf = exp_so3([0.0, 0.0, y]) @ exp_so3([0.0, p, 0.0]) @ exp_so3([r, 0.0, 0.0])
        np.testing.assert_allclose(R_urdf, R, atol=1e-8)


def test_an_arm_can_be_raced_within_its_own_limits(bench: ModuleType) -> None:
    case = targets_of("jaco", degrees=bench.OWN_LIMITS, count=200)
    assert np.all(case.limits[1:3, 0] > 0.0)  # zero is beyond them
    answers = np.array(
        [bench.baseline(case.task)(X, q0) for X, q0 in zip(case.targets, case.starts, strict=True)]
    )
    assert np.mean(bench.reached(case, answers)) > 0.99

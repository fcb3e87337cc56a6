"""Rotations and poses against SciPy's."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from uuv.sim.interfaces.spatial import (
    exp_so3,
    inverse,
    log_so3,
    pose,
    quat_wxyz_from_rotation,
    rotation_from_quat_wxyz,
    rotation_from_z,
    skew,
    transform_points,
)

ANGLES = [0.0, 1e-9, 9e-7, 1.1e-6, 1e-3, 1.0, 2.5, 3.1, np.pi - 1e-4, np.pi - 1e-7]


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_and_logarithm(angle: float, rng: np.random.Generator) -> None:
    for axis in (*np.eye(3), *rng.normal(size=(4, 3))):
        phi = angle * axis / np.linalg.norm(axis)
        R = exp_so3(phi)
        np.testing.assert_allclose(R, expm(skew(phi)), atol=1e-14)
        np.testing.assert_allclose(R, Rotation.from_rotvec(phi).as_matrix(), atol=1e-14)
        np.testing.assert_allclose(log_so3(R), phi, atol=1e-7)


def test_half_a_turn_has_one_of_two_logarithms(rng: np.random.Generator) -> None:
    for axis in (*np.eye(3), *rng.normal(size=(4, 3))):
        a = axis / np.linalg.norm(axis)
        phi = log_so3(2.0 * np.outer(a, a) - np.eye(3))
        np.testing.assert_allclose(np.abs(phi @ a), np.pi, atol=1e-7)


def test_quaternions_are_scipys_but_for_their_sign(rng: np.random.Generator) -> None:
    half_turns = [Rotation.from_rotvec(np.pi * a) for a in np.eye(3)]
    for R in (*Rotation.random(20, random_state=int(rng.integers(1000))), *half_turns):
        q = quat_wxyz_from_rotation(R.as_matrix())
        x, y, z, w = R.as_quat()
        assert abs(q @ [w, x, y, z]) == pytest.approx(1.0)
        np.testing.assert_allclose(rotation_from_quat_wxyz(q), R.as_matrix(), atol=1e-14)


def test_poses_are_undone_and_carry_points(rng: np.random.Generator) -> None:
    X, Y = (pose(exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2))
    np.testing.assert_allclose(inverse(X) @ X, np.eye(4), atol=1e-14)
    p = rng.normal(size=(5, 3))
    np.testing.assert_allclose(
        transform_points(X @ Y, p), transform_points(X, transform_points(Y, p)), atol=1e-13
    )
    np.testing.assert_allclose(transform_points(X, p[0]), (X @ [*p[0], 1.0])[:3])
    np.testing.assert_allclose(skew(p[0]) @ p[1], np.cross(p[0], p[1]))


def test_a_frame_about_an_axis(rng: np.random.Generator) -> None:
    for _ in range(10):
        z, hint = rng.normal(size=(2, 3))
        R = rotation_from_z(z, hint)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(R[:, 2], z / np.linalg.norm(z))
        assert R[:, 0] @ hint > 0.0
        assert np.cross(z, hint) @ R[:, 0] == pytest.approx(0.0, abs=1e-12)

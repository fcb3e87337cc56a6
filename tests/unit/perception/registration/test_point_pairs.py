"""Starts by point pairs: votes find the pose among touching neighbours, and none where there is no
pair.
"""

import numpy as np
import pytest

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.objects import targets
from uuv.perception.clouds.scan import Scan, facing_normals, voxel_means
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.point_pairs import point_pair_poses

ROCK = ModelSurface.of(targets.named("rock"))
VIEW = camera_pose(np.array([0.3, -0.8, 0.6]))


def oriented(name: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) [m] of a noisy look at an object, with normals."""
    scan = Scan.from_depth(
        look(targets.named(name), VIEW, np.random.default_rng(seed), floor=False)
    )
    points = voxel_means(scan.points[scan.depth > 0.0], ROCK.radius / 20.0)
    return points, facing_normals(points, 12)


def near(poses: np.ndarray) -> np.ndarray:
    """Mask of the poses (k, 4, 4) within 0.3 radii and 25 deg of the true one."""
    off = [ROCK.symmetry.error(X, VIEW) for X in poses]
    return np.array([p < 0.3 * ROCK.radius and a < np.deg2rad(25.0) for p, a in off])


def test_the_true_pose_gets_most_votes():
    poses = point_pair_poses(*oriented("rock", 0), ROCK)
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2),
        np.tile(np.eye(3), (len(poses), 1, 1)),
        atol=1e-6,
    )
    assert near(poses[:5]).any()


def test_neighbours_that_touch_it_do_not_hide_it():
    points, normals = oriented("rock", 1)
    for name, shift in (
        ("valve", [0.35, 0.0, 0.0]),
        ("starfish", [-0.3, 0.1, 0.0]),
        ("anode", [0.0, -0.25, 0.05]),
    ):
        beside, facing = oriented(name, 1)
        points = np.vstack([points, beside + shift])
        normals = np.vstack([normals, facing])
    assert near(point_pair_poses(points, normals, ROCK)[:60]).any()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_points_give_finite_poses(count: int):
    poses = point_pair_poses(
        np.arange(3.0 * count).reshape(-1, 3), np.tile([0.0, 0.0, -1.0], (count, 1)), ROCK
    )
    assert np.all(np.isfinite(poses))

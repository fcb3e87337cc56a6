"""The mean of several finds."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.tasks.arrival import fuse_poses
from sim.interfaces.messages import Target, ToolPath
from sim.interfaces.spatial import Array, exp_so3, log_so3, pose, transform_points

TRUE = pose(exp_so3([0.3, -0.5, 2.0]), [40.0, -25.0, -12.0])  # far from the origin: turns have a long lever there
PATH_T = np.linspace([-0.3, 0.0, 0.3], [0.3, 0.1, 0.3], 40)


def found(X_WT: Array, *, path: bool = True) -> Target:
    s, turned = np.linspace(0.0, 0.6, 40), np.ones((40, 1)) * X_WT[:3, 2]
    on = ToolPath(
        s=s, p=transform_points(X_WT, PATH_T), z=-turned, x=np.ones((40, 1)) * X_WT[:3, 0], on_scan=np.ones(40, bool)
    )
    return Target(time=0.0, X_WT=X_WT, accepted=True, check_m=0.0, range_m=1.0, reason="", path=on if path else None)


def off(rng: np.random.Generator, move: float, turn: float) -> Array:
    """TRUE moved and turned about its own origin by random errors of those deviations [m, rad]."""
    return pose(exp_so3(turn * rng.normal(size=3)) @ TRUE[:3, :3], TRUE[:3, 3] + move * rng.normal(size=3))


def test_mean_of_one_is_that_one(within):
    one = fuse_poses([found(TRUE)])
    within("pose", one.X_WT - TRUE, 1e-13)
    assert one.path is not None
    within("path [m]", one.path.p - transform_points(TRUE, PATH_T), 1e-13)


def test_errors_shrink_by_the_root_of_the_number(rng, within):
    """Of 16 finds a quarter is left, in place and in turn, over 200 means (chi-square: 3 % of deviation)."""
    moves, turns = [], []
    for _ in range(200):
        mean = fuse_poses([found(off(rng, 2e-3, 3e-3)) for _ in range(16)])
        assert mean.path is not None
        # About the middle of the path, 0.3 m from the object's origin, the turn moves too.
        moves.append(mean.X_WT[:3, 3] - TRUE[:3, 3])
        turns.append(log_so3(mean.X_WT[:3, :3] @ TRUE[:3, :3].T))
    within("moves", np.std(moves) / (2e-3 / 4) - 1.0, 0.15)
    within("turns", np.std(turns) / (3e-3 / 4) - 1.0, 0.15)


def test_path_goes_with_the_pose(rng, within):
    mean = fuse_poses([found(off(rng, 2e-3, 3e-3)) for _ in range(4)])
    assert mean.path is not None
    within("points [m]", mean.path.p - transform_points(mean.X_WT, PATH_T), 1e-12)
    within("axes", mean.path.z + mean.X_WT[:3, 2], 1e-12)
    within("directions", mean.path.x - mean.X_WT[:3, 0], 1e-12)


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(pose(TRUE[:3, :3], TRUE[:3, 3] + [0.2, 0.0, 0.0]), id="elsewhere"),
        pytest.param(pose(TRUE[:3, :3] @ exp_so3([np.pi, 0.0, 0.0]), TRUE[:3, 3]), id="turned over"),
    ],
)
def test_what_does_not_agree_with_the_last_is_left_out(other, within):
    within("pose", fuse_poses([found(other), found(TRUE), found(TRUE)]).X_WT - TRUE, 1e-13)


def test_without_a_path(rng):
    mean = fuse_poses([replace(found(off(rng, 1e-3, 1e-3), path=False)) for _ in range(3)])
    assert mean.path is None
    assert np.linalg.norm(mean.X_WT[:3, 3] - TRUE[:3, 3]) < 5e-3

"""The curve on which the published criterion is made: in front of all points, across the mean
direction.
"""

import numpy as np
import pytest

from uuv.perception.registration.projection import trajectories
from uuv.sim.interfaces.spatial import exp_so3


def test_reach_is_the_radius_about_the_line(rng: np.random.Generator) -> None:
    R = exp_so3(rng.normal(size=3))
    H = 5.0 * rng.normal(size=3)
    angle = rng.uniform(0, 6, 30)
    radius = rng.uniform(0.0, 0.7, 30)
    along = rng.normal(size=30)
    points = H + np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along]) @ R.T
    assert trajectories.lateral_reach(H, R[:, 2], points) == pytest.approx(radius.max())


def test_rays_start_in_front_of_all_points_in_one_plane(rng: np.random.Generator) -> None:
    R = exp_so3(rng.normal(size=3))
    H = rng.normal(size=3)
    o = R[:, 2]
    for shift in (0.0, 3.0):
        points = H + (rng.normal(size=(20, 3)) + np.array([0.0, 0.0, shift])) @ R.T
        flat = trajectories.circle(0.4, 12)
        starts = trajectories.in_plane(H, o, points, flat)
        depth = (starts - H) @ o
        np.testing.assert_allclose(depth, depth[0])
        assert depth[0] == pytest.approx(min(((points - H) @ o).min() - 0.3, -0.05))
        across = starts - H - np.outer(depth, o)
        np.testing.assert_allclose(np.linalg.norm(across, axis=1), 0.4)
        np.testing.assert_allclose(across.sum(axis=0), 0.0, atol=1e-12)
        gaps = np.linalg.norm(across - np.roll(across, 1, axis=0), axis=1)
        np.testing.assert_allclose(gaps, 0.8 * np.sin(np.pi / 12))

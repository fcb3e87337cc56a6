"""The nearest of many points, against a tree that knows nothing of cells."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from uuv.perception.clouds.nearest_point import NearestPoint


def _sphere(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points (count, 3) on a sphere of 0.3 m that is somewhere."""
    points = rng.normal(size=(count, 3))
    return 0.3 * points / np.linalg.norm(points, axis=1, keepdims=True) + rng.normal(size=3)


@pytest.mark.seeds(0, 1, 2)
@pytest.mark.parametrize("reach", [0.004, 0.05, 3.0])
def test_is_that_of_a_tree(seed: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    points = _sphere(rng, 3000)
    # On the surface, around it, and far outside the box that holds it.
    queries = np.concatenate(
        [
            points[:500],
            points[:500] + rng.normal(0.0, 0.02, (500, 3)),
            rng.normal(0.0, 2.0, (500, 3)),
        ]
    )
    spacing = float(rng.uniform(0.002, 0.05))
    distance, index = NearestPoint.of(points, spacing).query(queries, reach)
    expected, at = cKDTree(points).query(queries, distance_upper_bound=reach)
    np.testing.assert_allclose(distance, expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(index, at)
    assert np.isfinite(distance).any()


@pytest.mark.parametrize("spacing", [1e-9, 1.0])
def test_spacing_that_does_not_fit_costs_time_alone(spacing: float) -> None:
    rng = np.random.default_rng(5)
    points = _sphere(rng, 200)
    queries = rng.normal(0.0, 1.0, (100, 3))
    np.testing.assert_array_equal(
        NearestPoint.of(points, spacing).query(queries, 10.0)[1], cKDTree(points).query(queries)[1]
    )


def test_one_point_and_flat_ones() -> None:
    single = NearestPoint.of(np.array([[1.0, 2.0, 3.0]]), 0.01)
    distance, index = single.query(np.array([[1.0, 2.0, 3.5], [1.0, 2.0, 4.5]]), 1.0)
    np.testing.assert_array_equal(distance, [0.5, np.inf])
    np.testing.assert_array_equal(index, [0, 1])
    flat = np.stack([*np.meshgrid(np.arange(5.0), np.arange(4.0), [0.0])], axis=-1).reshape(-1, 3)
    np.testing.assert_array_equal(
        NearestPoint.of(flat, 0.5).query(flat + 0.1, 1.0)[1], np.arange(len(flat))
    )

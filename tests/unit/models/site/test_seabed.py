"""Heights of a seabed: linear between its nodes, refused where they are no square grid."""

import numpy as np
import pytest

from uuv.models.site.seabed import Seabed
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

MIDDLE = np.array([1.0, -2.0, -3.0])


def seabed(heights: Array, half: float = 2.0) -> Seabed:
    return Seabed(kind="flat", heights=heights, half=half, center_W=MIDDLE, rocks=np.zeros((0, 3)))


def test_an_inclined_plane_has_its_height_everywhere(rng: np.random.Generator) -> None:
    x = np.linspace(-2.0, 2.0, 9)
    ground = seabed(0.3 * x[None, :] - 0.1 * x[:, None])
    assert ground.step == 0.5
    at = rng.uniform(-2.0, 2.0, (200, 2))
    height = ground.height(at + MIDDLE[:2])
    np.testing.assert_allclose(height, -3.0 + 0.3 * at[:, 0] - 0.1 * at[:, 1], atol=1e-12)
    corners = np.array([[-2.0, -2.0], [2.0, 2.0], [-2.0, 2.0], [2.0, -2.0]]) + MIDDLE[:2]
    assert np.isfinite(ground.height(corners)).all()
    assert np.isnan(ground.height(corners + np.sign(corners - MIDDLE[:2]) * 1e-6)).all()
    assert np.isnan(ground.height([[np.nan, 0.0]])).all()


def test_nodes_keep_their_heights(rng: np.random.Generator) -> None:
    heights = rng.normal(size=(5, 5))
    ground = seabed(heights)
    grid = np.linspace(-2.0, 2.0, 5)
    x, y = np.meshgrid(grid + 1.0, grid - 2.0)
    height_of = ground.height(np.column_stack([x.ravel(), y.ravel()])).reshape(5, 5)
    np.testing.assert_allclose(height_of, heights - 3.0, atol=1e-12)


@pytest.mark.parametrize("shape", [(3, 4), (4, 3), (1, 1), (3,), (3, 3, 3)])
def test_what_is_no_square_grid_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ConfigurationError, match="seabed heights"):
        seabed(np.zeros(shape))


def test_what_is_not_finite_or_has_no_size_is_refused() -> None:
    assert seabed(np.zeros((2, 2))).heights.flags.writeable is False
    with pytest.raises(ConfigurationError, match="every height must be finite"):
        seabed(np.array([[0.0, np.nan], [0.0, 0.0]]))
    for half in (0.0, -1.0, np.nan):
        with pytest.raises(ConfigurationError, match="half"):
            seabed(np.zeros((2, 2)), half)

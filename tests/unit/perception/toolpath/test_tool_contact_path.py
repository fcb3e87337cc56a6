"""A ball that rolls on a surface, against closed forms and against SciPy's closing of a grey
picture.
"""

import numpy as np
import pytest
from scipy import ndimage

from uuv.perception.toolpath.path_planner import lift
from uuv.sim.interfaces.spatial import Array

RADIUS, STEP = 0.06, 0.003  # [m]
X, Y = np.arange(-40, 41) * STEP, np.arange(-12, 13) * STEP


def surface(height: np.ndarray) -> tuple[Array, Array]:
    """A grid (N, L, 3) with `height` (N, L) [m] along z, and the ways out of it."""
    points = np.stack(np.broadcast_arrays(X[:, None], Y[None], height), axis=-1)
    return points, np.tile([0.0, 0.0, 1.0], (len(X), 1))


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.5])
def test_groove(angle, within):
    """Between two planes, each `angle` [rad] steep, the ball stays R (1 / cos - 1) over the
    bottom.
    """
    over = lift(*surface(np.tan(angle) * np.abs(X[:, None]) + np.zeros_like(Y)), RADIUS)
    # 4e-6 by the grid
    within("over the bottom [m]", over[40, 12] - RADIUS * (1.0 / np.cos(angle) - 1.0), 2e-5)
    away = np.abs(X) > RADIUS * np.sin(angle) + STEP
    within("on the flanks [m]", over[away & (np.abs(X) < 0.06)], 1e-9)


def test_what_bulges_is_touched_everywhere(within):
    over = lift(*surface(np.sqrt(0.3**2 - X[:, None] ** 2) + np.zeros_like(Y)), RADIUS)
    # farther out the centre would be beyond the grid
    inner = np.abs(X) < X[-1] / (1.0 + RADIUS / 0.3) - STEP
    within("over a cylinder [m]", over[inner], 3e-5)  # 1e-5 by the grid


@pytest.mark.seeds(1)
def test_is_a_morphological_closing(seed, within):
    rng = np.random.default_rng(seed)
    height = np.asarray(
        0.08 * ndimage.gaussian_filter(rng.standard_normal((len(X), len(Y))), 4.0), dtype=np.float64
    )
    over = lift(*surface(height), RADIUS)
    half = np.arange(-19, 20) * STEP
    square = half[:, None] ** 2 + half**2
    inside = square < (RADIUS - 1e-9) ** 2
    ball = np.where(inside, np.sqrt(np.maximum(RADIUS**2 - square, 0.0)), 0.0)
    closed = ndimage.grey_erosion(
        ndimage.grey_dilation(
            height, footprint=inside, structure=ball, mode="constant", cval=-np.inf
        ),
        footprint=inside,
        structure=ball,
        mode="constant",
        cval=np.inf,
    )
    within("closing [m]", height + over - closed, 1e-12)
    assert over.max() > 1e-3, seed

"""What perception assumes of a 3D sonar, and its scans rid of echoes that stand alone."""

import numpy as np
from numpy.typing import ArrayLike

from perception.clouds.scan import SensorModel, jump
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, readonly

_SUPPORT = 3  # neighbours of 8 that share a surface with a beam that is believed


def sonar_model(pitch: float, sigma: float = 0.005, at: float = 1.3) -> SensorModel:
    """A sensor model for beams `pitch` [rad] apart whose ranges err by `sigma` [m] at the range `at` [m].

    It grows with the square of the range, as stereo's does: near `at` that is no matter. Raises ConfigurationError
    for numbers that are not positive.
    """
    if not (pitch > 0.0 and sigma > 0.0 and at > 0.0):
        raise ConfigurationError(f"sonar model: pitch, sigma and at must be positive, got {pitch}, {sigma}, {at}")
    baseline = 0.12
    return SensorModel(
        focal=1.0 / pitch,
        baseline=baseline,
        disparity_sigma=sigma * baseline / (pitch * at**2),
        noise_length=1.0,  # beams err each by itself
    )


def without_lone_echoes(points: ArrayLike) -> Array:
    """Echoes (H, W, 3) [m], NaN where fewer than 3 of the 8 beams around hit the same surface.

    A triangulation takes a lone wrong echo for a hole in what it should have hit. Raises ConfigurationError for
    clouds that are not organised by beams.
    """
    cloud = np.array(points, dtype=np.float64)
    if cloud.ndim != 3 or cloud.shape[2] != 3:
        raise ConfigurationError(f"sonar scan: expected echoes (H, W, 3) [m], got shape {cloud.shape}")
    r = np.linalg.norm(cloud, axis=-1)
    around = np.pad(r, 1, constant_values=np.nan)
    height, width = r.shape
    support = np.zeros(r.shape, dtype=int)
    step = jump(r)
    for row in range(3):
        for column in range(3):
            if (row, column) != (1, 1):
                support += np.abs(around[row : row + height, column : column + width] - r) < step
    cloud[support < _SUPPORT] = np.nan
    return readonly(cloud)

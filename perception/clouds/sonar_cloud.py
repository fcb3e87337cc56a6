"""3D sonar: its sensor model, and removal of isolated echoes from its scans."""

import numpy as np
from numpy.typing import ArrayLike

from uuv.perception.clouds.scan import SensorModel, jump
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, readonly

_SUPPORT = 3  # least number of the 8 neighbours on the same surface, for an echo to be kept


def sonar_model(pitch: float, sigma: float = 0.005, at: float = 1.3) -> SensorModel:
    """Sensor model of a 3D sonar from its beam pitch and range noise.

    The modelled noise grows with the square of the range, as for stereo. Near the range `at` the
    difference from a sonar does not matter.

    Args:
        pitch: [rad] between beams.
        sigma: [m] standard deviation of the ranges.
        at: [m] range at which the model has this standard deviation.

    Returns:
        The sensor model.

    Raises:
        ConfigurationError: A value is not positive.
    """
    if not (pitch > 0.0 and sigma > 0.0 and at > 0.0):
        raise ConfigurationError(
            f"sonar model: pitch, sigma and at must be positive, got {pitch}, {sigma}, {at}"
        )

    baseline = 0.12
    return SensorModel(
        focal=1.0 / pitch,
        baseline=baseline,
        disparity_sigma=sigma * baseline / (pitch * at**2),
        noise_length=1.0,  # errors of beams are independent
    )


def without_isolated_echoes(points: ArrayLike) -> Array:
    """Replace echoes with fewer than 3 of their 8 neighbours on the same surface by NaN.

    Triangulation would turn an isolated wrong echo into a hole of the surface behind it.

    Args:
        points: (h, w, 3) [m] echoes, one per beam.

    Raises:
        ConfigurationError: The cloud is not organised by beams.
    """
    cloud = np.array(points, dtype=np.float64)
    if cloud.ndim != 3 or cloud.shape[2] != 3:
        raise ConfigurationError(
            f"sonar scan: expected echoes (H, W, 3) [m], got shape {cloud.shape}"
        )

    # Neighbours on the same surface: their ranges differ by less than a jump
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

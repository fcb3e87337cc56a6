"""Coarse detection: pose of an object that is known before a look, drawn around the true pose."""

import numpy as np

from uuv.sim.interfaces.spatial import Array, exp_so3


def coarse_detection(X_WT: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Coarse pose of an object at `X_WT` (4, 4), with a random error.

    Returns:
        Position (3,) [m] with an error of 10 to 30 cm, and rotation (3, 3) with an error of up to
        30 deg.
    """
    way, axis = rng.standard_normal((2, 3))
    approach = X_WT[:3, 3] + rng.uniform(0.1, 0.3) * way / np.linalg.norm(way)
    turn = exp_so3(rng.uniform(0.0, np.radians(30.0)) * axis / np.linalg.norm(axis))
    return approach, turn @ X_WT[:3, :3]

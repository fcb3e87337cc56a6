"""Example of docs/own_current.md: a jet."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Jet:
    """Jet along y, widest in the plane x = 0, that sets in within 10 s."""

    speed: float = 0.2  # [m/s]
    width: float = 1.0  # [m]

    def velocity(self, p_W, time):
        across = np.exp(-((p_W[0] / self.width) ** 2))
        return np.array([0.0, self.speed * across * (1.0 - np.exp(-time / 10.0)), 0.0])

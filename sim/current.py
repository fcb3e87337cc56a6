"""A current in time: a steady part plus gusts that have a finite acceleration."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, checked

_BLOCK = 4096  # steps generated at a time


class Current:
    """Velocity and acceleration of the water, uniform in space, at the physics rate.

    Gusts are white noise through two equal first-order filters, so that their acceleration, which the
    pressure-gradient force needs, is finite. `gust` is their standard deviation per axis.
    """

    def __init__(
        self,
        mean_W: ArrayLike,
        *,
        gust: float = 0.0,
        time_constant: float = 5.0,
        timestep: float = 0.002,
        rng: np.random.Generator | None = None,
    ) -> None:
        """Take the steady current (3,) [m/s], gust [m/s], the gusts' time constant [s], the physics step [s].

        Raises ConfigurationError for a non-finite current, negative gust, or gusts without a generator.
        """
        self._mean = checked(mean_W, (3,), "current [m/s]")
        if not (np.isfinite(gust) and gust >= 0.0):
            raise ConfigurationError(f"gust: must be finite and >= 0 m/s, got {gust}")
        if gust > 0.0 and rng is None:
            raise ConfigurationError("gusts need a random generator")
        if not time_constant > 10.0 * timestep:
            raise ConfigurationError(f"gust time constant {time_constant} s: must be above ten steps of {timestep} s")
        self._gust, self._rng, self._dt = gust, rng, timestep
        a = np.exp(-timestep / time_constant)
        self._numerator, self._denominator = [(1.0 - a) ** 2], [1.0, -2.0 * a, a * a]
        # Stationary variance of two equal poles a driven by unit white noise through gain (1-a)^2.
        variance = (1.0 - a) ** 4 * (1.0 + a * a) / (1.0 - a * a) ** 3
        self._scale = gust / np.sqrt(variance)
        self._filter = np.zeros((2, 3))
        self._rows = np.zeros((0, 3))
        self._last = np.zeros(3)
        self._at = 0
        if gust > 0.0:
            for _ in range(max(1, round(10.0 * time_constant / timestep / _BLOCK)) + 1):
                self._refill()  # all but the last go by: start from the stationary state, not from a calm

    def _refill(self) -> None:
        assert self._rng is not None
        self._last = self._rows[-1] if len(self._rows) else np.zeros(3)
        noise = self._scale * self._rng.standard_normal((_BLOCK, 3))
        self._rows, self._filter = lfilter(self._numerator, self._denominator, noise, axis=0, zi=self._filter)
        self._at = 0

    def step(self) -> tuple[Array, Array]:
        """Velocity (3,) [m/s] and acceleration (3,) [m/s^2] of the water for the next physics step, world axes."""
        if self._gust == 0.0:
            return self._mean, np.zeros(3)
        if self._at == len(self._rows):
            self._refill()
        previous = self._rows[self._at - 1] if self._at else self._last
        now = self._rows[self._at]
        self._at += 1
        return self._mean + now, (now - previous) / self._dt

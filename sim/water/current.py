"""Time-varying current: a steady part plus gusts of finite acceleration."""

import sys
from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import ArrayLike

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, checked, number

_BLOCK = 4096  # steps generated at a time
_LONGEST = 1e12  # [steps] longest time constant; beyond it the filter's pole is lost in rounding


@numba.njit(cache=True)
def _filter(gain: float, pole: float, signal: Array, state: Array) -> None:
    """First-order filter of the columns of `signal` (N, 3), in place, with its `state` (3,); as scipy.signal.lfilter.

    SciPy's takes as long to import as a fifth of the program.
    """
    for k in range(len(signal)):
        for i in range(3):
            value = state[i] + gain * signal[k, i]
            signal[k, i] = value
            state[i] = pole * value


class Current:
    """Velocity and acceleration of the water, uniform in space, one sample per step of the plant.

    Gusts are white noise through two equal first-order filters: their acceleration, which the pressure-gradient force
    needs, is then finite. `gust` is their standard deviation per axis.

    `velocity` [m/s] and `acceleration` [m/s^2], each (N, 3), hold the steps generated ahead, without the profile; `row`
    (2,) is the next of their rows, and by how many rows a step moves on. Compiled code may take rows itself, `ready` of
    them. The three arrays are never replaced.
    """

    def __init__(
        self,
        mean_W: ArrayLike,
        *,
        gust: float = 0.0,
        time_constant: float = 5.0,
        timestep: float = 0.002,
        rng: np.random.Generator | None = None,
        profile: Callable[[float], tuple[float, float]] | None = None,
    ) -> None:
        """Set up the steady current and its gusts.

        Args:
            mean_W: Steady current (3,) [m/s].
            gust: Standard deviation of the gusts per axis [m/s].
            time_constant: Of the gusts [s].
            timestep: Step of the plant [s].
            rng: Random generator; needed for gusts only.
            profile: Function of the time t [s] since the start. It returns a factor on the whole current and the
                factor's rate of change [1/s].

        Raises:
            ConfigurationError: A number is not finite or has the wrong sign, the time constant has too few or too many
                steps, or gusts lack a generator.
        """
        self._mean = checked(mean_W, (3,), "current [m/s]")
        gust, dt = number(gust, "gust [m/s]"), number(timestep, "timestep of the current [s]")
        time_constant = number(time_constant, "time constant of the gusts [s]")
        if not (np.isfinite(gust) and gust >= 0.0):
            raise ConfigurationError(f"gust: must be finite and >= 0 m/s, got {gust}")
        if gust > 0.0 and not isinstance(rng, np.random.Generator):
            raise ConfigurationError(f"gusts need a random generator, got {rng!r}")
        if not (np.isfinite(dt) and dt > 0.0):
            raise ConfigurationError(f"timestep of the current: must be finite and > 0 s, got {dt}")
        if not 10.0 * dt < time_constant <= _LONGEST * dt:
            raise ConfigurationError(
                f"gust time constant {time_constant} s: must be above ten steps of {dt} s, and no more than "
                f"{_LONGEST:.0e} of them"
            )
        self._rng, self._dt = rng, dt
        self.profile, self._ticks = profile, 0
        self._blows = gust > 0.0
        a, b = np.exp(-dt / time_constant), -np.expm1(-dt / time_constant)
        self._gain, self._pole = float(b), float(a)
        # Stationary start: standard deviations of both filter states for unit white noise (gain b and pole a, twice),
        # from Lyapunov's equation; scaled so that the second state has the gust's.
        first = gust * (1.0 + a) / (1.0 + a * a)
        self._scale = gust * (1.0 + a) * np.sqrt((1.0 + a) / (b * (1.0 + a * a)))
        rows = _BLOCK if self._blows else 1
        self.velocity, self.acceleration = np.tile(self._mean, (rows, 1)), np.zeros((rows, 3))
        self.row = np.array([rows, 1] if self._blows else [0, 0])  # no gust is generated yet
        self._filters = np.zeros((2, 3))
        if self._blows:
            assert rng is not None
            now, other = rng.standard_normal((2, 3))
            self._gust = gust * now  # [m/s] at the last step generated
            self._filters[:] = a * first * (now + a * other), a * self._gust

    @property
    def timestep(self) -> float | None:
        """Step of the plant [s] that it was made for; None for a steady current, which suits any step."""
        return self._dt if self._blows or self.profile is not None else None

    def _refill(self) -> None:
        assert self._rng is not None
        noise = self._scale * self._rng.standard_normal((_BLOCK, 3))
        for state in self._filters:
            _filter(self._gain, self._pole, noise, state)
        self.velocity[:] = self._mean + noise
        self.acceleration[:] = np.diff(noise, axis=0, prepend=self._gust[None]) / self._dt
        self._gust, self.row[0] = noise[-1], 0

    def ready(self) -> int:
        """Number of steps that may now be taken from the rows; generates new ones after the last."""
        if not self._blows:
            return sys.maxsize
        if self.row[0] == _BLOCK:
            self._refill()
        return _BLOCK - int(self.row[0])

    def step(self) -> tuple[Array, Array]:
        """Velocity (3,) [m/s] and acceleration (3,) [m/s^2] of the water for the plant's next step, world axes."""
        self.ready()
        at = self.row[0]
        velocity, acceleration = self.velocity[at].copy(), self.acceleration[at].copy()
        self.row[0] += self.row[1]
        if self.profile is None:
            return velocity, acceleration
        share, growth = self.profile(self._ticks * self._dt)
        self._ticks += 1
        return share * velocity, share * acceleration + growth * velocity

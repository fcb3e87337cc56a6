"""Draw of version 1 of the benchmark: water, sensors, vehicle and pad of a case.

One generator draws them in a fixed order. Another order, or one more draw, would be another
version.
"""

from dataclasses import dataclass

import numpy as np

from uuv.perturbations.loop import MisplacedSurface
from uuv.perturbations.pad import Pad
from uuv.perturbations.vehicle import Gears, Payload, ThrusterSpread, Water
from uuv.scenario import Sensing
from uuv.sim.interfaces.spatial import Array

TICK = 0.002  # [s] periods and delays are whole multiples of this


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstDraw:
    """Quantities that are drawn for a case in addition to its job."""

    seed: int
    perturbation_seed: int
    current: tuple[float, float, float]  # [m/s] in W
    gust: float  # [m/s] standard deviation per axis
    sensing: Sensing
    payload: Payload
    pad: Pad

    @classmethod
    def of(cls, seed: int, index: int) -> "FirstDraw":
        """The draw of a case.

        Args:
            seed: Seed of the benchmark's cases.
            index: Index of the case.
        """
        rng = np.random.default_rng([seed, index])
        current = _current(rng)
        gust = rng.uniform(0.0, 0.05)

        payload = Payload(spread=0.1, trim_error=rng.uniform(-0.1, 0.1))
        pad = Pad(
            friction=rng.uniform(0.1, 0.6),
            stiffness=float(np.exp(rng.uniform(*np.log((1e4, 1e6))))),
        )

        # A drawn number without effect: the position of the surface, which is that of the object.
        rng.uniform()
        sensing = Sensing(
            vision_period=_ticks(1.0 / rng.uniform(5.0, 20.0)),
            vision_delay=_ticks(rng.uniform(0.05, 0.25)),
            vision_noise=rng.uniform(0.001, 0.005),
            torque_noise=0.01,
            torque_bias=0.5,
        )

        perturbation_seed, own_seed = (int(rng.integers(2**31)) for _ in range(2))
        return cls(
            seed=own_seed,
            perturbation_seed=perturbation_seed,
            current=_vector(current),
            gust=gust,
            sensing=sensing,
            payload=payload,
            pad=pad,
        )

    @property
    def of_vehicle(self) -> tuple[Water | Payload | ThrusterSpread | Gears, ...]:
        """Deviations of the true vehicle from its model."""
        return (
            Water(spread=0.3),
            self.payload,
            ThrusterSpread(lag=0.2, gain=0.2),
            Gears(spread=0.3),
        )

    @property
    def of_surface(self) -> tuple[Pad | MisplacedSurface, ...]:
        """Properties of the surface that a pad meets."""
        return (self.pad, MisplacedSurface(offset=0.0))


def _current(rng: np.random.Generator) -> Array:
    """Current (3,) [m/s] in W with uniformly drawn speed, and a direction drawn uniformly on the
    sphere.
    """
    speed = rng.uniform(0.0, 0.4)
    azimuth = rng.uniform(-np.pi, np.pi)
    rise = rng.uniform(-1.0, 1.0)
    level = np.sqrt(1.0 - rise * rise)
    return speed * np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])


def _vector(v: Array) -> tuple[float, float, float]:
    x, y, z = v.tolist()
    return x, y, z


def _ticks(time: float) -> float:
    """The nearest whole multiple of TICK [s], at least one."""
    return max(1, round(time / TICK)) * TICK

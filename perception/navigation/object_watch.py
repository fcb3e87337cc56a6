"""Detection of the motion of an object that the camera on the arm tracks, from a divergence of
track and vision.

The track measures the motion of the hull relative to the object, vision its motion in the world.
The difference of the two is the position of the object, up to a constant. The mean of this position
over a short time is compared with the mean over some seconds. A slower divergence cannot be
distinguished from errors of the arm's model and of the track, which grow with the distance. If
vision states a slow drift ("wander"), no motion can be detected.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from uuv.sim.interfaces.spatial import Array

_SHORT, _LONG = 1.0, 8.0  # [s] time constants of the two means
_BEGUN = 2.0  # [s] duration of a track before its means are used
_SURE = 5.0  # [sigma] significant difference of the means
_LEAST = 1e-3  # [m] errors that no sensor states


@dataclass(slots=True, eq=False)
class ObjectWatch:
    """Position of the object from track and vision, up to a constant, as means over two time
    constants.
    """

    begun: float = math.nan  # [s] of the track
    count: int = 0  # number of pictures of vision since the track began
    late: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] W, over _SHORT
    early: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] W, over _LONG
    # (3,) [m^2] variance of the position by the track, over _LONG
    grown: Array = field(default_factory=lambda: np.zeros(3))
    time: float = math.nan  # [s] of the newest picture
    # (3,) [m] motion of the object; zero: not significant
    moved_W: Array = field(default_factory=lambda: np.zeros(3))

    def begin(self, time: float) -> None:
        """Begin with a new track at `time` [s], and discard the means of the previous track."""
        self.begun = time
        self.count = 0
        self.moved_W = np.zeros(3)

    def take(
        self, time: float, place_W: Array, sigma: float, variance_W: Array | None = None
    ) -> None:
        """Take one picture of vision.

        Args:
            time: [s] of its exposure.
            place_W: (3,) [m] position of the object from track and vision, up to a constant.
            sigma: [m] standard deviation of vision's white noise.
            variance_W: (3,) [m^2] variance of the position by the track since it began, which
                grows; inf in directions that are not observed. None: zero.
        """
        if not time > self.begun:  # picture exposed before the track began
            return

        variance = np.zeros(3) if variance_W is None else variance_W
        self.count += 1

        if self.count == 1:
            self.late = place_W
            self.early = place_W
            self.grown = variance
            self.time = time
            return

        # Means over two times; of all pictures while these are few
        interval = max(time - self.time, 1e-3)
        self.time = time
        short, long = (
            max(1.0 / self.count, -math.expm1(-interval / mean)) for mean in (_SHORT, _LONG)
        )
        self.late = self.late + short * (place_W - self.late)
        self.early = self.early + long * (place_W - self.early)

        # Growth of the variance by which the track may have drifted between them
        observed = np.isfinite(variance) & np.isfinite(self.grown)
        parted = np.subtract(variance, self.grown, out=np.full(3, np.inf), where=observed)
        self.grown = np.where(
            observed, self.grown + long * np.where(observed, parted, 0.0), variance
        )

        if time - self.begun < _BEGUN:
            return

        # Significant motion
        noise = np.sqrt(
            sigma**2 * (short / (2.0 - short) + long / (2.0 - long)) + np.maximum(parted, 0.0)
        )
        moved = self.late - self.early
        self.moved_W = moved * (np.abs(moved) > np.maximum(_LEAST, _SURE * noise))

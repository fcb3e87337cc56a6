"""Watch on an object that the camera on the arm tracks: it moves if the track and vision part.

The track says how the hull moves over the object, vision how it moves in the world. Their difference is where the
object is, up to a constant. The short mean of that difference is compared with its mean since the track began. Where
vision wanders by its own statement, nothing can be told.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from sim.interfaces.spatial import Array

_SHORT = 1.0  # [s] of the short mean
_BEGUN = 2.0  # [s] of a track before its mean counts
_SURE = 5.0  # [sigma] of vision's noise
_LEAST = 1e-3  # [m] of the track's own errors


@dataclass(slots=True, eq=False)
class ObjectWatch:
    """Place of the object by track and vision, up to a constant: mean since the track began, and of late."""

    begun: float = math.nan  # [s] of the track
    count: int = 0  # pictures of vision since
    mean: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] W
    late: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] W
    time: float = math.nan  # [s] of the newest picture
    moved_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] by which it moves; zero: not beyond doubt

    def begin(self, time: float) -> None:
        """A track has begun at `time` [s]: what was known of another one does not count."""
        self.begun, self.count, self.moved_W = time, 0, np.zeros(3)

    def take(self, time: float, place_W: Array, sigma: float) -> None:
        """Take one picture of vision.

        Args:
            time: [s] of its exposure.
            place_W: (3,) [m] object by track and vision, up to a constant.
            sigma: [m] standard deviation of vision's white noise.
        """
        if not time > self.begun:  # exposed before
            return
        self.count += 1
        if self.count == 1:
            self.mean, self.late, self.time = place_W, place_W, time
            return
        interval, self.time = max(time - self.time, 1e-3), time
        share = max(1.0 / self.count, -math.expm1(-interval / _SHORT))
        self.mean = self.mean + (place_W - self.mean) / self.count
        self.late = self.late + share * (place_W - self.late)
        if time - self.begun < _BEGUN:
            return
        noise = sigma * math.sqrt(share / (2.0 - share) + 1.0 / self.count)
        moved = self.late - self.mean
        self.moved_W = moved * (np.abs(moved) > max(_LEAST, _SURE * noise))

"""Fixes of the navigation filter: positions from vision and velocities from the DVL, validated.

A fix is compared with the stored estimate of the step at which it was measured. A fix that passes
is stored at that step, and the filter is run forward again from that step (`filter_kernel.replay`).
"""

import math
from dataclasses import dataclass, field

import numpy as np

from uuv.perception.navigation.filter_kernel import (
    ATTITUDE,
    DVL,
    FIX,
    HAS,
    HISTORY,
    JUMP,
    SHIFT,
    TIME,
    VALUE,
    VARIANCE,
    VISION,
    mahalanobis,
    replay,
    row_at,
)
from uuv.sim.interfaces.spatial import Array

_REPEATS = 3  # number of equal consecutive readings from which on a noisy sensor counts as frozen
# [s] time constant of the mean innovation; a jump by 0.05 m/s^2 is detected in twice that time
_MEAN_TIME = 0.25
# [-] chi-square with 3 degrees of freedom: noise alone exceeds it once in 10^9 fixes
_MEAN_GATE = 45.0
# number of consistent rejected fixes in a row, after which the filter is assumed to be wrong
_AGREEING = 5
_MOST_SCALE = 100.0  # [-] largest factor on a sensor's variance
# [-] gain per fix, largest square used, neutral square
_SCALE_GAIN, _SCALE_CAP, _SCALE_SLACK = 0.05, 4.0, 1.2


@dataclass(slots=True, eq=False)
class FixMonitor:
    """Monitor of one kind of fix, with its frozen readings, noise scale, rejected fixes and mean
    innovation.
    """

    last: Array  # (3,) last reading
    time: float  # [s] time of the last reading
    repeats: int = 0  # number of equal consecutive readings, minus one
    scale: float = 1.0  # [-] factor on the stated variance, from the innovations
    agreeing: int = 0  # number of consistent rejected fixes in a row
    # (3,) innovation of the last rejected fix
    rejected: Array = field(default_factory=lambda: np.zeros(3))
    # (3,) mean of recent whitened innovations
    mean: Array = field(default_factory=lambda: np.zeros(3))
    mean_variance: float = 0.0  # [-] variance of each of its axes for white innovations
    mean_time: float = -math.inf  # [s] time of its last innovation
    refused: int = 0  # number of fixes not used since the start, for the log

    def is_new(self, value: Array, time: float) -> bool:
        """Store a reading; False if it is a repetition of the last one, which is not used."""
        if np.array_equal(value, self.last):
            if time == self.time:
                return False
            self.repeats += 1
        else:
            self.repeats = 0
        self.last = value
        self.time = time
        return True

    def take(self, white: Array, time: float, most: float) -> float:
        """Add a whitened innovation to the running mean.

        A steady offset is not noise, so the mean so far is subtracted before the square.

        Args:
            white: (3,) whitened innovation.
            time: [s] of the fix.
            most: Length to which the innovation is clipped in the mean.

        Returns:
            Mean square [-] about the mean so far, 1 for a sensor whose noise is as stated.
        """
        off = white - self.mean

        square = float(off @ off) / (3.0 + 3.0 * self.mean_variance)
        share = 1.0 - math.exp(-max(time - self.mean_time, 0.0) / _MEAN_TIME)
        self.mean_time = max(time, self.mean_time)
        self.mean = self.mean + share * (
            white * min(1.0, most / max(math.hypot(*white.tolist()), 1e-9)) - self.mean
        )

        self.mean_variance = (1.0 - share) ** 2 * self.mean_variance + share**2
        return square

    def agrees(self, innovation: Array, farthest: float) -> bool:
        """Count a rejected fix; True once enough consecutive rejected fixes are near each other.

        `farthest` is the largest squared distance of two fixes that are near.
        """
        apart = float(np.sum((innovation - self.rejected) ** 2))
        self.agreeing = self.agreeing + 1 if self.agreeing and apart <= farthest else 1
        self.rejected = innovation
        return self.agreeing >= _AGREEING


@dataclass(slots=True, eq=False)
class Fixes:
    """Processing of the fixes of one filter."""

    memory: np.ndarray  # (1,) of `filter_kernel.FILTER`, changed in place
    gate: float  # [-] chi-square with 3 degrees of freedom beyond which a fix is refused
    # True: raise a sensor's variance on large innovations, and re-estimate an accelerometer bias
    # that jumped
    adapt: bool
    watches: tuple[FixMonitor, FixMonitor]  # vision, DVL
    bias_jumps: int = 0  # detected jumps of the accelerometer bias since the start, for the log

    def take(self, kind: int, time: float, value: Array, sigma: float) -> bool:
        """Update the filter by a fix at its step, and withhold the correction; False if refused.

        Args:
            kind: VISION or DVL.
            time: [s] at which it was measured.
            value: (3,) position [m] in W, or velocity [m/s] in B.
            sigma: Standard deviation of its white noise per axis.
        """
        watch = self.watches[kind]

        sound = np.isfinite(value).all() and math.isfinite(time)
        if sound and not watch.is_new(value, time):
            return False

        used = bool(sound) and self._used(watch, kind, time, sigma)
        watch.refused += not used
        return used

    def _used(self, watch: FixMonitor, kind: int, time: float, sigma: float) -> bool:
        """Update the filter by the reading in `watch`; False if it is refused."""
        if watch.repeats >= _REPEATS and sigma > 0.0:
            return False
        at, shift = row_at(self.memory, time)
        if at < 0:
            return False

        # Fix in W, with its variance
        row = self.memory["past_input"][0, at]
        reading = watch.last
        fix = np.zeros(FIX)
        fix[VALUE : VALUE + 3] = (
            reading if kind == VISION else row[ATTITUDE : ATTITUDE + 9].reshape(3, 3) @ reading
        )
        floor = 1e-6 if kind == VISION else 1e-7  # [m], [m/s]
        fix[HAS] = 1.0
        fix[VARIANCE] = watch.scale * max(sigma, floor) ** 2
        fix[SHIFT] = shift

        # An innovation larger than stated raises the sensor's variance
        squared, innovation, white = mahalanobis(self.memory, kind, fix, at)
        square = watch.take(white, time, math.sqrt(self.gate))
        if self.adapt:
            excess = min(square, _SCALE_CAP) - _SCALE_SLACK
            watch.scale = min(max(watch.scale * math.exp(_SCALE_GAIN * excess), 1.0), _MOST_SCALE)

        # If a jump of the bias does not explain the fix, the gate decides
        first = self._bias_jumped(watch, innovation, time) if kind == DVL and self.adapt else -1
        if first < 0 and not self._admit(kind, fix, at, innovation, squared):
            return False

        # The fix is stored at its step, from which the filter runs forward again
        slot = self.memory["past_fix"][0, at, kind]
        if slot[HAS]:  # two fixes of a kind at one step are replaced by their weighted mean
            share = fix[VARIANCE] / (fix[VARIANCE] + slot[VARIANCE])
            fix[VALUE:] = share * slot[VALUE:] + (1.0 - share) * fix[VALUE:]
            fix[VARIANCE] = share * slot[VARIANCE]
        slot[:] = fix
        replay(self.memory, at if first < 0 else first)

        used = self.memory["used"][0]
        used[kind] = max(used[kind], time)
        return True

    def _bias_jumped(self, watch: FixMonitor, innovation: Array, time: float) -> int:
        """Row of the past before a jump of the accelerometer bias; -1 if there was no jump.

        The DVL's mean innovation shows the jump. The bias is then assumed to have changed earlier
        by twice the time constant of the mean. The variance added at that step allows the filter to
        explain the innovation as a growing velocity error.
        """
        if float(watch.mean @ watch.mean) <= _MEAN_GATE * watch.mean_variance:
            return -1

        # Step at which the bias is assumed to have changed
        ago = 2.0 * _MEAN_TIME
        at, _ = row_at(self.memory, time - ago)
        before = (at - 1) % HISTORY
        past = self.memory["past_input"][0]
        if at < 0 or not -math.inf < past[before, TIME] < past[at, TIME]:
            return -1  # older than the stored past

        # Variance of the jump, by the innovation it made
        past[at, JUMP] += float(innovation @ innovation) / ago**2
        self.bias_jumps += 1
        self.memory["jumped"][0] = time

        watch.mean = np.zeros(3)
        watch.mean_variance = 0.0
        for blamed in self.watches:  # the errors of the DVL were those of the accelerometer
            blamed.scale = 1.0
            blamed.agreeing = 0
        return before

    def _admit(self, kind: int, fix: Array, at: int, innovation: Array, squared: float) -> bool:
        """Chi-square gate on the innovation, overruled by consecutive rejected fixes that agree."""
        watch = self.watches[kind]
        if squared <= self.gate:
            watch.agreeing = 0
            return True
        if not watch.agrees(innovation, 2.0 * self.gate * fix[VARIANCE]):
            return False

        # The filter is wrong: its covariance at that step is increased until the fixes pass.
        first = 0 if kind == VISION else 3
        past_P = self.memory["past_P"][0]
        for i in range(3):
            past_P[at, first + i, first + i] += innovation[i] ** 2
        watch.agreeing = 0
        watch.scale = 1.0
        return True

"""Judgement of work that goes on, step by step, by the rules and limits of a run's figures."""

import math

import numpy as np

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.force_levels import force_peak, is_lost, unsettled
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array


class RunningForce:
    """Error of the true normal force from one set force, as `contact_figures` has it for a run.

    It counts once the force is settled, since `start`.
    """

    def __init__(self, set_force: float, bounds: Bounds) -> None:
        """Take the set force [N] and the bounds of its error."""
        self.set_force = set_force
        self.bounds = bounds
        self.start()

    def start(self) -> None:
        """The set force begins to act."""
        self.since = 0.0  # [s]
        self.peak = 0.0  # [N]
        self._squares = self._judged = 0.0

    @property
    def rms(self) -> float:
        """Root mean square error [N] of the settled steps; 0 before."""
        return math.sqrt(self._squares / self._judged) if self._judged else 0.0

    def add(self, normal: float, least: float, most: float, dt: float) -> str:
        """A step of `dt` [s], with the mean, smallest and largest normal force [N] in it.

        Returns:
            What of it is out of bounds, once settled; empty: nothing.
        """
        self.since += dt
        if self.since < unsettled(0.0):
            return ""
        error = normal - self.set_force
        self._judged += dt
        self._squares += dt * error * error

        peak = float(force_peak(least, most, self.set_force))
        self.peak = max(self.peak, peak)
        if is_lost(least):
            return "contact lost"
        return f"force off by {peak:.1f} N" if peak > self.bounds.force_error_max else ""

    def missed(self) -> str:
        """What of the whole is out of bounds: the root mean square; empty: nothing."""
        rms = self.rms
        return f"force off by {rms:.1f} N RMS" if rms > self.bounds.force_error_rms else ""


def place_on_path(path: ToolPath, p_W: Array) -> tuple[float, float]:
    """Arc length [m] of the place of a path nearest to a tip (3,) [m], and its distance [m].

    The distance is that across the path's tool axes: how deep the tool is does not count.
    """
    ((s, distance),) = places_on_path(path, p_W[None]).tolist()
    return s, distance


def places_on_path(path: ToolPath, p_W: Array) -> Array:
    """Arc lengths and distances (N, 2) [m] as `place_on_path`, of tips (N, 3) [m]."""
    places = np.empty((len(p_W), 2))
    _find_nearest(path.s, path.p, path.z, np.ascontiguousarray(p_W), places)
    return places


@kernel
def _find_nearest(s, p, z, p_W, places):
    for i in range(p_W.shape[0]):
        places[i, 0], places[i, 1] = _nearest(s, p, z, p_W[i])


@kernel
def _nearest(s, p, z, p_W):
    """Arc length [m] and distance [m], for the samples of a path: `s` (N,), `p` (N, 3) and `z` (N, 3)."""
    count = s.shape[0]
    gap, squares = np.empty((count, 3)), np.empty(count)
    at = 0
    for i in range(count):
        depth = 0.0
        for k in range(3):
            gap[i, k] = p_W[k] - p[i, k]
            depth += gap[i, k] * z[i, k]
        squares[i] = 0.0
        for k in range(3):
            gap[i, k] -= depth * z[i, k]
            squares[i] += gap[i, k] * gap[i, k]
        if squares[i] < squares[at]:
            at = i
    best, distance = s[at], np.sqrt(squares[at])

    # Between the samples, before and after the nearest one.
    for a in range(max(at - 1, 0), min(at + 1, count - 1)):
        length = ahead = 0.0
        for k in range(3):
            along = p[a + 1, k] - p[a, k]
            length += along * along
            ahead += gap[a, k] * along
        share = min(max(ahead / length, 0.0), 1.0)
        off = 0.0
        for k in range(3):
            off += (gap[a, k] - share * (p[a + 1, k] - p[a, k])) ** 2
        off = np.sqrt(off)
        if off < distance:
            best, distance = s[a] + share * (s[a + 1] - s[a]), off
    return best, distance

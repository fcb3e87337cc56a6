"""Judgement of work in progress, step by step, by the rules and bounds of a run's figures."""

import math

import numpy as np

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.surface.force_levels import is_lost, unsettled
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array


class RunningForce:
    """Error of the true normal force from one set force, by the definition of `contact_figures`.

    The error counts once the force has settled after `start`.
    """

    def __init__(self, set_force: float, bounds: Bounds) -> None:
        """Take the set force [N] and the bounds of the force error."""
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
        """Root mean square error [N] of the settled steps; 0 before the first of them."""
        return math.sqrt(self._squares / self._judged) if self._judged else 0.0

    def add(self, normal: float, least: float, most: float, dt: float) -> str:
        """A step of `dt` [s], with the mean, smallest and largest normal force [N] in it.

        Returns:
        Message of an error out of bounds in a settled step; empty if there is none.
        """
        self.since += dt
        if self.since < unsettled(0.0):
            return ""

        error = normal - self.set_force
        self._judged += dt
        self._squares += dt * error * error

        # Same as `force_peak`, which takes arrays.
        peak = max(abs(most - self.set_force), abs(least - self.set_force))
        self.peak = max(self.peak, peak)

        if is_lost(least):
            return "contact lost"
        return f"force error {peak:.1f} N" if peak > self.bounds.force_error_max else ""

    def missed(self) -> str:
        """Message of a root mean square error out of bounds over all settled steps; empty if there
        is none.
        """
        rms = self.rms
        return f"force error {rms:.1f} N RMS" if rms > self.bounds.force_error_rms else ""


def place_on_path(path: ToolPath, p_W: Array) -> tuple[float, float]:
    """Arc length [m] of the point of a path nearest to a tip (3,) [m], and the distance [m] between
    them.

    The distance is measured across the path's tool axes, so that the depth of the tool does not
    count.
    """
    ((s, distance),) = places_on_path(path, p_W[None]).tolist()
    return s, distance


def places_on_path(path: ToolPath, p_W: Array) -> Array:
    """Arc lengths and distances (N, 2) [m] of tips (N, 3) [m], as defined in `place_on_path`."""
    places = np.empty((len(p_W), 2))
    _find_nearest(path.s, path.p, path.z, np.ascontiguousarray(p_W), places)
    return places


@kernel
def _find_nearest(s, p, z, p_W, places):
    for i in range(p_W.shape[0]):
        places[i, 0], places[i, 1] = _nearest(s, p, z, p_W[i])


@kernel
def _nearest(s, p, z, p_W):
    """Arc length [m] and distance [m] for a path sampled at `s` (N,), with points `p` and axes `z`
    (N, 3).
    """
    at = 0
    least = np.inf
    for i in range(s.shape[0]):
        gap = _across(p, z, p_W, i)
        square = _dot(gap, gap)
        if square < least:
            at = i
            least = square

    best = s[at]
    distance = np.sqrt(least)

    # Between the samples, before and after the nearest one.
    for a in range(max(at - 1, 0), min(at + 1, s.shape[0] - 1)):
        gap = _across(p, z, p_W, a)
        way = p[a + 1, 0] - p[a, 0], p[a + 1, 1] - p[a, 1], p[a + 1, 2] - p[a, 2]
        share = min(max(_dot(gap, way) / _dot(way, way), 0.0), 1.0)
        rest = gap[0] - share * way[0], gap[1] - share * way[1], gap[2] - share * way[2]
        off = np.sqrt(_dot(rest, rest))
        if off < distance:
            best = s[a] + share * (s[a + 1] - s[a])
            distance = off

    return best, distance


@kernel
def _across(p, z, p_W, i):
    """Displacement [m] (3,) from sample `i` to a tip, across the tool axis there."""
    gap = p_W[0] - p[i, 0], p_W[1] - p[i, 1], p_W[2] - p[i, 2]
    depth = _dot(gap, z[i])
    return gap[0] - depth * z[i, 0], gap[1] - depth * z[i, 1], gap[2] - depth * z[i, 2]


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

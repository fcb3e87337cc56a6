"""Judgement of work that goes on, step by step, by the rules and limits of a run's figures."""

import math

import numpy as np

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.force_levels import is_lost, unsettled
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

        peak = max(abs(most - self.set_force), abs(least - self.set_force))  # `force_peak` of one step
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
    at, least = 0, np.inf
    for i in range(s.shape[0]):
        square = _square(_across(p, z, p_W, i))
        if square < least:
            at, least = i, square
    best, distance = s[at], np.sqrt(least)

    # Between the samples, before and after the nearest one.
    for a in range(max(at - 1, 0), min(at + 1, s.shape[0] - 1)):
        gap = _across(p, z, p_W, a)
        x, y, w = p[a + 1, 0] - p[a, 0], p[a + 1, 1] - p[a, 1], p[a + 1, 2] - p[a, 2]
        share = (gap[0] * x + gap[1] * y + gap[2] * w) / (x * x + y * y + w * w)
        share = min(max(share, 0.0), 1.0)
        off = np.sqrt(_square((gap[0] - share * x, gap[1] - share * y, gap[2] - share * w)))
        if off < distance:
            best, distance = s[a] + share * (s[a + 1] - s[a]), off
    return best, distance


@kernel
def _across(p, z, p_W, i):
    """Way [m] from sample `i` to a tip, across the tool axis there."""
    x, y, w = p_W[0] - p[i, 0], p_W[1] - p[i, 1], p_W[2] - p[i, 2]
    depth = x * z[i, 0] + y * z[i, 1] + w * z[i, 2]
    return x - depth * z[i, 0], y - depth * z[i, 1], w - depth * z[i, 2]


@kernel
def _square(v):
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]

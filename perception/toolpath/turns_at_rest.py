"""Corners in which a tool that is not round stops and turns: steps of its second axis along a path, and their time.

Splines swing beyond a step. So a path's axes are splined without their steps, which are put back at their places, and
at last the place of each step becomes a part of the path on which the tool stays and only turns.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim.interfaces.messages import ToolPath
from sim.interfaces.spatial import Array, readonly

STEP = 0.35  # [rad] by which the axis turns between two points, from which on the tool turns at rest
_LENGTH = 0.02  # [m] by which a path's s grows in a turn of 1 rad, as if the tool moved
_EACH = 0.05  # [rad] between two samples of a turn


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Steps of the second axis along a path, about the tool axis."""

    after: np.ndarray  # (K,) int index of the last point before each
    angle: Array  # (K,) [rad] right-handed about the tool axis

    @classmethod
    def of(cls, z: Array, x: Array) -> "Steps":
        """Steps between neighbours of `x` (n, 3), unit and across the unit axes `z` (n, 3), beyond STEP."""
        moved = x[:-1] - np.sum(x[:-1] * z[1:], axis=1, keepdims=True) * z[1:]  # as it would be without a turn
        angle = np.arctan2(np.sum(np.cross(moved, x[1:]) * z[1:], axis=1), np.sum(moved * x[1:], axis=1))
        after = np.flatnonzero(np.abs(angle) > STEP)
        return cls(after, angle[after])

    def taken_out(self, z: Array, x: Array) -> Array:
        """`x` (n, 3) as it would be without the steps."""
        return self._turned(z, x, -1.0, np.arange(len(x)))

    def put_back(self, z: Array, x: Array, at: np.ndarray) -> Array:
        """`x` (m, 3) with the steps, `at` (m,) being the index of each of its points among those of the path."""
        return self._turned(z, x, 1.0, at)

    def _turned(self, z: Array, x: Array, sign: float, at: np.ndarray) -> Array:
        return _rotated(z, x, sign * np.sum(np.where(at[:, None] > self.after, self.angle, 0.0), axis=1))


NO_STEPS = Steps(np.zeros(0, dtype=np.int64), np.zeros(0))


def turning_at_rest(path: ToolPath) -> ToolPath:
    """`path`, with a part for each step of its x on which the tool stays in its place and turns."""
    steps = Steps.of(path.z, path.x)
    if not len(steps.after):
        return path
    count = np.ones(len(path.s), dtype=np.int64)
    count[steps.after] += np.ceil(np.abs(steps.angle) / _EACH).astype(np.int64)
    row = np.repeat(np.arange(len(path.s)), count)
    turned = np.zeros(len(row))
    for last, angle, first in zip(
        steps.after, steps.angle, np.cumsum(count)[steps.after] - count[steps.after], strict=True
    ):
        turned[first : first + count[last]] = np.linspace(0.0, angle, count[last])
    s, z, x = path.s[row], path.z[row], path.x[row]
    longer = np.diff(turned, prepend=0.0)
    longer[np.concatenate([[True], np.diff(row) > 0])] = 0.0  # the first point of each row is the path's own
    return replace(
        path,
        s=readonly(s + _LENGTH * np.cumsum(np.abs(longer))),
        p=readonly(path.p[row]),
        z=readonly(z),
        x=readonly(_rotated(z, x, turned)),
        on_scan=path.on_scan[row],
        fits=None if path.fits is None else path.fits[row],
    )


def _rotated(z: Array, x: Array, angle: Array) -> Array:
    """`x` (n, 3) turned about `z` (n, 3) by `angle` (n,) [rad]."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return c * x + s * np.cross(z, x) + (1.0 - c) * np.sum(z * x, axis=1, keepdims=True) * z

"""Steps of the second axis along a path, at corners in which a tool that is not round stops and
turns.

Such an axis cannot be interpolated across a step, because splines overshoot. The steps are
therefore removed, the axis is interpolated, and the steps are put back at their positions.
"""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.spatial import Array

# [rad] angle between the axes of two points, from which on the tool stops and turns
STEP = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Steps of the second axis along a path, about the tool axis."""

    after: np.ndarray  # (K,) int index of the last point before each step
    angle: Array  # (K,) [rad] angle of each step, right-handed about the tool axis

    @classmethod
    def of(cls, z: Array, x: Array) -> "Steps":
        """Steps beyond STEP between neighbours of `x` (n, 3), unit, across unit axes `z` (n, 3)."""
        # the next axis if the tool did not turn
        moved = x[:-1] - np.sum(x[:-1] * z[1:], axis=1, keepdims=True) * z[1:]
        angle = np.arctan2(
            np.sum(np.cross(moved, x[1:]) * z[1:], axis=1), np.sum(moved * x[1:], axis=1)
        )

        after = np.flatnonzero(np.abs(angle) > STEP)
        return cls(after, angle[after])

    def taken_out(self, z: Array, x: Array) -> Array:
        """`x` (n, 3) as it would be without the steps."""
        return self._turned(z, x, -1.0, np.arange(len(x)))

    def put_back(self, z: Array, x: Array, at: np.ndarray) -> Array:
        """`x` (m, 3) with the steps put back; `at` (m,) are the indices of its points in the
        path.
        """
        return self._turned(z, x, 1.0, at)

    def _turned(self, z: Array, x: Array, sign: float, at: np.ndarray) -> Array:
        return rotated(
            z, x, sign * np.sum(np.where(at[:, None] > self.after, self.angle, 0.0), axis=1)
        )


NO_STEPS = Steps(np.zeros(0, dtype=np.int64), np.zeros(0))


def rotated(z: Array, x: Array, angle: Array) -> Array:
    """`x` (n, 3) turned about `z` (n, 3) by `angle` (n,) [rad]."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return c * x + s * np.cross(z, x) + (1.0 - c) * np.sum(z * x, axis=1, keepdims=True) * z

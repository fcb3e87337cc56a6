"""Soil reaction on a penetrating tool: elastic up to a quake, then plastic at the resistance of `uuv.models.site.soil`.

As in pile driving [Smith 1960], the soil yields elastically up to a quake and then flows. The force-free position of
the tool, the anchor, is then dragged along. Along the tool the resistances are those of pushing and pulling, across it
that of sideways motion. The three depend on the depth only, not on each other or on speed. A tool that leaves the soil
leaves a hole: there is no force until it enters the soil elsewhere.
"""

from typing import NamedTuple

import numpy as np

from uuv.models.site.seabed import Seabed
from uuv.models.site.soil import Soil, SoilTool, pull_resistance, push_resistance, side_resistance
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_TABLE = 512  # number of depths at which the resistances are tabulated
_DEEPEST = 0.5  # [m] largest tabulated depth


class _Soil(NamedTuple):
    """The ground for the kernel, and the state of the plastic flow."""

    heights: Array  # (k, k) [m] over `corner`
    corner: Array  # (3,) [m] least x and y of the grid, and height zero
    cell: float  # [m]
    bounds: Array  # (3, N) [N] resistance to pushing, pulling and sideways motion
    step: float  # [m] of depth between columns of `bounds`
    quake: float  # [m]
    anchor: Array  # (3,) [m] force-free position of the tool
    inside: np.ndarray  # (1,) bool: the tool is in the soil


class SoilForce:
    """Force of the soil under `ground` on the tip of one tool; its state is the anchor of the plastic flow."""

    def __init__(self, ground: Seabed, soil: Soil, tool: SoilTool) -> None:
        d = np.linspace(0.0, _DEEPEST, _TABLE)
        bounds = np.stack([resist(soil, tool, d) for resist in _RESISTANCES])
        bounds[0, 0] = soil.tip_factor * tool.edge * soil.cone  # the edge meets resistance at depth zero
        self._soil = _Soil(
            heights=np.array(ground.heights),
            corner=ground.center_W - [ground.half, ground.half, 0.0],
            cell=ground.step,
            bounds=bounds,
            step=float(d[1]),
            quake=soil.quake,
            anchor=np.zeros(3),
            inside=np.zeros(1, dtype=np.bool_),
        )
        self._as_tuple = tuple(self._soil)  # goes to the kernel faster
        self._force = np.zeros(3)

    def reset(self) -> None:
        """Set the tool to be outside the soil."""
        self._soil.inside[0] = False

    def save(self) -> tuple[Array, np.ndarray]:
        """Anchor, and whether the tool is inside, as they are: to be copied before the next step."""
        return self._soil.anchor, self._soil.inside

    def resume(self, saved: tuple[Array, np.ndarray]) -> None:
        """Go on from what `save` of an equal soil returned."""
        self._soil.anchor[:], self._soil.inside[:] = saved

    def step(self, p_W: Array, axis_W: Array) -> Array:
        """Force (3,) [N] in W on the tip at `p_W` (3,) [m]; `axis_W` (3,) is the unit axis out of the tool.

        The returned array is overwritten by the next call.
        """
        _press(self._as_tuple, p_W, axis_W, self._force)
        return self._force


_RESISTANCES = (push_resistance, pull_resistance, side_resistance)


@kernel
def _press(soil, p, axis, force):
    heights, corner, cell, bounds, step, quake, anchor, inside = soil
    force[:] = 0.0
    depth = _height(heights, corner, cell, p[0], p[1]) - p[2]
    if not depth > 0.0:  # also NaN, outside the grid
        inside[0] = False
        return
    if not inside[0]:
        anchor[:], inside[0] = p, True
    i = min(int(depth / step), bounds.shape[1] - 2)
    share = min(depth / step - i, 1.0)
    push = bounds[0, i] + share * (bounds[0, i + 1] - bounds[0, i])
    pull = bounds[1, i] + share * (bounds[1, i + 1] - bounds[1, i])
    side = bounds[2, i] + share * (bounds[2, i + 1] - bounds[2, i])
    along = 0.0
    for k in range(3):
        along += (p[k] - anchor[k]) * axis[k]
    least = -quake * pull / push if push > 0.0 else 0.0  # same stiffness in both directions
    held = min(max(along, least), quake)
    across = 0.0
    for k in range(3):
        across += (p[k] - anchor[k] - along * axis[k]) ** 2
    across = np.sqrt(across)
    kept = min(1.0, quake / across) if across > 0.0 else 0.0
    for k in range(3):
        aside = kept * (p[k] - anchor[k] - along * axis[k])
        force[k] = -(push * held * axis[k] + side * aside) / quake
        anchor[k] = p[k] - held * axis[k] - aside


@kernel
def _height(heights, corner, cell, x, y):
    """Height at one point, as `uuv.models.site.seabed.Seabed.height` computes it."""
    last = heights.shape[0] - 1
    u, v = (x - corner[0]) / cell, (y - corner[1]) / cell
    if not (0.0 <= u <= last and 0.0 <= v <= last):
        return np.nan
    i, j = min(int(u), last - 1), min(int(v), last - 1)
    u, v = u - i, v - j
    a, b = heights[j, i], heights[j, i + 1]
    c, d = heights[j + 1, i + 1], heights[j + 1, i]
    z = a + u * (b - a) + v * (c - b) if v <= u else a + v * (d - a) + u * (c - d)
    return z + corner[2]

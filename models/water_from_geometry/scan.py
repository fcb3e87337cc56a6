"""Scan of solids by a grid of lines, which gives where each line enters and leaves the union of
closed shells.

Along a line the signed crossings are summed. A point is in the union if the sum is positive.
Overlapping shells therefore count once, and a cavity whose shell was turned outward is filled.
Volume and centre are exact along the lines, and the projected area is the area of the lines that
meet the union.
"""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_FEWEST = 64  # least number of lines along the shorter side


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineScan:
    """Crossings of the union's surface by parallel lines, line by line: entry, exit, entry, ..."""

    axis: int  # axis along which the lines run
    line: np.ndarray  # (C,) index of the crossing's line, i * len(v) + j
    at: Array  # (C,) [m] position along the axis
    triangle: np.ndarray  # (C,) index of the crossed triangle
    u: Array  # (U,) [m] positions of the lines on the axis after `axis`
    v: Array  # (V,) [m] positions of the lines on the axis after that
    cell: float  # [m^2] area that each line represents
    disjoint: bool  # True: no line is within two shells at once

    @property
    def volume(self) -> float:
        """Volume [m^3] of the union."""
        return self.cell * float(np.sum(self.at[1::2] - self.at[::2]))

    @property
    def moment(self) -> Array:
        """Volume times centre (3,) [m^4] of the union."""
        start = self.at[::2]
        end = self.at[1::2]
        i, j = np.divmod(self.line[::2], len(self.v))

        out = np.zeros(3)
        out[self.axis] = 0.5 * float(np.sum(end**2 - start**2))
        out[(self.axis + 1) % 3] = float(np.sum(self.u[i] * (end - start)))
        out[(self.axis + 2) % 3] = float(np.sum(self.v[j] * (end - start)))

        return self.cell * out

    @property
    def outer(self) -> np.ndarray:
        """Mask (C,) of the first and the last crossing of each line, which a flow along the axis
        meets.
        """
        first = np.ones(len(self.line), dtype=bool)
        first[1:] = self.line[1:] != self.line[:-1]
        last = np.ones(len(self.line), dtype=bool)
        last[:-1] = first[1:]
        return first | last

    @property
    def area(self) -> float:
        """Projected area [m^2] of the union along the axis."""
        return self.cell * len(np.unique(self.line))


def scanned(corners: Array, lines: int, axis: int) -> LineScan:
    """Scan triangles along an axis.

    Args:
        corners: (T, 3, 3) [m] of closed shells, each counter-clockwise from outside.
        lines: number over the longer side of the bounding box.
        axis: 0 to 2.
    """
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    a = (axis + 1) % 3
    b = (axis + 2) % 3

    # Lines through the middles of equal cells.
    step = max(high[a] - low[a], high[b] - low[b]) / lines
    count = [max(_FEWEST, int(np.ceil((high[k] - low[k]) / step))) for k in (a, b)]
    steps = [(high[k] - low[k]) / n for k, n in zip((a, b), count, strict=True)]
    u, v = (low[k] + (np.arange(n) + 0.5) * d for k, n, d in zip((a, b), count, steps, strict=True))
    return along_lines(corners, axis, u, v, steps[0] * steps[1])


def along_lines(corners: Array, axis: int, u: Array, v: Array, cell: float = 0.0) -> LineScan:
    """Scan triangles (T, 3, 3) along `axis`, on lines at rising `u`, `v` on the next two axes."""
    order = [(axis + k) % 3 for k in range(3)]
    turned = np.ascontiguousarray(corners[:, :, order])
    line, at, step, triangle = _crossings(turned, u, v)

    first = np.lexsort((at, line))
    line = line[first]
    at = at[first]
    step = step[first]
    triangle = triangle[first]

    keep = _boundary(line, step)
    return LineScan(
        axis=axis,
        line=line[keep],
        at=at[keep],
        triangle=triangle[keep],
        u=u,
        v=v,
        cell=cell,
        disjoint=bool(keep.all()),
    )


@kernel
def _boundary(line: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Mask of the crossings that bound the union. A line whose sum never returns to zero ends
    early.
    """
    keep = np.zeros(len(line), dtype=np.bool_)
    k = 0
    while k < len(line):
        end = k
        inside = 0
        entry = -1

        while end < len(line) and line[end] == line[k]:
            before = inside
            inside += step[end]
            if before <= 0 < inside:
                entry = end
            elif inside <= 0 < before:
                keep[entry] = True
                keep[end] = True
            end += 1

        k = end
    return keep


@kernel
def _crossings(
    corners: Array, u: Array, v: Array
) -> tuple[np.ndarray, Array, np.ndarray, np.ndarray]:
    """All crossings: line, position on the first axis, +1 for entry or -1 for exit, triangle."""
    line = np.empty(0, dtype=np.int64)
    at = np.empty(0)
    step = np.empty(0, dtype=np.int64)
    triangle = np.empty(0, dtype=np.int64)

    for fill in range(2):  # counted first
        n = 0
        for t in range(len(corners)):
            p = corners[t]
            i0 = np.searchsorted(u, min(p[0, 1], p[1, 1], p[2, 1]))
            i1 = np.searchsorted(u, max(p[0, 1], p[1, 1], p[2, 1]), side="right")
            j0 = np.searchsorted(v, min(p[0, 2], p[1, 2], p[2, 2]))
            j1 = np.searchsorted(v, max(p[0, 2], p[1, 2], p[2, 2]), side="right")

            # Lines within the triangle's bounding box.
            for i in range(i0, i1):
                for j in range(j0, j1):
                    w0 = _side(p[1], p[2], u[i], v[j])
                    w1 = _side(p[2], p[0], u[i], v[j])
                    w2 = _side(p[0], p[1], u[i], v[j])
                    positive = w0 > 0.0 and w1 > 0.0 and w2 > 0.0
                    negative = w0 < 0.0 and w1 < 0.0 and w2 < 0.0
                    if not (positive or negative):
                        continue

                    if fill:
                        line[n] = i * len(v) + j
                        at[n] = (w0 * p[0, 0] + w1 * p[1, 0] + w2 * p[2, 0]) / (w0 + w1 + w2)
                        # the normal points along the line, so the line leaves
                        step[n] = -1 if positive else 1
                        triangle[n] = t
                    n += 1

        if not fill:
            line = np.empty(n, dtype=np.int64)
            at = np.empty(n)
            step = np.empty(n, dtype=np.int64)
            triangle = np.empty(n, dtype=np.int64)
    return line, at, step, triangle


@kernel
def _side(p: Array, q: Array, u: float, v: float) -> float:
    """Twice the area of (p, q, point), never zero and opposite for (q, p), so that exactly one
    neighbour counts.
    """
    swapped = p[1] > q[1] or (p[1] == q[1] and p[2] > q[2])
    a, b = (q, p) if swapped else (p, q)
    w = (b[1] - a[1]) * (v - a[2]) - (b[2] - a[2]) * (u - a[1])
    if w == 0.0:
        w = 1e-300
    return -w if swapped else w

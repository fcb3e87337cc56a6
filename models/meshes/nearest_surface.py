"""Nearest point on a triangle mesh, exact in double precision, by a tree of bounding boxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_LEAF = 4  # largest number of triangles in a leaf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nearest:
    """Nearest points of a mesh to given points."""

    distance: Array  # (N,) [m], never negative
    point: Array  # (N, 3) [m] on the mesh
    triangle: np.ndarray  # (N,) index of a triangle that contains the point
    weights: Array  # (N, 3) barycentric, at that triangle's corners


@dataclass(frozen=True, slots=True, eq=False)
class NearestSurface:
    """Bounding-box tree of a mesh for nearest-point queries; made by `of`."""

    corners: Array  # (T, 3, 3) [m] triangle corners, in the order of the boxes
    order: np.ndarray  # (T,) original index of each triangle
    boxes: Array  # (B, 6) [m] lowest and highest corner of each box
    spans: np.ndarray  # (B, 3) leaf: first and last + 1 triangle, -1; else: two child boxes, 0

    @classmethod
    def of(cls, vertices: ArrayLike, triangles: ArrayLike) -> "NearestSurface":
        """Build the tree from finite vertices (V, 3) [m] and triangles (T, 3), T >= 1."""
        corners = np.asarray(vertices, dtype=np.float64)[np.asarray(triangles)]
        order, boxes, spans = _tree(corners)
        return cls(corners[order], order, boxes, spans)

    def query(self, points: ArrayLike) -> Nearest:
        """Nearest point on the mesh to each of `points` (N, 3) [m], finite with finite squares."""
        queries = np.ascontiguousarray(points, dtype=np.float64)
        at = np.zeros(len(queries), dtype=np.int64)
        weights = np.zeros((len(queries), 3))
        _search(queries, self.corners, self.boxes, self.spans, at, weights)
        point = np.einsum("nk,nkj->nj", weights, self.corners[at])
        distance = np.linalg.norm(queries - point, axis=1)
        return Nearest(distance=distance, point=point, triangle=self.order[at], weights=weights)


@kernel
def _tree(corners: Array) -> tuple[np.ndarray, Array, np.ndarray]:
    """Order (T,), boxes (B, 6) and spans (B, 3) of a tree whose boxes are halved along the longest
    side.
    """
    count = len(corners)
    order = np.arange(count)
    middles = np.empty((count, 3))
    for n in range(count):
        for a in range(3):
            middles[n, a] = (corners[n, 0, a] + corners[n, 1, a] + corners[n, 2, a]) / 3.0

    boxes = np.empty((2 * count, 6))
    spans = np.zeros((2 * count, 3), dtype=np.int64)
    allocated = 1
    waiting = [(0, 0, count)]
    while len(waiting) > 0:
        box, first, end = waiting.pop()
        widest = -1.0
        side = 0

        # Box of the triangles, and the axis along which their middles spread most.
        for a in range(3):
            boxes[box, a] = np.inf
            boxes[box, a + 3] = -np.inf
            low = np.inf
            high = -np.inf
            for n in order[first:end]:
                low = min(low, middles[n, a])
                high = max(high, middles[n, a])
                for k in range(3):
                    boxes[box, a] = min(boxes[box, a], corners[n, k, a])
                    boxes[box, a + 3] = max(boxes[box, a + 3], corners[n, k, a])
            if high - low > widest:
                widest = high - low
                side = a

        if end - first <= _LEAF:
            spans[box] = np.array([first, end, -1])
            continue

        # Two halves, split at the middles along that axis.
        part = order[first:end].copy()
        order[first:end] = part[np.argsort(middles[part, side], kind="mergesort")]
        half = (first + end) // 2
        spans[box, 0] = allocated
        spans[box, 1] = allocated + 1
        waiting.append((allocated, first, half))
        waiting.append((allocated + 1, half, end))
        allocated += 2

    return order, boxes[:allocated].copy(), spans[:allocated].copy()


@kernel
def _search(
    points: Array, corners: Array, boxes: Array, spans: np.ndarray, at: np.ndarray, weights: Array
) -> None:
    """Write the index `at` (N,) of each point's nearest triangle, and weights (N, 3) there."""
    waiting = np.empty(128, dtype=np.int64)
    away = np.empty(128)

    # Depth first, the nearer child first; a box farther than the best distance is skipped.
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        best = np.inf
        waiting[0] = 0
        away[0] = 0.0
        depth = 1
        while depth > 0:
            depth -= 1
            if away[depth] >= best:
                continue
            box = waiting[depth]
            first = spans[box, 0]
            second = spans[box, 1]
            if spans[box, 2] < 0:
                for t in range(first, second):
                    u, v, w, square = _on_triangle(x, y, z, corners[t])
                    if square < best:
                        best = square
                        at[n] = t
                        weights[n, 0] = u
                        weights[n, 1] = v
                        weights[n, 2] = w
                continue

            near = _from_box(x, y, z, boxes[first])
            far = _from_box(x, y, z, boxes[second])
            if near > far:
                first, second, near, far = second, first, far, near
            waiting[depth] = second
            away[depth] = far
            waiting[depth + 1] = first
            away[depth + 1] = near
            depth += 2


@kernel
def _from_box(x: float, y: float, z: float, box: Array) -> float:
    """Squared distance of a point from a box."""
    a = max(box[0] - x, x - box[3], 0.0)
    b = max(box[1] - y, y - box[4], 0.0)
    c = max(box[2] - z, z - box[5], 0.0)
    return a * a + b * b + c * c


@kernel
def _on_triangle(x: float, y: float, z: float, corner: Array) -> tuple[float, float, float, float]:
    """Barycentric weights of the point of a triangle (3, 3) nearest to x, y, z, and its squared
    distance.
    """
    # Two sides, and the point, from the first corner.
    ax, ay, az = (
        corner[1, 0] - corner[0, 0],
        corner[1, 1] - corner[0, 1],
        corner[1, 2] - corner[0, 2],
    )
    bx, by, bz = (
        corner[2, 0] - corner[0, 0],
        corner[2, 1] - corner[0, 1],
        corner[2, 2] - corner[0, 2],
    )
    px, py, pz = x - corner[0, 0], y - corner[0, 1], z - corner[0, 2]

    # Normal equations of the projection onto the plane.
    aa = ax * ax + ay * ay + az * az
    ab = ax * bx + ay * by + az * bz
    bb = bx * bx + by * by + bz * bz
    pa = px * ax + py * ay + pz * az
    pb = px * bx + py * by + pz * bz
    area = aa * bb - ab * ab
    if area > 1e-14 * aa * bb:
        v = (bb * pa - ab * pb) / area
        w = (aa * pb - ab * pa) / area
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            ex, ey, ez = px - v * ax - w * bx, py - v * ay - w * by, pz - v * az - w * bz
            return 1.0 - v - w, v, w, ex * ex + ey * ey + ez * ez

    # Projection outside the triangle, or no area: the nearest point is on an edge.
    u = 1.0
    v = 0.0
    w = 0.0
    best = np.inf
    for side in range(3):
        i = side
        j = (side + 1) % 3
        sx, sy, sz = (
            corner[j, 0] - corner[i, 0],
            corner[j, 1] - corner[i, 1],
            corner[j, 2] - corner[i, 2],
        )
        qx, qy, qz = x - corner[i, 0], y - corner[i, 1], z - corner[i, 2]
        length = sx * sx + sy * sy + sz * sz
        along = 0.0 if length == 0.0 else min(max((qx * sx + qy * sy + qz * sz) / length, 0.0), 1.0)
        ex, ey, ez = qx - along * sx, qy - along * sy, qz - along * sz
        square = ex * ex + ey * ey + ez * ez

        if square < best:
            best = square
            u = (1.0 - along) * (i == 0) + along * (j == 0)
            v = (1.0 - along) * (i == 1) + along * (j == 1)
            w = (1.0 - along) * (i == 2) + along * (j == 2)

    return u, v, w, best

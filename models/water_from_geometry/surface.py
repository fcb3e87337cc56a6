"""One closed surface around a union of shells, with about a desired number of triangles.

Dual contouring [Ju 2002]: a grid's points are inside or outside the union; where they differ, the
exact crossing of the edge and its normal are known. Each cell that the surface passes through gets
the vertex that fits these planes best, so that edges and corners of boxes stay sharp. The remaining
error of the volume is corrected by a uniform offset.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uuv.models.meshes.closed_shells import vertex_normals, volume
from uuv.models.water_from_geometry.scan import LineScan, along_lines, scanned
from uuv.sim.interfaces.spatial import Array, exp_so3

_THIN = 4.0  # root of the number of triangles, over the number of cells across the shortest side
_FEWEST_CELLS = 6  # least number of cells across the shortest side
_MOST_CELLS = 220  # largest number of cells along a side
_SOFT = 0.02  # weight of the mean of the crossings, relative to their planes
_ROUNDS = 6  # rounds of adapting the cell to the desired number of triangles
_LINES = 120  # number of lines across the longer side, for projected areas and plates
_ASKEW = 0.4  # [rad] angle of that grid about the axis
_PLATE = 0.01  # share of all lines through a union that must meet a plate
_FACING = 0.95  # cosine between an axis and the normal of a plate perpendicular to it
_ALIKE = 1.0 + 1e-6  # ratio of two diagonals that count as equal, so that rounding does not decide
# volume of a surface before its offset over the true one, within which the surface is accepted
_HELD = (0.85, 1.15)
_PAD = 0.37  # distance between the union and the first points of the grid, in cells


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnionSurface:
    """Closed surface of a union."""

    vertices: Array  # (V, 3) [m]
    triangles: np.ndarray  # (T, 3), counter-clockwise from outside
    held: float  # ratio of the volume before the offset to that of the union
    # largest relative difference of the surface's projected areas along three axes from those of
    # the union
    missed: float

    @property
    def holds_body(self) -> bool:
        """True if the volume before the offset is near that of the union."""
        return _HELD[0] < self.held < _HELD[1]


def union_surface(corners: Array, true_volume: float, panels: int) -> UnionSurface:
    """Surface of about `panels` triangles around the union of shells.

    Args:
        corners: (T, 3, 3) [m] of closed shells, each counter-clockwise from outside.
        true_volume: [m^3] volume of the union.
        panels: desired number of triangles.

    Returns:
        The surface. It is empty if no point of the grid is inside.
    """
    R = box_axes(corners)
    turned = corners @ R
    low = turned.min(axis=(0, 1))
    high = turned.max(axis=(0, 1))
    extent = high - low
    x, y, z = extent
    cell = float(np.sqrt(4.0 * (x * y + y * z + z * x) / panels))

    # The cell is adapted until the number of triangles is about the desired one.
    best: tuple[float, Array, np.ndarray] | None = None
    for _ in range(_ROUNDS):
        vertices, triangles = _contour(
            turned, low, extent, cell, max(_FEWEST_CELLS, round(np.sqrt(panels) / _THIN))
        )
        miss = abs(np.log(max(len(triangles), 1) / panels))
        if best is None or miss < best[0]:
            best = miss, vertices, triangles
        if miss < 0.1:
            break
        cell *= float(np.clip(np.sqrt(max(len(triangles), 1) / panels), 0.5, 1.6))

    assert best is not None
    _, vertices, triangles = best
    if not len(triangles):
        return UnionSurface(vertices=vertices, triangles=triangles, held=0.0, missed=1.0)
    held = volume(vertices, triangles) / true_volume

    # The missing volume is corrected by a uniform offset.
    for _ in range(3):  # an offset changes the area
        a, b, c = vertices[triangles].transpose(1, 0, 2)
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        lacking = (true_volume - volume(vertices, triangles)) / area
        limit = 0.2 * cell
        vertices = vertices + np.clip(lacking, -limit, limit) * vertex_normals(vertices, triangles)

    missed = max(
        abs(projected_area(vertices[triangles], axis) / projected_area(turned, axis) - 1.0)
        for axis in range(3)
    )
    return UnionSurface(vertices=vertices @ R.T, triangles=triangles, held=held, missed=missed)


def projected_area(corners: Array, axis: int) -> float:
    """Projected area [m^2] of the union of shells (T, 3, 3) along an axis, by a grid of lines."""
    return scanned(corners @ exp_so3(_ASKEW * np.eye(3)[axis]), _LINES, axis).area


def box_axes(corners: Array) -> Array:
    """Axes (3, 3), in columns, along which shells (T, 3, 3) are measured.

    They are the axes of the body, or the principal axes if those have a clearly smaller box.
    """
    a, b, c = corners.transpose(1, 0, 2)
    weight = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    middles = corners.mean(axis=1)
    spread = middles - np.average(middles, axis=0, weights=weight)
    R = np.linalg.eigh((spread * weight[:, None]).T @ spread)[1]
    R[:, 2] *= np.sign(np.linalg.det(R))

    points = corners.reshape(-1, 3)
    own_box = np.prod(np.ptp(points, axis=0))
    principal = np.prod(np.ptp(points @ R, axis=0))
    return R if principal < 0.8 * own_box else np.eye(3)


def _contour(
    corners: Array, low: Array, extent: Array, cell: float, fewest: int
) -> tuple[Array, np.ndarray]:
    """Dual contour of the union on cells of about `cell` [m], at least `fewest` along a side."""
    counts = np.clip(np.ceil(extent / cell), fewest, _MOST_CELLS).astype(int)
    a, b, c = corners.transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    grid = []
    for k in range(3):
        step = extent[k] / (counts[k] - 1 + 2.0 * _PAD)
        positions = low[k] + (np.arange(counts[k] + 3) - 2.0 + _PAD + 0.013 * (k + 1)) * step
        grid.append(
            _through_plates(positions, step, scanned(corners, _LINES, k), np.abs(normals[:, k]))
        )

    scans = [along_lines(corners, k, grid[(k + 1) % 3], grid[(k + 2) % 3]) for k in range(3)]
    inside = _inside(scans[0], grid)
    return _joined(inside, grid, lambda k, index: _hermite(scans[k], grid, index, normals))


def _through_plates(places: Array, step: float, scan: LineScan, facing: Array) -> Array:
    """Move planes of a grid into thin plates, perpendicular to the axis, that would be between two
    planes.

    Args:
        places: [m] positions of the planes.
        step: [m] between planes.
        scan: lines along the axis.
        facing: (T,) cosine between the axis and the normal of each triangle.

    Returns:
        The positions, in order, with an additional one for each plate for which no plane can be
            moved.
    """
    start = scan.at[::2]
    end = scan.at[1::2]
    flat = facing[scan.triangle] > _FACING  # the rims of round parts are thin as well
    thin = (end - start < step) & flat[::2] & flat[1::2]
    if not thin.any():
        return places

    # Plates in order: neighbouring crossings belong to the same plate.
    order = np.argsort(0.5 * (start + end)[thin])
    start = start[thin][order]
    end = end[thin][order]
    middle = 0.5 * (start + end)
    first = np.flatnonzero(np.diff(middle, prepend=-np.inf) > 0.1 * step)
    lines = len(np.unique(scan.line))

    taken = np.zeros(len(places), dtype=bool)
    for i, j in zip(first, [*first[1:], len(middle)], strict=True):
        if j - i < _PLATE * lines:
            continue
        low, high, at = (float(np.median(ends[i:j])) for ends in (start, end, middle))
        inside = np.flatnonzero((places > low) & (places < high))
        if len(inside):
            taken[inside] = True
            continue

        near = int(np.argmin(np.where(taken, np.inf, np.abs(places - at))))
        if taken[near] or abs(places[near] - at) > 0.6 * step:
            k = int(np.searchsorted(places, at))
            places = np.insert(places, k, at)
            taken = np.insert(taken, k, True)
        else:
            places[near] = at
            taken[near] = True

    return np.sort(places)


def level_surface(field: Array, grid: list[Array], level: float) -> tuple[Array, np.ndarray]:
    """Closed surface around the points of a grid at which a field exceeds a level.

    Args:
        field: (X, Y, Z), below the level on the border.
        grid: [m] positions of the points along each axis.
        level: value of the field on the surface.

    Returns:
        Vertices (V, 3) [m] and triangles (T, 3), counter-clockwise from outside.
    """
    slopes = np.stack([np.gradient(field, grid[k], axis=k) for k in range(3)], axis=-1)

    def crossing(k: int, index: np.ndarray) -> tuple[Array, Array]:
        end = index + np.eye(3, dtype=np.int64)[k]
        low = field[tuple(index.T)]
        high = field[tuple(end.T)]
        share = ((level - low) / (high - low))[:, None]
        points = np.column_stack([grid[m][index[:, m]] for m in range(3)])
        points[:, k] += share[:, 0] * (grid[k][end[:, k]] - grid[k][index[:, k]])
        slope = (1.0 - share) * slopes[tuple(index.T)] + share * slopes[tuple(end.T)]
        return points, -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300)

    return _joined(field > level, grid, crossing)


def _joined(
    inside: np.ndarray,
    grid: list[Array],
    crossing: Callable[[int, np.ndarray], tuple[Array, Array]],
) -> tuple[Array, np.ndarray]:
    """Vertices in the cells that the surface passes through, and triangles around the crossed edges
    of the grid.
    """
    cells = tuple(n - 1 for n in inside.shape)
    matrix = np.zeros((*cells, 3, 3))
    target = np.zeros((*cells, 3))
    mean = np.zeros((*cells, 3))
    weight = np.zeros(cells)
    quads = []

    for k in range(3):
        p = (k + 1) % 3
        q = (k + 2) % 3
        first = [slice(None)] * 3
        second = [slice(None)] * 3
        first[k] = slice(None, -1)
        second[k] = slice(1, None)
        index = np.argwhere(inside[tuple(first)] != inside[tuple(second)])
        if not len(index):
            continue

        points, planes = crossing(k, index)
        corner = []
        for dp, dq in ((-1, -1), (0, -1), (0, 0), (-1, 0)):  # counter-clockwise about the edge
            at = index.copy()
            at[:, p] += dp
            at[:, q] += dq
            here = tuple(at.T)
            np.add.at(matrix, here, planes[:, :, None] * planes[:, None, :])
            np.add.at(target, here, planes * np.sum(planes * points, axis=1, keepdims=True))
            np.add.at(mean, here, points)
            np.add.at(weight, here, 1.0)
            corner.append(np.ravel_multi_index(here, cells))

        quad = np.column_stack(corner)
        leaving = inside[tuple(index.T)]  # the surface faces along the axis
        quads.append(np.where(leaving[:, None], quad, quad[:, ::-1]))
    if not quads:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)

    # The point of each cell that fits the planes of the cell best [Ju 2002].
    used = np.argwhere(weight > 0.0)
    here = tuple(used.T)
    middle = mean[here] / weight[here][:, None]
    A = matrix[here] + _SOFT * weight[here][:, None, None] * np.eye(3)
    r = target[here] - np.einsum("nij,nj->ni", matrix[here], middle)
    vertices = middle + np.linalg.solve(A, r[:, :, None])[:, :, 0]
    for k in range(3):
        vertices[:, k] = np.clip(vertices[:, k], grid[k][used[:, k]], grid[k][used[:, k] + 1])

    vertex_of_cell = np.zeros(int(np.prod(cells)), dtype=np.int64)
    vertex_of_cell[np.ravel_multi_index(here, cells)] = np.arange(len(used))
    return vertices, _halved(vertices, vertex_of_cell[np.vstack(quads)])


def _inside(scan: LineScan, grid: list[Array]) -> np.ndarray:
    """Mask of the grid points that are in the union, from lines along the first axis."""
    flips = np.zeros((len(grid[0]) + 1, len(grid[1]) * len(grid[2])), dtype=np.int64)
    np.add.at(flips, (np.searchsorted(grid[0], scan.at), scan.line), 1)
    odd = np.cumsum(flips[:-1], axis=0) % 2 == 1
    return odd.reshape(len(grid[0]), len(grid[1]), len(grid[2]))


def _hermite(
    scan: LineScan, grid: list[Array], index: np.ndarray, normals: Array
) -> tuple[Array, Array]:
    """Crossings and normals (n, 3) of the edges along the axis that begin at grid points `index`
    (n, 3).
    """
    k = scan.axis
    p = (scan.axis + 1) % 3
    q = (scan.axis + 2) % 3

    line = index[:, p] * len(grid[q]) + index[:, q]
    span = len(grid[k]) + 1
    key = scan.line * span + np.searchsorted(grid[k], scan.at)
    edge_key = line * span + index[:, k] + 1
    nearest = np.minimum(np.searchsorted(key, edge_key), max(len(key) - 1, 0))
    hit = key[nearest] == edge_key if len(key) else np.zeros(len(edge_key), dtype=bool)

    points = np.column_stack([grid[m][index[:, m]] for m in range(3)])
    # for edges at which the lines disagree due to rounding
    middle = 0.5 * (grid[k][index[:, k]] + grid[k][index[:, k] + 1])
    points[:, k] = np.where(hit, scan.at[nearest] if len(key) else middle, middle)

    planes = np.zeros((len(index), 3))
    planes[:, k] = 1.0
    if len(key):
        planes[hit] = normals[scan.triangle[nearest[hit]]]
    return points, planes


def _halved(vertices: Array, quads: np.ndarray) -> np.ndarray:
    """Triangles (2 n, 3) of quads (n, 4), each cut along its shorter diagonal."""
    a, b, c, d = quads.T
    one_way, other_way = (
        np.linalg.norm(vertices[p] - vertices[q], axis=1) for p, q in ((a, c), (b, d))
    )

    short = one_way <= other_way * _ALIKE
    first = np.where(short[:, None], np.column_stack([a, b, c]), np.column_stack([a, b, d]))
    second = np.where(short[:, None], np.column_stack([a, c, d]), np.column_stack([b, c, d]))
    return np.vstack([first, second])

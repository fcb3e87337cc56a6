"""Closed shells of users' meshes: welded, turned outward, and closed where they are open.

An open surface is replaced by the surface on which its winding number [Jacobson 2013] is one half:
holes are bridged smoothly. If the result encloses almost no volume, as for a bent sheet, the convex
hull is used.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from uuv.models.meshes.closed_shells import open_edges, volume, welded
from uuv.models.water_from_geometry.solid_angle import half_solid_angle
from uuv.models.water_from_geometry.surface import level_surface
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_WELD = 1e-6  # distance of vertices that are merged, as a share of the mesh's size
_CELLS = 36  # number of cells along the longest side, for the winding number
_FEW = 2500  # number of triangles for which it is summed; larger meshes are clustered
_LITTLE = 0.05  # share of the hull's volume below which a surface has no inside
_HALF = 0.5  # level of the winding number
_SPREAD = 0.2  # other levels, which show the uncertainty of the volume


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shells:
    """Closed shells, each counter-clockwise from outside; they may overlap."""

    corners: Array  # (T, 3, 3) [m]
    said: str  # description of the shells, and how they were closed
    doubt: float = 0.0  # [m^3] uncertainty of the volume that the closing causes


def shells_of(vertices: Array, triangles: np.ndarray) -> Shells:
    """Closed shells of a mesh; an empty array (0, 3, 3) if it has neither an inside nor a hull.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices, in any order of corners.
    """
    size = float(np.ptp(vertices, axis=0).max(initial=0.0))
    if not size > 0.0 or not len(triangles):
        return Shells(corners=np.zeros((0, 3, 3)), said="no surface")

    points, faces = welded(vertices, triangles, _WELD * size)
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(first)]
    faces, labels = _oriented(faces)

    closed = []
    open_faces = []
    inward = 0
    for label in range(labels.max(initial=-1) + 1):
        shell = faces[labels == label]
        if open_edges(shell):
            open_faces.append(_outward(points, shell))
            continue
        enclosed = volume(points - points[shell[0, 0]], shell)
        if abs(enclosed) < 1e-12 * size**3:
            continue
        inward += enclosed < 0.0
        closed.append(shell[:, ::-1] if enclosed < 0.0 else shell)

    parts = [points[shell] for shell in closed]
    notes = [_count(len(closed), "closed shell")] if closed else []
    if inward:
        notes.append(f"{inward} turned outward")

    doubt = 0.0
    for sort, closed_parts, doubts in _closed_all(points, open_faces):
        parts += closed_parts
        doubt += doubts
        notes.append(sort)

    corners = np.vstack(parts) if parts else np.zeros((0, 3, 3))
    return Shells(corners=corners, said=", ".join(notes) or "no inside", doubt=doubt)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _closed_all(
    points: Array, shells: list[np.ndarray]
) -> Iterator[tuple[str, list[Array], float]]:
    """Open shells, closed together if the result encloses a volume, else one by one; returns
    description, corners, uncertainty.
    """
    if not shells:
        return

    whole, doubt = _by_winding(points, np.vstack(shells))
    if whole is not None:
        yield f"{_count(len(shells), 'open surface')} closed by the winding number", [whole], doubt
        return

    wound = []
    hulls = []
    flat = 0
    doubts = [0.0, 0.0]
    for shell in shells:
        surface, doubt = _by_winding(points, shell) if len(shells) > 1 else (None, 0.0)
        if surface is not None:
            wound.append(surface)
            doubts[0] += doubt
            continue

        hull, enclosed = convex_hull(points[shell])
        if enclosed > 0.0:
            hulls.append(hull)
            doubts[1] += enclosed
        else:
            flat += 1

    if wound:
        yield f"{_count(len(wound), 'open surface')} closed by the winding number", wound, doubts[0]
    if hulls:
        yield (
            f"{_count(len(hulls), 'open surface')} without an inside, as convex hulls",
            hulls,
            doubts[1],
        )
    if flat:
        yield f"{_count(flat, 'flat surface')} left out", [], 0.0


def _oriented(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn neighbouring faces to the same side, and label (T,) the faces that are connected by
    edges of two faces.
    """
    count = len(faces)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(count), 3)
    ahead = ends[:, 0] < ends[:, 1]

    # Edges that exactly two faces share.
    key = np.sort(ends, axis=1) @ np.array([int(faces.max()) + 1, 1])
    order = np.argsort(key, kind="stable")
    _, start, times = np.unique(key[order], return_index=True, return_counts=True)
    pair = start[times == 2]
    first = order[pair]
    second = order[pair + 1]
    alike = ahead[first] != ahead[second]

    # Each face occurs twice, as it is and reversed; occurrences that agree at an edge are
    # connected.
    f = owner[first]
    g = owner[second]
    rows = np.concatenate([f, f + count])
    columns = np.concatenate([np.where(alike, g, g + count), np.where(alike, g + count, g)])
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = connected_components(graph, directed=False)

    as_is = label[:count]
    turned = label[count:]
    base = np.minimum(as_is, turned)
    flip = as_is != base
    _, joined = np.unique(base, return_inverse=True)
    return np.where(flip[:, None], faces[:, ::-1], faces), joined


def _outward(points: Array, faces: np.ndarray) -> np.ndarray:
    """An open shell, turned so that it encloses a positive volume with the cone to its middle."""
    middle = points[faces].reshape(-1, 3).mean(axis=0)
    return faces[:, ::-1] if volume(points - middle, faces) < 0.0 else faces


def convex_hull(corners: Array) -> tuple[Array, float]:
    """Corners (T, 3, 3) [m] and volume [m^3] of the convex hull of (N, 3, 3); empty and 0 if
    flat.
    """
    try:
        hull = ConvexHull(corners.reshape(-1, 3))
    except QhullError:
        return np.zeros((0, 3, 3)), 0.0

    a, b, c = hull.points[hull.simplices].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    return hull.points[np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)], float(
        hull.volume
    )


def _by_winding(points: Array, faces: np.ndarray) -> tuple[Array | None, float]:
    """Corners of a closed surface that replaces an open one, and its uncertainty [m^3]; None if
    there is none.
    """
    corners = points[faces]
    _, hull_volume = convex_hull(corners)
    if not hull_volume > 0.0:
        return None, 0.0

    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    size = float((high - low).max())

    # Large meshes are clustered.
    some_points = points
    some = faces
    merge = size / 200.0
    while len(some) > _FEW:
        some_points, some = welded(points, faces, merge)
        merge *= 1.3

    cell = size / _CELLS
    grid = [np.arange(low[k] - 1.51 * cell, high[k] + 2.0 * cell, cell) for k in range(3)]
    field = _winding(
        np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 3), some_points[some]
    )
    field = field.reshape([len(g) for g in grid])

    for axis in range(3):  # points on the border count as outside
        for end in (0, -1):
            np.moveaxis(field, axis, 0)[end] = np.minimum(np.moveaxis(field, axis, 0)[end], 0.0)

    vertices, triangles = level_surface(field, grid, _HALF)
    if not len(triangles) or volume(vertices, triangles) < _LITTLE * hull_volume:
        return None, 0.0

    more, less = ((field > _HALF + sign * _SPREAD).sum() for sign in (-1.0, 1.0))
    return vertices[triangles], 0.5 * float(more - less) * cell**3


@kernel(error_model="numpy")
def _winding(points: Array, corners: Array) -> Array:
    """Winding number (N,) of triangles (T, 3, 3) around points (N, 3)."""
    out = np.zeros(len(points))
    r = np.empty((3, 3))
    d = np.empty(3)

    for i in range(len(points)):
        total = 0.0
        for t in range(len(corners)):
            for k in range(3):
                for axis in range(3):
                    r[k, axis] = corners[t, k, axis] - points[i, axis]
                d[k] = np.sqrt(r[k, 0] ** 2 + r[k, 1] ** 2 + r[k, 2] ** 2)
            total += half_solid_angle(r, d)
        out[i] = total / (2.0 * np.pi)

    return out

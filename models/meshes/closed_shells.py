"""Closed triangle meshes of simple shapes, and their welding, volume, normals and subdivision.

Triangles wind counter-clockwise seen from outside.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, transform_points

Shell = tuple[Array, np.ndarray]  # vertices (V, 3) [m] and triangles (T, 3)

SIDES = 48  # number of sides of a round shell; the sagitta of a side is 0.2 % of the radius
_WELD = 1e-7  # [m] distance below which two vertices are merged


def revolve(profile: ArrayLike, sides: int) -> tuple[Array, np.ndarray]:
    """Closed surface of `profile` (P, 2) [m], rows (x, radius), revolved about x in `sides` steps.

    Returns:
        Vertices (V, 3) [m] and triangles (T, 3). For a profile from -x to +x, triangles are
            counter-clockwise seen from outside.

    Raises:
        ConfigurationError: the first or last radius is not 0.
    """
    x, radius = np.asarray(profile, dtype=np.float64).T
    if radius[0] != 0.0 or radius[-1] != 0.0:
        raise ConfigurationError("profile of revolution: the first and the last radius must be 0")

    # Rings of vertices between the two poles.
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring_x = x[1:-1]
    ring_r = radius[1:-1]
    rings = np.stack(
        [
            np.repeat(ring_x[:, None], sides, axis=1),
            -ring_r[:, None] * np.sin(angle),
            ring_r[:, None] * np.cos(angle),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.vstack([[x[0], 0.0, 0.0], rings, [x[-1], 0.0, 0.0]])

    # Triangles: a cap at each end, and two triangles for each side between two rings.
    i = np.arange(sides)
    j = (i + 1) % sides
    last = 1 + (len(ring_x) - 1) * sides
    faces = [np.column_stack([np.zeros_like(i), 1 + j, 1 + i])]
    for ring in range(len(ring_x) - 1):
        low = 1 + ring * sides
        high = 1 + (ring + 1) * sides
        faces.append(np.column_stack([low + i, low + j, high + i]))
        faces.append(np.column_stack([low + j, high + j, high + i]))
    faces.append(np.column_stack([last + i, last + j, np.full_like(i, len(vertices) - 1)]))
    return vertices, np.vstack(faces)


def prism(lower: ArrayLike, upper: ArrayLike) -> tuple[Array, np.ndarray]:
    """Closed surface between two convex polygons (N, 3) [m], both counter-clockwise."""
    low = np.asarray(lower, dtype=np.float64)
    high = np.asarray(upper, dtype=np.float64)
    n = len(low)
    i = np.arange(n)
    j = (i + 1) % n

    # The two polygons as fans of triangles, then the sides.
    fan = np.arange(1, n - 1)
    zero = np.zeros_like(fan)
    return np.vstack([low, high]), np.vstack(
        [
            np.column_stack([zero, fan + 1, fan]),
            np.column_stack([zero + n, fan + n, fan + 1 + n]),
            np.column_stack([i, j, n + j]),
            np.column_stack([i, n + j, n + i]),
        ]
    )


def box(size: ArrayLike, middle: ArrayLike) -> tuple[Array, np.ndarray]:
    """Closed box of `size` (3,) [m] around `middle` (3,) [m]."""
    half = 0.5 * np.asarray(size, dtype=np.float64)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
    low = np.column_stack([corners, np.full(4, -half[2])]) + middle
    return prism(low, low + np.array([0.0, 0.0, 2.0 * half[2]]))


def sphere(level: int) -> tuple[Array, np.ndarray]:
    """Unit sphere: an icosahedron whose triangles are divided in four `level` times."""
    g = 0.5 * (1.0 + np.sqrt(5.0))
    corners = [
        [-1, g, 0],
        [1, g, 0],
        [-1, -g, 0],
        [1, -g, 0],
        [0, -1, g],
        [0, 1, g],
        [0, -1, -g],
        [0, 1, -g],
    ]
    vertices = np.array(
        [*corners, [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]], dtype=np.float64
    )

    faces = "0 11 5 0 5 1 0 1 7 0 7 10 0 10 11 1 5 9 5 11 4 11 10 2 10 7 6 7 1 8"
    faces += " 3 9 4 3 4 2 3 2 6 3 6 8 3 8 9 4 9 5 2 4 11 6 2 10 8 6 7 9 8 1"
    triangles = np.array(faces.split(), dtype=np.int64).reshape(-1, 3)

    for _ in range(level):
        vertices, triangles = split(vertices, triangles, np.ones(len(triangles), dtype=bool), 0.0)
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), triangles


def cylinder(radius: float, height: float, sides: int = SIDES) -> Shell:
    """Cylinder about z around the origin, `radius` and `height` in [m]."""
    half = 0.5 * height
    profile = [(-half, 0.0), (-half, radius), (half, radius), (half, 0.0)]
    vertices, triangles = revolve(profile, sides)
    return vertices[:, [1, 2, 0]], triangles


def moved(shell: Shell, X: Array) -> Shell:
    """`shell` at the pose `X` (4, 4)."""
    return transform_points(X, shell[0]), shell[1]


def scaled(shell: Shell, scale: ArrayLike) -> Shell:
    """`shell` with its axes scaled by `scale`, one positive factor or three."""
    return shell[0] * np.asarray(scale, dtype=np.float64), shell[1]


def joined(parts: Iterable[tuple[Array, np.ndarray]]) -> tuple[Array, np.ndarray]:
    """Concatenate several meshes (vertices (V, 3), triangles (T, 3)) without welding."""
    vertices: list[Array] = []
    triangles: list[np.ndarray] = []
    count = 0
    for points, faces in parts:
        vertices.append(points)
        triangles.append(faces + count)
        count += len(points)

    return np.vstack(vertices), np.vstack(triangles)


def welded(
    vertices: ArrayLike, triangles: np.ndarray, distance: float = _WELD
) -> tuple[Array, np.ndarray]:
    """Merge vertices that are closer than about `distance`, and drop triangles that collapse.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices.
        distance: [m] grid size of the merge.

    Returns:
        The remaining vertices and triangles.
    """
    points = np.asarray(vertices, dtype=np.float64)
    _, first, index = np.unique(
        np.round(points / distance), axis=0, return_index=True, return_inverse=True
    )

    order = np.argsort(first)  # keeps the order of the vertices
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[index.ravel()][triangles]

    keep = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    return points[first[order]], faces[keep]


def open_edges(triangles: np.ndarray) -> int:
    """Number of directed edges of `triangles` (T, 3) without exactly one opposite edge; 0 for a
    closed mesh.
    """
    edges = np.concatenate(
        [triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]
    ).astype(np.int64)
    count = int(triangles.max()) + 1
    key, times = np.unique(edges[:, 0] * count + edges[:, 1], return_counts=True)
    opposite = np.isin((key % count) * count + key // count, key)
    return int((times > 1).sum() + (~opposite).sum())


def volume(vertices: Array, triangles: np.ndarray) -> float:
    """Enclosed volume [m^3]; overlapping shells add up, inverted shells count negative."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def area_centroid(vertices: Array, triangles: np.ndarray) -> Array:
    """Centroid (3,) [m] of the surface of a mesh."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return area @ (a + b + c) / (3.0 * area.sum())


def vertex_normals(vertices: Array, triangles: np.ndarray) -> Array:
    """Unit normals (V, 3) at the vertices, weighted by triangle area; zero where undefined."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], cross)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)


def split(
    vertices: Array, triangles: np.ndarray, chosen: np.ndarray, longest: float
) -> tuple[Array, np.ndarray]:
    """Bisect every edge of the `chosen` triangles that is longer than `longest`.

    Neighbouring triangles are divided too, so that a closed mesh stays closed.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices.
        chosen: (T,) bool.
        longest: [m] largest length of an edge that is not bisected.

    Returns:
        Vertices and triangles of the finer mesh.
    """
    # (T, 3, 2)
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1)
    key = ends[..., 0] * len(vertices) + ends[..., 1]
    length = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=-1)
    cut_keys = np.unique(key[chosen[:, None] & (length > longest)])
    if not len(cut_keys):
        return vertices, triangles

    # A new vertex in the middle of each bisected edge.
    middles = 0.5 * (vertices[cut_keys // len(vertices)] + vertices[cut_keys % len(vertices)])
    position = np.searchsorted(cut_keys, key)
    cut = cut_keys[np.minimum(position, len(cut_keys) - 1)] == key
    # (T, 3): the vertex on the edge from corner i to i + 1
    middle = np.where(cut, len(vertices) + position, -1)

    count = cut.sum(axis=1)
    parts = [triangles[count == 0]]

    # Corners are permuted so that one bisected edge is edge 0, and of two bisected edges the
    # remaining edge is edge 2.
    for n, first in (
        (1, cut.argmax(axis=1)),
        (2, (~cut).argmax(axis=1) + 1),
        (3, np.zeros(len(cut), dtype=np.int64)),
    ):
        rows = np.flatnonzero(count == n)
        turn = (first[rows, None] + np.arange(3)) % 3
        a, b, c = triangles[rows[:, None], turn].T
        x, y, z = middle[rows[:, None], turn].T
        if n == 1:
            pieces = [(a, x, c), (x, b, c)]
        elif n == 2:
            pieces = [(x, b, y), (a, x, y), (a, y, c)]
        else:
            pieces = [(a, x, z), (x, b, y), (z, y, c), (x, y, z)]
        parts += [np.column_stack(piece) for piece in pieces]

    return np.vstack([vertices, middles]), np.vstack(parts)

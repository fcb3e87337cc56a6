"""Triangle mesh of a point cloud from those faces of its Delaunay tetrahedra that are small enough.

From outside, tetrahedra are removed through every face that is larger than the spacing of the
points, or that runs across the surface from one wall to another. The faces where the removal ends
are the mesh [Edelsbrunner 1994]. Its vertices are the points, and additional vertices on sharp
edges without points. Holes are not closed: a hole wider than a few spacings, and the side that was
not scanned, stay open.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError, cKDTree

from uuv.models.meshes.closed_shells import sphere
from uuv.models.meshes.far_origin import middle_if_far
from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

FEWEST = 100  # least number of points of a model; fewer do not determine a shape
_MOST = 60_000  # approximate largest number of points in a mesh; more points only add time
_NEIGHBOURS = 12  # number of points from which a normal is computed, including the point itself
_COUNTED = 6  # number of neighbours from whose distance the density is computed
# [spacings] radius of the largest empty ball under a face that lies in the surface; up to 2 for
# random points
_HOLE = 2.2
_FLAT = 0.2  # [-] largest thickness over width of a neighbourhood whose normal is used
# cosine of the angle between the normals of two points, below which a sharp edge lies between the
# points
_CREASE = np.cos(np.deg2rad(30.0))
_BEYOND = 1.0  # [-] largest distance of this edge from the points, in multiples of their distance
# [-] largest distance of two points of one plane from that plane, in multiples of their distance
_IN_PLANE = 0.1
_PARALLEL = 0.9  # [-] cosine between normals, above which they count as parallel
# [-] share of opposite normals among those, above which normals do not determine the sides
_MIXED = 0.1
# [spacings] standard deviation of the points from the surface, above which they are averaged
_ROUGH = 0.5
_SMOOTHED = 40  # number of neighbours to whose plane such points are moved before averaging
_SMOOTH = 0.25  # [spacings] remaining standard deviation after averaging
_RING = 20  # number of neighbours in which the end of the surface is detected
# [rad] angle around a point without neighbours, above which the surface ends there
_GAP = np.deg2rad(150.0)
_GRAZING = 0.1  # [-] cosine of incidence below which a triangle is not used
_SKIN = 0.05  # [spacings] largest distance of a second layer that counts as the same surface
_SIDES = 400  # approximate number of points from which open sky is searched for, on both sides
_WAYS = 24  # number of directions from each of these points
_LIFT = 0.5  # [spacings] distance of the rays' origins from the surface
_SKY = 0.25  # [-] share of rays without a hit, above which that side is outside
_OPEN = 0.5  # [-] share of the surface with outside on both sides, above which the surface is open
# [spacings] random displacement of points, so that no four lie in one plane and no five on one
# sphere
_APART = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudMesh:
    """Mesh of a cloud; triangles wind counter-clockwise seen from outside."""

    vertices: Array  # (V, 3) [m]
    triangles: np.ndarray  # (T, 3)
    spacing: float  # [m] between neighbouring points, median
    # True: the cloud was scanned from some sides only, and the space behind it is unknown
    is_open: bool
    # (k, 3) [m] points where an open surface ends although the object may continue; empty if it is
    # closed
    border: Array
    note: str  # description of how the mesh was made, one sentence


def mesh_of_cloud(points: Array, normals: Array | None = None) -> CloudMesh:
    """Mesh a cloud.

    Args:
        points: (n, 3) [m], finite, on the surface of an object or of a part of it.
        normals: (n, 3) outward, of any length except 0; None: they are computed from the points. If
            their signs are inconsistent, they are turned to one side; those of an open surface are
            turned so that the surface bulges outward.

    Raises:
        ConfigurationError: there are fewer than FEWEST distinct points, or the points form no
            surface.
    """
    middle = middle_if_far(points)  # relative to which all squares of lengths are exact
    count = len(points)
    points = points - middle
    points, first = np.unique(points, axis=0, return_index=True)
    if len(points) < FEWEST:
        raise ConfigurationError(
            f"cloud: must have at least {FEWEST} distinct points, got {len(points)}"
        )

    outward, how = _given_normals(points, None if normals is None else normals[first])

    # Density, and normals if the cloud has none.
    points, outward = _averaged(points, outward)
    local, spacing = _spacing(points)
    axes, flat = (
        _normals(points) if outward is None else (outward, np.ones(len(points), dtype=bool))
    )

    # The surface, its sharp edges, and the side from which it is seen.
    triangles = _surface(points, local, axes, flat)
    if not len(triangles):
        raise ConfigurationError(f"cloud: must form a surface, but its {len(points)} points do not")
    vertices, triangles = _sharpened(points, triangles, axes, flat)

    is_open = _share_open(vertices, triangles, spacing) > _OPEN
    triangles = _met(vertices, triangles, 0.0 if is_open else spacing)
    if is_open and np.einsum("ni,ni->", axes, points - points.mean(axis=0)) < 0.0:
        triangles = triangles[:, ::-1]
        axes = -axes
        how = f"{how}, turned over, since the surface bulged inward"

    fewer = f", averaged to {len(points)}" if len(points) < len(first) else ""
    ends = (
        "open: the space behind the surface and beyond its borders is unknown"
        if is_open
        else "all around"
    )

    return CloudMesh(
        vertices=vertices + middle,
        triangles=triangles,
        spacing=spacing,
        is_open=is_open,
        border=_ends(points, axes, spacing) + middle if is_open else np.zeros((0, 3)),
        note=f"meshed from a cloud of {count} points{fewer}, {1e3 * spacing:.1f} mm apart, "
        f"normals {how}; {ends}",
    )


def _given_normals(points: Array, normals: Array | None) -> tuple[Array | None, str]:
    """Unit normals (n, 3) of a cloud, turned to one side of the surface, and a description of how.

    Without given normals the first result is None, and normals are computed from the points later.
    """
    if normals is None:
        return None, "estimated from the points"
    outward = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if _one_sided(points, outward):
        return outward, "given"
    near = cKDTree(points).query(points, k=_NEIGHBOURS)[1]
    return _turned(points, outward, near), "given with mixed signs: turned to one side"


def _spacing(points: Array) -> tuple[Array, float]:
    """Spacing (n,) [m] around each point, and its median, as of a square lattice of equal
    density.
    """
    distance, near = cKDTree(points).query(points, k=_COUNTED + 1)
    spacing = distance[:, -1] * np.sqrt(np.pi / _COUNTED)
    local = np.maximum(spacing, np.median(spacing[near], axis=1))
    return local, float(np.median(spacing))


def _normals(points: Array) -> tuple[Array, np.ndarray]:
    """Unit normals (n, 3), and the mask (n,) of normals that come from a flat neighbourhood.

    A point gets the best fitting of the planes of all neighbourhoods that contain it. Such a plane
    does not run across a sharp edge.
    """
    near = cKDTree(points).query(points, k=_NEIGHBOURS)[1]
    middle = points[near].mean(axis=1)
    around = points[near] - middle[:, None]
    spread, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / _NEIGHBOURS)
    spread = np.sqrt(np.maximum(spread, 0.0))
    normals = vectors[:, :, 0]

    # A point takes the plane of that neighbour whose neighbourhood is thinnest and contains the
    # point.
    off = np.abs(np.einsum("nki,nki->nk", normals[near], points[:, None] - middle[near]))
    best = near[np.arange(len(points)), (spread[near, 0] + off).argmin(axis=1)]
    return _turned(points, normals[best], near), spread[best, 0] < _FLAT * spread[best, 1]


def _one_sided(points: Array, normals: Array) -> bool:
    """True if normals (n, 3) have consistent signs: neighbours in one plane point to the same
    side.
    """
    near = cKDTree(points).query(points, k=_NEIGHBOURS)[1][:, 1:]
    away = points[near] - points[:, None]
    along = np.einsum("nki,ni->nk", normals[near], normals)
    flat = np.abs(np.einsum("nki,ni->nk", away, normals)) < _IN_PLANE * np.linalg.norm(away, axis=2)
    pairs = flat & (np.abs(along) > _PARALLEL)
    return bool((along[pairs] < 0.0).mean() < _MIXED) if pairs.any() else True


def _turned(points: Array, normals: Array, near: np.ndarray) -> Array:
    """The normals (n, 3), each turned to the side of its most parallel neighbour's, then all
    outward.
    """
    first = np.repeat(np.arange(len(points)), near.shape[1] - 1)
    second = near[:, 1:].ravel()
    along = np.einsum("ni,ni->n", normals[first], normals[second])
    tree = minimum_spanning_tree(
        coo_matrix((1.0001 - np.abs(along), (first, second)), shape=(len(points),) * 2).tocsr()
    )

    # From one member of each connected part along the tree, then the whole part outward.
    label = connected_components(tree, directed=False)[1]
    sign = np.ones(len(points))
    for part in range(label.max() + 1):
        members = np.flatnonzero(label == part)
        order, parent = breadth_first_order(tree, members[0], directed=False)
        for k in order[1:]:
            sign[k] = sign[parent[k]] * (1.0 if normals[k] @ normals[parent[k]] >= 0.0 else -1.0)

        out = np.einsum(
            "ni,ni->n",
            sign[members, None] * normals[members],
            points[members] - points[members].mean(axis=0),
        )
        sign[members] *= 1.0 if out.sum() >= 0.0 else -1.0

    return sign[:, None] * normals


def _averaged(points: Array, normals: Array | None) -> tuple[Array, Array | None]:
    """Fewer points, averaged over cubes, if they scatter about their surface or are too many."""
    while True:
        near = cKDTree(points).query(points, k=_NEIGHBOURS)[1]
        around = points[near] - points[near].mean(axis=1, keepdims=True)
        least = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", around, around))[:, 0]
        off = float(np.median(np.sqrt(np.maximum(least, 0.0) / (_NEIGHBOURS - 3))))
        spacing = _spacing(points)[1]

        many = len(points) / _MOST
        rough = off > _ROUGH * spacing
        # measured in a neighbourhood as thin as the scatter, the scatter is overestimated
        if rough:
            many = max(many, off / (_SMOOTH * spacing))
        if many <= 1.0 or len(points) < many * FEWEST:
            return points, normals

        # Points are moved onto the planes of wide neighbourhoods first.
        if rough:
            near = cKDTree(points).query(points, k=_SMOOTHED)[1]
            middle = points[near].mean(axis=1)
            away = points[near] - middle[:, None]
            axes = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))[1][:, :, 0]
            points = points - np.einsum("ni,ni->n", points - middle, axes)[:, None] * axes

        points, normals = _means(points, normals, spacing * np.sqrt(many))


def _means(points: Array, normals: Array | None, edge: float) -> tuple[Array, Array | None]:
    """Mean points (m, 3) and unit normals over cubes of an `edge` [m]; the two sides of a plate
    stay separate.
    """
    key = np.floor(points / edge).astype(np.int64)
    if normals is not None:
        main = np.abs(normals).argmax(axis=1)
        key = np.column_stack([key, 2 * main + (normals[np.arange(len(normals)), main] > 0.0)])

    _, index, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)

    def mean(values: Array) -> Array:
        return (
            np.column_stack([np.bincount(index.ravel(), values[:, i]) for i in range(3)])
            / count[:, None]
        )

    if normals is None:
        return mean(points), None
    turned = mean(normals)
    return mean(points), turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _surface(points: Array, local: Array, normals: Array, trusted: np.ndarray) -> np.ndarray:
    """Triangles (t, 3) that have the outside on one side or on both sides."""
    rng = np.random.default_rng(0)
    moved = points + _APART * local[:, None] * rng.uniform(-1.0, 1.0, points.shape)
    try:
        mesh = Delaunay(moved)
    except QhullError as error:
        raise ConfigurationError("cloud: must form a surface, but its points do not") from error
    cells = mesh.simplices
    beside = mesh.neighbors

    # Each face is used once: from the cell with the lower number, or on the hull.
    rows, sides = np.nonzero((beside > np.arange(len(cells))[:, None]) | (beside < 0))
    corners = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    faces = np.take_along_axis(cells[rows], corners[sides], axis=1)
    other = beside[rows, sides]
    radius_of_cell = _circumradius(moved[cells])

    # Circumradius and circumcentre of each face.
    a, b, c = moved[faces].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=1)
    sides_of = [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(double > 0.0, np.prod(sides_of, axis=0) / (2.0 * double), np.inf)
        middle = a + _to_circumcenter(b - a, c - a, cross, double)

    # The ball around the face is empty unless it contains the fourth corner of an adjacent cell.
    empty = np.ones(len(faces), dtype=bool)
    least = radius_of_cell[rows].copy()
    for cell, known in (
        (rows, np.ones(len(rows), dtype=bool)),
        (np.where(other < 0, rows, other), other >= 0),
    ):
        fourth = cells[cell].sum(axis=1) - faces.sum(axis=1)
        with np.errstate(invalid="ignore"):
            empty &= ~(known & (np.linalg.norm(moved[fourth] - middle, axis=1) < radius))
        least = np.where(known, np.minimum(least, radius_of_cell[cell]), least)

    ball = np.where(empty, radius, least)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = cross / double[:, None]
    along = np.abs(np.einsum("fi,fci->fc", unit, normals[faces]))

    # A face across the surface, from one wall to another, must be smaller than a face in the
    # surface.
    agreement = np.where(trusted[faces].all(axis=1), along.max(axis=1), np.sqrt(0.5))
    in_surface = (ball < _HOLE * agreement**2 * local[faces].max(axis=1)) & (double > 0.0)

    # Cells that can be reached from outside without crossing a face of the mesh.
    count = len(cells)
    far = np.where(other < 0, count, other)
    graph = coo_matrix(
        (np.ones(int((~in_surface).sum())), (rows[~in_surface], far[~in_surface])),
        shape=(count + 1, count + 1),
    )
    label = connected_components(graph, directed=False)[1]
    outside = label == label[count]

    inward = np.einsum("fi,fci->f", cross, normals[faces]) < 0.0
    return np.where(inward[:, None], faces[:, ::-1], faces)[
        in_surface & (outside[rows] | outside[far])
    ]


def _circumradius(corners: Array) -> Array:
    """Radius (n,) [m] of the sphere through four corners (n, 4, 3); inf if they are coplanar."""
    edges = corners[:, 1:] - corners[:, :1]
    squares = np.einsum("nij,nij->ni", edges, edges)
    u, v, w = edges.transpose(1, 0, 2)
    volume = np.einsum("ni,ni->n", u, np.cross(v, w))

    top = (
        squares[:, :1] * np.cross(v, w)
        + squares[:, 1:2] * np.cross(w, u)
        + squares[:, 2:] * np.cross(u, v)
    )

    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.linalg.norm(top, axis=1) / (2.0 * np.abs(volume))
    return np.where(np.isfinite(radius), radius, np.inf)


def _to_circumcenter(u: Array, v: Array, cross: Array, double: Array) -> Array:
    """Vectors (n, 3) from a corner of triangles, sides `u`, `v` (n, 3), to their circumcentres."""
    uu, vv = (np.einsum("ni,ni->n", side, side)[:, None] for side in (u, v))
    return (uu * np.cross(v, cross) + vv * np.cross(cross, u)) / (2.0 * double[:, None] ** 2)


def _sharpened(
    points: Array, triangles: np.ndarray, normals: Array, flat: np.ndarray
) -> tuple[Array, np.ndarray]:
    """Insert vertices on sharp edges that the points cut off, where the planes of two corners
    intersect [Attene 2005].
    """
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1)
    keys, edge_of_side = np.unique(ends[..., 0] * len(points) + ends[..., 1], return_inverse=True)
    edge_of_side = edge_of_side.reshape(-1, 3)
    a = keys // len(points)
    b = keys % len(points)
    cosine = np.einsum("ni,ni->n", normals[a], normals[b])
    middle = 0.5 * (points[a] + points[b])
    apart = points[b] - points[a]

    # The point on both planes that is nearest to the middle: middle + u n_a + v n_b.
    at_a, at_b = (
        0.5 * np.einsum("ni,ni->n", apart, sign * normals[k]) for k, sign in ((a, -1.0), (b, 1.0))
    )
    square = np.maximum(1.0 - cosine**2, 1e-9)
    u = (at_a - cosine * at_b) / square
    v = (at_b - cosine * at_a) / square
    to = u[:, None] * normals[a] + v[:, None] * normals[b]

    # A crease gets a vertex if that vertex is near.
    creased = flat[a] & flat[b] & (np.abs(cosine) < _CREASE)
    creased &= np.linalg.norm(to, axis=1) < _BEYOND * np.linalg.norm(apart, axis=1)
    number = np.where(creased, len(points) + np.cumsum(creased) - 1, -1)
    cut = number[edge_of_side]
    count = (cut >= 0).sum(axis=1)

    # Triangles by the number of their sides that get a vertex.
    parts = [triangles[count == 0]]
    inner = np.zeros((0, 3))
    next_vertex = len(points) + int(creased.sum())
    for many, first in (
        (1, cut.argmax(axis=1)),
        (2, (cut < 0).argmax(axis=1) + 1),
        (3, np.zeros(len(cut), dtype=int)),
    ):
        rows = np.flatnonzero(count == many)
        turn = (first[rows, None] + np.arange(3)) % 3
        p, q, r = triangles[rows[:, None], turn].T
        x, y, z = cut[rows[:, None], turn].T
        if many == 1:
            pieces = [(p, x, r), (x, q, r)]
        elif many == 2:
            pieces = [(x, q, y), (p, x, y), (p, y, r)]
        else:  # three faces meet
            inner = _corner_points(points[triangles[rows]], normals[triangles[rows]])
            c = next_vertex + np.arange(len(rows))
            pieces = [(p, x, c), (x, q, c), (q, y, c), (y, r, c), (r, z, c), (z, p, c)]
        parts += [np.column_stack(piece) for piece in pieces]

    return np.vstack([points, (middle + to)[creased], inner]), np.vstack(parts)


def _corner_points(corners: Array, normals: Array) -> Array:
    """Points (n, 3) where the planes through the corners (n, 3, 3) of triangles intersect, if
    near.
    """
    center = corners.mean(axis=1)
    off = np.einsum("nki,nki->nk", normals, corners - center[:, None])
    step = np.einsum("nij,nj->ni", np.linalg.pinv(normals, rcond=0.2), off)

    size = np.linalg.norm(corners - center[:, None], axis=2).max(axis=1)
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-12)
    return center + step * np.minimum(1.0, size / length)[:, None]


def _share_open(vertices: Array, triangles: np.ndarray, spacing: float) -> float:
    """Share of the surface that has open sky on both sides: 1 for a sheet, 0 for a closed mesh."""
    rng = np.random.default_rng(0)
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)

    some = rng.choice(len(triangles), _SIDES, p=double / double.sum())
    normal = cross[some] / double[some, None]
    at = corners[some].mean(axis=1)

    scene = RayScene(vertices, triangles)
    free = np.ones(_SIDES, dtype=bool)
    for side in (normal, -normal):
        ways = rng.normal(size=(_SIDES, _WAYS, 3))
        ways *= np.sign(np.einsum("nwi,ni->nw", ways, side))[..., None]
        starts = np.repeat((at + _LIFT * spacing * side)[:, None], _WAYS, axis=1)
        free &= np.isinf(scene.distance(starts, ways)).mean(axis=1) > _SKY
    return float(free.mean())


def _met(vertices: Array, triangles: np.ndarray, spacing: float) -> np.ndarray:
    """Triangles (t, 3) that are visible from afar, turned towards the viewer if `spacing` [m] > 0.

    Needed because, where sparse points leave a crack, both sides of the surface behind the crack
    count as outside.
    """
    corners = vertices[triangles]
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)

    scene = RayScene(vertices, triangles)
    far = 3.0 * float(np.linalg.norm(np.ptp(vertices, axis=0)))

    hits = np.zeros((2, len(triangles)), dtype=np.int64)  # from ahead and from behind
    for way in sphere(1)[0]:
        cosine = normal @ way
        facing = np.flatnonzero(np.abs(cosine) > _GRAZING)
        t = scene.distance(middle[facing] + far * way, np.broadcast_to(-way, (len(facing), 3)))
        first = facing[t > far - _SKIN * spacing - 1e-5 * far]
        np.add.at(hits, ((cosine[first] < 0.0).astype(int), first), 1)

    turned = (hits[1] > hits[0]) & (spacing > 0.0)
    return np.where(turned[:, None], triangles[:, ::-1], triangles)[hits.any(axis=0)]


def _ends(points: Array, normals: Array, spacing: float) -> Array:
    """Points (k, 3) where the surface ends, since a wide angle around them in their plane has no
    points.
    """
    near = cKDTree(points).query(points, k=min(_RING + 1, len(points)))[1][:, 1:]
    u = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)

    away = points[near] - points[:, None]
    angle = np.sort(
        np.arctan2(
            np.einsum("nki,ni->nk", away, np.cross(normals, u)), np.einsum("nki,ni->nk", away, u)
        ),
        axis=1,
    )

    gap = np.diff(np.column_stack([angle, angle[:, 0] + 2.0 * np.pi]), axis=1).max(axis=1)
    ends = points[gap > _GAP]
    beside = (
        cKDTree(ends).query_ball_point(ends, 3.0 * spacing, return_length=True)
        if len(ends)
        else np.zeros(0)
    )
    return ends[beside > 2]  # a single such point is a gap between random points

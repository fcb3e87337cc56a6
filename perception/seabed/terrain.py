"""Triangulated surface of an unknown seabed from a sonar cloud, with standard errors of heights.

Seen from a vehicle above it a seabed is a height over the ground plane [Konoplin 2019, section 1].
The cloud is therefore triangulated by Delaunay in that plane. Delaunay triangulation needs no
parameter and no normals, gives one height at each position, and a vertical plane cuts its edges in
order. Ball pivoting leaves holes wherever the density changes. Poisson reconstruction invents soil
where nothing was measured, and a sampler must not go there
(`scripts/experiments/seabed/seabed_speed.py` has the figures). Overhangs are not represented,
because the ground under one cannot be reached from above either. A cloud of two surfaces, one above
the other, is refused.

Frame S is that of the cloud (the hull frame Oxyz of [Konoplin 2019]); `up` is the vertical in S,
called z in the paper.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay, QhullError, cKDTree

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import (
    Array,
    checked_place,
    finite_number,
    readonly,
    real_array,
    unit_vector,
)

_FARTHEST = 1e5  # [m] largest accepted distance of ground from the sensor
MIN_POINTS = 60  # least number of points that determine a surface
# approximate number of vertices: more add time, not shape; denser clouds are averaged in cells of
# the ground plane
MAX_VERTICES = 16_000
_NEIGHBOURS = 24  # points of a local fit, a quadric of 6 terms
_SWEEPS = 4  # iterations of its robust weights
_FAR = 4.0  # standard deviations from the neighbours' quadric, beyond which a point is an outlier
_THIN = 0.02  # [-] ratio of a cloud's sides, below which it is a line
_LAYER_POINTS = 12_000  # approximate number of points at which two layers are searched for
_LAYER_GAP = 0.02  # [m] least gap between two layers, in addition to noise and curvature
# [-] largest share of the points with two heights around them; edges of rocks have fewer
_LAYER_SHARE = 0.12
_LAYER_RADIUS = 0.15  # [m] around a target, within which layers are refused
_HOLE = 4.0  # [-] largest length of an edge, in mean spacings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Terrain:
    """Triangulated seabed in S."""

    vertices: Array  # (v, 3) [m]
    triangles: np.ndarray  # (t, 3) indices, counter-clockwise from above
    up: Array  # (3,) unit vertical, called z in [Konoplin 2019]
    sigma: Array  # (v,) [m] standard error of each vertex's height
    noise: float  # [m] standard deviation of one point's height, estimated from the cloud
    spacing: float  # [m] mean distance of neighbouring vertices
    hole: float  # [m] longest edge accepted as surface
    points: int  # number of points in the cloud
    outliers: int  # number of them rejected
    scene: RayScene = field(repr=False)  # ray caster of the mesh, relative to `origin`
    origin: Array = field(repr=False)  # (3,) [m]
    # (k, 2) [m] positions on the ground plane with two heights around them
    layered: Array = field(repr=False)
    looked_at: Array = field(repr=False)  # (m, 2) [m] positions examined for two heights

    @property
    def R_ground(self) -> Array:
        """Rows (3, 3): two axes of the ground plane, and `up`, in S."""
        return _axes(self.up)

    def ground(self, points: ArrayLike) -> Array:
        """Coordinates (n, 3) [m] of `points` (n, 3) [m] in S: two on the ground plane, and the
        height.
        """
        return np.asarray(points, dtype=np.float64) @ self.R_ground.T

    def under(self, points: ArrayLike) -> tuple[Array, np.ndarray]:
        """Distance (n,) [m] down from `points` (n, 3) [m] to the surface, or inf; and the triangles
        hit.
        """
        p = np.atleast_2d(np.asarray(points, dtype=np.float64))
        hit = self.scene.cast(p - self.origin, np.broadcast_to(-self.up, p.shape))
        return hit["t"].astype(np.float64), hit["triangle"]


def build_terrain(
    cloud: ArrayLike,
    up: ArrayLike = (0.0, 0.0, 1.0),
    *,
    hole: float | None = None,
    max_vertices: int = MAX_VERTICES,
) -> Terrain:
    """Triangulate the seabed surface of a cloud.

    Args:
        cloud: (n, 3) [m] points in S.
        up: (3,) vertical in S.
        hole: [m] longest edge accepted as surface; None: four times the mean spacing of the points.
        max_vertices: Denser clouds are averaged to about this number of vertices.

    Returns:
        The terrain in S.

    Raises:
        ConfigurationError: The array is not a cloud.
        PerceptionError: The cloud has no single surface: too few points, values that are not
            finite, all points on a line, or two layers.
    """
    points = _as_cloud(cloud)
    z = unit_vector(up, "up")
    if hole is not None:
        hole = finite_number(hole, "hole [m]", above=0.0)

    # Local coordinates: over the ground plane and from the middle of the cloud
    origin = points.mean(axis=0)
    R = _axes(z)
    local = (points - origin) @ R.T
    _check_spread(local)

    looked_at, layered = _in_one_layer(local)

    # Heights with their standard errors, and the triangles over them
    thinned, count, noise = _thinned(local, max_vertices)
    height, sigma, noise, good = _fitted(thinned, count, noise)
    vertices = np.column_stack([thinned[:, :2], height])[good]
    triangles = _delaunay(vertices)

    spacing = np.sqrt(_area(local) / len(vertices))
    limit = _HOLE * spacing if hole is None else hole
    triangles = _without_holes(vertices, triangles, limit)

    p_S = vertices @ R
    triangles.setflags(write=False)
    return Terrain(
        vertices=readonly(p_S + origin),
        triangles=triangles,
        up=z,
        sigma=readonly(sigma[good]),
        noise=noise,
        spacing=float(spacing),
        hole=float(limit),
        points=len(points),
        outliers=int(count[~good].sum()) + len(points) - int(count.sum()),
        scene=RayScene(p_S, triangles),
        origin=readonly(origin),
        layered=readonly(layered + (R @ origin)[:2]),
        looked_at=readonly(looked_at + (R @ origin)[:2]),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
    """Targets projected on the surface: A_i = B_i - t_i z [Konoplin 2019, eq. 1 to 4]."""

    A: Array  # (s, 3) [m] in S
    t: Array  # (s,) [m] from B_i down to A_i
    normal: Array  # (s, 3) unit, upwards, of the triangle that was hit
    sigma: Array  # (s,) [m] standard error of the surface at A_i


def project(terrain: Terrain, B: ArrayLike) -> Projection:
    """Project points `B` (s, 3) [m] in S vertically down on the terrain.

    The ray caster replaces the loop over all triangles of [Konoplin 2019, eq. 4].

    Raises:
        ConfigurationError: The points are malformed.
        PerceptionError: A point has a hole under it, is below the surface, or is over two layers;
            the message names the point.
    """
    targets = real_array(B, "targets B", "(s, 3) numbers")
    if targets.ndim != 2 or targets.shape[1:] != (3,) or not len(targets):
        raise ConfigurationError(
            f"targets B: must be (s, 3) numbers, s > 0, got shape {targets.shape}"
        )

    if not np.all(np.isfinite(targets)):
        bad = int(np.argmin(np.isfinite(targets).all(axis=1)))
        raise ConfigurationError(
            f"targets B: every number must be finite, B_{bad + 1} is {targets[bad].tolist()}"
        )
    checked_place(targets, targets.shape, "targets B", _FARTHEST)

    # Vertical rays to the surface, which must exist there and have one layer
    t, triangle = terrain.under(targets)
    for i in np.flatnonzero(~np.isfinite(t)):
        _say_missed(terrain, targets[i], f"B_{i + 1}")

    A = targets - t[:, None] * terrain.up
    for i in range(len(A)):
        _check_layers(terrain, A[i], f"A_{i + 1}")

    corner = terrain.vertices[terrain.triangles[triangle]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sigma = terrain.sigma[terrain.triangles[triangle]].max(axis=1)
    return Projection(A=readonly(A), t=readonly(t), normal=readonly(normal), sigma=readonly(sigma))


# -- the cloud -------------------------------------------------------------------------------------


def _as_cloud(cloud: ArrayLike) -> Array:
    points = real_array(cloud, "cloud", "(N, 3) numbers [m]")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ConfigurationError(f"cloud: expected (N, 3) numbers [m], got shape {points.shape}")

    if len(points) < MIN_POINTS:
        raise PerceptionError(
            f"cloud: {len(points)} points show no surface, at least {MIN_POINTS} are needed"
        )

    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise PerceptionError(
            f"cloud: {bad.sum()} of {len(points)} points are not finite numbers, the first is "
            f"point {int(bad.argmax()) + 1}"
        )
    return checked_place(points, points.shape, "cloud", _FARTHEST)


def _check_spread(local: Array) -> None:
    """Refuse a cloud that covers no area of the ground plane."""
    flat = local[:, :2] - local[:, :2].mean(axis=0)
    size, axes = np.linalg.eigh(flat.T @ flat / len(flat))
    across, along = np.sqrt(np.maximum(size, 0.0))
    if not across > _THIN * along or not along > 1e-6:
        whole = float(np.ptp(flat @ axes[:, 1]))
        raise PerceptionError(
            f"cloud: seen from above all {len(local)} points lie in a line ({whole:.3g} m long, "
            f"{across:.2g} m wide): they span no surface"
        )


def _area(local: Array) -> float:
    """Area [m^2] covered by the points: occupied cells of a grid with about 12 points per cell."""
    low = local[:, :2].min(axis=0)
    size = np.ptp(local[:, :2], axis=0)
    side = float(np.sqrt(size[0] * size[1] / max(4.0, len(local) / 12.0)))
    cell = ((local[:, :2] - low) / max(side, 1e-9)).astype(np.int64)
    return side**2 * len(np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]))


def _in_one_layer(local: Array) -> tuple[Array, Array]:
    """Positions as returned by `_layers`; a cloud of two layers is refused."""
    looked_at, layered = _layers(local)
    if len(layered) > _LAYER_SHARE * len(looked_at):
        raise PerceptionError(
            "cloud: there are two surfaces, one above the other, at "
            f"{len(layered) / len(looked_at):.0%} of the checked positions; which of them is the "
            "seabed is ambiguous"
        )
    return looked_at, layered


def _layers(local: Array) -> tuple[Array, Array]:
    """Positions (m, 2) [m] examined, and those (k, 2) with two heights around them.

    The heights of a point's neighbours are compared with the plane through them. At an edge or on a
    curved surface, the points of the two sides are also apart on the ground, and the plane follows
    them. Points of two layers are not apart on the ground.
    """
    part = local[:: max(1, -(-len(local) // _LAYER_POINTS))]
    k = 12
    if len(part) < 4 * k:
        return part[:, :2], part[:0, :2]

    # Plane through the neighbours of each point
    distance, index = cKDTree(part[:, :2]).query(part[:, :2], k=k)
    offset = part[index] - part[:, None]
    ones = np.ones((*offset.shape[:2], 1))
    M = np.concatenate([ones, offset[..., :2] / np.maximum(distance[:, -1:, None], 1e-9)], axis=2)
    normal = np.einsum("nki,nkj->nij", M, M) + 1e-6 * np.eye(3)
    plane = np.linalg.solve(normal, np.einsum("nki,nk->ni", M, offset[..., 2])[..., None])[..., 0]

    # Widest gap between the sorted deviations, and the spread on either side of it
    off = np.sort(offset[..., 2] - np.einsum("nki,ni->nk", M, plane), axis=1)
    side = 3  # least number of neighbours on either side of the gap
    gaps = np.diff(off, axis=1)[:, side - 1 : k - side]
    at = gaps.argmax(axis=1) + side
    gap = gaps.max(axis=1)
    upper = np.arange(k) >= at[:, None]
    spread = np.zeros(len(part))
    for rows in (upper, ~upper):
        n = rows.sum(axis=1)
        mean = (off * rows).sum(axis=1) / n
        spread = np.maximum(spread, np.sqrt((((off - mean[:, None]) * rows) ** 2).sum(axis=1) / n))

    two = gap > _LAYER_GAP + 2.0 * spread + 0.3 * distance[:, -1]
    return part[:, :2], part[two, :2]


def _thinned(local: Array, most: int) -> tuple[Array, np.ndarray, float]:
    """Points averaged in cells to about `most`, the count (n,) in each and the noise [m] of one.

    A small cloud is returned without averaging, with noise NaN. Points far from the median of their
    cell are left out.
    """
    if len(local) <= most:
        return _distinct(local), np.ones(len(_distinct(local)), dtype=np.int64), np.nan

    # Points by cell, and by height within it
    side = np.sqrt(_area(local) / most)
    low = local[:, :2].min(axis=0)
    cell = ((local[:, :2] - low) / side).astype(np.int64)
    key = cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]
    order = np.lexsort((local[:, 2], key))
    key = key[order]
    p = local[order]

    first = np.flatnonzero(np.diff(key, prepend=key[0] - 1))
    count = np.diff(first, append=len(key))
    row = np.repeat(np.arange(len(first)), count)

    # Points near the median of their cell
    median = 0.5 * (p[first + (count - 1) // 2, 2] + p[first + count // 2, 2])
    off = np.abs(p[:, 2] - median[row])
    spread = 1.48 * float(np.median(off[count[row] >= 3])) if np.any(count >= 3) else np.inf
    near = off <= _FAR * spread + side

    # Their mean, and the scatter about it
    held = np.bincount(row[near], minlength=len(first))
    some = np.maximum(held, 1)
    mean = (
        np.column_stack([np.bincount(row[near], p[near, i], len(first)) for i in range(3)])
        / some[:, None]
    )
    rest = (p[near, 2] - mean[row[near], 2]) ** 2

    many = held >= 3
    variance = np.bincount(row[near], rest, len(first))[many] / (held[many] - 1)
    noise = float(np.sqrt(np.median(variance))) if many.any() else np.nan
    # if two points are far from each other, neither is used
    return mean[held > 0], held[held > 0], noise


def _distinct(local: Array) -> Array:
    """Remove points over the same position (to a micrometre), of which Delaunay would keep one."""
    _, index = np.unique(np.round(local[:, :2] * 1e6), axis=0, return_index=True)
    return local[np.sort(index)]


def _fitted(
    points: Array, count: np.ndarray, noise: float
) -> tuple[Array, Array, float, np.ndarray]:
    """Smoothed heights (v,) [m] of `points`, standard errors, noise of a point, mask of inliers.

    A quadric is fitted robustly around each point. If the quadric explains the neighbours within
    their noise, it is the better measurement. If the relief is finer, the point itself is the
    better one. A Wiener filter weights the two.
    """
    k = min(_NEIGHBOURS, len(points))
    distance, index = cKDTree(points[:, :2]).query(points[:, :2], k=k)

    # Robust quadrics, and the distance of each point from its own quadric
    fit, scatter, leverage = np.empty((3, len(points)))
    _fit_quadrics(points, index, distance, count.astype(np.float64), fit, scatter, leverage)
    off = points[:, 2] - fit

    # Each point pulls the quadric towards itself, so its residual is smaller than its noise; the
    # leverage corrects this.
    per_point = np.sqrt(count / np.maximum(1.0 - leverage, 0.05))

    if not np.isfinite(noise):
        noise = 1.48 * float(np.median(np.abs(off) * per_point))

    # Outliers
    point_sigma = noise / np.sqrt(count)
    scale = np.maximum(scatter, np.median(scatter))
    good = np.abs(off) <= _FAR * np.maximum(scale, point_sigma) + 1e-6

    # Wiener filter: the weight of the point grows with the relief that its quadric does not explain
    keep = np.maximum(0.0, 1.0 - point_sigma**2 / np.maximum(scatter**2, 1e-18))
    height = fit + keep * off
    sigma = point_sigma * np.sqrt(keep**2 + (1.0 - keep**2) * leverage)
    return height, sigma, noise, good


@kernel
def _fit_quadrics(points, index, distance, count, fit, scatter, leverage):
    """Height, scatter and leverage of each point, by a robust quadric through its neighbours.

    Writes `fit`, `scatter` and `leverage`, (n,) each.
    """
    n, k = index.shape
    M = np.empty((k, 6))
    w = np.empty(k)
    off = np.empty(k)
    A = np.empty((6, 6))
    b = np.empty(6)
    e = np.empty(6)
    x = np.zeros(6)
    for i in range(n):
        # Terms of the quadric at the neighbours
        radius = max(distance[i, k - 1], 1e-9) * 1.05
        for j in range(k):
            u = (points[index[i, j], 0] - points[i, 0]) / radius
            v = (points[index[i, j], 1] - points[i, 1]) / radius
            M[j, 0] = 1.0
            M[j, 1] = u
            M[j, 2] = v
            M[j, 3] = u * u
            M[j, 4] = u * v
            M[j, 5] = v * v
            off[j] = points[index[i, j], 2]

        # Start from the neighbours' median, since least squares would start off the surface if two
        # of them are outliers.
        off -= np.median(off)
        scale = max(1.48 * np.median(np.abs(off)), 1e-9)

        # Iteratively reweighted least squares: weights by distance, count and Tukey's biweight
        for _ in range(_SWEEPS):
            A[:] = 0.0
            b[:] = 0.0
            for j in range(k):
                share = distance[i, j] / radius
                w[j] = (1.0 - share**3) ** 3 * count[index[i, j]]
                r = off[j] / (4.685 * scale)
                w[j] *= max(1e-3, 1.0 - r * r) ** 2 if abs(r) < 1.0 else 1e-6
                z = points[index[i, j], 2] - points[i, 2]
                for p in range(6):
                    b[p] += w[j] * M[j, p] * z
                    for q in range(6):
                        A[p, q] += w[j] * M[j, p] * M[j, q]

            trace = A[0, 0]
            for p in range(6):
                A[p, p] += 1e-9 * trace
            x = np.linalg.solve(A, b)

            # Residuals, and their scale
            for j in range(k):
                z = points[index[i, j], 2] - points[i, 2]
                for p in range(6):
                    z -= M[j, p] * x[p]
                off[j] = z
            scale = max(1.48 * np.median(np.abs(off)) * np.sqrt(k / max(k - 6.0, 1.0)), 1e-9)

        # Height at the point, and its own weight in it
        e[:] = 0.0
        e[0] = 1.0
        fit[i] = points[i, 2] + x[0]
        scatter[i] = scale
        leverage[i] = min(1.0, np.linalg.solve(A, e)[0] * w[0])


def _delaunay(vertices: Array) -> np.ndarray:
    """Triangles (t, 3) over the ground plane, counter-clockwise from above."""
    try:
        triangles = Delaunay(vertices[:, :2]).simplices.astype(np.int64)
    except QhullError as error:
        raise PerceptionError(
            "cloud: seen from above its points lie in a line: they span no surface"
        ) from error

    # Counter-clockwise, none of zero area
    corner = vertices[triangles][..., :2]
    a = corner[:, 1] - corner[:, 0]
    b = corner[:, 2] - corner[:, 0]
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    triangles = np.where((twice < 0.0)[:, None], triangles[:, ::-1], triangles)
    return triangles[np.abs(twice) > 1e-12]


def _without_holes(vertices: Array, triangles: np.ndarray, limit: float) -> np.ndarray:
    """Triangles (t, 3) without an edge longer than `limit` [m] on the ground plane."""
    closed = vertices[triangles][:, [0, 1, 2, 0], :2]
    longest = np.linalg.norm(np.diff(closed, axis=1), axis=2).max(axis=1)
    triangles = triangles[longest <= limit]
    if not len(triangles):
        raise PerceptionError(
            f"cloud: no three neighbouring points are within {limit:.3f} m of each other"
        )
    return triangles


# -- rays ------------------------------------------------------------------------------------------


def _say_missed(terrain: Terrain, B: Array, name: str) -> None:
    """Raise a PerceptionError that states why the ray down from `B` (3,) [m] meets no surface."""
    above = terrain.scene.cast((B - terrain.origin)[None], terrain.up[None])["t"][0]
    if np.isfinite(above):
        raise PerceptionError(
            f"target {name} is {above:.2f} m below the surface, so the ray down from it meets "
            "nothing"
        )

    p_ground = terrain.ground(B[None])[0]
    nearest = float(
        np.linalg.norm(terrain.ground(terrain.vertices)[:, :2] - p_ground[:2], axis=1).min()
    )
    raise PerceptionError(
        f"target {name}: there is a hole in the cloud under it; the nearest measured point is "
        f"{nearest:.2f} m away"
    )


def _check_layers(terrain: Terrain, A: Array, name: str) -> None:
    """Refuse a position around which the cloud shows two heights."""
    p_ground = terrain.ground(A[None])[0, :2]
    two = int((np.linalg.norm(terrain.layered - p_ground, axis=1) < _LAYER_RADIUS).sum())
    if (
        two
        and two
        > _LAYER_SHARE
        * (np.linalg.norm(terrain.looked_at - p_ground, axis=1) < _LAYER_RADIUS).sum()
    ):
        raise PerceptionError(
            f"target {name}: the cloud has two surfaces, one above the other, around it"
        )


def _axes(up: Array) -> Array:
    """Rows (3, 3): two axes perpendicular to `up`, the first of them nearest to x of S, and
    `up`.
    """
    first = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
    x = first - float(first @ up) * up
    x /= np.linalg.norm(x)
    y = np.array(
        [up[1] * x[2] - up[2] * x[1], up[2] * x[0] - up[0] * x[2], up[0] * x[1] - up[1] * x[0]]
    )
    return np.stack([x, y, up])

"""Global search for initial poses of ICP, with or without an expected position and attitude.

The model is rendered once from all sides. Each patch of the scan is then assumed to be the object
seen from each of these sides, rotated about the line of sight. Every such pose is refined by a fast
ICP on few points, which reads the nearest visible model point from a table. The poses are ranked by
a score: the share of the model that the scan confirms, plus the share of the scan that the model
explains.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uuv.models.meshes.closed_shells import sphere
from uuv.perception.clouds.scan import (
    Scan,
    SensorModel,
    connected_surfaces,
    facing_normals,
    voxel_means,
)
from uuv.perception.registration.model_surface import MODELS, ModelSurface
from uuv.perception.registration.point_pairs import point_pair_poses
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, exp_so3, rotation_from_z, transform_points

_SPINS = 12  # number of rotations about the line of sight, for each view
_DISTANCE = 4.0  # [radii] of the model, from its centre to the virtual sensor
_MODEL_POINTS = 4000  # number of model points used, up to twice as many
_SHOWN = 150  # number of model points of a view that are compared with the scan
_CELLS = 40  # number of cells of the table along its longest side
_MARGIN = 0.35  # [radii] by which the table extends beyond the model
_THIN = 1.0 / 20.0  # [radii] edge of the cubes to which the scan is thinned
_TOGETHER = 0.12  # [radii] largest distance between neighbouring points of one patch
_PATCHES = 5  # number of patches tried, the largest ones
_SMALL = 0.1  # [-] size as a share of the largest patch's points, below which a patch is ignored
_VICINITY = 1.2  # [radii] around a patch in which other patches may be parts of the same object
# number of points of a patch, and [radii] gates of pairing, one for each iteration
_ROUGH = (60, np.geomspace(0.5, 0.15, 8))
_CLOSE = (200, np.geomspace(0.25, 0.08, 10))  # the same for the second, finer ICP
_FINE = (400, np.geomspace(0.08, 0.03, 6))  # and for the third
_TRIED = 120  # number of poses of a patch that get the second ICP
_SETTLED = 40  # number of poses of a patch that get the third
_VOTED = 60  # number of poses tried, those for which most point pairs vote
_WHOLE = 1000  # number of points of the whole scan, with which they are refined
# [radii] from a patch's middle to its rim, beyond which the patch contains more than the object
_LARGE = 1.3
_BALL = 0.7  # [radii] of the balls into which such patches are divided
_BALLS = 8  # largest number of these balls
_FACING = 0.4  # [-] least cosine between the normals of paired points
_PULL = 0.3  # [-] weight of distances along the surface against those across it
_DAMPING = 1e-3  # [-] damping, as a share of the normal equations' trace
# [rad] largest difference from the expected attitude: 45 deg of error, plus the coarse grid of
# views
_ASTRAY = np.deg2rad(70.0)
_KEPT = 12  # number of initial poses besides the best one of each patch
_SHORT_OF = 0.6  # [-] difference from the best score, from which on a pose is dropped
_APART = (0.2, np.deg2rad(20.0))  # [radii], [rad] least distance between two initial poses


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expected:
    """Prior knowledge of the pose."""

    p: Array | None = None  # (3,) [m] of the model's centre, in S; None: unknown
    error: float = np.inf  # [m] largest error of `p`
    R: Array | None = None  # (3, 3) attitude of T in S; None: unknown

    def admits(self, X_ST: Array, surface: ModelSurface) -> np.ndarray:
        """Mask (n,) of the poses X_ST (n, 4, 4) that agree with the prior knowledge."""
        mask = self.admits_turn(X_ST[:, :3, :3], surface)
        if self.p is not None:
            mask &= (
                np.linalg.norm(X_ST[:, :3, :3] @ surface.center + X_ST[:, :3, 3] - self.p, axis=1)
                < self.error
            )
        return mask

    def admits_turn(self, R_ST: Array, surface: ModelSurface) -> np.ndarray:
        """Mask (n,) of the attitudes R_ST (n, 3, 3) within 70 deg of the expected, by symmetry."""
        if self.R is None:
            return np.ones(len(R_ST), dtype=bool)
        return surface.symmetry.cosines(R_ST, self.R) > np.cos(_ASTRAY)


class _Views(NamedTuple):
    """The model rendered from v sides, all in T; a tuple, as compiled kernels require."""

    points: Array  # (p, 3) [m]
    normals: Array  # (p, 3)
    spacing: float  # [m]
    center: Array  # (3,) [m] of the model
    radius: float  # [m]
    ways: Array  # (v, 3) unit, from the model's centre to the sensor
    # (v, _SPINS, 3, 3) rotations that map a direction to z, one for each spin about it
    turns: Array
    middles: Array  # (v, 3) [m] mean of the visible points
    shown: np.ndarray  # (v, _SHOWN) indices of visible points
    nearest: np.ndarray  # (v, nx, ny, nz) index of the visible point nearest to a cell
    corner: Array  # (3,) [m] of the table
    cell: float  # [m]


class _Picture(NamedTuple):
    """Depth image with its raster of tangents."""

    depth: Array  # (h, w) [m]
    tangent_x: float  # of the first column
    tangent_y: float  # of the first row
    pitch_x: float  # from column to column
    pitch_y: float  # from row to row


@remembered(16, owners=MODELS)
def _views(surface: ModelSurface, max_incidence: float) -> _Views:
    every = max(1, len(surface.points) // _MODEL_POINTS)
    points = surface.points[::every]
    normals = surface.normals[::every]

    # Table of cells around the model
    margin = _MARGIN * surface.radius
    corner = points.min(axis=0) - margin
    size = np.ptp(points, axis=0) + 2.0 * margin
    cell = float(size.max() / _CELLS)
    shape = np.ceil(size / cell).astype(int)
    cells = np.minimum(((points - corner) / cell).astype(int), shape - 1)

    ways = []
    middles = []
    shown = []
    nearest = []
    spins = np.stack(
        [exp_so3([0.0, 0.0, angle]) for angle in np.arange(_SPINS) * (2.0 * np.pi / _SPINS)]
    )

    # For each side: the visible points, and the nearest of them to each cell
    for way in sphere(1)[0]:
        mask = surface.exposed(
            surface.center + _DISTANCE * surface.radius * way, max_incidence, every
        )
        visible = np.nonzero(mask)[0]
        if len(visible) < 10:
            continue  # a plate seen edge-on has none
        owner = np.full(shape, -1, dtype=np.int32)
        owner[tuple(cells[visible].T)] = visible
        index = ndimage.distance_transform_edt(
            owner < 0, return_distances=False, return_indices=True
        )
        ways.append(way)
        middles.append(points[visible].mean(axis=0))
        shown.append(_some(visible, _SHOWN))
        nearest.append(owner[tuple(np.asarray(index))])

    return _Views(
        points=points,
        normals=normals,
        spacing=surface.spacing * float(np.sqrt(every)),
        center=surface.center,
        radius=surface.radius,
        ways=np.array(ways).reshape(-1, 3),
        turns=np.array([spins @ _facing(way).T for way in ways]).reshape(-1, _SPINS, 3, 3),
        middles=np.array(middles).reshape(-1, 3),
        shown=np.array(shown),
        nearest=np.array(nearest),
        corner=corner,
        cell=cell,
    )


def initial_poses(
    scan: Scan, mask: np.ndarray, surface: ModelSurface, sensor: SensorModel, expected: Expected
) -> list[Array]:
    """Initial poses X_ST for ICP: the best of each patch, up to 12 others, and of point pairs.

    Point pairs are used if the attitude is unknown; their poses are included both unchanged and
    after the fast ICP.

    Patches do not compete, because a small sliver is explained well by part of any model.

    Args:
        scan: The scan.
        mask: (h, w) pixels that may belong to the object.
        surface: Sampled model.
        sensor: Accuracy of the sensor.
        expected: Prior knowledge of the pose.

    Returns:
        Poses (4, 4), the best of each patch first. Empty if nothing in the scan resembles the model
        as expected.
    """
    views = _views(surface, sensor.max_incidence)
    if not len(views.ways):
        return []

    points = voxel_means(scan.points[mask], _THIN * surface.radius)
    normals = facing_normals(points, 12)
    picture = _Picture(scan.depth, scan.tangent_x[0], scan.tangent_y[0], *scan.pitches)
    others: list[tuple[float, Array]] = []
    firsts: list[tuple[float, Array]] = []

    def settled(patch: np.ndarray, X: Array) -> list[tuple[float, Array]]:
        """Scores and poses, the best first, to which `X` (k, 4, 4) converge on a patch."""
        sigma = float(np.median(sensor.sigma(points[patch, 2])))
        X = X[expected.admits_turn(X[:, :3, :3], surface)]
        score = np.zeros(len(X))
        for (count, gates), most in ((_ROUGH, len(X)), (_CLOSE, _TRIED), (_FINE, _SETTLED)):
            X = X[np.argsort(-score, kind="stable")[:most]]
            some = _some(patch, count)
            score = _settle(X, points[some], normals[some], sigma, gates * views.radius, views)
            score += _confirmed(X, views, picture, 2.0 * views.spacing + 3.0 * sigma)
        admitted = expected.admits(X, surface)
        return sorted(
            zip(score[admitted].tolist(), X[admitted], strict=True), key=lambda item: -item[0]
        )

    # Poses of each patch; the best one is kept separately
    for patch in _patches(points, surface.radius, expected):
        of_patch = settled(patch, _turned(views, points[patch].mean(axis=0)))
        firsts += of_patch[:1]
        others += of_patch[1:]

    # Distinct poses: the best of each patch, then the others
    for scored in (firsts, others):
        scored.sort(key=lambda item: -item[0])
    poses: list[Array] = []
    least = firsts[0][0] - _SHORT_OF if firsts else 0.0
    most = len(firsts) + _KEPT
    for score, X in firsts + others:
        if score < least:
            continue
        if len(poses) == most:
            break
        if _is_apart(surface, X, poses):
            poses.append(X)

    # Point pairs, where the attitude is unknown
    if expected.R is None:
        voted = point_pair_poses(points, normals, surface)[:_VOTED]
        by_pairs = voted.copy()
        sigma = float(np.median(sensor.sigma(points[:, 2])))
        some = _some(np.arange(len(points)), min(len(points), _WHOLE))
        _settle(by_pairs, points[some], normals[some], sigma, _CLOSE[1] * views.radius, views)
        for X in np.concatenate([by_pairs, voted]):
            if expected.admits(X[None], surface)[0] and _is_apart(surface, X, poses):
                poses.append(X)
    return poses


def _some(values: np.ndarray, count: int) -> np.ndarray:
    """Select `count` of the `values` (n,), evenly spread."""
    return values[np.linspace(0, len(values) - 1, count).astype(int)]


def _is_apart(surface: ModelSurface, X_ST: Array, kept: list[Array]) -> bool:
    """True if an initial pose (4, 4) differs from all of those that are kept."""
    if not kept:
        return True

    others = np.array(kept)
    centers = others[:, :3, :3] @ surface.center + others[:, :3, 3]
    moved = np.linalg.norm(centers - transform_points(X_ST, surface.center), axis=1)
    near = others[~(moved > _APART[0] * surface.radius)]
    return bool(np.all(surface.symmetry.cosines(X_ST[:3, :3], near[:, :3, :3]) < np.cos(_APART[1])))


def _patches(points: Array, radius: float, expected: Expected) -> list[np.ndarray]:
    """Indices of the points (n, 3) of each patch: a connected surface, its vicinity, or a part."""
    label = connected_surfaces(points, _TOGETHER * radius)
    size = np.bincount(label)
    patches: list[np.ndarray] = []
    for k in np.argsort(-size, kind="stable")[:_PATCHES]:
        if size[k] < _SMALL * size.max():
            break
        alone = np.nonzero(label == k)[0]
        patches.append(alone)
        near = np.linalg.norm(points - points[alone].mean(axis=0), axis=1) < _VICINITY * radius
        # the middle of a ring is far from all of it
        if near.any() and not 0.9 < near.sum() / len(alone) < 1.1:
            patches.append(np.nonzero(near)[0])

    return patches + _balls(
        points, np.concatenate(patches) if patches else np.zeros(0, dtype=int), radius, expected
    )


def _balls(points: Array, among: np.ndarray, radius: float, expected: Expected) -> list[np.ndarray]:
    """Indices of the points (n, 3) in each of a few balls over the patches larger than the object.

    Objects in contact form one surface, whose middle is not the middle of any of them. The centres
    of the balls are the points farthest from each other.
    """
    # Points of the patches that extend beyond the object
    label = connected_surfaces(points, _TOGETHER * radius)
    large = np.zeros(len(points), dtype=bool)
    for k in np.unique(label[among]):
        of_patch = label == k
        off = np.linalg.norm(points[of_patch] - points[of_patch].mean(axis=0), axis=1)
        large[of_patch] = np.percentile(off, 95) > _LARGE * radius
    if expected.p is not None:
        large &= np.linalg.norm(points - expected.p, axis=1) < expected.error + _BALL * radius

    seeds = points[large]
    if not len(seeds):
        return []

    # Farthest-point sampling, starting near the middle
    balls: list[np.ndarray] = []
    middle = seeds.mean(axis=0) if expected.p is None else expected.p
    distance = np.full(len(seeds), np.inf)
    seed = seeds[int(np.linalg.norm(seeds - middle, axis=1).argmin())]
    while len(balls) < _BALLS:
        balls.append(np.nonzero(np.linalg.norm(points - seed, axis=1) < _BALL * radius)[0])
        distance = np.minimum(distance, np.linalg.norm(seeds - seed, axis=1))
        if distance.max() < _BALL * radius:
            break
        seed = seeds[int(distance.argmax())]
    return balls


def _turned(views: _Views, middle: Array) -> Array:
    """Poses (v * _SPINS, 4, 4) that put each view, in each spin, on the scan at `middle` [m]."""
    R = _facing(-middle) @ views.turns
    X = np.zeros((*R.shape[:2], 4, 4))
    X[..., :3, :3] = R
    X[..., :3, 3] = middle - np.einsum("vsij,vj->vsi", R, views.middles)
    X[..., 3, 3] = 1.0
    return X.reshape(-1, 4, 4)


def _facing(z: Array) -> Array:
    """A rotation (3, 3) whose z axis is along `z` (3,); the other axes are arbitrary."""
    return rotation_from_z(z, np.eye(3)[int(np.abs(z).argmin())])


_Triple = tuple[float, float, float]


class _Equations(NamedTuple):
    """Normal equations of a twist (linear; angular x radius), and a row as working memory."""

    H: Array  # (6, 6), lower half
    g: Array  # (6,)
    row: Array  # (6,)


@kernel
def _settle(
    X_ST: Array, points: Array, normals: Array, sigma: float, gates: Array, views: _Views
) -> Array:
    """Fast ICP of every pose `X_ST` (n, 4, 4), in place; explained share (n,) of the points.

    One Gauss-Newton step for each of `gates` [m]. The share is computed in the last iteration,
    before its step.
    """
    explained = np.empty(len(X_ST))
    equations = _Equations(np.empty((6, 6)), np.empty(6), np.empty(6))
    H = equations.H
    g = equations.g
    model = views.points
    model_normals = views.normals
    nearest = views.nearest
    ways = views.ways
    corner = views.corner
    cell = views.cell
    center = views.center
    radius = views.radius
    spacing = views.spacing

    nx, ny, nz = nearest.shape[1:]
    reach = 2.0 * (cell + spacing)

    # Gauss-Newton steps of each pose
    for h in range(len(X_ST)):
        X = X_ST[h]
        for gate in gates:
            view = _view(X, ways, center)
            H[:] = 0.0
            g[:] = 0.0
            count = 0
            scale = max(2.0 * sigma, 0.25 * gate)
            for n in range(len(points)):
                # Scan point in T, and its cell of the table
                dx, dy, dz = points[n, 0] - X[0, 3], points[n, 1] - X[1, 3], points[n, 2] - X[2, 3]
                x = X[0, 0] * dx + X[1, 0] * dy + X[2, 0] * dz
                y = X[0, 1] * dx + X[1, 1] * dy + X[2, 1] * dz
                z = X[0, 2] * dx + X[1, 2] * dy + X[2, 2] * dz
                i, j, k = (
                    int((x - corner[0]) / cell),
                    int((y - corner[1]) / cell),
                    int((z - corner[2]) / cell),
                )
                if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
                    continue

                # Nearest visible model point, refused beyond the gate or if its normal differs
                m = nearest[view, i, j, k]
                ox, oy, oz = x - model[m, 0], y - model[m, 1], z - model[m, 2]
                square = ox * ox + oy * oy + oz * oz
                if square > gate * gate:
                    continue
                a, b, c = normals[n]
                u, v, w = model_normals[m]
                cosine = (
                    u * (X[0, 0] * a + X[1, 0] * b + X[2, 0] * c)
                    + v * (X[0, 1] * a + X[1, 1] * b + X[2, 1] * c)
                    + w * (X[0, 2] * a + X[1, 2] * b + X[2, 2] * c)
                )
                if abs(cosine) < _FACING:
                    continue

                # Explained: within the surface, not outside its rim
                along = u * ox + v * oy + w * oz
                if abs(along) < spacing + 3.0 * sigma and square < (reach + 3.0 * sigma) ** 2:
                    count += 1

                # Distance across the surface, with a robust weight
                weight = 1.0 / (1.0 + (along / scale) ** 2) ** 2
                ax, ay, az = (
                    (x - center[0]) / radius,
                    (y - center[1]) / radius,
                    (z - center[2]) / radius,
                )
                at = (ax, ay, az)
                _add(equations, weight, along, (u, v, w), at)
                # no model at this cell: the distance along the surface counts too
                if square > reach * reach:
                    weight *= _PULL / (1.0 + square / gate**2)
                    _add(equations, weight, ox, (1.0, 0.0, 0.0), at)
                    _add(equations, weight, oy, (0.0, 1.0, 0.0), at)
                    _add(equations, weight, oz, (0.0, 0.0, 1.0), at)

            explained[h] = count / len(points)

            # Damped step of at most half a radius
            damping = _DAMPING * np.trace(H) + 1e-9
            for a in range(6):
                H[a, a] += damping
                for b in range(a):
                    H[b, a] = H[a, b]
            step = np.linalg.solve(H, g)
            step *= min(1.0, 0.5 * radius / max(np.sqrt(np.sum(step**2)), 1e-12))
            _move(X, step, center, radius)
    return explained


@kernel
def _view(X_ST: Array, ways: Array, center: Array) -> int:
    """Index of the `ways` (v, 3) closest to the direction from the model's centre to the sensor."""
    p = X_ST[:3, 3]
    w = np.empty(3)
    for a in range(3):
        w[a] = -center[a] - (X_ST[0, a] * p[0] + X_ST[1, a] * p[1] + X_ST[2, a] * p[2])

    best, index = -np.inf, 0
    for v in range(len(ways)):
        cosine = ways[v, 0] * w[0] + ways[v, 1] * w[1] + ways[v, 2] * w[2]
        if cosine > best:
            best, index = cosine, v
    return index


@kernel
def _add(equations: _Equations, weight: float, offset: float, way: _Triple, at: _Triple) -> None:
    """Add an `offset` [m] along unit `way` to the normal equations, at `at` [radii] from the
    centre.
    """
    H = equations.H
    g = equations.g
    row = equations.row
    (u, v, w), (x, y, z) = way, at
    row[0], row[1], row[2] = u, v, w
    row[3], row[4], row[5] = y * w - z * v, z * u - x * w, x * v - y * u

    for a in range(6):
        weighted = weight * row[a]
        g[a] += weighted * offset
        for b in range(a + 1):
            H[a, b] += weighted * row[b]


@kernel
def _move(X_ST: Array, step: np.ndarray, center: Array, radius: float) -> None:
    """Move the model by `step` (6,) (linear [m]; angular x radius [m]), in T about its centre."""
    x, y, z = step[3] / radius, step[4] / radius, step[5] / radius
    angle = np.sqrt(x * x + y * y + z * z)
    sine, cosine = (
        (1.0, 0.5) if angle < 1e-6 else (np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2)
    )
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + sine * K + cosine * (K @ K)  # Rodrigues' formula

    R = X_ST[:3, :3].copy()
    X_ST[:3, 3] += R @ (center + step[:3] - turn @ center)
    X_ST[:3, :3] = R @ turn


@kernel
def _confirmed(X_ST: Array, views: _Views, picture: _Picture, tolerance: float) -> Array:
    """Share (n,) of the visible model that the scan confirms, minus the share it sees through."""
    share = np.empty(len(X_ST))
    model = views.points
    shown = views.shown
    depth = picture.depth
    height, width = depth.shape
    for h in range(len(X_ST)):
        X = X_ST[h]
        total = 0
        for m in shown[_view(X, views.ways, views.center)]:
            x, y, z = model[m]
            ahead = X[2, 0] * x + X[2, 1] * y + X[2, 2] * z + X[2, 3]
            if ahead <= 0.0:
                continue

            # Pixel of the model point, and whether the scan is at its depth or behind it
            column = (X[0, 0] * x + X[0, 1] * y + X[0, 2] * z + X[0, 3]) / ahead
            row = (X[1, 0] * x + X[1, 1] * y + X[1, 2] * z + X[1, 3]) / ahead
            i = round((row - picture.tangent_y) / picture.pitch_y)
            j = round((column - picture.tangent_x) / picture.pitch_x)
            if 0 <= i < height and 0 <= j < width:
                behind = depth[i, j] - ahead
                if abs(behind) < tolerance:
                    total += 1
                elif behind > 2.0 * tolerance:
                    total -= 1

        share[h] = total / shown.shape[1]
    return share

"""Symmetry of a known model: rotations that leave it nearly unchanged, and parts that break a
symmetry.

**Near symmetry.** Examples are a starfish turned by one arm, or a plate turned round. Such
rotations are found on the model alone, by rotating it about its principal axes. PoseCheck must then
distinguish the fitted pose from the rotated poses by the scan. Rotations declared as symmetry count
as the same pose.

**Broken symmetry.** A target declares the symmetry of its body. Parts of its mesh that do not have
this symmetry may be in view, such as a bung in a barrel's shell. The model is rendered at many
angles: the median depth of a pixel over them is that of the featureless body. An angle is accepted
if its parts explain the scan better than the featureless body does, and better than at every other
angle.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.spatial import cKDTree

from uuv.models.objects.target_model import Symmetry
from uuv.perception.clouds.nearest_point import NearestPoint
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.model_surface import MODELS, ModelSurface
from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, skew, transform_points

# Near symmetry
_FOLDS = (2, 3, 4, 5, 6, 8)  # n of the rotations by multiples of 360/n deg
# [-] rms distance between the surfaces as a share of the radius, up to which a rotation is tried
_ALIKE = 0.08
# [rad] rotation tried if all folds look alike, as for a flange with its bolts
_ROUND = np.deg2rad(5.0) * np.arange(1, 72)
# iterations of ICP of the turned model with itself, since a lug moves the centroid off the axis
_SETTLED = 6
_TRIMMED = 0.8  # [-] share of the points that are paired, the nearest ones
_PERIODS = (0.05, 0.8)  # [radii] range of the periods sought
# [-] least share of the points that a translation by a period leaves within the model's length
_OVERLAP = 0.4
_PERIODIC = 0.6  # [-] largest ratio of the rms distance after a period to the largest one before it
_MOST_PERIODS = 3  # number of shifts along an axis
_SCREWS = np.arange(1, 7) / 12.0  # [turns] of a screw that are tried, in both directions
_SHIFTED = 100  # approximate number of points compared
_COMPARED = 200  # approximate number of model points compared
# [rad] difference of two attitudes, beyond which they are not the same pose
_DIFFERENT = np.deg2rad(8.0)
_FEW = 10  # shares of these points that are compared in turn, until they exclude the rotation
_TRIED = 96  # number of rotations kept, the most similar first
# [-] ratio of the rms motion along the normals to that of the surface, below which a motion is
# hardly resisted
_SLIPPERY = 0.2
# Broken symmetry
_STEP = np.deg2rad(3.0)  # [rad] between the angles tried
_FINE = np.linspace(-1.0, 1.0, 13)  # [steps] angles tried around the best one
# [rad] turn after which the body must look the same
_PROBES = np.deg2rad([25.0, 60.0, 100.0, 155.0, 205.0, 260.0, 320.0])
# [m], or 1.2 spacings of the model points: least distance of a part's points from the rotated body
_OFF = 0.004
# [-] share of the surface in such parts, above which the declared symmetry is assumed to be wrong
_MOST = 0.3
_POINTS = 300  # approximate number of points on the parts
_PIXELS = 2500  # approximate number of pixels of the scan that are compared
_TOLERANCE = 0.002  # [m] error of the model and the fitted pose
_OUTLIER = 4.5  # [nat] largest cost of one independent error, that of 3 sigma
_NOISE_AREA = 25.0  # [px] over which the errors of a stereo matcher are correlated
# [nat] minimal gain of log likelihood over the featureless body and over every other angle
_TELLING = 10.0
# [-] least share of the pixels changed by the parts (2 sigma or more) that agree with them (2
# sigma)
_AGREE = 0.7
_OTHER = np.deg2rad(15.0)  # [rad] beyond which two angles count as different


@remembered(16, owners=MODELS)
def ambiguous_poses(surface: ModelSurface) -> tuple[Array, ...]:
    """Poses G (4, 4) in T such that the model at X G looks nearly the same as at X, most similar
    first.

    The rotations are by multiples of 360/n deg, with n from `_FOLDS` (2 to 8), and of 5 deg if all
    of these look alike. The axes are parallel to the principal axes and the axes of T, through the
    centroid of the surface and through the centre of its bounding box. Rotations about the declared
    axis are not tried, since they all count as the same pose.
    """
    points = surface.points[:: max(1, len(surface.points) // _COMPARED)]
    tree = cKDTree(surface.points)
    folds = sorted({2.0 * np.pi * k / n for n in _FOLDS for k in range(1, n)})

    rotations: list[tuple[float, Array]] = []
    for middle in (surface.points.mean(axis=0), surface.center):
        main = np.linalg.eigh(np.cov((surface.points - middle).T))[1].T
        for axis in np.vstack([main, np.eye(3)]):
            if _is_declared(surface.symmetry, axis):
                continue

            # Rotations by the folds; 5 deg steps of a round body only if all folds look alike
            turns = [
                pose(R, middle - R @ middle)
                for R in (exp_so3(angle * axis) for angle in (*folds, *_ROUND))
            ]
            alike = 0
            for k, G in enumerate(turns):
                if k == len(folds) and alike < len(folds):
                    break  # not nearly round
                unlike = _unlikeness(tree, points, G, _ALIKE * surface.radius)
                if unlike is None:
                    continue
                alike += 1

                # Refined, and different from all poses so far
                G = _settled(tree, points, G)
                others = [] if k >= len(folds) else [Y for _, Y in rotations]
                if _is_another(surface.symmetry, G, [np.eye(4), *others]):
                    rotations.append((unlike, G))

    turned = tuple(G for _, G in sorted(rotations, key=lambda item: item[0]))[:_TRIED]
    return turned + tuple(_shifts(surface, points, tree))


def _is_declared(symmetry: Symmetry, axis: Array) -> bool:
    """True if every rotation about a unit `axis` (3,) is the same pose by the declared symmetry.

    A rotation about an axis that differs from the declared axis by an angle turns the declared axis
    by at most twice that angle. ICP of the model with itself may add the same again before the pose
    counts as another one.
    """
    if symmetry.axis is None:
        return False
    return float(np.linalg.norm(np.cross(axis, symmetry.axis))) < np.sin(0.25 * _DIFFERENT)


def _settled(tree: cKDTree, points: Array, G: Array) -> Array:
    """Pose (4, 4) near `G` that fits points (n, 3) best to those of the tree, by trimmed ICP."""
    for _ in range(_SETTLED):
        moved = transform_points(G, points)
        distance, index = tree.query(moved)

        # Pairs, without the farthest ones
        paired = distance <= np.quantile(distance, _TRIMMED)
        a = moved[paired]
        b = tree.data[index[paired]]

        # Least-squares rotation of the pairs [Arun 1987]
        U, _, Vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        G = pose(R, b.mean(axis=0) - R @ a.mean(axis=0)) @ G
    return G


def _shifts(surface: ModelSurface, points: Array, tree: cKDTree) -> list[Array]:
    """Poses G (4, 4) after which a periodic model looks the same: shifts by a period, or screws."""
    middle = surface.points.mean(axis=0)
    some = points[:: max(1, len(points) // _SHIFTED)]
    steps = np.arange(*_PERIODS, surface.spacing / surface.radius) * surface.radius
    shifts: list[Array] = []

    # Rms distance along each principal axis
    for axis in np.linalg.eigh(np.cov((surface.points - middle).T))[1].T:
        length = float(np.ptp(surface.points @ axis))
        off = np.array([_overlap(tree, some, step * axis, length) for step in steps])
        if not np.isfinite(off).any():
            continue

        # After a period the surfaces coincide again, after they have been apart.
        limit = min(_PERIODIC * off[np.isfinite(off)].max(), _ALIKE * surface.radius)
        periods = steps[1:-1][(off[1:-1] <= off[:-2]) & (off[1:-1] < off[2:]) & (off[1:-1] < limit)]

        # Shifts by a period, and screws of either hand
        for period in periods[:_MOST_PERIODS]:
            shifts += [pose(p=sign * period * axis) for sign in (1.0, -1.0)]
            for share in _SCREWS:
                for turn in (share, -share):
                    R = exp_so3(2.0 * np.pi * turn * axis)
                    G = pose(R, middle - R @ middle)
                    for shift in (turn * period * axis, -turn * period * axis):  # of either hand
                        if _overlap(tree, transform_points(G, some), shift, length) < limit:
                            shifts.append(pose(p=shift) @ G)
    return shifts[:_TRIED]


@remembered(16, owners=MODELS)
def slipping_twist(surface: ModelSurface) -> Array | None:
    """Twist (6,) [1, 1/m] in T about the model's centre that the surface resists least [Gelfand
    2004].

    A coil spring, for instance, is screwed along itself, and a nearly round body is turned. Because
    of facets and ends there are several local optima along this motion. The twist moves the surface
    by 1 (rms). It is None if the surface resists every motion, or if the motion is a turn about a
    declared axis.
    """
    if surface.symmetry.axis is not None:
        return None

    at = surface.points - surface.center
    J = np.column_stack([surface.normals, np.cross(at, surface.normals) / surface.radius])

    # Smallest eigenvalue: the motion that the surface resists least
    eigenvalues, vectors = np.linalg.eigh(J.T @ J / len(J))
    linear, angular = vectors[:3, 0], vectors[3:, 0] / surface.radius
    motion = float(np.sqrt(np.mean(np.sum((linear + np.cross(angular, at)) ** 2, axis=1))))

    if np.sqrt(max(eigenvalues[0], 0.0)) > _SLIPPERY * motion:
        return None
    return np.concatenate([linear, angular]) / motion


@remembered(128, owners=MODELS)
def slipped(surface: ModelSurface, by: float) -> Array:
    """Pose G (4, 4) in T of the model after it has slipped by `by` [m] along `slipping_twist`."""
    twist = slipping_twist(surface)
    if twist is None:
        return np.eye(4)

    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = (
        skew(twist[3:]),
        twist[:3] - np.cross(twist[3:], surface.center),
    )
    return np.asarray(expm(by * generator), dtype=np.float64)


def _overlap(tree: cKDTree, points: Array, shift: Array, length: float) -> float:
    """Rms distance [m] of the shifted points (n, 3) that stay within the model; inf if too few."""
    share = 1.0 - np.linalg.norm(shift) / length
    if share < _OVERLAP:
        return np.inf

    distance = np.sort(tree.query(points + shift)[0])[: int(share * len(points))]
    return float(np.sqrt(np.mean(distance**2)))


def _unlikeness(tree: cKDTree, points: Array, G: Array, limit: float) -> float | None:
    """Rms distance [m] of points (n, 3) moved by `G` from those of the tree; None above `limit`."""
    moved = transform_points(G, points)
    total = 0.0
    for k in range(_FEW):  # the distances of a few points suffice to exclude most rotations
        total += float(np.sum(tree.query(moved[k::_FEW])[0] ** 2))
        if total > len(moved) * limit**2:
            return None
    return float(np.sqrt(total / len(moved)))


def _is_another(symmetry: Symmetry, G: Array, others: list[Array]) -> bool:
    """True if a pose (4, 4) differs from all others by more than 8 deg, up to declared symmetry."""
    return bool(
        np.all(symmetry.cosines(G[:3, :3], np.array(others)[:, :3, :3]) < np.cos(_DIFFERENT))
    )


@remembered(16, owners=MODELS)
def asymmetric_parts(surface: ModelSurface) -> Array:
    """Points (n, 3) [m] in T of parts that the declared rotations do not map onto the mesh.

    The result is None if the target has no axis of symmetry.
    """
    symmetry = surface.symmetry
    points = surface.points

    if symmetry.axis is None:
        return np.zeros((0, 3))

    least = max(_OFF, 1.2 * surface.spacing)
    grid = NearestPoint.of(points, surface.spacing)
    off = np.median(
        [
            grid.query(
                transform_points(symmetry.about_center(exp_so3(angle * symmetry.axis)), points),
                2.0 * least,
            )[0]
            for angle in _PROBES
        ],
        axis=0,
    )

    parts = points[off > least]
    if len(parts) > _MOST * len(points):
        return np.zeros((0, 3))
    return parts[:: max(1, len(parts) // _POINTS)]


def resolve_symmetry(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> Array | None:
    """Select the pose that the scan supports among those equal to `X_ST` by declared symmetry.

    Args:
        evidence: Scan of the object.
        surface: Sampled model.
        X_ST: (4, 4) fitted pose of T in S.

    Returns:
        The pose (4, 4), or None if the scan does not determine the angle.
    """
    symmetry = surface.symmetry
    if symmetry.axis is None or not len(asymmetric_parts(surface)):
        return None

    def turned(angles: Array, rotations: Array) -> list[Array]:
        return [
            X_ST @ symmetry.about_center(G @ exp_so3(a * symmetry.axis))
            for G in rotations
            for a in angles
        ]

    # All angles, on pixels where the parts may appear
    angles = np.arange(0.0, 2.0 * np.pi, _STEP)
    poses = turned(angles, symmetry.rotations)
    pixels = _Pixels.of(evidence, surface, poses)
    if pixels is None:
        return None

    # Gain over the featureless body
    depths = pixels.depths(surface, poses)
    bare = np.median(depths, axis=0)
    gain, agree = pixels.gains(depths, bare)

    # Uniqueness: the gain at other angles must be far less
    best = int(gain.argmax())
    group, at = divmod(best, len(angles))
    beside = np.abs(np.angle(np.exp(1j * (angles - angles[at])))) < _OTHER
    others = np.delete(gain, group * len(angles) + np.nonzero(beside)[0])
    if gain[best] < _TELLING + max(0.0, float(others.max())) or agree[best] < _AGREE:
        return None

    # Finer angles around the best one
    G = symmetry.rotations[group : group + 1]
    near = angles[at] + _STEP * _FINE
    gain = pixels.gains(pixels.depths(surface, turned(near, G)), bare)[0]
    # Centroid of the peak, not its maximum, since the top is flat and noise would move the maximum.
    return turned(np.array([np.average(near, weights=gain - gain.min() + 1e-9)]), G)[0]


@dataclass(frozen=True, slots=True, eq=False)
class _Pixels:
    """Pixels of the scan in which the parts appear at any of the angles."""

    rays: Array  # (p, 3) in S, scaled to a depth of 1 m
    depth: Array  # (p,) [m]
    sigma: Array  # (p,) [m]
    weight: float  # [-] weight of a pixel, as a share of an independent error

    @classmethod
    def of(cls, evidence: Evidence, surface: ModelSurface, poses: list[Array]) -> "_Pixels | None":
        """Select the pixels; None if the sensor got no echo where any of the parts could appear."""
        scan = evidence.scan
        points = asymmetric_parts(surface)
        where = np.zeros(scan.depth.shape, dtype=bool)
        for X in poses:
            row, column, inside = scan.pixels(transform_points(X, points))
            where[row[inside], column[inside]] = True

        # Evenly selected, if there are many
        rows, columns = np.nonzero(where & (scan.depth > 0.0))
        if not len(rows):
            return None
        step = -(-len(rows) // _PIXELS)
        rows, columns = rows[::step], columns[::step]

        depth = scan.depth[rows, columns]
        rays = np.column_stack([scan.tangent_x[columns], scan.tangent_y[rows], np.ones(len(rows))])
        sigma = np.hypot(evidence.sensor.sigma(depth), _TOLERANCE)
        return cls(rays, depth, sigma, min(1.0, step / _NOISE_AREA))

    def depths(self, surface: ModelSurface, poses: list[Array]) -> Array:
        """Depths (len(poses), p) [m] of the model; inf where the ray misses it."""
        rendered = np.empty((len(poses), len(self.rays)))
        for k, X_TS in enumerate(map(inverse, poses)):
            rendered[k] = surface.scene.distance(X_TS[:3, 3], self.rays @ X_TS[:3, :3].T)
        return rendered

    def gains(self, seen: Array, bare: Array) -> tuple[Array, Array]:
        """Gain (k,) [nat] of `seen` (k, p) [m] over the featureless `bare` (p,) [m].

        The second result is the share (k,) of the changed pixels that agree.
        """
        cost = np.minimum(0.5 * ((seen - self.depth) / self.sigma) ** 2, _OUTLIER)
        gain = np.minimum(0.5 * ((bare - self.depth) / self.sigma) ** 2, _OUTLIER) - cost

        with np.errstate(invalid="ignore"):
            changed = np.abs(seen - bare) > 2.0 * self.sigma
        agree = np.sum(changed & (cost < 2.0), axis=1) / np.maximum(1, changed.sum(axis=1))
        return self.weight * gain.sum(axis=1), agree

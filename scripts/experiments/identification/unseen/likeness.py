"""Likeness of a shape to itself: its rotations, its mirror image, and motions after which it looks
nearly alike.

All of it is measured on the surface that is visible from outside. Two surfaces agree where they lie
within a tolerance of each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from experiments.identification.unseen.grammar import UnseenShape
from uuv.models.meshes.closed_shells import area_centroid, sphere
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.visibility import SurfaceSamples, View
from uuv.models.objects.target_model import Symmetry
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    pose,
    readonly,
    rotation_from_z,
    transform_points,
)

SAME = 0.005  # [-] of the radius: distance up to which a rotation maps the surface onto itself
DIFFERENT = 0.005  # [m] distance from which two surfaces differ for the work
_STRAY = 0.002  # [-] share of the surface that a symmetry may miss: below it lies sampling at edges
_FOLDS = 48  # highest order of a rotation that is told from a turn by any angle
# [-] by which second moments about two axes may differ for a rotation of order above 2
_EQUAL = 0.01
_ANGLES = (0.7, 1.9, 3.05)  # [rad] by which a body of revolution may be turned
_EYES = 3.0  # [radii] distance of the viewpoints around the shape
_THINNED = 3  # of the points, every third counts for a share
_FEW = 120  # points by which most candidates are excluded
_SETTLING = 12  # iterations of an alignment
_SLOWLY = 4  # alignments in a row, for what must be exact
_TURNS = 24  # angles about an axis at which an alignment begins
# [extents] along an axis, likewise
_SLIDES = (-0.4, -0.3, -0.2, -0.15, -0.1, 0.1, 0.15, 0.2, 0.3, 0.4)
_APART, _SLID = np.deg2rad(8.0), 0.1  # [rad], [radii] turn and shift from which on poses are rivals
_KEPT = 6  # reflections, and rivals, at most
_RIVAL = 0.5  # [-] largest share of the surface in which a rival pose may differ


@dataclass(frozen=True, eq=False)
class Likeness:
    """Measures the likeness of `shape` to itself; everything is computed on first use."""

    shape: UnseenShape
    _nearest: NearestSurface = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "_nearest", NearestSurface.of(self.shape.vertices, self.shape.triangles)
        )

    @cached_property
    def points(self) -> Array:
        """Points (n, 3) [m] in T, uniform over the surface that is visible from outside."""
        samples = SurfaceSamples(self.shape.vertices, self.shape.triangles)
        away = _EYES * self.shape.radius

        eyes = [
            pose(rotation_from_z(-d, np.eye(3)[np.argmin(np.abs(d))]), away * d)
            for d in sphere(1)[0]
        ]
        return readonly(samples.points[samples.seen(np.array(eyes), View((1.0, 1.0), 2.0 * away))])

    def distance(self, points: Array) -> Array:
        """Distances (n,) [m] of points (n, 3) [m] in T from the surface."""
        return self._nearest.query(points).distance

    def share_apart(self, S: Array, points: Array | None = None, apart: float = DIFFERENT) -> float:
        """Share (0..1) of points in T, by default all, that `S` (4, 4) moves off the surface."""
        sampled = self.points[::_THINNED] if points is None else points
        return (
            float(np.mean(self.distance(transform_points(S, sampled)) > apart))
            if len(sampled)
            else 0.0
        )

    @cached_property
    def symmetry(self) -> Symmetry:
        """Rotations about the origin of T that map the surface onto itself."""
        moments, axes = self._moments

        # Axes of symmetry are axes of the second moments; equal moments leave them open.
        order = np.abs(np.diff(moments)) <= _EQUAL * moments[-1]
        if order.all():
            return self._by_search()

        if not order.any():
            turns = [exp_so3(np.pi * axis) for axis in axes.T]
            return Symmetry(rotations=np.array([np.eye(3), *(R for R in turns if self._maps(R))]))

        # Two equal moments: the third axis may be one of revolution, or have a fold.
        axis = axes[:, 2] if order[0] else axes[:, 0]

        if all(self._maps(exp_so3(angle * axis)) for angle in _ANGLES):
            flips = [R for R in (exp_so3(np.pi * _across(axis)),) if self._maps(R)]
            return Symmetry(axis=axis, rotations=np.array([np.eye(3), *flips]))

        fold = next(
            (n for n in range(_FOLDS, 1, -1) if self._maps(exp_so3(2.0 * np.pi / n * axis))), 1
        )

        turns = [exp_so3(2.0 * np.pi * k / fold * axis) for k in range(fold)]
        flip = self._flip(axis, fold)
        return Symmetry(
            rotations=np.array(turns if flip is None else [*turns, *(flip @ R for R in turns)])
        )

    @cached_property
    def mirror_share(self) -> float:
        """Share (0..1) of the surface that differs from the mirror image at its best fit."""
        return min(self.share_apart(S) for S in self.reflections)

    def has_hand(self, least: float) -> bool:
        """Whether the mirror image differs in at least the share `least` of the surface; sooner
        said than the share.
        """
        return all(self.share_apart(self.settled(-R)) >= least for R in self._turns())

    @cached_property
    def reflections(self) -> tuple[Array, ...]:
        """Reflections S (4, 4), rotated, that map the surface nearly onto itself, best first."""
        begun = [-R for R in self._turns()]
        return tuple(sorted(map(self.settled, begun), key=self.share_apart)[:_KEPT])

    @cached_property
    def rivals(self) -> tuple[Array, ...]:
        """Motions S (4, 4) in T that are no symmetry and leave at least half of the surface where
        one was.
        """
        axes = self._moments[1].T
        slides = [pose(p=share * self.shape.extent * axis) for axis in axes for share in _SLIDES]

        rotations: list[Array] = []
        for begun in (*map(pose, self._turns()), *slides):
            S = self.settled(begun)
            if self.are_rivals(S, np.eye(4)) and all(
                self.are_rivals(S, other) for other in rotations
            ):
                rotations.append(S)

        shares = [self.share_apart(S) for S in rotations]
        return tuple(rotations[k] for k in np.argsort(shares)[:_KEPT] if shares[k] < _RIVAL)

    def are_rivals(self, S: Array, other: Array) -> bool:
        """Whether two motions (4, 4) in T are apart by more than an error, modulo symmetry: turned,
        or slid.
        """
        position, angle = self.symmetry.error(S, other)
        return bool(angle > _APART or position > _SLID * self.shape.radius)

    @cached_property
    def _moments(self) -> tuple[Array, Array]:
        """Second moments (3,) of the surface, rising, and their axes (3, 3) as columns."""
        a, b, c = (self.shape.vertices - area_centroid(self.shape.vertices, self.shape.triangles))[
            self.shape.triangles
        ].transpose(1, 0, 2)

        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        second = (
            sum(np.einsum("n,ni,nj->ij", area, v, v) for v in (a, b, c, a + b + c)) / area.sum()
        )
        return np.linalg.eigh(second)

    def _maps(self, R: Array) -> bool:
        """Whether a rotation or reflection (3, 3) about the origin maps the surface onto itself."""
        apart = max(SAME * self.shape.radius, 0.0005)

        # A few points first: they refuse most rotations.
        for part in (self.points[:: max(1, len(self.points) // _FEW)], self.points):
            if np.mean(self.distance(part @ R.T) > apart) > _STRAY + 1.0 / len(part):
                return False
        return True

    def _flip(self, axis: Array, fold: int) -> Array | None:
        """Half turn (3, 3) about an axis across `axis` that maps the surface onto itself, if there
        is one.
        """
        few = self.points[:: max(1, len(self.points) // _FEW)]
        first = _across(axis)

        def best(angles: np.ndarray) -> float:
            turns = [exp_so3(np.pi * (exp_so3(angle * axis) @ first)) for angle in angles]
            return float(angles[np.argmin([np.mean(self.distance(few @ R.T)) for R in turns])])

        # By a grid over one period, then ever finer about the best angle.
        step = np.pi / fold / 60.0
        angle = best(np.arange(60) * step)
        for _ in range(3):
            angle = best(angle + step * np.linspace(-1.0, 1.0, 11))
            step *= 0.2

        R = exp_so3(np.pi * (exp_so3(angle * axis) @ first))
        return R if self._maps(R) else None

    def _by_search(self) -> Symmetry:
        """Symmetry of a surface with equal moments about all axes, such as a cube's: every rotation
        is tried.
        """
        rotations = [np.eye(3)]
        directions = sphere(2)[0]

        for axis in directions[directions @ [0.31, 0.53, 0.79] > 0.0]:
            for fold in (2, 3, 4, 5):
                R = exp_so3(2.0 * np.pi / fold * axis)
                few = self.points[:: max(1, len(self.points) // 40)]
                if np.mean(self.distance(few @ R.T)) < 0.08 * self.shape.radius:
                    for _ in range(_SLOWLY):
                        R = self.settled(R)[:3, :3]
                    if all(np.linalg.norm(R - known) > 0.05 for known in rotations) and self._maps(
                        R
                    ):
                        rotations.append(R)

        return Symmetry(rotations=np.array(_closed(rotations)))

    def _turns(self) -> Iterator[Array]:
        """Rotations (3, 3) at which the search for a likeness begins: about the main axes and those
        of T.
        """
        yield np.eye(3)
        for axes in (self._moments[1].T, np.eye(3)):
            for k in range(3):
                yield exp_so3(np.pi * axes[k])

        axes = self._moments[1].T
        for k in (0, 2):
            for angle in np.arange(1, _TURNS) * (2.0 * np.pi / _TURNS):
                yield exp_so3(angle * axes[k])

    def settled(self, R: Array, points: Array | None = None) -> Array:
        """Motion (4, 4) that lays points on the surface near a first guess, by closest points.

        Args:
            R: First guess: (3, 3) rotation, or reflection, about the origin, or (4, 4) motion.
            points: (n, 3) [m] in T; by default those of the whole surface.

        Returns:
            The motion, improper if `R` is.
        """
        sampled = self.points if points is None else points
        few = sampled[:: max(1, len(sampled) // _FEW)]
        S = pose(R) if R.shape == (3, 3) else R
        side = np.sign(np.linalg.det(S[:3, :3]))

        for _ in range(_SETTLING):
            near = self._nearest.query(transform_points(S, few))
            best = near.distance <= max(np.quantile(near.distance, 0.8), DIFFERENT)
            source, goal = few[best], near.point[best]
            a, b = source.mean(axis=0), goal.mean(axis=0)

            # Rotation between the matched points [Kabsch 1976], with the hand of the start.
            U, _, V = np.linalg.svd((goal - b).T @ (source - a))
            turn = U @ np.diag([1.0, 1.0, side * np.sign(np.linalg.det(U @ V))]) @ V
            S = pose(turn, b - turn @ a)

        return S


def _across(axis: Array) -> Array:
    """Unit vector perpendicular to the unit vector `axis`."""
    hint = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return np.asarray(hint / np.linalg.norm(hint), dtype=np.float64)


def _closed(rotations: list[Array]) -> list[Array]:
    """Group that `rotations` (3, 3) generate, identity first; at most that of an icosahedron."""
    group = list(rotations)

    for R in group:  # grows while it is walked
        for G in rotations:
            product = R @ G
            if len(group) < 60 and all(np.linalg.norm(product - known) > 0.05 for known in group):
                group.append(product)

    return group

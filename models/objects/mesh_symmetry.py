"""Symmetry of a mesh: rotations that map it onto itself within the resolution of sensors."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.objects.target_model import Symmetry
from uuv.sim.interfaces.spatial import Array, exp_so3, rotation_angle

# [radii] largest distance between two surfaces that count as the same; a 24-sided pipe is then
# round
_ALIKE = 0.006
_EVEN = 40_000  # number of triangles drawn from the mesh of a cloud
# [-] largest share of the surface of a cloud's mesh that may be a spacing or more off
_LOST = 0.01
# [-] largest share of the surface of a cloud's mesh that may be farther off than _ALIKE
_CHIPPED = 0.1
_FOLDS = range(2, 13)  # orders of rotation that are tried
# [rad] turn that only a surface of revolution passes for every order
_ROUND = np.deg2rad([13.0, 37.0, 71.0, 103.0, 163.0])
# [-] relative difference of moments of inertia, below which their axes are not unique
_EQUAL = 0.02
_SAMPLES = 1500  # number of points of the surface, and of corners, that are turned
_FIRST = 60  # number of them that are turned first: they exclude most rotations
# [rad] between the axes that are tried where the moments of inertia do not determine the axis
_SCANNED = np.deg2rad(3.0)
_EXACTLY = np.deg2rad(0.02)  # [rad] accuracy of such an angle
_REFINED = 20  # number of the best axes tried that are refined
_ITERATIONS = 15  # number of iterations of ICP
_SIGNS = np.array(
    [
        [1.0, 1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 1.0],
        [1.0, 1.0, -1.0],
        [1.0, -1.0, 1.0],
        [-1.0, 1.0, 1.0],
    ]
)
_SPHERE = 300  # number of axes tried if all moments are equal
_SAME = np.deg2rad(1.5)  # [rad] between axes or rotations that count as the same
_LARGEST = 60  # largest number of rotations in a group: that of an icosahedron


def mesh_symmetry(
    vertices: Array, triangles: np.ndarray, rng: np.random.Generator, spacing: float = 0.0
) -> Symmetry:
    """Rotations that map a mesh onto itself within 0.6 % of its radius.

    A mesh that was made from a cloud is compared only as accurately as the spacing of its points
    allows. The rotations are about the centroid of the surface. Axes are sought along the principal
    axes of inertia, and where two moments are equal, all around the third. A sphere has no single
    axis and counts as having no symmetry.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices.
        rng: Draws the points that are compared.
        spacing: [m] between the points of the cloud from which the mesh was made; some of the mesh
            is off the surface by as much.

    Returns:
        An axis of revolution with half turns across it, or a discrete group.
    """
    shape = _Shape(vertices, triangles, rng, spacing)
    moments, axes = np.linalg.eigh(shape.inertia)
    for axis in axes.T:
        if all(shape.is_like(exp_so3(angle * axis)) for angle in _ROUND):
            return _of_revolution(shape, axis)

    equal = np.diff(moments) < _EQUAL * moments[-1]
    if equal.all():
        half_turns = shape.half_turns(_hemisphere(_SPHERE))
        # Axes of third and fourth order pass midway between axes of second order.
        sums = [
            signs @ np.array(trio) for trio in combinations(half_turns[:9], 3) for signs in _SIGNS
        ]
        candidates = _distinct(
            [
                *half_turns,
                *(axis / np.linalg.norm(axis) for axis in sums if np.linalg.norm(axis) > 0.1),
            ]
        )
    elif equal.any():
        main = axes[:, 0] if equal[1] else axes[:, 2]
        side = axes[:, 1]
        candidates = [main, *shape.half_turns_across(main, side)]
    else:
        candidates = list(axes.T)

    return Symmetry(rotations=_group(shape, candidates), center=shape.center)


def has_mirror_plane(
    vertices: Array, triangles: np.ndarray, rng: np.random.Generator, spacing: float = 0.0
) -> bool:
    """True if a reflection maps a mesh onto itself within 0.6 % of its radius, so that its mirror
    image is the same shape.

    Args:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices.
        rng: Draws the points that are compared.
        spacing: [m] as in `mesh_symmetry`.
    """
    shape = _Shape(vertices, triangles, rng, spacing)
    moments, axes = np.linalg.eigh(shape.inertia)
    if any(shape.is_like(_reflection(axis)) for axis in axes.T):
        return True

    equal = np.diff(moments) < _EQUAL * moments[-1]
    if not equal.any():
        return False

    main = axes[:, 0] if equal[1] else axes[:, 2]
    side = axes[:, 1]
    normals = _hemisphere(_SPHERE)
    if not equal.all():
        normals = np.array(
            [exp_so3(angle * main) @ side for angle in np.arange(0.0, np.pi, _SCANNED)]
        )
    return bool(shape.settled([_reflection(normal) for normal in normals]))


def _reflection(normal: Array) -> Array:
    return np.eye(3) - 2.0 * np.outer(normal, normal)


class _Shape:
    """A mesh, and points on it that are turned and compared with the mesh."""

    def __init__(
        self, vertices: Array, triangles: np.ndarray, rng: np.random.Generator, spacing: float
    ) -> None:
        self.spacing = spacing
        corners = vertices[triangles]
        areas = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        shares = areas / areas.sum()
        if spacing > 0.0:
            corners, shares = _evenly(corners, areas, spacing, rng)
        self.center = shares @ corners.mean(axis=1)

        # Second moment of a triangle about its centroid: the mean square of the corners over 4.
        off = corners - self.center
        middle = off.mean(axis=1)
        spread = np.einsum("t,tci,tcj->ij", shares, off, off) / 12.0 + 0.75 * np.einsum(
            "t,ti,tj->ij", shares, middle, middle
        )
        self.inertia = np.trace(spread) * np.eye(3) - spread

        # Points on the surface: uniform over its area, and corners, since small parts have many
        # corners.
        used = vertices[np.unique(triangles)]
        self.radius = float(np.linalg.norm(used - self.center, axis=1).max())
        u, v = rng.random((2, _SAMPLES))
        u, v = np.where(u + v > 1.0, (1.0 - u, 1.0 - v), (u, v))
        a, b, c = corners[rng.choice(len(corners), size=_SAMPLES, p=shares)].transpose(1, 0, 2)
        inner = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        outer = used[rng.permutation(len(used))[:_SAMPLES]]  # small parts have many corners

        self.points = (
            np.vstack([inner, outer])[rng.permutation(len(inner) + len(outer))] - self.center
        )
        self.surface = NearestSurface.of(vertices - self.center, triangles)

    def is_like(self, R: Array) -> bool:
        """True if the mesh turned by `R` is the mesh, within _ALIKE."""
        limit = _ALIKE * self.radius
        for points in (self.points[:_FIRST], self.points[_FIRST:]):
            distance = self.surface.query(points @ R.T).distance
            if self.spacing == 0.0 and distance.max() > limit:
                return False
            for off, share in ((max(limit, self.spacing), _LOST), (limit, _CHIPPED)):
                # 2 sigma
                if (distance > off).sum() > share * len(points) + 2.0 * np.sqrt(
                    share * len(points)
                ):
                    return False

        return True

    def half_turns(self, axes: Array) -> list[Array]:
        """Axes of half turns that map the shape onto itself, by ICP from the best of `axes`."""
        return _distinct(
            [
                np.linalg.eigh(R + R.T)[1][:, -1]
                for R in self.settled([exp_so3(np.pi * a) for a in axes])
            ]
        )

    def half_turns_across(self, main: Array, side: Array) -> list[Array]:
        """Axes perpendicular to `main` (3,) of half turns that map the shape onto itself; `side`
        (3,) is perpendicular to `main`.

        Only the angle about `main` is unknown. ICP converges slowly to this angle on a prism,
        because most of the surface slides along itself.
        """
        from scipy.optimize import minimize_scalar

        angles = np.arange(0.0, np.pi, _SCANNED)

        def axis(angle: float) -> Array:
            return exp_so3(angle * main) @ side

        def off(angle: float, points: Array) -> float:
            return float(
                np.mean(self.surface.query(points @ exp_so3(np.pi * axis(angle)).T).distance ** 2)
            )

        few = self.points[:_FIRST]
        more = self.points[: 5 * _FIRST]
        around = np.array([off(angle, few) for angle in angles])
        lowest = np.nonzero((around <= np.roll(around, 1)) & (around <= np.roll(around, -1)))[0]
        turns: list[Array] = []

        for k in lowest[np.argsort(around[lowest], kind="stable")[:_REFINED]]:
            bounds = angles[k] - _SCANNED, angles[k] + _SCANNED
            best = minimize_scalar(
                off, bounds=bounds, args=(more,), method="bounded", options={"xatol": _EXACTLY}
            )
            if self.is_like(exp_so3(np.pi * axis(float(best.x)))):
                turns.append(axis(float(best.x)))

        return _distinct(turns)

    def settled(self, maps: Sequence[Array]) -> list[Array]:
        """Orthogonal maps (3, 3) of the shape onto itself, by ICP from the best of `maps`.

        The step of ICP is that of [Arun 1987].
        """
        few = self.points[:_FIRST]
        more = self.points[: 5 * _FIRST]
        off = [np.mean(self.surface.query(few @ R.T).distance ** 2) for R in maps]
        fixed: list[Array] = []

        for k in np.argsort(off, kind="stable")[:_REFINED]:
            R = maps[k]
            for _ in range(_ITERATIONS):
                turned = more @ R.T
                U, _, Vt = np.linalg.svd(self.surface.query(turned).point.T @ turned)
                R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt @ R
            if self.is_like(R):
                fixed.append(R)

        return fixed


def _evenly(
    corners: Array, areas: Array, spacing: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Triangles (n, 3, 3) drawn from `corners` (t, 3, 3), and their shares (n,), uniform over the
    surface.

    The mesh of a cloud has several layers in some places, which must not count twice.
    """
    some = corners[rng.choice(len(corners), _EVEN, p=areas / areas.sum())]
    tree = cKDTree(some.mean(axis=1))
    reach = max(spacing, 3.0 * np.sqrt(areas.sum() / _EVEN))
    weight = 1.0 / tree.query_ball_point(tree.data, reach, return_length=True)
    return some, weight / weight.sum()


def _of_revolution(shape: _Shape, axis: Array) -> Symmetry:
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    flip = exp_so3(np.pi * across / np.linalg.norm(across))
    rotations = [np.eye(3), flip] if shape.is_like(flip) else [np.eye(3)]
    return Symmetry(axis=axis, rotations=np.stack(rotations), center=shape.center)


def _group(shape: _Shape, axes: list[Array]) -> Array:
    """Rotations (n, 3, 3) about `axes` that map the shape onto itself, and their products; identity
    first.
    """
    group = [np.eye(3)]
    for axis in axes:
        for fold in _FOLDS:
            R = exp_so3(2.0 * np.pi / fold * axis)
            if _is_new(R, group) and shape.is_like(R):
                group = _closed([*group, R])

    if shape.spacing > 0.0 and len(group) == _LARGEST:
        # the products do not form a group, since each rotation is only an approximate symmetry
        return np.eye(3)[None]
    return np.stack(group)


def _closed(rotations: list[Array]) -> list[Array]:
    """The group that the rotations generate, up to rounding."""
    group: list[Array] = []
    waiting = list(rotations)
    while waiting and len(group) < _LARGEST:
        R = waiting.pop(0)
        if _is_new(R, group):
            group.append(R)
            waiting += [R @ B for B in rotations]

    return group


def _is_new(R: Array, group: list[Array]) -> bool:
    return all(rotation_angle(R, G) > _SAME for G in group)


def _distinct(axes: list[Array]) -> list[Array]:
    """Axes without repetitions, where an axis and its opposite count as the same."""
    distinct: list[Array] = []
    for axis in axes:
        if all(np.linalg.norm(np.cross(axis, other)) > np.sin(_SAME) for other in distinct):
            distinct.append(axis)

    return distinct


def _hemisphere(count: int) -> Array:
    """Unit vectors (count, 3), evenly spread over half a sphere: a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z = k / count
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    return np.column_stack(
        [np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z]
    )

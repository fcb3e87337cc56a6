"""Growth and dents on any mesh, with the ground truth of the displacement.

Growth raises the part of the surface that faces the same way as the surface at the middle of the
patch. A dent pushes in all surface nearby, for instance both faces of a plate. The height of growth
and the depth of a dent fall from the middle to a lobed edge as a half cosine. All points of a patch
move along one direction, by so little compared with the patch's radius that the surface never
folds. The mesh is refined where needed, and a closed mesh stays closed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.meshes.closed_shells import split, vertex_normals, welded
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.objects.target_model import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    readonly,
    real_array,
    shown,
    whole_number,
)

HEIGHT = (0.01, 0.04)  # [m] default range of the height of growth and depth of dents
PATCHES = 5  # default number of patches
_MOST_PATCHES = 1000  # largest number of patches
_STEEPEST = 2.5  # least ratio of radius to height; a steeper patch would fold
_LOBES = 0.15  # share of the radius by which the edge deviates from a circle
_MOST_OF_SIZE = 0.45  # largest radius of a patch, as a share of the object's
_CROWDED = 200  # rejected draws, after which patches may overlap
_EDGE = (0.004, 0.012)  # [m] range of the triangle sides in a patch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patch:
    """One patch of growth or one dent, in the frame T of its object."""

    kind: Literal["growth", "dent"]
    p_T: Array  # (3,) [m] middle of the patch, on the clean surface
    n_T: Array  # (3,) unit vector, outward normal at the middle
    radius: float  # [m] mean radius of the patch's edge
    height: float  # [m] displacement in the middle: outwards (growth) or inwards (dent)
    lobes: Array  # (2,) [rad] phases of the waves of the edge, three and five around

    def __post_init__(self) -> None:
        if self.kind not in ("growth", "dent"):
            raise ConfigurationError(f"patch: kind must be 'growth' or 'dent', got {self.kind!r}")

        normal = checked(self.n_T, (3,), "patch normal")
        length = float(np.linalg.norm(normal))
        if not length > 1e-9:
            raise ConfigurationError("patch: its normal must not be zero")
        if not (np.isfinite(self.height) and self.height > 0.0 and np.isfinite(self.radius)):
            raise ConfigurationError(
                f"patch: radius and height must be > 0 m, got {self.radius}, {self.height}"
            )
        if self.radius < _STEEPEST * self.height * (1.0 - 1e-9):
            raise ConfigurationError(
                f"patch: radius must be at least {_STEEPEST} times the height, got {self.radius} "
                f"and {self.height} m"
            )

        object.__setattr__(self, "p_T", readonly(checked(self.p_T, (3,), "patch middle")))
        object.__setattr__(self, "n_T", readonly(normal / length))
        object.__setattr__(self, "lobes", readonly(checked(self.lobes, (2,), "patch lobes")))

    def displacement(self, points_T: Array, normals_T: Array) -> Array:
        """Displacement (N, 3) [m] of points (N, 3) of the clean surface, outward normals (N, 3)."""
        offset = points_T - self.p_T
        x = np.cross(self.n_T, [0.0, 0.0, 1.0] if abs(self.n_T[2]) < 0.9 else [1.0, 0.0, 0.0])
        x /= np.linalg.norm(x)
        angle = np.arctan2(offset @ np.cross(self.n_T, x), offset @ x)
        wander = np.cos(3.0 * angle + self.lobes[0]) + 0.5 * np.cos(5.0 * angle + self.lobes[1])
        share = np.linalg.norm(offset, axis=1) / self.radius

        # Lobes fade out towards the middle, where they would otherwise meet in a cusp.
        share = share / (1.0 + _LOBES * wander * np.clip(share, 0.0, 1.0) ** 2)
        amount = self.height * 0.5 * (1.0 + np.cos(np.pi * np.clip(share, 0.0, 1.0)))

        if self.kind == "dent":
            return -amount[:, None] * self.n_T
        # surface that faces aside or away does not move
        faces = np.clip((normals_T @ self.n_T - 0.05) / 0.35, 0.0, 1.0)
        return (amount * faces**2 * (3.0 - 2.0 * faces))[:, None] * self.n_T


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deformed:
    """A deformed object with its ground truth: `target.vertices` are `clean_T` plus the
    displacements.
    """

    target: TargetModel  # the true shape; name, symmetry and paths are those of the clean object
    clean: TargetModel  # the believed shape
    patches: tuple[Patch, ...]
    clean_T: Array  # (V, 3) [m] position of each vertex of `target` on the clean surface
    # (V,) [m] offset of each vertex along the clean surface's normal; growth is positive
    offset: Array

    def offset_at(self, points_T: ArrayLike) -> Array:
        """Offset (N,) [m] from the clean surface of those points of the true surface that are
        nearest to `points_T` (N, 3) [m].

        Growth is positive.

        Raises:
            ConfigurationError: the points have another shape, are not finite, or are too far away.
        """
        points = real_array(points_T, "offset_at", "points (N, 3) [m]")
        if points.ndim != 2:
            raise ConfigurationError(
                f"offset_at: expected points (N, 3) [m], got shape {points.shape}"
            )
        points = checked_place(points, (len(points), 3), "offset_at: points [m]")

        nearest = NearestSurface.of(self.target.vertices, self.target.triangles).query(points)
        return np.einsum(
            "nk,nk->n", nearest.weights, self.offset[self.target.triangles[nearest.triangle]]
        )


def fouled(
    target: TargetModel,
    rng: np.random.Generator,
    patches: int = PATCHES,
    height: tuple[float, float] = HEIGHT,
    near: ArrayLike | None = None,
) -> Deformed:
    """Copy of `target` with random patches of growth.

    Args:
        target: clean object.
        rng: source of randomness.
        patches: number of patches.
        height: [m] range of their heights.
        near: (N, 3) [m] in T, points, such as those of a path, near which the patches lie; None:
            anywhere.

    Returns:
        The deformed object with its ground truth.

    Raises:
        ConfigurationError: a number is out of range, or the object is too small for the least
            height.
    """
    return deformed(target, _drawn("growth", target, rng, patches, height, near))


def dented(
    target: TargetModel,
    rng: np.random.Generator,
    patches: int = PATCHES,
    height: tuple[float, float] = HEIGHT,
    near: ArrayLike | None = None,
) -> Deformed:
    """Copy of `target` with random dents.

    Args:
        target: clean object.
        rng: source of randomness.
        patches: number of dents.
        height: [m] range of their depths.
        near: (N, 3) [m] in T, points, such as those of a path, near which the dents lie; None:
            anywhere.

    Returns:
        The deformed object with its ground truth.

    Raises:
        ConfigurationError: a number is out of range, or the object is too small for the least
            depth.
    """
    return deformed(target, _drawn("dent", target, rng, patches, height, near))


def deformed(target: TargetModel, patches: Sequence[Patch]) -> Deformed:
    """Copy of `target` with all of `patches` applied; overlapping patches add up."""
    points, faces = welded(target.vertices, target.triangles)

    # Finer triangles where a patch reaches.
    for patch in patches:
        edge = float(np.clip(patch.radius / 9.0, *_EDGE))
        reach = (1.0 + 1.5 * _LOBES) * patch.radius
        for _ in range(30):
            low = points[faces].min(axis=1)
            high = points[faces].max(axis=1)
            away = np.linalg.norm(
                np.maximum(np.maximum(low - patch.p_T, patch.p_T - high), 0.0), axis=1
            )
            finer = split(points, faces, away < reach, edge)
            if len(finer[0]) == len(points):
                break
            points, faces = finer

    normals = vertex_normals(points, faces)
    moved = points + sum(
        (patch.displacement(points, normals) for patch in patches), np.zeros_like(points)
    )

    return Deformed(
        target=replace(target, vertices=moved, triangles=faces, solids=(), hulls=()),
        clean=target,
        patches=tuple(patches),
        clean_T=readonly(points),
        offset=readonly(np.einsum("ij,ij->i", moved - points, normals)),
    )


def _drawn(
    kind: Literal["growth", "dent"],
    target: TargetModel,
    rng: np.random.Generator,
    count: int,
    height: tuple[float, float],
    near: ArrayLike | None,
) -> list[Patch]:
    least, most = checked(height, (2,), f"{kind}: height [m]").tolist()
    if not 0.0 < least <= most:
        raise ConfigurationError(
            f"{kind}: height must be 0 < least <= most [m], got {shown(height)}"
        )

    count = whole_number(count, f"{kind}: patches", least=1, most=_MOST_PATCHES)
    widest = _MOST_OF_SIZE * target.radius
    if least * _STEEPEST > widest:
        raise ConfigurationError(
            f"{kind}: {target.name!r} of radius {target.radius:.3g} m is too small for a height of "
            f"{least:.3g} m; the height must be at most {widest / _STEEPEST:.3g} m"
        )

    near_T = None if near is None else np.asarray(near, dtype=np.float64)
    if near_T is not None and (near_T.ndim != 2 or near_T.shape[1:] != (3,) or not len(near_T)):
        raise ConfigurationError(
            f"{kind}: near must be points (N, 3), N > 0, got shape {near_T.shape}"
        )
    if near_T is not None and not np.isfinite(near_T).all():
        raise ConfigurationError(f"{kind}: every point of near must be finite")

    # Surface from which the middles are drawn, uniformly by area.
    a, b, c = target.vertices[target.triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)

    if near_T is not None:
        away = float(
            NearestSurface.of(target.vertices, target.triangles).query(near_T).distance.min()
        )
        close = 0.5 * min(4.5 * most, widest)
        if away >= close:
            raise ConfigurationError(
                f"{kind}: the points of `near` must be within {close:.3g} m of {target.name!r}, "
                f"the largest reach of a patch; they are {away:.3g} m away"
            )

    drawn: list[Patch] = []
    crowded = 0
    while len(drawn) < count:
        tall = float(rng.uniform(least, min(most, widest / _STEEPEST)))
        radius = float(rng.uniform(min(3.0 * tall, widest), min(4.5 * tall, widest)))
        face = int(rng.choice(len(area), size=1, p=area / area.sum())[0])
        u, v = np.sort(rng.random(2))
        p = u * a[face] + (v - u) * b[face] + (1.0 - v) * c[face]
        lobes = rng.uniform(-np.pi, np.pi, 2)

        if near_T is not None and np.linalg.norm(near_T - p, axis=1).min() > 0.5 * radius:
            continue
        if crowded < _CROWDED and any(
            np.linalg.norm(p - q.p_T) < 0.7 * (radius + q.radius) for q in drawn
        ):
            crowded += 1  # overlapping patches exceed `height`; allowed only where there is no room
            continue
        drawn.append(
            Patch(
                kind=kind,
                p_T=p,
                n_T=cross[face] / area[face],
                radius=radius,
                height=tall,
                lobes=lobes,
            )
        )

    return drawn

"""Closed solids of which shapes are put together: extruded outlines with holes, swept and turned
profiles, primitives.

A solid is a pair of vertices (V, 3) [m] and triangles (T, 3), counter-clockwise seen from outside.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay

from uuv.models.meshes.closed_shells import SIDES, Shell, open_edges, prism, revolve, sphere
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

_STEP = 1e-9  # [m] between two places of a path, below which they are one
_REFINEMENTS = 6  # halvings of the spacing until a triangulation keeps every edge of the outline


def mirrored(solid: Shell) -> Shell:
    """Mirror image of `solid` in the plane x = 0, wound outwards."""
    return solid[0] * [-1.0, 1.0, 1.0], solid[1][:, ::-1]


def circle(radius: float, sides: int = SIDES) -> Array:
    """Corners (N, 2) [m] of a regular polygon, counter-clockwise from +x."""
    angle = np.arange(sides) * (2.0 * np.pi / sides)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rectangle(length: float, width: float, rounding: float = 0.0) -> Array:
    """Corners (N, 2) [m] of a rectangle around the origin, rounded with radius `rounding` [m]."""
    corners = 0.5 * np.array(
        [[length, width], [-length, width], [-length, -width], [length, -width]]
    )
    if rounding <= 0.0:
        return corners

    turn = np.linspace(0.0, 0.5 * np.pi, 9)
    arc = rounding * np.column_stack([np.cos(turn), np.sin(turn)])
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])  # turns row vectors by 90 deg
    turned = [arc @ np.linalg.matrix_power(quarter, k) for k in range(4)]

    return np.vstack([c - rounding * np.sign(c) + a for c, a in zip(corners, turned, strict=True)])


def extruded(
    outline: Array,
    thickness: float,
    holes: Sequence[Array] = (),
    *,
    twist: float = 0.0,
    layers: int = 1,
) -> Shell:
    """Solid of an outline moved along z, from -thickness/2 to thickness/2.

    Args:
        outline: (N, 2) [m] corners, counter-clockwise, without self-intersection.
        thickness: [m] along z.
        holes: Outlines (M, 2) [m] of holes, counter-clockwise, within the outline and apart from
            each other.
        twist: [rad] by which the upper end is turned about z against the lower one.
        layers: Number of layers along z, which a twist needs.

    Raises:
        ConfigurationError: The outlines cross, or are too close for a triangulation.
    """
    spacing = 0.12 * float(np.ptp(outline, axis=0).max())

    for _ in range(_REFINEMENTS):
        # Too coarse edges may be missing from the triangulation: finer ones are tried.
        loops = [_divided(outline, spacing), *(_divided(hole, spacing)[::-1] for hole in holes)]
        solid = _lofted(loops, _filled(loops), thickness, twist, layers)
        if open_edges(solid[1]) == 0:
            return solid
        spacing *= 0.5

    raise ConfigurationError("extrusion: its outlines cross, or lie too close to each other")


def _divided(loop: Array, spacing: float) -> Array:
    """Closed outline (N, 2) with points added, so that no edge is longer than `spacing` [m]."""
    after = np.roll(loop, -1, axis=0)

    parts = [
        a + (b - a) * (np.arange(n) / n)[:, None]
        for a, b, n in zip(
            loop,
            after,
            np.maximum(1, np.ceil(np.linalg.norm(after - loop, axis=1) / spacing)).astype(int),
            strict=True,
        )
    ]

    return np.vstack(parts)


def _filled(loops: Sequence[Array]) -> np.ndarray:
    """Triangles (T, 3) inside an odd number of `loops`, counter-clockwise; indices run on."""
    points = np.vstack(loops)
    triangles = Delaunay(points).simplices

    a, b, c = points[triangles].transpose(1, 0, 2)
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles = np.where((area > 0.0)[:, None], triangles, triangles[:, ::-1])

    within = inside((a + b + c) / 3.0, loops)
    return triangles[within & (np.abs(area) > 1e-9 * np.ptp(points, axis=0).max() ** 2)]


def inside(points: Array, loops: Iterable[Array]) -> np.ndarray:
    """Mask (N,) of the points (N, 2) that lie inside an odd number of closed `loops` (M, 2)."""
    odd = np.zeros(len(points), dtype=bool)
    for loop in loops:
        x0, y0 = loop.T
        x1, y1 = np.roll(loop, -1, axis=0).T
        x, y = points[:, :1], points[:, 1:]

        # Edges that a ray along +x from the point crosses.
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        odd ^= crosses.sum(axis=1) % 2 == 1

    return odd


def _lofted(
    loops: Sequence[Array], faces: np.ndarray, thickness: float, twist: float, layers: int
) -> Shell:
    """Solid between copies of the triangulated area `loops`, `faces` along z."""
    flat = np.vstack(loops)

    count = len(flat)
    vertices = []
    for share in np.linspace(-0.5, 0.5, layers + 1):
        c, s = np.cos(share * twist), np.sin(share * twist)
        turned = flat @ np.array([[c, s], [-s, c]])
        vertices.append(np.column_stack([turned, np.full(count, share * thickness)]))

    # Two triangles for each edge of an outline and each layer.
    first = np.arange(count)
    after = np.concatenate(
        [np.roll(part, -1) for part in np.split(first, np.cumsum([len(p) for p in loops])[:-1])]
    )
    walls = [
        part
        for low in range(0, layers * count, count)
        for part in (
            np.column_stack([low + first, low + after, low + count + after]),
            np.column_stack([low + first, low + count + after, low + count + first]),
        )
    ]

    return np.vstack(vertices), np.vstack([faces[:, ::-1], faces + layers * count, *walls])


def swept(path: Array, profile: Array, scale: ArrayLike = 1.0) -> Shell:
    """Solid of a convex profile moved along a path, closed by flat ends.

    The profile turns no more than the path does (parallel transport).

    Args:
        path: (N, 3) [m] places of the profile; two at one place with different scales make a step.
        profile: (M, 2) [m] corners, counter-clockwise about the path.
        scale: Factor of the profile at each place, or one for all.

    Returns:
        The solid.
    """
    scales = np.broadcast_to(np.asarray(scale, dtype=np.float64), len(path))
    return skinned(
        path[:, None] + scales[:, None, None] * np.einsum("mk,nki->nmi", profile, _frames(path))
    )


def tube(
    path: Array, radius: float, bore: float = 0.0, depth: int = 0, sides: int = SIDES
) -> Shell:
    """Round bar along a path, with a blind bore at both ends.

    Args:
        path: (N, 3) [m], N > 2 depth.
        radius: [m] outer.
        bore: [m] inner radius at the ends; 0: none.
        depth: Depth of the bores in places of the path.
        sides: Of the profile.

    Returns:
        The solid.
    """
    rings = path[:, None] + np.einsum("mk,nki->nmi", circle(radius, sides), _frames(path))

    if bore > 0.0 and depth > 0:
        inner = path[:, None] + (rings - path[:, None]) * (bore / radius)
        rings = np.concatenate([inner[depth::-1], rings, inner[: -depth - 2 : -1]])

    return skinned(rings)


def skinned(rings: Array) -> Shell:
    """Solid through convex rings (N, M, 3) [m], counter-clockwise about the way, with flat ends."""
    places, corners = rings.shape[:2]

    i = np.arange(corners)
    j = (i + 1) % corners
    low = (np.arange(places - 1) * corners)[:, None]

    sides = [
        np.stack([low + i, low + j, low + corners + j], axis=-1).reshape(-1, 3),
        np.stack([low + i, low + corners + j, low + corners + i], axis=-1).reshape(-1, 3),
    ]

    # Fans close the ends.
    fan = np.arange(1, corners - 1)
    start = np.column_stack([np.zeros_like(fan), fan + 1, fan])
    end = np.column_stack([np.zeros_like(fan), fan, fan + 1]) + (places - 1) * corners

    return rings.reshape(-1, 3), np.vstack([start, *sides, end])


def _frames(path: Array) -> Array:
    """Two unit axes (N, 2, 3) across a path (N, 3), turned no more than it turns; doubled places
    share theirs.
    """
    ahead = np.diff(path, axis=0)
    length = np.linalg.norm(ahead, axis=1)
    tangent = ahead[length > _STEP][0] / length[length > _STEP][0]

    u = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent))])

    frames = np.empty((len(path), 2, 3))
    for n in range(len(path)):
        # Mean direction of the edges at this place, those without length left out.
        around = [
            ahead[k] / length[k] for k in (n - 1, n) if 0 <= k < len(ahead) and length[k] > _STEP
        ]
        if around:
            middle = np.sum(around, axis=0)
            tangent = middle / np.linalg.norm(middle)

        # Parallel transport: the last axis, less its part along the tangent.
        u = u - (u @ tangent) * tangent
        u /= np.linalg.norm(u)
        frames[n] = u, np.cross(tangent, u)

    return frames


def ring(profile: Array, sides: int = SIDES) -> Shell:
    """Ring of a closed profile (M, 2) [m], rows (radius, z), counter-clockwise, turned about z."""
    angle = np.arange(sides) * (2.0 * np.pi / sides)

    radius, z = profile.T
    rings = np.stack(
        [
            np.outer(np.cos(angle), radius),
            np.outer(np.sin(angle), radius),
            np.broadcast_to(z, (sides, len(z))),
        ],
        axis=-1,
    )

    corners = len(profile)
    i = np.arange(corners)
    j = (i + 1) % corners
    low = (np.arange(sides) * corners)[:, None]
    high = np.roll(low, -1, axis=0)

    return rings.reshape(-1, 3), np.vstack(
        [
            np.stack([low + i, high + j, low + j], axis=-1).reshape(-1, 3),
            np.stack([low + i, high + i, high + j], axis=-1).reshape(-1, 3),
        ]
    )


def turned(profile: ArrayLike, sides: int = SIDES) -> Shell:
    """Solid of revolution about z of a profile (P, 2) [m], rows (z, radius), from axis to axis."""
    vertices, triangles = revolve(profile, sides)
    return vertices[:, [1, 2, 0]], triangles


def hexagon(radius: float, height: float) -> Shell:
    """Hexagonal prism about z around the origin, as a bolt's head; `radius` [m] to its edges."""
    corner = circle(radius, 6)

    low, high = (np.column_stack([corner, np.full(6, z)]) for z in (-0.5 * height, 0.5 * height))
    return prism(low, high)


def ball(radius: float) -> Shell:
    """Sphere around the origin, `radius` in [m]."""
    vertices, triangles = sphere(3)
    return radius * vertices, triangles

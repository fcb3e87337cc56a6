"""Placing of bodies in a scene: at rest, in contact with each other, in a heap, next to an object,
or in front of it.

Frame F has its origin at the object, on or above a level seabed, and z up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.spatial import ConvexHull

from uuv.clouds.frames import pinhole
from uuv.models.meshes.closed_shells import Shell, box, cylinder, moved, scaled, sphere
from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, rotation_from_z

Rng = np.random.Generator

COARSE = 4  # [px] between the rays that estimate occlusion
_CARRIED = 1e-6  # [radii] tolerance for the distance of points from a side of the convex hull
_AFAR = 4.0  # [m] distance at which a body starts when it is pushed towards the others
_TRIES = 8  # number of places tried for each object of a heap
_TOUCH = 600  # number of points of each body that are tested for the first contact
_GOAL = 0.05  # [-] tolerance of an occlusion
_SLIGHT = 0.03  # [-] smallest occlusion that is aimed for
_VEILS = 60  # number of occluders tried


class Shape(Protocol):
    """Shape to be placed: a mesh, with the centroid of its surface at the origin of its frame T."""

    @property
    def vertices(self) -> Array:
        """Vertices (V, 3) [m], in T."""
        ...

    @property
    def triangles(self) -> np.ndarray:
        """Triangles (T, 3), counter-clockwise from outside."""
        ...

    @property
    def radius(self) -> float:
        """Radius [m] of a sphere around T's origin that contains the mesh."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A body in the scene: its surface, and points on the surface that are tested for contact."""

    p: Array  # (3,) [m] displacement since the body was made
    _shell: Shell  # (V, 3) vertices in F before that displacement
    _rays: RayScene  # ray caster of that surface
    _points: Array  # (n, 3) [m] on that surface

    @classmethod
    def of(cls, solid: Shell, rng: Rng) -> "Body":
        """Body made from a solid in F; `rng` draws its points."""
        vertices, triangles = solid
        corner = vertices[triangles]
        area = np.linalg.norm(
            np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
        )

        # points uniform over the surface, and some of the corners, which often touch first
        which = rng.choice(len(area), _TOUCH, p=area / area.sum())
        points = np.einsum("ni,nij->nj", rng.dirichlet(np.ones(3), _TOUCH), corner[which])
        some = rng.permutation(len(vertices))[:_TOUCH]
        return cls(
            np.zeros(3), solid, RayScene(vertices, triangles), np.vstack([points, vertices[some]])
        )

    def moved(self, p: Array) -> "Body":
        """The body shifted by `p` (3,) [m]."""
        return replace(self, p=self.p + p)

    def distance(self, origins: Array, directions: Array) -> np.ndarray:
        """Distances (n,) to the body from `origins`, (n, 3) or (3,) [m] in F, in units of the
        `directions` (n, 3).
        """
        return self._rays.distance(origins - self.p, directions)

    @property
    def solid(self) -> Shell:
        """Vertices (V, 3) [m] in F, and triangles (T, 3)."""
        return self._shell[0] + self.p, self._shell[1]

    @property
    def points(self) -> Array:
        """Points (n, 3) [m] on the surface, in F."""
        return self._points + self.p

    @property
    def reach(self) -> float:
        """Horizontal distance [m] of its farthest vertex from the origin of F."""
        return float(np.linalg.norm(self.solid[0][:, :2], axis=1).max())

    @property
    def extent(self) -> float:
        """Largest side [m] of its bounding box in F."""
        return float(np.ptp(self.solid[0], axis=0).max())


def any_rotation(rng: Rng) -> Array:
    """Uniformly distributed rotation (3, 3)."""
    q = rng.normal(size=4)
    v = q[1:]
    return exp_so3(2.0 * np.arctan2(np.linalg.norm(v), q[0]) * v / np.linalg.norm(v))


def resting_attitude(shape: Shape, rng: Rng) -> Array:
    """Rotation (3, 3) of a shape that rests on flat ground, z up, on a stable side of its hull."""
    hull = ConvexHull(shape.vertices)
    normals = hull.equations[:, :3]
    offsets = -hull.equations[:, 3]

    # The projection of the centroid, which is the origin, must lie on the side. For the nearest
    # side this holds.
    way = any_rotation(rng)[0]
    limits = offsets + _CARRIED * shape.radius
    down = next(
        normals[k]
        for k in np.argsort(-normals @ way)
        if (normals @ (offsets[k] * normals[k]) <= limits).all()
    )

    R = rotation_from_z(-down, np.eye(3)[np.argmin(np.abs(down))]).T
    return exp_so3([0.0, 0.0, rng.uniform(-np.pi, np.pi)]) @ R


def free_way(body: Body, others: Sequence[Body], way: Array) -> float:
    """Distance [m] by which a body can move along the unit vector `way` until it meets another; inf
    if it meets none.
    """
    free = np.inf
    for other in others:
        free = min(
            free, float(other.distance(body.points, np.broadcast_to(way, body.points.shape)).min())
        )
        back = body.distance(other.points, np.broadcast_to(-way, other.points.shape))
        free = min(free, float(back.min()))
    return free


def slid(body: Body, others: Sequence[Body], way: Array, gap: float) -> Body | None:
    """A body moved from far away along `way` until it is `gap` [m] in front of the first of
    `others`; None if it passes them.
    """
    start = body.moved(-_AFAR * way)
    free = free_way(start, others, way)
    return start.moved((free - gap) * way) if np.isfinite(free) else None


def heaped(shapes: Sequence[Shape], rng: Rng, around: Sequence[Body] = ()) -> list[Array]:
    """Poses X_FT (4, 4) of shapes in contact with each other. Each shape is lowered onto the
    others, or pushed against them.

    Args:
        shapes: The shapes, in the order in which they are placed.
        rng: Draws attitudes and directions of motion.
        around: Bodies that already stand on the ground, z_F = 0.
    """
    poses: list[Array] = []
    bodies = list(around)

    for shape in shapes:
        R = resting_attitude(shape, rng)
        standing = Body.of((shape.vertices @ R.T, shape.triangles), rng)
        standing = standing.moved(np.array([0.0, 0.0, -standing.solid[0][:, 2].min()]))
        options = [standing]
        if bodies:
            placing = _let_down if len(bodies) % 2 == 0 else _pushed
            options = _tried(placing, standing, bodies, rng) or _tried(
                _pushed, standing, bodies, rng
            )

        # The lowest body; among those on the ground, the one nearest to the middle.
        body = min(options, key=_height_and_reach)
        X = pose(R, body.solid[0][0] - R @ shape.vertices[0])
        poses.append(X)
        bodies.append(body)
    return poses


def _let_down(body: Body, others: Sequence[Body], rng: Rng) -> Body | None:
    """A body lowered onto others, near the middle; None if it passes them."""
    above = body.moved(np.array([*rng.normal(0.0, 0.3 * body.extent, 2), _AFAR]))
    fall = free_way(above, others, np.array([0.0, 0.0, -1.0]))
    return above.moved(np.array([0.0, 0.0, -fall])) if fall < _AFAR else None


def _pushed(body: Body, others: Sequence[Body], rng: Rng) -> Body | None:
    """A body pushed along the ground against others, from any side; None if it passes them."""
    heading = rng.uniform(-np.pi, np.pi)
    return slid(body, others, np.array([np.cos(heading), np.sin(heading), 0.0]), 0.0)


def _tried(
    placing: Callable[[Body, Sequence[Body], Rng], Body | None],
    body: Body,
    others: Sequence[Body],
    rng: Rng,
) -> list[Body]:
    """Best result of several tries to place a body against others."""
    return [placed for _ in range(_TRIES) if (placed := placing(body, others, rng)) is not None]


def _height_and_reach(body: Body) -> tuple[float, float]:
    middle = body.points.mean(axis=0)
    return round(float(middle[2]), 6), float(np.hypot(*middle[:2]))


def beside(
    body: Body,
    others: Sequence[Body],
    shape: Shape,
    heading: float,
    gap: float,
    ground: float,
    rng: Rng,
) -> Body | None:
    """A shape at rest on the ground next to a body, moved towards it until it is near, or until it
    meets another body.

    Args:
        body: The body that the shape is moved towards.
        others: Bodies that the shape may meet before.
        shape: The shape.
        heading: [rad] Direction about z_F from which the shape comes.
        gap: [m] Distance that remains; 0: contact.
        ground: [m] height of the seabed.
        rng: Draws the attitude of the shape.

    Returns:
        The new body; None if contact was requested and the shape meets nothing.
    """
    vertices = shape.vertices @ resting_attitude(shape, rng).T
    vertices[:, 2] += ground - vertices[:, 2].min()
    way = np.array([np.cos(heading), np.sin(heading), 0.0])
    start = Body.of((vertices, shape.triangles), rng)

    placed = slid(start, [body, *others], -way, gap)
    if placed is None and gap > 0.0:  # the shape is lower than the body
        placed = start.moved((body.reach + shape.radius + gap) * way)
    elif placed is None and not others:  # the shape is lifted to the height of the body
        lift = float(np.mean(body.points[:, 2]) - np.mean(start.points[:, 2]))
        placed = slid(start.moved(np.array([0.0, 0.0, lift])), [body], -way, 0.0)
    return placed


def stone(body: Body, ground: float, rng: Rng) -> Body:
    """Ellipsoid half in the seabed at height `ground` [m], without contact with a body."""
    size = rng.uniform(0.02, 0.12, 3)
    reach = body.reach + size.max() + rng.uniform(0.03, 0.6)
    heading = rng.uniform(-np.pi, np.pi)
    X = pose(
        exp_so3(rng.normal(0.0, 0.4, 3)), [reach * np.cos(heading), reach * np.sin(heading), ground]
    )
    return Body.of(moved(scaled(sphere(3), size), X), rng)


def hidden_by(body: Body, others: Sequence[Body], X_CF: Array) -> tuple[Array, np.ndarray]:
    """Coarse view of a body: points (n, 3) [m] in F that a camera would see of the body alone, and
    a mask of those that are hidden.

    Args:
        body: The body.
        others: Bodies that may hide it.
        X_CF: (4, 4) pose of F in the camera's frame.
    """
    eye = inverse(X_CF)
    ways = pinhole(COARSE).reshape(-1, 3) @ eye[:3, :3].T
    t = body.distance(eye[:3, 3], ways)
    on = np.isfinite(t)
    ways = ways[on]
    t = t[on]

    hidden = np.zeros(len(t), dtype=bool)
    for other in others:
        hidden |= other.distance(eye[:3, 3], ways) < t
    return eye[:3, 3] + t[:, None] * ways, hidden


def veil(
    body: Body, others: Sequence[Body], X_CF: Array, share: tuple[float, float], rng: Rng
) -> list[Body] | None:
    """Rods, boards and stones between camera and object, so that they hide a share of its image.

    Args:
        body: The object.
        others: Bodies that already hide a part of it.
        X_CF: (4, 4) pose of F in the camera's frame.
        share: Bounds of the share that is to be hidden.
        rng: Draws the goal within these bounds, and the occluders.

    Returns:
        The occluders; None if others hide too much, or no occluder fits.
    """
    low, high = share
    visible, hidden = hidden_by(body, others, X_CF)
    if not len(visible):
        return None
    goal = 0.0 if high < _SLIGHT else float(rng.uniform(max(low, _SLIGHT), high - 0.02))
    eye = inverse(X_CF)[:3, 3]
    spread = float(np.linalg.norm(visible - visible.mean(axis=0), axis=1).max())

    # Occluders are added until the goal is reached; one that hides too much is left out.
    occluders: list[Body] = []
    for _ in range(_VEILS):
        if abs(hidden.mean() - goal) < _GOAL and low <= hidden.mean() <= high:
            return occluders
        if hidden.mean() > goal:
            return None

        nearness = rng.uniform(0.45, 0.85)
        at = eye + nearness * (visible[rng.integers(len(visible))] - eye)
        new = Body.of(moved(_occluder(rng, nearness * spread), pose(any_rotation(rng), at)), rng)
        with_it = hidden | (new.distance(eye, visible - eye) < 1.0)
        if with_it.mean() <= goal + 0.8 * _GOAL:
            hidden = with_it
            occluders.append(new)
    return None


def _occluder(rng: Rng, spread: float) -> Shell:
    """Rod, board or stone around the origin that hides part of an object with a size of `spread`
    [m].
    """
    form = ("rod", "board", "stone")[int(rng.integers(3))]
    size = spread * rng.uniform(0.08, 0.45)
    if form == "rod":
        return cylinder(0.3 * size, 1.5, 16)
    if form == "board":
        return box([size, size * rng.uniform(0.5, 2.0), 0.01], np.zeros(3))
    return scaled(sphere(2), size * rng.uniform(0.5, 1.0, 3))


def seabed(ground: float, rng: Rng) -> Shell:
    """Seabed at height `ground` [m] in F: flat, or with ripples whose crests are at that height."""
    count = 110  # number of lines
    half = 3.0  # [m] length of its side
    grid = np.linspace(-half, half, count)
    x, y = np.meshgrid(grid, grid)

    height = np.zeros_like(x)
    if rng.random() < 0.5:
        deep = rng.uniform(0.003, 0.012)
        length = rng.uniform(0.25, 0.6)
        turn = rng.uniform(0.0, np.pi)
        c = np.cos(turn)
        s = np.sin(turn)
        wave = c * x + s * y + 0.05 * np.sin(3.0 * (c * y - s * x))
        height = deep * (np.sin(2.0 * np.pi * wave / length) - 1.0)

    # two triangles for each cell, from the corners of the cell
    index = np.arange(count * count).reshape(count, count)
    a = index[:-1, :-1].ravel()
    b = index[:-1, 1:].ravel()
    c = index[1:, 1:].ravel()
    d = index[1:, :-1].ravel()
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel(), ground + height.ravel()]), faces

"""Seeded grammar of shapes: ten classes of technical and natural objects, thin and thick, in unit
size.

Parts are closed shells that may run into each other; rays see the outside of their union only. No
class is known to perception, and none was chosen for what identification can do.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np

from experiments.identification.unseen.solids import (
    ball,
    circle,
    extruded,
    hexagon,
    inside,
    mirrored,
    rectangle,
    ring,
    skinned,
    swept,
    tube,
    turned,
)
from uuv.clouds.placing import any_rotation
from uuv.models.meshes.closed_shells import (
    Shell,
    area_centroid,
    box,
    cylinder,
    joined,
    moved,
    scaled,
    sphere,
)
from uuv.models.objects.target_model import Symmetry, TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, rotation_from_z

Rng = np.random.Generator
Choice = TypeVar("Choice")

EXTENT = (0.2, 1.2)  # [m] of the largest side of the bounding box
THINNEST = 0.008  # [m] of a bar or sheet: two pixels of the usual camera at 2 m
_NAME = "unseen"  # of every target: it says nothing about its class


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnseenShape:
    """A shape of the grammar, its area's centroid at the origin of T."""

    kind: str  # class, a name in KINDS
    vertices: Array  # (V, 3) [m], in T
    triangles: np.ndarray  # (T, 3), counter-clockwise from outside

    @property
    def radius(self) -> float:
        """Distance [m] of the farthest vertex from the origin of T."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @property
    def extent(self) -> float:
        """Largest side [m] of the bounding box in T."""
        return float(np.ptp(self.vertices, axis=0).max())

    def mirrored(self) -> "UnseenShape":
        """The mirror image in the plane x_T = 0."""
        vertices, triangles = mirrored((self.vertices, self.triangles))
        return replace(self, vertices=vertices, triangles=triangles)

    def resized(self, factor: float) -> "UnseenShape":
        """The shape in `factor` times its size."""
        return replace(self, vertices=factor * self.vertices)

    def target(self, symmetry: Symmetry | None = None) -> TargetModel:
        """What perception is given: the mesh, and a symmetry if one is declared."""
        return TargetModel(
            name=_NAME,
            vertices=self.vertices,
            triangles=self.triangles,
            symmetry=symmetry or Symmetry(),
        )


def unseen_shape(kind: str, rng: Rng, extent: tuple[float, float] = EXTENT) -> UnseenShape:
    """A random shape of the class `kind`.

    Args:
        kind: Name in KINDS.
        rng: Draws everything.
        extent: [m] bounds of the largest side of the bounding box.

    Raises:
        ConfigurationError: The class is unknown.
    """
    if kind not in KINDS:
        raise ConfigurationError(f"no class of shapes {kind!r}; there are {', '.join(KINDS)}")

    size = float(np.exp(rng.uniform(*np.log(extent))))
    solid = KINDS[kind](rng, THINNEST / size)
    if rng.random() < 0.5:
        solid = mirrored(solid)
    if rng.random() < 0.5:  # as a scanned model: its axes say nothing
        solid = moved(solid, pose(any_rotation(rng)))

    vertices, triangles = solid
    vertices = vertices * (size / np.ptp(vertices, axis=0).max())
    return UnseenShape(
        kind=kind, vertices=vertices - area_centroid(vertices, triangles), triangles=triangles
    )


def _pick(rng: Rng, *choices: Choice) -> Choice:
    """One of `choices`, each as likely as the others."""
    return choices[int(rng.integers(len(choices)))]


def _spread(rng: Rng, low: float, high: float) -> float:
    """Random number, uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _at(x: float, y: float, z: float, R: Array | None = None) -> Array:
    return pose(R, [x, y, z])


def _about(axis: int, angle: float) -> Array:
    return exp_so3(angle * np.eye(3)[axis])


def _outline(rng: Rng) -> Array:
    """Outline of a plate, about 1 across."""
    form = _pick(rng, "rectangle", "rounded", "disc", "polygon", "angle")
    width = rng.uniform(0.4, 1.0)

    if form == "rectangle":
        return rectangle(1.0, width)
    if form == "rounded":
        return rectangle(1.0, width, rng.uniform(0.1, 0.45) * width)
    if form == "disc":
        return circle(0.5)

    if form == "polygon":
        count = int(rng.integers(3, 8))
        angle = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * (2.0 * np.pi / count)
        return 0.5 * np.column_stack([np.cos(angle), width**0.5 * np.sin(angle)])

    # An angle with two arms.
    leg, foot = rng.uniform(0.25, 0.5, 2)
    corners = np.array(
        [[0, 0], [1, 0], [1, foot * width], [leg, foot * width], [leg, width], [0, width]]
    )

    return corners - 0.5 * np.array([1.0, width])


def _holes(rng: Rng, outline: Array, count: int, least: float) -> list[Array]:
    """Up to `count` holes within an outline, apart from it and from each other."""
    holes: list[Array] = []
    taken: list[tuple[Array, float]] = []
    low, high = outline.min(axis=0), outline.max(axis=0)

    for _ in range(12 * count):
        if len(holes) == count:
            break

        size = _spread(rng, max(0.03, 1.5 * least), max(0.2, 2.0 * least))
        offset, margin = rng.uniform(low, high), 0.4 * size + 0.02

        free = all(np.linalg.norm(offset - p) > size + s + 0.02 for p, s in taken)
        if not free or not inside(offset + circle(size + margin, 24), [outline]).all():
            continue

        form = _pick(rng, "round", "round", "slot", "square")
        hole = circle(size, 24)
        if form == "slot":
            hole = rectangle(2.0 * size, 0.8 * size, 0.39 * size)
        elif form == "square":
            hole = rectangle(1.4 * size, 1.4 * size)

        c, s = np.cos(turn := rng.uniform(0.0, np.pi)), np.sin(turn)
        holes.append(offset + hole @ np.array([[c, s], [-s, c]]))
        taken.append((offset, size))

    return holes


def _plate(rng: Rng, least: float) -> Shell:
    """Plate with holes, and sometimes ribs on one side."""
    outline = _outline(rng)

    thick = max(least, _spread(rng, 0.015, 0.12))
    parts = [extruded(outline, thick, _holes(rng, outline, int(rng.integers(1, 8)), least))]

    # Ribs stand on one side, and only where the whole foot lies on the plate.
    for _ in range(_pick(rng, 0, 0, 1, 2)):
        length, height, middle = (
            rng.uniform(0.25, 0.5),
            _spread(rng, 0.04, 0.2),
            rng.uniform(-0.3, 0.3, 2),
        )

        turn = _about(2, rng.uniform(0.0, np.pi))
        foot = middle + np.linspace(-0.5, 0.5, 5)[:, None] * length * turn[:2, 0]
        if inside(foot, [outline]).all():
            rib = box([length, max(least, 0.03), height], [0.0, 0.0, 0.5 * (thick + height)])
            parts.append(moved(rib, _at(middle[0], middle[1], 0.0, turn)))

    return joined(parts)


def _pipe(rng: Rng, least: float) -> Shell:
    """Pipe, straight or bent, with branches and collars."""
    r = max(2.0 * least, rng.uniform(0.06, 0.17))
    bore, deep = r * rng.uniform(0.6, 0.85), rng.uniform(0.05, 0.1)

    if rng.random() < 0.4:
        path = _bend(rng, deep)
        branches = 0
    else:
        path = np.array(
            [[0, 0, -0.5], [0, 0, deep - 0.5], [0, 0, 0.5 - deep], [0, 0, 0.5]], dtype=float
        )
        branches = int(rng.integers(1, 4))

    parts = [tube(path, r, bore, 1)]

    # Branches leave the straight pipe between its bores.
    free = 0.5 - deep - 1.6 * r
    for _ in range(branches):
        z, azimuth = (
            rng.uniform(-free, free),
            _pick(rng, 0.0, 0.5, 1.0, 1.5, rng.uniform(0.0, 2.0)) * np.pi,
        )
        lean, length = _pick(rng, 0.5, 0.5, 0.25) * np.pi, r + rng.uniform(0.12, 0.35)
        small = r * rng.uniform(0.55, 0.98)
        arm = np.array(
            [[0, 0, 0], [0, 0, 0.4 * length], [0, 0, length - 0.08], [0, 0, length]], dtype=float
        )

        X = _at(0.0, 0.0, z, _about(2, azimuth) @ _about(1, lean))
        parts.append(moved(tube(arm, small, 0.7 * small, 1), X))
        if rng.random() < 0.4:
            parts.append(moved(_collar(rng, small), X @ _at(0.0, 0.0, length - 0.03)))

    # Collars around the ends.
    for end in (0, -1):
        if rng.random() < 0.6:
            way = path[end] - path[1 if end == 0 else -2]
            z = way / np.linalg.norm(way)
            hint = np.eye(3)[np.argmin(np.abs(z))]
            p = path[end] - 0.03 * z
            parts.append(moved(_collar(rng, r), pose(rotation_from_z(z, hint), p)))

    return joined(parts)


def _bend(rng: Rng, deep: float) -> Array:
    """Path (N, 3) of a pipe with one or two bends, in or out of a plane; its first and last step
    are `deep`.
    """
    around = rng.uniform(0.22, 0.35)

    # Directions of the straight parts, each bent from the one before.
    ways = [np.array([1.0, 0.0, 0.0])]
    for _ in range(_pick(rng, 1, 2)):
        axis = np.cross(ways[-1], any_rotation(rng)[0])
        ways.append(
            exp_so3(_pick(rng, 0.25, 0.5, 0.5) * np.pi * axis / np.linalg.norm(axis)) @ ways[-1]
        )

    points = [np.zeros(3), deep * ways[0], (deep + rng.uniform(0.1, 0.3)) * ways[0]]

    # Each bend is an arc of a circle that touches both directions.
    for before, after in pairwise(ways):
        axis = np.cross(before, after)
        angle = float(np.arctan2(np.linalg.norm(axis), before @ after))
        middle = points[-1] + around * np.cross(axis / np.linalg.norm(axis), before)
        arm = points[-1] - middle

        points += [
            middle + exp_so3(share * angle * axis / np.linalg.norm(axis)) @ arm
            for share in np.linspace(0, 1, 13)[1:]
        ]
        points.append(points[-1] + rng.uniform(0.1, 0.3) * after)

    points.append(points[-1] + deep * ways[-1])
    return np.array(points)


def _collar(rng: Rng, r: float) -> Shell:
    """Flange ring around a pipe of radius `r` along z."""
    wide, half = r * rng.uniform(1.35, 1.8), 0.5 * rng.uniform(0.03, 0.06)
    return ring(np.array([[0.97 * r, -half], [wide, -half], [wide, half], [0.97 * r, half]]))


def _flange(rng: Rng, least: float) -> Shell:
    """Flange with a hub and bolts; some bolts may be missing, and a lug may break the symmetry."""
    thick, bore = max(least, _spread(rng, 0.05, 0.2)), rng.uniform(0.1, 0.24)
    count = int(rng.integers(4, 13))
    at = 0.5 * (0.5 + bore) + 0.02
    size = min(0.06, 0.55 * np.pi * at / count, 0.5 * (0.5 - bore) - 0.06)

    # Missing bolts leave their holes behind.
    present = np.ones(count, dtype=bool)
    if rng.random() < 0.5:
        present[rng.choice(count, int(rng.integers(1, 3)), replace=False)] = False

    angle = np.arange(count) * (2.0 * np.pi / count)
    places = at * np.column_stack([np.cos(angle), np.sin(angle)])
    holes = [circle(bore), *(p + circle(0.7 * size, 20) for p in places[~present])]
    parts = [extruded(circle(0.5, 72), thick, holes)]

    # Bolts: head above, shaft and nut below.
    head, nut = size * rng.uniform(0.6, 1.1), size * rng.uniform(0.6, 1.4)
    for p in places[present]:
        for part, z in (
            (hexagon(size, head), 0.5 * (thick + head)),
            (cylinder(0.55 * size, 1.6 * nut, 20), -0.5 * thick - 0.8 * nut),
            (hexagon(size, nut), -0.5 * (thick + nut)),
        ):
            parts.append(moved(part, _at(p[0], p[1], z)))

    # Hub.
    if rng.random() < 0.7:
        height, wide = rng.uniform(0.08, 0.5), bore + rng.uniform(0.3, 0.9) * (at - size - bore)
        low = 0.5 * thick - 0.01
        slim = bore + 0.6 * (wide - bore)
        parts.append(
            ring(
                np.array([[bore, low], [wide, low], [slim, low + height], [bore, low + height]]), 72
            )
        )

    # Lug.
    if rng.random() < 0.4:
        lug = box([0.12, rng.uniform(0.08, 0.2), thick], [0.53, 0.0, 0.0])
        parts.append(moved(lug, pose(_about(2, rng.uniform(0.0, 2.0 * np.pi)))))

    return joined(parts)


def _bar(a: Array, b: Array, width: float, is_round: bool) -> Shell:
    """Bar between two points, a little longer than their distance, so that bars join in corners."""
    way = b - a
    z = way / np.linalg.norm(way)
    R = rotation_from_z(z, np.eye(3)[np.argmin(np.abs(z))])

    length = float(np.linalg.norm(way)) + (0.0 if is_round else width)
    bar = (
        cylinder(0.5 * width, length, 16) if is_round else box([width, width, length], np.zeros(3))
    )
    return moved(bar, pose(R, 0.5 * (a + b)))


def _frame(rng: Rng, least: float) -> Shell:
    """Frame of bars along the edges of a box or wedge, with braces; some bars may be missing."""
    width = max(least, _spread(rng, 0.025, 0.09))
    is_round = bool(rng.random() < 0.5)

    size = np.array([1.0, rng.uniform(0.35, 1.0), rng.uniform(0.3, 0.9)]) - width
    corners = 0.5 * size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    if rng.random() < 0.3:  # the upper side is smaller
        corners[1::2, :2] *= rng.uniform(0.4, 0.8, 2)

    # The corners' numbers are bits of x, y and z: an edge changes one of them, a diagonal two.
    edges = [(i, j) for i in range(8) for j in range(i + 1, 8) if bin(i ^ j).count("1") == 1]
    gone = rng.choice(12, _pick(rng, 0, 0, 1, 2), replace=False)
    bars = [edge for k, edge in enumerate(edges) if k not in gone]
    diagonals = [(i, j) for i in range(8) for j in range(i + 1, 8) if bin(i ^ j).count("1") == 2]
    bars += [diagonals[k] for k in rng.choice(12, _pick(rng, 0, 1, 2, 3), replace=False)]

    parts = [_bar(corners[i], corners[j], width, is_round) for i, j in bars]
    for _ in range(_pick(rng, 0, 1, 2)):  # a bar between two parallel edges
        axis = int(rng.integers(3))
        first = [k for k, (i, j) in enumerate(edges) if (i ^ j) == 4 >> axis]
        (a, b), (c, d) = (edges[k] for k in rng.choice(first, 2, replace=False))

        share = _pick(rng, 0.5, rng.uniform(0.25, 0.75))
        ends = (
            corners[a] + share * (corners[b] - corners[a]),
            corners[c] + share * (corners[d] - corners[c]),
        )
        parts.append(_bar(*ends, width, is_round))

    # Balls close the gaps that round bars leave in the corners.
    if is_round:
        parts += [moved(ball(0.5 * width), pose(p=corner)) for corner in corners]

    return joined(parts)


def _spring(rng: Rng, least: float) -> Shell:
    """Helical spring, cylindrical or conical, open, hooked or with flat ends."""
    coils = _pick(rng, 3.0, 4.0, 5.5, 7.0, rng.uniform(2.5, 9.0))
    wire = max(0.6 * least, rng.uniform(0.1, 0.3) / coils)
    radius = max(rng.uniform(0.12, 0.4), 2.5 * wire)
    taper = _pick(rng, 1.0, 1.0, rng.uniform(0.5, 0.8))

    turns = np.linspace(0.0, coils, int(24 * coils) + 1)
    share = turns / coils
    around = radius * (1.0 + (taper - 1.0) * share)
    angle = 2.0 * np.pi * turns
    height = (1.0 - 2.0 * wire) * (share - 0.5)

    ends = _pick(rng, "open", "flat", "hooked")
    if ends == "flat":
        height = (0.5 - wire) * np.clip((share - 0.5) / (0.5 - min(0.3, 0.8 / coils)), -1.0, 1.0)

    path = np.column_stack([around * np.cos(angle), around * np.sin(angle), height])
    if ends == "hooked":
        inward = path[-1] * [0.0, 0.0, 1.0] + [0.0, 0.0, 0.3 * radius]
        path = np.vstack([path, inward, inward + np.array([0.0, 0.0, radius])])

    return swept(path, circle(wire, 12))


def _grid(rng: Rng, least: float) -> Shell:
    """Periodic object: grating, ladder, rack of fins, or stacked discs, perhaps with a gap."""
    form = _pick(rng, "grating", "ladder", "fins", "discs")

    missing = bool(rng.random() < 0.4)
    width = max(least, rng.uniform(0.02, 0.05))

    # Two rails with rungs across.
    if form in ("grating", "ladder"):
        across = rng.uniform(0.4, 1.0) if form == "grating" else rng.uniform(0.2, 0.45)
        depth = max(least, width * rng.uniform(0.6, 2.0))
        rails = [box([1.0, width, depth], [0.0, y, 0.0]) for y in (-0.5 * across, 0.5 * across)]
        count = int(rng.integers(4, 11))
        rungs = [
            box([width, across, depth], [x, 0.0, 0.0])
            for x in np.linspace(-0.5, 0.5, count) * (1.0 - width)
        ]

        if form == "grating":
            more = int(rng.integers(1, 7))
            rails += [
                box([1.0, width, depth], [0.0, y, 0.0])
                for y in np.linspace(-0.5, 0.5, more + 2)[1:-1] * across
            ]

        if missing:
            rungs.pop(int(rng.integers(1, count - 1)))

        return joined([*rails, *rungs])

    # Elements along z: discs on a rod, or fins on a base.
    count, thick = int(rng.integers(4, 10)), max(least, rng.uniform(0.015, 0.05))
    z = np.linspace(-0.5, 0.5, count) * (1.0 - thick)
    if missing:
        z = np.delete(z, int(rng.integers(1, count - 1)))

    wide = rng.uniform(0.2, 0.5)
    if form == "discs":
        rod = cylinder(max(0.6 * least, 0.2 * wide), 1.0)
        return joined([rod, *(moved(cylinder(wide, thick), _at(0.0, 0.0, h)) for h in z)])

    height = rng.uniform(0.15, 0.5)
    base = box([2.0 * wide, max(least, 0.04), 1.0], [0.0, 0.0, 0.0])
    return joined([base, *(box([2.0 * wide, height, thick], [0.0, 0.5 * height, h]) for h in z)])


def _pebble(rng: Rng, _least: float) -> Shell:
    """Smooth stone: an ellipsoid with broad bumps and hollows."""
    directions, triangles = sphere(4)
    radius = np.ones(len(directions))
    for power, most in ((2, 0.2), (3, 0.25), (3, 0.25), (4, 0.2), (5, 0.2)):
        way = any_rotation(rng)[0]
        radius += rng.uniform(-most, most) * (directions @ way) ** power

    axes = np.array([1.0, rng.uniform(0.55, 0.95), rng.uniform(0.35, 0.85)])
    return scaled((np.maximum(radius, 0.3)[:, None] * directions, triangles), axes)


def _extrusion(rng: Rng, least: float) -> Shell:
    """Profile of constant section: angle, tee, channel, beam, gear, star or a smooth curve."""
    form = _pick(rng, "angle", "tee", "channel", "beam", "gear", "star", "curve")
    wall, width = max(0.08, 1.2 * least), rng.uniform(0.5, 1.0)

    if form in ("gear", "star"):
        teeth = int(rng.integers(4, 13)) if form == "gear" else int(rng.integers(3, 8))
        inner = rng.uniform(0.3, 0.42)
        share = np.array([-0.3, -0.2, 0.2, 0.3]) if form == "gear" else np.array([0.0, 0.5])
        radius = np.array([inner, 0.5, 0.5, inner]) if form == "gear" else np.array([0.5, inner])
        angle = (np.arange(teeth)[:, None] + share).ravel() * (2.0 * np.pi / teeth)
        outline = np.tile(radius, teeth)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    elif form == "curve":
        # A circle with four harmonics, whose largest amplitudes fall with their order.
        angle = np.arange(72) * (2.0 * np.pi / 72)
        radius = 0.4 * np.ones(72)
        for n in range(1, 5):
            radius += (
                0.25
                / n
                * rng.uniform(-1.0, 1.0)
                * np.cos(n * angle + rng.uniform(0.0, 2.0 * np.pi))
                / 1.5
            )
        outline = np.maximum(radius, 0.1)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        outline = np.column_stack(_section(form, wall, width))

    return extruded(outline, _spread(rng, 0.15, 2.5))


def _section(form: str, wall: float, width: float) -> tuple[list[float], list[float]]:
    """Corners x, y of a rolled section of height 1, counter-clockwise."""
    a, b, c, d, m = 0.5 * width, 0.5 * width - wall, 0.5 - wall, 0.5, 0.5 * wall

    if form == "angle":
        return [-a, a, a, -b, -b, -a], [-d, -d, -c, -c, d, d]
    if form == "tee":
        return [-m, m, m, a, a, -a, -a, -m], [-d, -d, c, c, d, d, c, c]
    if form == "channel":
        return [-a, a, a, b, b, -b, -b, -a], [-d, -d, d, d, -c, -c, d, d]
    return [-a, a, a, m, m, a, a, -a, -a, -m, -m, -a], [-d, -d, -c, -c, c, c, d, d, c, c, -c, -c]


def _union(rng: Rng, least: float) -> Shell:
    """Three to seven random primitives grown onto each other."""
    parts: list[Shell] = []

    for _ in range(int(rng.integers(3, 8))):
        part = moved(_primitive(rng, least), pose(any_rotation(rng)))
        if parts:
            spot = _pick(rng, *parts)[0]
            part = moved(part, pose(p=spot[int(rng.integers(len(spot)))]))
        parts.append(part)

    return joined(parts)


def _primitive(rng: Rng, least: float) -> Shell:
    a, b, c = np.maximum(rng.uniform(0.08, 0.5, 3), 1.5 * least)
    form = _pick(rng, "box", "box", "cylinder", "cone", "ball", "hoop", "hexagon")

    if form == "box":
        return box([a, b, c], np.zeros(3))
    if form == "cylinder":
        return cylinder(0.5 * a, b)
    if form == "cone":
        return turned([(-0.5 * b, 0.0), (-0.5 * b, 0.5 * a), (0.5 * b, 0.2 * a), (0.5 * b, 0.0)])
    if form == "ball":
        return ball(0.4 * a)
    if form == "hexagon":
        return hexagon(0.5 * a, b)

    wide = max(0.3, a)
    return ring(np.array([0.5 * wide, 0.0]) + circle(max(0.06, least), 16))


def _chiral(rng: Rng, least: float) -> Shell:
    """Object with a hand: propeller, twisted bar, screw, winding stair, or bent bracket."""
    form = _pick(rng, "propeller", "twisted", "screw", "stair", "bracket")
    thick = max(least, rng.uniform(0.02, 0.05))

    if form == "propeller":
        hub, count = rng.uniform(0.06, 0.12), int(rng.integers(2, 6))
        chord, span = rng.uniform(0.15, 0.3), 0.5 - 0.7 * hub
        blade = extruded(rectangle(chord, thick), span, twist=rng.uniform(-0.9, -0.3), layers=10)
        pitch = _about(2, rng.uniform(0.4, 0.8))
        R = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # the span lies along x
        blade = moved(blade, _at(0.7 * hub + 0.5 * span, 0.0, 0.0, R @ pitch))
        blades = [moved(blade, pose(_about(2, 2.0 * np.pi * k / count))) for k in range(count)]
        return joined([cylinder(hub, max(1.6 * hub, 1.2 * chord * np.sin(0.8))), *blades])

    if form == "twisted":
        profile = rectangle(0.3, max(thick, rng.uniform(0.08, 0.3)))
        return extruded(profile, 1.0, twist=rng.uniform(0.8, 4.0), layers=32)

    if form == "screw":
        shaft, wide, turns = rng.uniform(0.06, 0.12), rng.uniform(0.2, 0.35), rng.uniform(1.5, 4.0)
        angle = np.linspace(0.0, 2.0 * np.pi * turns, int(32 * turns) + 1)
        z = np.linspace(-0.5, 0.5 - thick, len(angle))
        corners = np.array([[0.5 * shaft, 0.0], [0.5 * shaft, thick], [wide, thick], [wide, 0.0]])
        r, rise = corners.T

        rings = np.stack(
            [np.outer(np.cos(angle), r), np.outer(np.sin(angle), r), z[:, None] + rise], axis=-1
        )
        return joined([skinned(rings), cylinder(shaft, 1.1)])

    if form == "stair":
        count, step = int(rng.integers(5, 11)), rng.uniform(0.35, 0.7)
        z = np.linspace(-0.45, 0.45, count)
        tread = box([0.4, 0.14, thick], [0.22, 0.0, 0.0])
        treads = [moved(tread, _at(0.0, 0.0, h, _about(2, k * step))) for k, h in enumerate(z)]
        return joined([cylinder(max(0.04, 0.5 * least), 1.0), *treads])

    # Bracket: three bars along the axes in a random order, with a plate at each end.
    width = max(1.5 * least, rng.uniform(0.06, 0.16))
    ends = np.cumsum(
        [np.zeros(3), *(np.eye(3)[k] * rng.uniform(0.3, 0.8) for k in rng.permutation(3))], axis=0
    )

    parts = [_bar(a, b, width, False) for a, b in pairwise(ends)]
    parts += [
        box([3.0 * width, 3.0 * width, thick], ends[0]),
        box([thick, 2.0 * width, 3.0 * width], ends[-1]),
    ]

    return joined(parts)


KINDS: Mapping[str, Callable[[Rng, float], Shell]] = {
    "plate": _plate,
    "pipe": _pipe,
    "flange": _flange,
    "frame": _frame,
    "spring": _spring,
    "grid": _grid,
    "pebble": _pebble,
    "extrusion": _extrusion,
    "union": _union,
    "chiral": _chiral,
}

"""Shapes of the grammar are closed and repeat; symmetry and likeness agree with what is known of
simple solids.
"""

import numpy as np
import pytest

from experiments.identification.unseen.grammar import EXTENT, KINDS, UnseenShape, unseen_shape
from experiments.identification.unseen.likeness import Likeness
from experiments.identification.unseen.solids import (
    ball,
    circle,
    extruded,
    hexagon,
    inside,
    rectangle,
    ring,
    swept,
    tube,
    turned,
)
from uuv.models.meshes.closed_shells import (
    Shell,
    area_centroid,
    box,
    cylinder,
    joined,
    open_edges,
    volume,
)
from uuv.models.objects.target_model import Symmetry
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3

PITCH, RACK = 0.12, np.arange(-4, 5)  # [m], numbers of the fins


def likeness(solid: Shell) -> Likeness:
    vertices, triangles = solid
    return Likeness(
        UnseenShape(kind="", vertices=vertices - area_centroid(*solid), triangles=triangles)
    )


def spring(coils: float, radius: float = 0.1, wire: float = 0.012) -> Shell:
    angle = np.linspace(-np.pi * coils, np.pi * coils, int(24 * coils) + 1)
    path = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), 0.06 * angle / (2.0 * np.pi)]
    )
    return swept(path, circle(wire, 12))


def two_holes(left: float, right: float) -> list[np.ndarray]:
    aside = np.array([0.15, 0.0])
    return [circle(left) - aside, circle(right) + aside]


def orders(symmetry: Symmetry) -> tuple[bool, int]:
    return symmetry.axis is not None, len(symmetry.rotations)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.seeds(1, 2, 3)
def test_shapes_are_closed_of_their_size_and_repeat(kind: str, seed: int):
    shape, again, other = (
        unseen_shape(kind, np.random.default_rng(k)) for k in (seed, seed, seed + 1000)
    )
    assert np.array_equal(shape.vertices, again.vertices)
    assert np.array_equal(shape.triangles, again.triangles)
    assert shape.vertices.shape != other.vertices.shape or not np.allclose(
        shape.vertices, other.vertices
    )
    assert open_edges(shape.triangles) == 0
    assert volume(shape.vertices, shape.triangles) > 0.0
    assert EXTENT[0] - 1e-9 <= shape.extent <= EXTENT[1] + 1e-9
    assert area_centroid(shape.vertices, shape.triangles) == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_every_shell_winds_outwards(kind: str):
    shape = unseen_shape(kind, np.random.default_rng(5))
    for vertices, triangles in shells(shape):
        assert volume(vertices, triangles) > 0.0


def shells(shape: UnseenShape) -> list[Shell]:
    """The connected shells of a shape."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.vstack([shape.triangles[:, [0, 1]], shape.triangles[:, [1, 2]]])
    count = len(shape.vertices)
    label = connected_components(coo_matrix((np.ones(len(edges)), edges.T), (count, count)))[1][
        shape.triangles[:, 0]
    ]
    return [(shape.vertices, shape.triangles[label == k]) for k in np.unique(label)]


def test_an_unknown_class_is_refused():
    with pytest.raises(ConfigurationError, match="no class of shapes 'teapot'; there are plate"):
        unseen_shape("teapot", np.random.default_rng(0))


@pytest.mark.parametrize(
    ("solid", "true_volume", "within_share"),
    [
        # Polygons of 48 sides: the area of a circle is 0.29 % too small.
        (cylinder(0.3, 0.5), np.pi * 0.3**2 * 0.5, 3e-3),
        (turned([(-0.2, 0.0), (0.2, 0.3), (0.2, 0.0)]), np.pi * 0.3**2 * 0.4 / 3.0, 3e-3),
        (
            ring(np.array([[0.2, -0.05], [0.3, -0.05], [0.3, 0.05], [0.2, 0.05]])),
            np.pi * (0.09 - 0.04) * 0.1,
            3e-3,
        ),
        (
            tube(np.outer([-0.5, -0.4, 0.4, 0.5], [0, 0, 1.0]), 0.1, 0.05, 1),
            np.pi * (0.01 - 0.2 * 0.0025),
            3e-3,
        ),
        (
            extruded(rectangle(0.4, 0.2), 0.05, [circle(0.05)]),
            (0.08 - np.pi * 0.05**2) * 0.05,
            3e-3,
        ),
        (extruded(rectangle(0.4, 0.2), 0.5, twist=1.0, layers=40), 0.04, 2e-3),
        (hexagon(0.1, 0.2), 1.5 * np.sqrt(3.0) * 0.01 * 0.2, 1e-9),
        (ball(0.2), 4.0 / 3.0 * np.pi * 0.008, 1.5e-2),
        (box([0.1, 0.2, 0.3], np.zeros(3)), 0.006, 1e-9),
    ],
)
def test_solids_are_closed_and_have_their_volume(
    solid: Shell, true_volume: float, within_share: float
):
    assert open_edges(solid[1]) == 0
    assert volume(*solid) == pytest.approx(true_volume, rel=within_share)


def test_a_bent_tube_has_the_volume_of_pappus():
    angle = np.linspace(0.0, 0.5 * np.pi, 40)
    quarter = tube(0.4 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)]), 0.1)
    assert volume(*quarter) == pytest.approx(np.pi * 0.1**2 * 0.4 * 0.5 * np.pi, rel=4e-3)


def test_outlines_that_cross_are_refused():
    bow = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(ConfigurationError, match="outlines cross"):
        extruded(bow, 0.1)


def test_inside_counts_a_hole_out():
    loops = [rectangle(2.0, 2.0), circle(0.5)]
    assert inside(np.array([[0.8, 0.8], [0.1, 0.2], [1.2, 0.0]]), loops).tolist() == [
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(
    ("solid", "has_axis", "rotations"),
    [
        (box([0.2, 0.3, 0.5], np.zeros(3)), False, 4),
        (box([0.3, 0.3, 0.5], np.zeros(3)), False, 8),
        # every rotation is tried
        pytest.param(box([0.4, 0.4, 0.4], np.zeros(3)), False, 24, marks=pytest.mark.long),
        (hexagon(0.2, 0.5), False, 12),
        (cylinder(0.2, 0.5), True, 2),
        (turned([(-0.2, 0.0), (-0.2, 0.3), (0.3, 0.1), (0.3, 0.0)]), True, 1),
        (extruded(circle(0.3, 72), 0.05, two_holes(0.05, 0.05)), False, 4),
        (extruded(circle(0.3, 72), 0.05, two_holes(0.04, 0.05)), False, 2),
        # a half turn about the one axis across it through the middle of its wire
        (spring(4.0), False, 2),
    ],
    ids=[
        "box",
        "square bar",
        "cube",
        "hexagon",
        "cylinder",
        "cone",
        "two holes",
        "unequal holes",
        "spring",
    ],
)
def test_symmetry_is_that_of_the_solid(solid: Shell, has_axis: bool, rotations: int):
    turn = exp_so3([0.3, -0.8, 0.5])  # it does not stand along the axes
    found = likeness((solid[0] @ turn.T, solid[1]))
    assert orders(found.symmetry) == (has_axis, rotations)
    for R in found.symmetry.rotations:
        assert np.median(found.distance(found.points @ R.T)) < 1e-3


@pytest.mark.parametrize(
    "solid", [box([0.2, 0.3, 0.5], np.zeros(3)), cylinder(0.2, 0.5), hexagon(0.2, 0.5)]
)
def test_what_has_a_plane_of_symmetry_is_its_mirror_image(solid: Shell):
    assert likeness(solid).mirror_share == 0.0


def test_a_spring_has_a_hand():
    found = likeness(spring(4.0))
    # 0.48: both hands agree near the points where their wires cross
    assert found.mirror_share > 0.3
    twin = Likeness(found.shape.mirrored())
    assert volume(twin.shape.vertices, twin.shape.triangles) > 0.0
    assert orders(twin.symmetry) == (False, 2)
    assert twin.has_hand(0.2)


def test_a_missing_bolt_leaves_rivals_of_which_one_differs_by_two_bolts():
    angle = 2.0 * np.pi / 6.0 * np.arange(5)
    holes = [circle(0.03, 20) + 0.2 * np.array([np.cos(a), np.sin(a)]) for a in angle]
    found = likeness(extruded(circle(0.3, 72), 0.06, holes))
    assert orders(found.symmetry) == (False, 2)
    turns = [found.symmetry.error(S, np.eye(4))[1] for S in found.rivals]
    assert np.rad2deg(min(turns, key=lambda turn: abs(turn - np.pi / 3.0))) == pytest.approx(
        60.0, abs=1.5
    )
    assert 0.0 < found.share_apart(found.rivals[0]) < 0.1


def test_a_rack_of_fins_is_its_own_rival_one_pitch_further():
    base, fins = (
        box([0.3, 0.04, 1.0], np.zeros(3)),
        [box([0.3, 0.3, 0.02], [0.0, 0.15, z]) for z in PITCH * RACK],
    )
    found = likeness(joined([base, *fins]))
    slides = [np.linalg.norm(S[:3, 3]) for S in found.rivals if np.trace(S[:3, :3]) > 2.9]
    assert slides
    assert min(abs(slide - PITCH) for slide in slides) < 0.01

"""Shells against the volumes and counts of their solids."""

import numpy as np
import pytest

from uuv.models.meshes.closed_shells import (
    box,
    joined,
    open_edges,
    prism,
    revolve,
    sphere,
    split,
    vertex_normals,
    volume,
    welded,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3


@pytest.mark.parametrize("sides", [3, 5, 24])
def test_a_profile_turned_about_x_is_a_stack_of_frustums(sides: int) -> None:
    x = np.array([-0.2, -0.1, 0.3, 0.7, 0.9])
    r = np.array([0.0, 0.3, 0.5, 0.2, 0.0])
    vertices, triangles = revolve(np.column_stack([x, r]), sides)
    area = 0.5 * sides * np.sin(2.0 * np.pi / sides)  # of the polygon in a unit circle
    expected = area * np.sum(np.diff(x) * (r[1:] ** 2 + r[1:] * r[:-1] + r[:-1] ** 2)) / 3.0
    assert open_edges(triangles) == 0
    # A quadrangle of a cone is bent at its diagonal where the rings differ, by nothing: its corners
    # lie in a plane.
    assert volume(vertices, triangles) == pytest.approx(expected)
    assert len(vertices) == 2 + 3 * sides
    assert len(vertices) - len(triangles) // 2 == 2  # Euler: V - 3/2 T + T
    np.testing.assert_allclose(np.unique(np.round(np.hypot(*vertices[:, 1:].T), 12)), np.unique(r))
    assert set(np.round(vertices[:, 0], 12)) == set(x)
    for bad in ([0.1, 0.3, 0.5, 0.2, 0.0], [0.0, 0.3, 0.5, 0.2, 0.1]):
        with pytest.raises(ConfigurationError, match="first and the last radius"):
            revolve(np.column_stack([x, bad]), sides)


def test_prisms_and_boxes_have_their_volume() -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [1.5, 2, 0], [0, 1, 0]], dtype=float)
    ground = 0.5 * np.sum(
        corners[:, 0] * np.roll(corners[:, 1], -1) - corners[:, 1] * np.roll(corners[:, 0], -1)
    )
    vertices, triangles = prism(corners, corners + np.array([0.3, 0.2, 0.7]))
    assert open_edges(triangles) == 0
    assert volume(vertices, triangles) == pytest.approx(0.7 * ground)
    vertices, triangles = box([0.2, 0.3, 0.5], [1.0, 2.0, 3.0])
    assert open_edges(triangles) == 0
    assert volume(vertices, triangles) == pytest.approx(0.2 * 0.3 * 0.5)
    np.testing.assert_allclose(vertices.min(axis=0), [0.9, 1.85, 2.75])
    np.testing.assert_allclose(vertices.max(axis=0), [1.1, 2.15, 3.25])
    assert volume(vertices, triangles[:, ::-1]) == pytest.approx(-0.03)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_spheres_are_divided_icosahedra(level: int) -> None:
    vertices, triangles = sphere(level)
    assert len(triangles) == 20 * 4**level
    assert len(vertices) == 2 + len(triangles) // 2
    assert open_edges(triangles) == 0
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    edges = np.linalg.norm([a - b, b - c, c - a], axis=2)
    assert edges.max() / edges.min() < 1.35  # 1 at level 0, then 1.18 and 1.28
    if level == 0:
        # regular, in a unit sphere
        assert volume(vertices, triangles) == pytest.approx(2.5361507, abs=1e-6)
    np.testing.assert_allclose(vertex_normals(vertices, triangles), vertices, atol=0.02)


def test_normals_are_weighted_by_area_and_zero_without_triangle() -> None:
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 3], [5, 5, 5]], dtype=float)
    normals = vertex_normals(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    np.testing.assert_allclose(normals[0], np.array([3.0, 0.0, 2.0]) / np.sqrt(13.0))
    np.testing.assert_allclose(normals[1], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(normals[3], [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(normals[4], 0.0)


def test_open_edges_are_counted() -> None:
    _, triangles = sphere(0)
    assert open_edges(triangles[1:]) == 3
    turned = triangles.copy()
    turned[0] = turned[0, ::-1]
    assert open_edges(turned) == 6  # three edges run twice one way, and have no opposite
    assert open_edges(np.vstack([triangles, triangles[:1]])) == 3


def test_welding_joins_what_is_near_and_drops_what_collapses() -> None:
    first, second = box([1.0, 1.0, 1.0], [0.0, 0.0, 0.0]), box([1.0, 1.0, 1.0], [0.0, 0.0, 1.0])
    vertices, triangles = joined([first, second])
    assert (len(vertices), len(triangles)) == (16, 24)
    np.testing.assert_array_equal(vertices[triangles[12:]], second[0][second[1]])
    points, faces = welded(vertices + 1e-9 * np.arange(16)[:, None], triangles, 1e-4)
    assert (len(points), len(faces)) == (12, 24)
    assert volume(points, faces) == pytest.approx(2.0, abs=1e-6)
    np.testing.assert_allclose(points[:8], vertices[:8], atol=1e-6)  # in the order of the first
    three = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        near = three.copy()
        near[j] = near[i] + 1e-7
        _, faces = welded(np.vstack([near, three]), np.array([[0, 1, 2], [3, 4, 5]]), 1e-4)
        assert len(faces) == 1
    assert len(welded(three, np.array([[0, 1, 2]]))[0]) == 3


def test_splitting_divides_long_edges_alone() -> None:
    vertices, triangles = box([1.0, 0.2, 0.2], [0.0, 0.0, 0.0])
    vertices = vertices @ exp_so3([0.3, 0.2, 0.1]).T
    none = split(vertices, triangles, np.zeros(len(triangles), dtype=bool), 0.0)
    np.testing.assert_array_equal(none[1], triangles)
    finer, faces = split(vertices, triangles, np.ones(len(triangles), dtype=bool), 0.5)
    assert open_edges(faces) == 0
    assert volume(finer, faces) == pytest.approx(0.04)
    a, b, c = finer[faces].transpose(1, 0, 2)
    # halves of 1 and 1.02, and their diagonals
    assert np.linalg.norm([a - b, b - c, c - a], axis=2).max() < 0.62

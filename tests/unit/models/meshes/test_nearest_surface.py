"""Nearest points on triangles, uncompiled, against a search over the triangle and over all
triangles.
"""

import numpy as np
import pytest

from uncompiled import uncompiled
from uuv.models.meshes.closed_shells import sphere
from uuv.sim.interfaces.spatial import Array, exp_so3

(nearest,) = uncompiled("uuv.models.meshes.nearest_surface")
_STEPS = np.linspace(0.0, 1.0, 41)
_V, _W = (grid.ravel() for grid in np.meshgrid(_STEPS, _STEPS))
_INSIDE = _V + _W <= 1.0 + 1e-12
WEIGHTS = np.column_stack([1.0 - _V - _W, _V, _W])[_INSIDE]


def mesh(rng: np.random.Generator, stretch: Array) -> tuple[Array, np.ndarray]:
    vertices, triangles = sphere(1)
    return (vertices * stretch) @ exp_so3(rng.normal(size=3)).T, triangles


def test_the_nearest_point_of_a_triangle(rng: np.random.Generator) -> None:
    for _ in range(60):
        corner = rng.normal(size=(3, 3))
        p = 1.5 * rng.normal(size=3)
        *weights, square = nearest._on_triangle(*p, corner)
        assert min(weights) >= 0.0
        assert sum(weights) == pytest.approx(1.0)
        assert square == pytest.approx(
            float(np.sum((np.array(weights) @ corner - p) ** 2)), abs=1e-14
        )
        tried = np.sum((WEIGHTS @ corner - p) ** 2, axis=1)
        assert (
            tried.min() - 0.05 * np.ptp(corner) * np.sqrt(tried.min()) - 2e-3
            <= square
            <= tried.min() + 1e-12
        )


@pytest.mark.parametrize("corner", [np.zeros((3, 3)), np.outer([0.0, 1.0, 3.0], [1.0, 0.0, 0.0])])
def test_a_triangle_without_area_is_its_edges(corner: Array) -> None:
    *weights, square = nearest._on_triangle(2.0, 1.0, 0.0, corner)
    assert sum(weights) == pytest.approx(1.0)
    assert square == pytest.approx(1.0 if corner.any() else 5.0)


def test_the_distance_to_a_box() -> None:
    box = np.array([-1.0, -2.0, -3.0, 1.0, 2.0, 3.0])
    for p, square in (
        ((0.5, -1.0, 2.9), 0.0),
        ((1.5, 0.0, 0.0), 0.25),
        ((-1.5, 0.0, 0.0), 0.25),
        ((0.0, 4.0, 0.0), 4.0),
        ((0.0, -4.0, 5.0), 8.0),
        ((2.0, 3.0, -4.0), 3.0),
    ):
        assert nearest._from_box(*p, box) == pytest.approx(square)


def test_a_tree_halves_each_box_across_its_longest_side(rng: np.random.Generator) -> None:
    vertices, triangles = mesh(rng, np.array([0.02, 0.3, 0.05]))
    corners = vertices[triangles]
    order, boxes, spans = nearest._tree(corners)
    assert sorted(order) == list(range(len(triangles)))
    middles = corners[order].mean(axis=1)
    leaves = []
    waiting = [(0, 0, len(order))]
    while waiting:
        box, first, end = waiting.pop()
        inside = corners[order[first:end]].reshape(-1, 3)
        np.testing.assert_allclose(boxes[box], [*inside.min(axis=0), *inside.max(axis=0)])
        if spans[box, 2] < 0:
            assert tuple(spans[box, :2]) == (first, end)
            assert end - first <= nearest._LEAF
            leaves.append((first, end))
            continue
        half = (first + end) // 2
        side = int(np.argmax(np.ptp(middles[first:end], axis=0)))
        assert middles[first:half, side].max() <= middles[half:end, side].min()
        waiting += [(spans[box, 0], first, half), (spans[box, 1], half, end)]
    assert len(spans) == 2 * len(leaves) - 1


def test_the_nearest_of_all_triangles_is_found(rng: np.random.Generator) -> None:
    vertices, triangles = mesh(rng, np.array([1.0, 0.4, 0.2]))
    surface = nearest.NearestSurface.of(vertices, triangles)
    points = rng.uniform(-1.2, 1.2, (25, 3))
    closest = surface.query(points)
    for i, p in enumerate(points):
        squares = [nearest._on_triangle(*p, vertices[t])[3] for t in triangles]
        assert closest.distance[i] == pytest.approx(np.sqrt(min(squares)), abs=1e-12)
        assert squares[closest.triangle[i]] == pytest.approx(min(squares), abs=1e-12)
    np.testing.assert_allclose(np.linalg.norm(closest.point - points, axis=1), closest.distance)
    at = np.einsum("nk,nkj->nj", closest.weights, vertices[triangles[closest.triangle]])
    np.testing.assert_allclose(at, closest.point, atol=1e-12)

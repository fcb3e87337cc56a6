"""Block with rounded edges, and paths around corners: lengths, normals and turns in closed form."""

import numpy as np
import pytest

from uuv.models.meshes.closed_shells import open_edges, volume
from uuv.models.objects.barrel import BARREL_DIAMETER, around_corner
from uuv.models.objects.block import SIZE, block, over_edge
from uuv.models.objects.target_model import without_turn
from uuv.sim.evaluation.surface.mesh_surface import Surface
from uuv.sim.interfaces.errors import ConfigurationError


@pytest.mark.parametrize("radius", [0.005, 0.02, 0.1])
def test_block_is_closed_and_as_large_as_a_rounded_box(radius):
    solid = block(radius)
    a, b, c = np.array(SIZE) - 2.0 * radius
    whole = a * b * c + 2.0 * radius * (a * b + b * c + c * a) + np.pi * radius**2 * (a + b + c)
    whole += 4.0 / 3.0 * np.pi * radius**3
    assert open_edges(solid.triangles) == 0
    assert volume(solid.vertices, solid.triangles) == pytest.approx(whole, rel=1e-3)


@pytest.mark.parametrize("radius", [0.005, 0.05])
def test_edge_path_lies_on_the_block_normal_to_it(radius):
    solid, path = block(radius), over_edge(radius)
    p_surface, normal = Surface.of(solid.vertices, solid.triangles).closest(path.p)
    assert np.linalg.norm(p_surface - path.p, axis=1).max() < 2e-3 * radius + 1e-6  # facets
    assert np.einsum("ij,ij->i", normal, -path.a).min() > np.cos(np.radians(4.0))
    assert np.abs(np.sum(path.a * path.b, axis=1)).max() < 1e-12
    assert path.a[0].tolist() == [0.0, 0.0, -1.0]
    np.testing.assert_allclose(path.a[-1], [0.0, -1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("corner", np.radians([30.0, 90.0, -120.0]))
def test_corner_on_the_barrel_is_straight_on_the_unrolled_shell(corner):
    path = around_corner(corner, 0.2)
    length = 0.2
    radius = 0.5 * BARREL_DIAMETER
    assert np.linalg.norm(path.p[:, 1:], axis=1) == pytest.approx(radius)
    flat = np.column_stack([path.p[:, 0], radius * np.arctan2(path.p[:, 1], path.p[:, 2])])
    np.testing.assert_allclose(
        flat[-1], length * np.array([np.cos(corner), np.sin(corner)]), atol=1e-12
    )
    steps = np.linalg.norm(np.diff(flat, axis=0), axis=1)
    assert steps.sum() == pytest.approx(2.0 * length)
    still = without_turn(path.b[0], path.a)
    across = np.cross(-path.a, still)
    turned = np.arctan2(np.sum(path.b * across, axis=1), np.sum(path.b * still, axis=1))
    assert turned[0] == 0.0
    assert turned[-1] == pytest.approx(corner)


def test_tool_turns_over_the_blend():
    """Linear over the blend, and at the corner half-way."""
    path = around_corner(np.pi / 2.0, 0.2).turned(0.0, blend=0.1)
    still = without_turn(path.b[0], path.a)
    turn = np.unwrap(
        np.arctan2(
            np.sum(path.b * np.cross(-path.a, still), axis=1), np.sum(path.b * still, axis=1)
        )
    )
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p, axis=0), axis=1))]) - 0.2
    expected = np.pi / 2.0 * np.clip(s / 0.1 + 0.5, 0.0, 1.0)
    assert np.abs(turn - expected).max() < np.radians(6.0)  # of the path's 5 mm
    assert path.keeps_b


@pytest.mark.parametrize("wrong", [{"radius": 0.0}, {"radius": 0.3}, {"corner": 3.0}])
def test_blocks_that_cannot_be(wrong):
    with pytest.raises(ConfigurationError, match=f"block .*{next(iter(wrong))}"):
        block(**wrong)

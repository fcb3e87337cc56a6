"""Depth edges of a square before a wall."""

import numpy as np

from uuv.perception.clouds.contours import contour
from uuv.perception.clouds.scan import Scan
from uuv.sim.interfaces.spatial import Array


def scan_of(depth: Array) -> Scan:
    """Scan of a camera of 50 px, its axis through the middle."""
    y, x = ((np.arange(n) - 0.5 * (n - 1)) / 50.0 for n in depth.shape)
    points = np.stack([x[None, :] * depth, y[:, None] * depth, depth], axis=-1)
    return Scan(points=points, tangent_x=x, tangent_y=y)


def test_a_square_before_a_wall_has_an_edge_on_each_side_midway() -> None:
    depth = np.full((30, 40), 3.0)
    depth[10:20, 12:28] = 1.0
    scan = scan_of(depth)
    mask = depth == 1.0
    edges = contour(scan, mask, scan.depth)
    sides = {
        (int(right), int(down)): edges.steps.tolist().count([right, down])
        for right, down in edges.steps
    }
    assert sides == {(-1, 0): 10, (1, 0): 10, (0, -1): 16, (0, 1): 16}
    np.testing.assert_array_equal(edges.depth, 1.0)
    middles = np.column_stack([scan.tangent_x[edges.columns], scan.tangent_y[edges.rows]])
    np.testing.assert_allclose(edges.tangents, middles + 0.5 * scan.pitches * edges.steps)
    assert mask[edges.rows, edges.columns].all()
    # The border of the picture is no edge; nor is where the mask ends within the surface.
    depth[:] = 1.0
    flat = scan_of(depth)
    assert not len(contour(flat, np.ones_like(mask), flat.depth).rows)
    assert not len(contour(flat, mask, flat.depth).rows)

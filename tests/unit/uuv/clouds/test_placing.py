"""Bodies are placed where spheres and boxes meet; veils hide the share that they should."""

import numpy as np
import pytest

from uuv.clouds.placing import Body, hidden_by, slid, veil
from uuv.models.meshes.closed_shells import Shell, box, moved, scaled, sphere
from uuv.sim.interfaces.spatial import pose


def ball(radius: float) -> Shell:
    return scaled(sphere(3), radius)


def test_bodies_meet_where_spheres_do(within):
    """A ball pushed past another at an offset stops where their centres are two radii apart."""
    rng = np.random.default_rng(0)
    radius = 0.2
    first = Body.of(ball(radius), rng)
    for aside in (0.0, 0.1, 0.3):
        second = first.moved(np.array([0.0, aside, 0.0]))
        met = slid(second, [first], np.array([-1.0, 0.0, 0.0]), 0.0)
        assert met is not None
        # 0.9 mm: a ball of 1280 triangles
        within("distance [m]", np.linalg.norm(met.p) - 2.0 * radius, 9e-3)
        placed = slid(second, [first], np.array([-1.0, 0.0, 0.0]), 0.05)
        assert placed is not None
        assert placed.p[0] - met.p[0] == pytest.approx(0.05)
    assert (
        slid(first.moved(np.array([0.0, 0.5, 0.0])), [first], np.array([-1.0, 0.0, 0.0]), 0.0)
        is None
    )


def test_a_veil_hides_what_it_should():
    rng = np.random.default_rng(1)
    X_CF = pose(p=[0.0, 0.0, 1.5])  # a camera before the ball
    body = Body.of(ball(0.3), rng)
    for share in ((0.005, 0.2), (0.2, 0.6)):
        before = veil(body, [], X_CF, share, rng)
        assert before
        hidden = hidden_by(body, before, X_CF)[1].mean()
        assert share[0] <= hidden <= share[1]
    assert veil(body, [], X_CF, (0.0, 0.005), rng) == []
    wall = Body.of(moved(box([2.0, 2.0, 0.01], np.zeros(3)), pose(p=[0.0, 0.0, -0.5])), rng)
    assert hidden_by(body, [wall], X_CF)[1].all()
    assert veil(body, [wall], X_CF, (0.2, 0.6), rng) is None

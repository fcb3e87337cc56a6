"""A rock's form: within its planes and nearly on them, of the size asked for, its paths over the
top.
"""

import numpy as np
import pytest

from uuv.models.objects import rock as rocks
from uuv.models.objects.rock import rock
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array


def ways(rng: np.random.Generator, count: int) -> Array:
    drawn = rng.normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def test_without_roughness_it_is_a_worn_polyhedron(rng: np.random.Generator) -> None:
    form = rocks._Form(rng, 0.0)
    directions = ways(rng, 300)
    radius = np.linalg.norm(form.surface(directions), axis=1)
    np.testing.assert_allclose(form.surface(directions), radius[:, None] * directions)
    facing = directions @ form._normals.T / form._reach
    flat = 1.0 / facing.max(axis=1)  # radius of the polyhedron of its planes
    count = (facing > 0.0).sum(axis=1)
    assert np.all(radius <= flat + 1e-12)
    assert np.all(radius >= flat * count ** (-1.0 / rocks._WORN) - 1e-12)
    assert np.all(form._reach > 0.0)


def test_roughness_moves_the_surface_in_and_out_by_its_share(rng: np.random.Generator) -> None:
    seed = int(rng.integers(1000))
    directions = ways(rng, 400)
    smooth, rough = (
        rocks._Form(np.random.default_rng(seed), share).surface(directions) for share in (0.0, 0.1)
    )
    swell = np.linalg.norm(rough, axis=1) / np.linalg.norm(smooth, axis=1) - 1.0
    assert swell.max() > 0.01
    assert swell.min() < -0.01
    assert np.abs(swell).max() < 0.1 * rocks._SWELLS
    np.testing.assert_allclose(np.cross(rough, smooth), 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", [0, 5])
def test_its_longest_side_is_its_size_and_lies_along_x(seed: int) -> None:
    target = rock(seed, size=0.7)
    extent = np.ptp(target.vertices, axis=0)
    assert extent.max() == pytest.approx(0.7)
    assert extent[0] > extent[2]


@pytest.mark.parametrize("name", ["over", "across"])
def test_a_path_runs_over_the_top_at_even_steps(name: str) -> None:
    path = rock(5).paths[name]
    along, aside = (0, 1) if name == "over" else (1, 0)
    angle = np.degrees(np.arctan2(path.p[:, along], path.p[:, 2]))
    np.testing.assert_allclose(angle[[0, -1]], [-40.0, 40.0], atol=0.05)
    assert np.all(np.diff(angle) > 0.0)
    np.testing.assert_allclose(path.p[:, aside], 0.0, atol=1e-12)
    steps = np.linalg.norm(np.diff(path.p, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.02)
    assert np.all(np.einsum("ij,ij->i", path.a, path.p) < 0.0)  # inwards
    np.testing.assert_allclose(np.einsum("ij,ij->i", path.a, path.b), 0.0, atol=1e-9)
    ahead = np.gradient(path.p, axis=0)
    assert np.all(np.einsum("ij,ij->i", path.b, ahead) > 0.9 * np.linalg.norm(ahead, axis=1))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"size": 0.0}, "size"),
        ({"size": np.inf}, "size"),
        ({"roughness": -0.01}, "roughness"),
        ({"roughness": 0.16}, "roughness"),
        ({"seed": -1}, "seed"),
        ({"seed": True}, "seed"),
        ({"seed": 1.0}, "seed"),
    ],
)
def test_what_is_out_of_range_is_refused(change: dict, said: str) -> None:
    with pytest.raises(ConfigurationError, match=f"rock: {said}"):
        rock(**({"seed": 1} | change))

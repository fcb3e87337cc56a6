"""Kinds of scenes show what they are called: checked by rays on the meshes, and by the depth that
was seen.
"""

from functools import cache

import numpy as np
import pytest

from uuv.clouds.frames import ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.clouds.scene_kinds import KINDS, draw, in_heap, object_of, other_than
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ray_casting import RayScene
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.streams import Streams

NAME = "starfish"
SEED = 11


@cache
def scene_of(kind: str, name: str = NAME) -> ObjectScene:
    return draw(name, kind, SEED, "white")


def before_the_object(scene: ObjectScene) -> float:
    """Share of the clean object's image in which something nearer than 2 cm before it is seen."""
    exact = ModelSurface.of(scene.target).seen(scene.X_CT, scene.scan)[0].depth
    on = np.isfinite(exact) & np.isfinite(scene.scan.depth)
    return float((scene.scan.depth[on] < exact[on] - 0.02).mean())


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_one_view_for_all_kinds(kind: str):
    """View and coarse start are those of the clean object: kinds are compared scene by scene."""
    scene = scene_of(kind)
    clean = object_scene(NAME, SEED, "white")
    for field in ("X_CT", "approach", "orientation"):
        assert np.array_equal(getattr(scene, field), getattr(clean, field)), field
    assert scene.target.name == NAME


def test_a_seed_gives_one_scene():
    scene = scene_of("hidden")
    again = draw(NAME, "hidden", SEED, "white")
    assert np.array_equal(again.scan.depth, scene.scan.depth, equal_nan=True)
    assert again.hidden == scene.hidden


@pytest.mark.parametrize(
    ("kind", "bounds"), [("hidden", (0.2, 0.53)), ("hidden_most", (0.72, 0.93))]
)
def test_the_stated_share_is_hidden(kind: str, bounds: tuple[float, float], within):
    scene = scene_of(kind)
    assert bounds[0] <= scene.hidden <= bounds[1]
    within("share by the depth seen", before_the_object(scene) - scene.hidden, 0.06)  # 0.006


def test_nothing_hides_a_clean_object_and_what_is_absent_is_not_seen():
    assert scene_of("clean").hidden == 0.0
    assert before_the_object(scene_of("clean")) < 0.01
    exact = ModelSurface.of(object_of(NAME)).seen(scene_of("absent").X_CT, scene_of("absent").scan)
    on = np.isfinite(exact[0].depth)
    assert np.nanmedian((scene_of("absent").scan.depth - exact[0].depth)[on]) > 0.02


def test_growth_is_outside_the_object():
    """Beyond four standard deviations of the noise, 12 mm, the fouled object is seen before the
    clean one on a part of its image, and behind it nowhere.
    """
    shares = {}
    for kind in ("clean", "fouled"):
        scene = scene_of(kind)
        exact = ModelSurface.of(scene.target).seen(scene.X_CT, scene.scan)[0].depth
        on = np.isfinite(exact) & np.isfinite(scene.scan.depth)
        before = (exact - scene.scan.depth)[on]
        shares[kind] = float((before > 0.012).mean())
        assert (before < -0.012).mean() < 0.005
    assert shares["clean"] < 0.005
    assert 0.05 < shares["fouled"] < 0.6


def test_another_object_is_another_one_or_in_another_size():
    target = object_of(NAME)
    for seed in range(20):
        other = other_than(target, np.random.default_rng(seed))
        size = other.radius / target.radius
        assert other.name != target.name
        if other.name.startswith(target.name):
            assert 0.7 <= size <= 0.85 or 1.0 / 0.85 <= size <= 1.0 / 0.7


def test_a_heap_touches_the_object_and_stands_on_the_seabed(within):
    """All parts lie above the lowest point of a barrel, the nearest touches it, none is in it."""
    scene = scene_of("heap", "barrel")
    target = scene.target
    heap, hidden = in_heap(target, scene.X_CT, Streams(SEED)["heap"])
    assert hidden == scene.hidden
    assert 0.02 < hidden <= 0.6
    within("share by the depth seen", before_the_object(scene) - hidden, 0.02)  # 0.0015

    count = len(target.vertices)
    others = heap.vertices[count:]
    assert np.allclose(heap.vertices[:count], target.vertices, atol=1e-12)
    assert others[:, 2].min() >= target.vertices[:, 2].min() - 1e-3
    assert NearestSurface.of(target.vertices, target.triangles).query(others).distance.min() < 0.01

    # The barrel is convex: what has a part of it above and below is inside.
    rays = RayScene(target.vertices, target.triangles)
    inside = np.ones(len(others), dtype=bool)
    for way in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]):
        inside &= np.isfinite(rays.cast(others, np.broadcast_to(way, others.shape))["t"])
    assert inside.mean() < 0.01


def test_unknown_kinds_are_refused():
    with pytest.raises(
        ConfigurationError, match=r"kind of scene: must be one of .*heap.*, got 'buried'"
    ):
        draw(NAME, "buried", 0, "white")

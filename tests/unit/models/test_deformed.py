"""Growth and dents: closed as before, where and as high as said, the truth the difference of both
meshes.
"""

from typing import Literal

import mujoco
import numpy as np
import pytest

from uuv.models.meshes.closed_shells import box, open_edges, volume, welded
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects import targets
from uuv.models.objects.deformed import Patch, deformed, dented, fouled
from uuv.models.objects.target_model import TargetModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import pose


def block() -> TargetModel:
    vertices, triangles = box([0.8, 0.6, 0.3], np.zeros(3))
    return TargetModel(name="block", vertices=vertices, triangles=triangles)


def distance_from_clean(clean: TargetModel, points: np.ndarray) -> np.ndarray:
    return NearestSurface.of(clean.vertices, clean.triangles).query(points).distance


@pytest.mark.seeds(2)
@pytest.mark.parametrize("change", [fouled, dented])
@pytest.mark.parametrize("name", ["manifold", "starfish", "valve"])
def test_stays_closed_and_moves_where_said(name: str, change, seed: int, within):
    """Nothing moves outside of the patches; in them as far as said, seen from the clean mesh."""
    clean = targets.named(name)
    least = 0.01 if name != "valve" else 0.005
    fouled_object = change(clean, np.random.default_rng(seed), patches=2, height=(least, 0.04))
    assert open_edges(fouled_object.target.triangles) == 0, seed
    away = np.min(
        [
            np.linalg.norm(fouled_object.clean_T - p.p_T, axis=1) / p.radius
            for p in fouled_object.patches
        ],
        axis=0,
    )
    within("moved outside of the patches [m]", fouled_object.offset[away > 1.3], 1e-12)
    within(
        "clean vertices off the clean mesh [m]",
        distance_from_clean(clean, fouled_object.clean_T),
        1e-3,
    )
    whole = volume(clean.vertices, clean.triangles)
    within(
        "volume before, relative",
        volume(fouled_object.clean_T, fouled_object.target.triangles) / whole - 1.0,
        1e-9,
    )
    moved = np.linalg.norm(fouled_object.target.vertices - fouled_object.clean_T, axis=1)
    assert moved.max() <= sum(p.height for p in fouled_object.patches) + 1e-9, seed
    assert moved.max() > 0.5 * max(p.height for p in fouled_object.patches), seed
    for patch in fouled_object.patches:
        assert least <= patch.height <= 0.04
        within("middle off the clean mesh [m]", distance_from_clean(clean, patch.p_T[None]), 1e-3)


def test_one_patch_on_a_plane_is_its_own_closed_form(within):
    """Height at the middle, a half cosine to the edge, and the volume that it adds."""
    kinds: list[tuple[Literal["growth", "dent"], float]] = [("growth", 1.0), ("dent", -1.0)]
    for kind, sign in kinds:
        patch = Patch(
            kind=kind,
            p_T=np.array([0.05, -0.02, 0.15]),
            n_T=np.array([0.0, 0.0, 1.0]),
            radius=0.12,
            height=0.03,
            lobes=np.array([0.4, 1.0]),
        )
        dented = deformed(block(), [patch])
        mesh = dented.target
        scene = RayScene(mesh.vertices, mesh.triangles)
        down = np.array([0.0, 0.0, -1.0])
        at = scene.cast(patch.p_T + np.array([[0.0, 0.0, 0.2]]), down[None])["t"][0]
        within("height in the middle [m]", 0.2 - at - sign * 0.03, 1e-4)
        # Without lobes the bump holds h r^2 (pi / 2 - 2 / pi); lobes change it by a few per cent.
        expected = 0.03 * 0.12**2 * (0.5 * np.pi - 2.0 / np.pi)
        change = volume(mesh.vertices, mesh.triangles) - 0.8 * 0.6 * 0.3
        within("volume, relative", sign * change / expected - 1.0, 0.1)
        points = np.column_stack(
            [np.random.default_rng(1).uniform(-0.3, 0.3, (50, 2)), np.full(50, 0.4)]
        )
        hit = scene.cast(points, np.broadcast_to(down, points.shape))["t"]
        surface = points + hit[:, None] * down
        within("truth against rays [m]", dented.offset_at(surface) - (surface[:, 2] - 0.15), 1e-6)


def test_same_seed_same_growth_near_the_path():
    barrel = targets.named("barrel")
    near = barrel.path("longitudinal").p
    first, same = (fouled(barrel, np.random.default_rng(5), patches=1, near=near) for _ in range(2))
    assert np.array_equal(first.target.vertices, same.target.vertices)
    assert np.linalg.norm(near - first.patches[0].p_T, axis=1).min() < 0.1
    assert first.target.path("longitudinal") is not None
    assert first.target.symmetry.axis is not None


def test_growth_is_felt_where_it_is(within):
    """Rays straight down on what collides: within a millimetre of the mesh, on the bump and beside
    it.
    """
    patch = Patch(
        kind="growth",
        p_T=np.array([0.0, 0.0, 0.15]),
        n_T=np.array([0.0, 0.0, 1.0]),
        radius=0.1,
        height=0.03,
        lobes=np.zeros(2),
    )
    dented = deformed(block(), [patch])
    spec = mujoco.MjSpec()
    dented.target.add_to(spec, pose())
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    model.geom_rgba[:, 3] = 1.0
    start = np.column_stack(
        [np.random.default_rng(0).uniform(-0.15, 0.15, (200, 2)), np.full(200, 0.5)]
    )
    down = np.array([0.0, 0.0, -1.0])
    geom = np.zeros(1, dtype=np.int32)
    group = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
    felt = np.array([mujoco.mj_ray(model, data, s, down, group, 1, -1, geom) for s in start])
    scene = RayScene(dented.target.vertices, dented.target.triangles)
    ranges = scene.cast(start, np.broadcast_to(down, start.shape))["t"]
    within("felt against seen [m]", felt - ranges, 1e-3)  # 0.5 mm
    assert np.ptp(ranges) > 0.02
    picture = mujoco.MjSpec()
    dented.target.add_to(picture, pose(), felt=False)
    assert picture.compile().ngeom == 1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: fouled(block(), np.random.default_rng(0), patches=0), r"1\.\.1000"),
        (lambda: fouled(block(), np.random.default_rng(0), height=(0.02, 0.01)), "least <= most"),
        (lambda: dented(block(), np.random.default_rng(0), height=(0.3, 0.4)), "too small"),
        (lambda: dented(block(), np.random.default_rng(0), near=np.zeros(3)), "near"),
        (lambda: dented(block(), np.random.default_rng(0), near=np.zeros((0, 3))), "N > 0"),
        (
            lambda: dented(block(), np.random.default_rng(0), near=[[9.0, 0.0, 0.0]]),
            "the largest reach of a patch",
        ),
        (
            lambda: fouled(block(), np.random.default_rng(0)).offset_at([[np.nan, 0.0, 0.0]]),
            "finite",
        ),
        (
            lambda: fouled(block(), np.random.default_rng(0)).offset_at([[1e200, 0.0, 0.0]]),
            "within",
        ),
        (lambda: fouled(block(), np.random.default_rng(0)).offset_at(np.zeros(3)), "shape"),
        (
            lambda: Patch(
                kind="dent",
                p_T=np.zeros(3),
                n_T=np.ones(3),
                radius=0.05,
                height=0.03,
                lobes=np.zeros(2),
            ),
            "2.5 times",
        ),
    ],
)
def test_impossible_deformations_are_refused(make, words: str):
    with pytest.raises(ConfigurationError, match=words):
        make()


def test_welding_keeps_the_block_closed():
    assert open_edges(welded(*box([1.0, 1.0, 1.0], np.zeros(3)))[1]) == 0

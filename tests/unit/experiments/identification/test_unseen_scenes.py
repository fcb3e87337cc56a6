"""Scenes with unseen objects: the frame shows what the truth says, occlusion is in its class, and a
case repeats.
"""

from collections import Counter
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from experiments.identification.unseen.grammar import KINDS, unseen_shape
from experiments.identification.unseen.judge import (
    FOUND,
    RIVAL_GAIN,
    TELLING,
    ViewOfObject,
    pose_error,
)
from experiments.identification.unseen.scenes import (
    DEPTH_SENSORS,
    HIDDEN,
    PILE,
    RESIZED,
    UnseenCase,
    UnseenScene,
    build,
    piled,
    present,
    wrong,
)
from experiments.identification.unseen.unseen import UnseenTrial, unseen
from uuv.clouds.frames import FOCAL, pinhole
from uuv.clouds.placing import resting_attitude
from uuv.models.meshes.ray_casting import RayScene
from uuv.perception.clouds.scan import SensorModel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

_STEP = 4  # [px] between the rays of a view
NO_EDGES = SensorModel(edge_sigma=1e6)


@cache
def scene_of(case: UnseenCase) -> UnseenScene:
    return build(case)


def mujoco_depth(scene: UnseenScene, rows: np.ndarray, columns: np.ndarray) -> Array:
    """Depth (n,) [m] by MuJoCo's ray caster, which shares no code with the camera; inf where
    nothing is hit.
    """
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    hit = np.zeros(1, dtype=np.int32)
    depth = []
    for row, column in zip(rows, columns, strict=True):
        ray = np.array([(column - 319.5) / FOCAL, (row - 239.5) / FOCAL, 1.0])
        length = float(np.linalg.norm(ray))
        t = mujoco.mj_ray(scene.model, data, np.zeros(3), ray / length, None, 1, -1, hit)
        depth.append(t / length if t >= 0.0 else np.inf)
    return np.array(depth)


def test_cases_are_balanced_and_named():
    cases = [present(0, k) for k in range(300)]
    assert set(Counter(case.kind for case in cases).values()) == {30}
    assert Counter(case.hidden for case in cases) == {"none": 120, "little": 90, "much": 90}
    assert set(Counter(case.sensor for case in cases).values()) == {100}
    for name in KINDS:  # within each class too
        assert Counter(case.hidden for case in cases if case.kind == name) == {
            "none": 12,
            "little": 9,
            "much": 9,
        }
    assert len({(case.sensor, case.around) for case in cases[:10]}) == len(DEPTH_SENSORS) ** 2
    assert set(Counter(wrong(0, k).content for k in range(100)).values()) == {25}


def test_a_case_gives_one_scene():
    scene, again, other = scene_of(present(0, 7)), build(present(0, 7)), scene_of(present(0, 8))
    for name in ("exact", "seen", "X_CT", "approach", "orientation"):
        assert np.array_equal(getattr(scene, name), getattr(again, name)), name
    assert np.array_equal(scene.scan.points, again.scan.points, equal_nan=True)
    assert np.array_equal(scene.target.vertices, again.target.vertices)
    assert not np.allclose(scene.X_CT, other.X_CT)


@pytest.mark.parametrize(
    "case", [present(0, 1), present(0, 7), wrong(0, 3)], ids=lambda case: case.content
)
def test_the_frame_is_that_of_another_ray_caster(case: UnseenCase, within):
    scene = scene_of(case)
    rng = np.random.default_rng(0)
    on = np.argwhere(scene.seen)
    rows, columns = np.vstack([on[rng.choice(len(on), 60)], rng.integers(0, (480, 640), (20, 2))]).T
    expected, exact = mujoco_depth(scene, rows, columns), scene.exact[rows, columns]
    both = np.isfinite(expected) & np.isfinite(exact)
    off = np.abs(expected[both] - exact[both])
    assert both.sum() >= 60
    # Two casters may pass an edge on different sides of it.
    assert np.mean(np.isfinite(expected) != np.isfinite(exact)) <= 0.03
    within("depth [m]", np.quantile(off, 0.95), 3e-6)  # 2.4e-7


@pytest.mark.parametrize("index", [1, 7, 8])
def test_the_object_stands_where_it_is_said_to(index: int, within):
    scene = scene_of(present(0, index))
    view = ViewOfObject(scene)
    off = scene.likeness.distance(transform_points(inverse(scene.X_CT), view.points_C))
    within("surface [m]", off, 3e-6)  # 3.2e-7
    assert view.contradicted(scene.X_CT) == 0.0
    assert view.contradicted(scene.X_CT @ pose(p=[0.0, 0.0, 0.1])) > 0.3


@pytest.mark.parametrize("index", [1, 7, 8])
def test_occlusion_is_measured_and_in_its_class(index: int):
    scene = scene_of(present(0, index))
    low, high = HIDDEN[scene.case.hidden]
    assert low <= scene.hidden <= high
    # By the surface samples of the shape instead of pixels: how many of those that face the camera
    # are in the frame?
    eye_T = inverse(scene.X_CT)[:3, 3]
    way = scene.likeness.points - eye_T
    own = RayScene(scene.shape.vertices, scene.shape.triangles).distance(eye_T, way) > 1.0 - 1e-3
    p = transform_points(scene.X_CT, scene.likeness.points[own])
    row, column = np.rint(p[:, 1::-1] / p[:, 2:] * FOCAL + [239.5, 319.5]).astype(int).T
    inside = (row >= 0) & (row < 480) & (column >= 0) & (column < 640)
    shown = scene.exact[row[inside], column[inside]] > p[inside, 2] - 0.01
    # Samples are uniform over the surface, pixels over the image, so that both agree only roughly.
    assert 1.0 - shown.mean() == pytest.approx(scene.hidden, abs=0.15)


def test_what_stands_in_the_place_is_what_the_case_says():
    absent, resized = scene_of(wrong(0, 0)), scene_of(wrong(0, 3))
    assert absent.there is None
    assert not absent.seen.any()
    assert resized.there is not None
    assert abs(resized.there.extent / resized.shape.extent - 1.0) == pytest.approx(RESIZED)


@pytest.mark.long
@pytest.mark.parametrize("index", range(1, 41, 4))
def test_another_object_differs(index: int):
    scene = scene_of(wrong(0, index))
    assert scene.there is not None
    assert scene.there.kind == scene.shape.kind
    assert ViewOfObject(scene).contradicted(scene.X_CT) > TELLING


@pytest.mark.long
@pytest.mark.parametrize("index", range(2, 42, 4))
def test_what_is_mirrored_differs(index: int):
    scene = scene_of(wrong(0, index))
    assert scene.case.content == "mirrored"
    assert scene.there is not None
    assert np.array_equal(scene.there.vertices, scene.shape.vertices * [-1.0, 1.0, 1.0])
    assert scene.likeness.mirror_share > TELLING
    # The model laid on the image as well as can be differs less than where the twin stands.
    view = ViewOfObject(scene)
    assert view.mirror_share() <= view.contradicted(scene.X_CT) + 0.02


@pytest.mark.long
def test_the_objects_of_a_pile_are_in_one_frame_and_apart():
    for pile in range(3):
        scenes = [scene_of(piled(0, PILE * pile + k)) for k in range(PILE)]
        for k, scene in enumerate(scenes):
            assert np.array_equal(scene.exact, scenes[0].exact)
            assert np.array_equal(scene.scan.points, scenes[0].scan.points, equal_nan=True)
            assert not any((scene.seen & other.seen).any() for other in scenes[:k])
            assert scene.hidden <= HIDDEN["much"][1] + 0.03  # that bound is by coarse rays
        assert len({scene.shape.kind for scene in scenes}) == PILE


@pytest.mark.long
@pytest.mark.parametrize("index", range(60))
def test_each_of_many_scenes_shows_its_object(index: int):
    scene = build(present(5, index))
    low, high = HIDDEN[scene.case.hidden]
    assert low <= scene.hidden <= high
    view = ViewOfObject(scene)
    assert len(view.points_C) > 20
    assert view.contradicted(scene.X_CT) == 0.0
    assert np.linalg.norm(scene.approach - transform_points(scene.X_CT, scene.target.center)) <= 0.3


def test_a_resting_shape_is_carried_by_what_it_touches():
    for kind in ("frame", "union", "pebble"):
        shape = unseen_shape(kind, np.random.default_rng(3))
        standing = shape.vertices @ resting_attitude(shape, np.random.default_rng(4)).T
        base = standing[standing[:, 2] < standing[:, 2].min() + 1e-6 * shape.radius, :2]
        assert len(base) >= 3
        # The centroid, at the origin, lies within the base: no direction has all of the base on its
        # far side.
        angle = np.linspace(0.0, 2.0 * np.pi, 360)
        assert (base @ np.array([np.cos(angle), np.sin(angle)])).max(axis=0).min() >= -1e-6


def test_found_means_near_modulo_symmetry():
    scene = scene_of(present(0, 7))  # a bar
    turns = scene.likeness.symmetry.rotations
    assert len(turns) > 1
    assert scene.likeness.symmetry.axis is None
    most = FOUND[0] + FOUND[1] * scene.range_m
    for G in turns:
        X = scene.X_CT @ pose(G)
        assert pose_error(scene, X).found
        for share, found in ((0.9, True), (1.1, False)):
            assert pose_error(scene, pose(p=[share * most, 0.0, 0.0]) @ X).found is found
            tilt = exp_so3([0.0, share * np.deg2rad(FOUND[2]), 0.0])
            assert pose_error(scene, X @ pose(tilt)).found is found


def test_bounds_of_a_view_are_those_of_rendered_differences(within):
    """The information of the surface in view, from depth images of slightly moved and scaled
    models.
    """
    scene, sensor = scene_of(present(0, 6)), NO_EDGES  # a pebble
    bounds = ViewOfObject(scene).bounds(sensor)
    rays = pinhole(_STEP)[scene.seen[::_STEP, ::_STEP]]

    def depth(small: np.ndarray) -> Array:
        X_TC = inverse(scene.X_CT @ pose(exp_so3(small[3:6]), small[:3]))
        larger = RayScene((1.0 + small[6]) * scene.shape.vertices, scene.shape.triangles)
        return larger.distance(X_TC[:3, 3], rays @ X_TC[:3, :3].T).astype(np.float64)

    h = 1e-3
    with np.errstate(invalid="ignore"):
        J = np.column_stack([(depth(h * e) - depth(-h * e)) / (2.0 * h) for e in np.eye(7)])
    # A shift by n moves the depth along a ray r by 1 / (n.r): this leaves out what is seen at
    # grazing incidence.
    slant = np.linalg.norm(J[:, :3] * np.linalg.norm(rays, axis=1)[:, None], axis=1)
    facing = slant < 1.0 / np.cos(sensor.max_incidence)
    sigma = sensor.sigma(depth(np.zeros(7))[facing]) / np.sqrt(sensor.independent(_STEP))
    J = J[facing] / sigma[:, None]
    H = J.T @ J + np.eye(7)
    covariance = np.linalg.inv(H[:6, :6])
    position, angle = (
        np.sqrt(np.linalg.eigvalsh(part)[-1]) for part in (covariance[:3, :3], covariance[3:, 3:])
    )
    within("position", bounds.position_m / position - 1.0, 0.1)  # 0.012
    within("angle", np.deg2rad(bounds.angle_deg) / angle - 1.0, 0.1)  # 0.012
    within("size", bounds.size / np.sqrt(np.linalg.inv(H)[6, 6]) - 1.0, 0.1)  # 0.015


def test_edges_and_better_sensors_tell_more():
    view = ViewOfObject(scene_of(present(0, 7)))
    plain, blind, fine = (
        view.bounds(s) for s in (SensorModel(), NO_EDGES, SensorModel(disparity_sigma=0.05))
    )
    for name in ("position_m", "angle_deg", "size"):
        assert getattr(fine, name) < getattr(plain, name) < getattr(blind, name)


def test_a_better_sensor_tells_more_rivals_apart():
    view = ViewOfObject(scene_of(present(0, 7)))
    plain, fine = (view.rival_nats(SensorModel(disparity_sigma=sigma)) for sigma in (0.25, 0.1))
    assert RIVAL_GAIN < plain < fine < np.inf


def test_unknown_names_are_refused():
    case = present(0, 0)
    with pytest.raises(
        ConfigurationError, match="sensor: allowed white, stereo, quantised, sonar, got 'lidar'"
    ):
        build(replace(case, sensor="lidar"))
    with pytest.raises(ConfigurationError, match=r"class of shapes: allowed .* got 'teapot'"):
        build(replace(case, kind="teapot"))
    with pytest.raises(
        ConfigurationError, match="class of occlusion: allowed none, little, much, got 'all'"
    ):
        build(replace(case, hidden="all"))


def test_an_empty_sea_is_drawn_anew():
    scene = build(wrong(149116613, 8))  # its first draw has neither the object nor anything else
    assert scene.there is None
    assert np.isfinite(scene.exact).any()


@pytest.mark.long
@pytest.mark.parametrize("member", [0, 4])
def test_in_a_heap_the_object_is_found_that_others_resemble_more(member: int):
    """A frame and a union, 2000 and 3500 pixels among four others: none of the likeliest starts
    leads there.
    """
    row = unseen(UnseenTrial(**vars(piled(990001, 10 + member)), known="place"))
    assert row.found
    assert row.decision == "accept", row.reason

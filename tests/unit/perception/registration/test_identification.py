"""Identification of known objects in noisy frames: error statistics, refusals, objects that it was
not made for.
"""

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from depth_scenes import DEFAULT_NOISE, FLOOR, coarse, halved, look, random_view, standing
from uuv import perception
from uuv.cli.identify.object import print_pose
from uuv.clouds.frames import Camera, camera_pose
from uuv.clouds.object_scenes import add_seabed
from uuv.models.meshes.closed_shells import box, joined, revolve
from uuv.models.objects.targets import Symmetry, TargetModel, barrel
from uuv.perception.clouds.scan import Scan, SensorModel, background, facing_normals
from uuv.perception.finding.target_finder import KnownObjectFinder
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import check
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage, EncoderMeasurement
from uuv.sim.interfaces.protocols import TargetFinder
from uuv.sim.interfaces.spatial import (
    exp_so3,
    inverse,
    pose,
    quat_wxyz_from_rotation,
    rotation_from_z,
    transform_points,
)
from uuv.sim.runs.terminal import PlainConsole

BARREL = barrel()
VIEW = camera_pose(np.array([0.1, -0.9, 0.75]))


@pytest.fixture(scope="module")
def surface() -> ModelSurface:
    return ModelSurface.of(BARREL)


@pytest.fixture(scope="module")
def frame() -> DepthImage:
    return look(BARREL, VIEW, np.random.default_rng(5))


@pytest.fixture(scope="module")
def found(surface: ModelSurface, frame: DepthImage) -> Identification:
    return identify(
        Scan.from_depth(frame), surface, VIEW[:3, 3] + 0.1, exp_so3([0.2, -0.2, 0.2]) @ VIEW[:3, :3]
    )


def test_a_card_has_the_middle_of_the_object_and_the_verdict(found: Identification):
    middle = transform_points(found.X_sensor_target, BARREL.center)
    card = found._repr_html_()
    assert ", ".join(f"{value:.4f}" for value in middle) in card
    assert "accepted" in card
    refused = replace(found, accepted=False, reason="seen <through>")._repr_html_()
    assert "not accepted: seen &lt;through&gt;" in refused


def bracket() -> TargetModel:
    """An L of two plates: no symmetry, nothing round."""
    return boxes(
        "bracket", [([0.3, 0.12, 0.02], [-0.15, -0.06, 0]), ([0.02, 0.12, 0.2], [-0.15, -0.06, 0])]
    )


def boxes(
    name: str, parts: list[tuple[list[float], list[float]]], pipes: tuple = ()
) -> TargetModel:
    """Boxes by size and lowest corner, and pipes by radius, length, turn from upright and
    middle.
    """
    shells = [box(size, np.array(corner) + 0.5 * np.array(size)) for size, corner in parts]
    for radius, length, R, center in pipes:
        points, faces = upright(radius, length)
        shells.append((points @ R.T + center, faces))
    vertices, triangles = joined(shells)
    return TargetModel(name=name, vertices=vertices, triangles=triangles)


def upright(radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """A cylinder about z, of 40 sides."""
    half = 0.5 * length
    points, faces = revolve([(-half, 0.0), (-half, radius), (half, radius), (half, 0.0)], 40)
    return points[:, [1, 2, 0]], faces


def manifold() -> TargetModel:
    """A plate with pipes in three directions."""
    half = 0.5 * np.pi
    pipes = (
        (0.03, 0.4, exp_so3([0, half, 0]), [0, 0.08, 0.08]),
        (0.025, 0.3, exp_so3([half, 0, 0]), [-0.15, 0, 0.06]),
        (0.04, 0.15, np.eye(3), [0.15, -0.08, 0.09]),
    )
    return boxes("manifold", [([0.5, 0.35, 0.02], [-0.25, -0.175, 0])], pipes)


MORE_VIEWS = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_barrel_from_all_sides"
)
MORE_SEEDS = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_objects_it_was_not_made_for"
)
NEARER_ORIGIN = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_the_origin_of_a_model_may_lie_anywhere"
)
EVERY_THIRD = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_clouds_without_a_grid"
)
ANOTHER_SIDE = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_an_exact_frame_gives_the_pose_without_bias"
)


def test_the_shell_prints_the_pose_with_its_standard_deviations(
    found: Identification, capsys: pytest.CaptureFixture[str]
):
    print_pose(found, BARREL, PlainConsole())
    printed = capsys.readouterr().out
    number = r"(-?[\d.]+)"
    middle = re.search(rf"middle at \({number}, {number}, {number}\) m, standard dev", printed)
    turn = re.search(rf"rotation vector \({number}, {number}, {number}\) deg, standard", printed)
    assert middle, printed
    assert turn, printed
    X_ST = found.X_sensor_target
    p_C = transform_points(X_ST, BARREL.center)
    assert [float(value) for value in middle.groups()] == pytest.approx(p_C, abs=1e-4)
    R_ST = exp_so3(np.radians([float(value) for value in turn.groups()]))
    np.testing.assert_allclose(R_ST, X_ST[:3, :3], atol=2e-3)  # printed to 0.1 deg
    assert "symmetric object: of the equivalent orientations" in printed


@pytest.mark.parametrize("seeds", [(10, 142), pytest.param((0, 31, 214), marks=MORE_VIEWS)])
def test_barrel_from_all_sides(
    surface: ModelSurface, seeds: tuple[int, ...], fresh_seeds: list[int], within
):
    """1 to 1.5 m, floor and stand in view; 50 seeds gave 0.3 mm median, 2.1 mm worst, 0.12 deg.

    Of 250 seeds 4 were refused, one of them rightly and three for want of edges in view; of those
    of --fresh one in twenty may be.
    """
    errors, refused = [], {}
    for seed in (*seeds, *fresh_seeds):
        rng = np.random.default_rng(seed)
        X_CT = random_view(rng)
        image = look(BARREL, X_CT, rng)
        result = identify(Scan.from_depth(image), surface, *coarse(rng, X_CT, BARREL))
        if result.accepted:
            errors.append(BARREL.symmetry.error(result.X_sensor_target, X_CT))
        else:
            refused[seed] = result.reason
    assert set(refused) <= set(fresh_seeds), refused
    assert len(refused) <= 1 + len(fresh_seeds) // 20, refused
    position, angle = np.array(errors).T
    within("median position [m]", np.median(position), 2e-3)
    within("worst position [m]", position, 5e-3)
    within("worst axis [rad]", angle, np.deg2rad(0.3))


@pytest.mark.parametrize("seeds", [(2,), pytest.param((1, 4), marks=MORE_SEEDS)])
@pytest.mark.parametrize("shape", [bracket, manifold])
def test_objects_it_was_not_made_for(
    shape: Callable[[], TargetModel], seeds: tuple[int, ...], within
):
    target = shape()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        X_CT = random_view(rng, 0.8, 1.2)
        image = look(target, X_CT, rng, floor=seed % 2 == 0)
        result = identify(Scan.from_depth(image), target, *coarse(rng, X_CT, target))
        assert result.accepted, f"seed {seed}: {result.reason}"
        position, angle = target.symmetry.error(result.X_sensor_target, X_CT)
        within("position [m]", position, 5e-3)  # 1.1 mm
        within("angle [rad]", angle, np.deg2rad(2.0))  # 0.4 deg
        assert "none needed" in result.symmetry.policy


def test_a_start_that_ends_across_is_leant_before_the_barrel_is_slid(within):
    from uuv.clouds.object_scenes import object_scene

    # from this start a fit lies across the barrel, or 90 mm along it
    scene = object_scene("barrel", 6)
    identified = identify(
        scene.scan, scene.target, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    off, turn = scene.error(identified.X_sensor_target)
    assert identified.accepted, identified.reason
    within("position [m]", off, 0.005)  # 0.4 mm
    within("attitude [deg]", np.rad2deg(turn), 0.5)  # 0.03 deg


def test_normals_are_the_principal_components_of_least_spread(within):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(500, 3)) * [1.0, 1.0, 0.05] + [0.0, 0.0, 5.0]
    near = points[cKDTree(points).query(points, k=20)[1]]
    offset = near - near.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))[1][:, :, 0]
    facing = facing_normals(points)
    # 7e-16
    within(
        "1 - |cosine|", np.abs(1.0 - np.abs(np.einsum("ni,ni->n", normals, facing))).max(), 1e-13
    )
    assert np.all(np.einsum("ni,ni->n", facing, points) <= 0.0)
    flat = facing_normals(points * [1.0, 1.0, 0.0] + [0.0, 0.0, 2.0])
    within("a plane's normal", np.abs(flat - [0.0, 0.0, -1.0]).max(), 1e-12)


def test_unknown_attitude_is_searched_for(within):
    rng = np.random.default_rng(3)
    target = manifold()
    X_CT = random_view(rng, 0.8, 1.2)
    image = look(target, X_CT @ pose(exp_so3([0, 0, 2.5])), rng)
    result = identify(Scan.from_depth(image), target)
    assert result.accepted, result.reason
    position, angle = target.symmetry.error(
        result.X_sensor_target, X_CT @ pose(exp_so3([0, 0, 2.5]))
    )
    within("position [m]", position, 5e-3)
    within("angle [rad]", angle, np.deg2rad(2.0))
    assert result.symmetry.angle_known


def test_symmetry_that_nobody_declared_is_found_in_the_mesh(frame: DepthImage, within):
    undeclared = replace(BARREL, symmetry=Symmetry())
    result = identify(Scan.from_depth(frame), undeclared, VIEW[:3, 3])
    assert result.accepted, result.reason
    assert result.symmetry.axis is not None
    within("axis", np.abs(result.symmetry.axis) - [1.0, 0.0, 0.0], 1e-6)
    assert result.symmetry.turns == len(BARREL.symmetry.rotations)
    position, angle = BARREL.symmetry.error(result.X_sensor_target, VIEW)
    within("position [m]", position, 5e-3)
    within("axis [rad]", angle, np.deg2rad(1.0))


def test_attitudes_that_fit_alike_are_all_told(frame: DepthImage, surface: ModelSurface):
    lone = replace(surface, symmetry=Symmetry())  # as if its turns did not look the same
    result = identify(Scan.from_depth(halved(frame)), lone, VIEW[:3, 3])
    first, *others = result.hypotheses
    assert others
    assert not result.accepted
    likely = [hypothesis.log_likelihood for hypothesis in result.hypotheses]
    assert likely == sorted(likely, reverse=True)
    assert result.margin == likely[0] - likely[1]
    for other in others:
        assert lone.symmetry.error(other.X_sensor_target, first.X_sensor_target)[1] > np.deg2rad(
            5.0
        )


@pytest.mark.parametrize("order", ["none", pytest.param("rows", marks=EVERY_THIRD)])
def test_clouds_without_a_grid(surface: ModelSurface, frame: DepthImage, order: str, within):
    points = Scan.from_depth(frame).points.reshape(-1, 3)
    drawn = np.random.default_rng(1).permutation(points)[:20_000]
    cloud = drawn if order == "none" else points[::3]
    result = perception.identify(cloud, surface, VIEW[:3, 3] + 0.1, VIEW[:3, :3])
    assert result.accepted, result.reason
    within("position [m]", BARREL.symmetry.error(result.X_sensor_target, VIEW)[0], 5e-3)


def test_result_tells_how_it_came_about(found: Identification, within):
    assert found.accepted
    assert found.reason == ""
    assert found.check is not None
    assert 0.0 < found.check.figure_m < found.check.threshold_m
    assert found.check.rays > 200
    assert found.symmetry.axis is not None
    assert np.array_equal(found.symmetry.axis, [1, 0, 0])
    assert "nearest to the coarse orientation" in found.symmetry.policy
    assert len(found.symmetry.twists) == 1
    assert not found.symmetry.angle_known
    assert 1.5 < found.score <= 2.0
    assert np.array_equal(found.hypotheses[0].X_sensor_target, found.X_sensor_target)
    assert 0 < len(found.model_after) < len(found.model_before)
    assert not found.X_sensor_target.flags.writeable
    within("free angle [rad]", np.linalg.norm(found.X_sensor_target[:3, :3] - VIEW[:3, :3]), 0.5)
    between = np.linalg.norm(found.check.projections.scan - found.check.projections.model, axis=1)
    within("C_i from C'_i [m]", np.median(between), 5e-3)


def test_same_input_same_answer(surface: ModelSurface, frame: DepthImage, found: Identification):
    again = identify(
        Scan.from_depth(frame), surface, VIEW[:3, 3] + 0.1, exp_so3([0.2, -0.2, 0.2]) @ VIEW[:3, :3]
    )
    assert np.array_equal(again.X_sensor_target, found.X_sensor_target)


@pytest.mark.parametrize("far", [pytest.param(20.0, marks=NEARER_ORIGIN), 1e4])
def test_the_origin_of_a_model_may_lie_anywhere(far: float, within):
    """As in files of a survey: found, and not refused for poses that move the origin and leave the
    object.
    """
    known, away = bracket(), far * np.array([0.6, 0.0, -0.8])
    moved = TargetModel(name="moved", vertices=known.vertices + away, triangles=known.triangles)
    X_WC = camera_pose(np.array([0.35, -0.55, 0.5]))
    scan = Scan.from_depth(look(known, X_WC, np.random.default_rng(5)))
    start = (
        X_WC[:3, 3] + X_WC[:3, :3] @ known.center + 0.05,
        exp_so3([0.1, -0.1, 0.1]) @ X_WC[:3, :3],
    )
    near, found = (identify(scan, each, *start) for each in (known, moved))
    assert near.accepted
    assert found.accepted, found.reason
    place, other = (
        transform_points(each.X_sensor_target, p)
        for each, p in ((near, known.center), (found, moved.center))
    )
    within("place [m]", np.linalg.norm(place - other), 1e-4)  # measured 2e-6


def test_wrong_poses_are_refused(surface: ModelSurface, found: Identification):
    """2 cm along any axis; 5 deg about any axis that can be seen."""
    assert found.evidence is not None
    assert not check(found.evidence, surface, VIEW).reason
    for axis in np.eye(3):
        for sign in (-1.0, 1.0):
            assert check(found.evidence, surface, VIEW @ pose(p=sign * 0.02 * axis)).reason
            if axis[0] == 0.0:
                assert check(
                    found.evidence, surface, VIEW @ pose(exp_so3(sign * np.deg2rad(5.0) * axis))
                ).reason


ANOTHER_SHAPE = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_other_shapes_are_refused"
)
CYLINDER, BOX, SPHERE = (
    mujoco.mjtGeom.mjGEOM_CYLINDER,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_SPHERE,
)


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        (BOX, [0.3, 0.3, 0.45]),
        (SPHERE, [0.35, 0, 0]),
        pytest.param(CYLINDER, [0.3, 0.35, 0], marks=ANOTHER_SHAPE),  # 20 cm shorter
        pytest.param(CYLINDER, [0.3, 0.6, 0], marks=ANOTHER_SHAPE),  # 30 cm longer
        (CYLINDER, [0.25, 0.45, 0]),  # 10 cm thinner
        pytest.param(CYLINDER, [0.35, 0.45, 0], marks=ANOTHER_SHAPE),  # 10 cm thicker
        pytest.param(BOX, [0.05, 0.05, 0.05], marks=ANOTHER_SHAPE),
    ],
)
def test_other_shapes_are_refused(surface: ModelSurface, kind: mujoco.mjtGeom, size: list[float]):
    spec = mujoco.MjSpec()
    along_x = VIEW[:3, :3] @ rotation_from_z([1.0, 0, 0], [0, 0, 1.0])
    spec.worldbody.add_geom(
        type=kind, size=size, pos=VIEW[:3, 3], quat=quat_wxyz_from_rotation(along_x)
    )
    add_seabed(spec, VIEW, FLOOR)
    image = halved(Camera(stereo=DEFAULT_NOISE).frame(spec.compile(), np.random.default_rng(2)))
    result = identify(Scan.from_depth(image), surface, VIEW[:3, 3] + [0.1, 0.05, 0.1], VIEW[:3, :3])
    assert not result.accepted
    assert result.reason


RNG = np.random.default_rng(0)
NOTHING = {
    "empty": np.zeros((0, 3)),
    "five points": np.ones((5, 3)),
    "all NaN": np.full((1000, 3), np.nan),
    "all inf": np.full((1000, 3), np.inf),
    "behind the sensor": RNG.uniform([-1, -1, -2], [1, 1, -1], (1000, 3)),
    "one line of sight": np.linspace(1, 2, 500)[:, None] * np.array([0.1, 0.1, 1.0]),
    "a line": np.linspace(0, 1, 500)[:, None] * np.array([0, 0.1, 1.0]) + np.array([0, 0, 1.0]),
    "one point many times": np.tile([0.0, 0.0, 1.0], (500, 1)),
    "a wall": np.column_stack([RNG.uniform(-1, 1, (20_000, 2)), np.full(20_000, 1.5)]),
    "beyond single precision": 1e300 * RNG.uniform([-1, -1, 0.5], [1, 1, 2.5], (1000, 3)),
    "a grain": 1e-3 * RNG.uniform([-0.2, -0.2, 1.4], [0.2, 0.2, 1.6], (2000, 3)),
    "dust": RNG.uniform([-1, -1, 0.5], [1, 1, 2.5], (3000, 3)),
}


@pytest.mark.parametrize("name", NOTHING)
@pytest.mark.parametrize("prior", [True, False])
def test_nothing_there_is_said_not_raised(surface: ModelSurface, name: str, prior: bool):
    hint = (np.array([0.0, 0.0, 1.3]), np.eye(3)) if prior else (None, np.eye(3))
    result = identify(NOTHING[name], surface, *hint)
    assert not result.accepted
    assert result.reason


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        ([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], r"along \+x \(the axes of ROS camera_link\?\)"),
        ([[1, 0, 0], [0, -1, 0], [0, 0, -1]], r"along -z \(the axes of OpenGL or Blender\?\)"),
    ],
    ids=["ROS", "OpenGL"],
)
def test_a_cloud_in_other_axes_is_named(
    surface: ModelSurface, frame: DepthImage, turn: list[list[int]], words: str
):
    points = Scan.from_depth(frame).points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    refused = identify(
        points[::9] @ np.array(turn).T, surface, orientation=np.eye(3), thorough=False
    )
    assert not refused.accepted
    assert re.search(words, refused.reason), refused.reason


def test_an_approach_in_millimetres_is_named(surface: ModelSurface, frame: DepthImage):
    refused = identify(Scan.from_depth(frame), surface, 1e3 * VIEW[:3, 3])
    assert re.search(
        r"approach is [\d.]+ m from the sensor \(in millimetres\?\), the points [\d.]+ to [\d.]+ m",
        refused.reason,
    ), refused.reason
    beside = identify(Scan.from_depth(frame), surface, VIEW[:3, 3] + [0.0, 0.0, 8.0])
    assert re.search("approach is 9.18 m from the sensor, the points", beside.reason), beside.reason


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("cloud", BARREL), "cloud"),
        ((np.zeros((10, 2)), BARREL), "cloud"),
        ((np.ones((100, 3)), 7), "target"),
        ((np.ones((100, 3)), "no such file.stl"), "there is no such file"),
        ((np.ones((100, 3)), BARREL, [0, 0]), "approach"),
        ((np.ones((100, 3)), BARREL, [0, 0, 1], 2 * np.eye(3)), "rotation"),
        ((np.ones((100, 3)), BARREL, [0, 0, 1], np.diag([1, 1, -1])), "rotation"),
    ],
)
def test_arguments_of_a_wrong_kind_are_refused(arguments: tuple, words: str):
    with pytest.raises(ConfigurationError, match=words):
        identify(*arguments)
    with pytest.raises(ConfigurationError, match="seed: must be a whole number"):
        identify(np.ones((100, 3)), BARREL, seed=-1)
    with pytest.raises(ConfigurationError):
        SensorModel(baseline=0.0)
    for sigma in (1e300, np.inf, np.nan, 1e-300):
        with pytest.raises(ConfigurationError, match=r"1e-06 to 0\.01 m|must be positive"):
            SensorModel(disparity_sigma=sigma)


def test_a_mesh_of_trimesh_is_a_target():
    mesh = trimesh.creation.box([0.3, 0.2, 0.4])
    surface = identify(np.zeros((0, 3)), mesh).surface
    assert np.array_equal(surface.target.vertices, mesh.vertices)
    assert np.array_equal(surface.target.triangles, mesh.faces)


def test_what_lies_where_nothing_is_expected_is_told(frame: DepthImage):
    """No start is left: a refusal in words, not an error."""
    identified = identify(
        Scan.from_depth(frame),
        BARREL,
        VIEW[:3, 3] + [0.0, 0.0, 0.55],
        VIEW[:3, :3],
        approach_error=0.1,
    )
    assert not identified.accepted
    assert identified.reason


@pytest.mark.parametrize(
    "p_TC", [(0.1, -0.9, 0.75), pytest.param((-0.7, 0.8, 0.5), marks=ANOTHER_SIDE)]
)
def test_an_exact_frame_gives_the_pose_without_bias(surface: ModelSurface, p_TC, within):
    """No noise, so what is left in depth is the method's own: pixels, voxels, facets."""
    X_CT, rng = camera_pose(np.array(p_TC)), np.random.default_rng(1)
    scan = Scan.from_depth(look(BARREL, X_CT, rng, noise=None))
    result = identify(scan, surface, *coarse(rng, X_CT, BARREL))
    assert result.accepted, result.reason
    off = transform_points(result.X_sensor_target, BARREL.center) - transform_points(
        X_CT, BARREL.center
    )
    within("in depth [m]", off @ X_CT[:3, 3] / np.linalg.norm(X_CT[:3, 3]), 5e-4)


def test_a_face_whose_plane_cuts_the_bed_is_no_background(rng):
    """A disc that hangs over the bed: its plane meets the bed in a strip, far to both sides of
    it.
    """
    x = y = np.arange(-0.3, 0.3, 0.003)
    tx, ty = np.meshgrid(x, y)
    # the camera looks down on the bed, which lies 1.35 m below it
    pitch, height = np.deg2rad(30.0), 1.35
    with np.errstate(divide="ignore"):
        z = height / (np.cos(pitch) * ty + np.sin(pitch))
    z[(z < 0.0) | (z > 2.3)] = np.nan
    disc = np.hypot(tx, ty) < 0.2
    z[disc] = 1.9
    # Rougher than its noise is thought to be: no seed of the search for planes may matter.
    z += rng.normal(0.0, 0.004, z.shape)
    scan = Scan(points=np.stack([z * tx, z * ty, z], axis=-1), tangent_x=x, tangent_y=y)
    usable = np.isfinite(z)
    taken = background(scan, usable, 1.0, SensorModel(focal=1.0 / 0.003), np.random.default_rng(0))
    assert taken[disc].mean() < 0.01
    assert taken[usable & ~disc].mean() > 0.95
    # The same disc as large as the limit lets nothing be: a wall.
    wall = background(scan, usable, 0.5, SensorModel(focal=1.0 / 0.003), np.random.default_rng(0))
    assert wall[disc].mean() > 0.95


@pytest.mark.parametrize("reach", [0.3, 0.36])
def test_a_panel_in_the_picture_is_the_object_though_a_neighbour_lengthens_it(reach: float):
    """The object may be 0.5 m long: a panel of 0.6 m that the picture shows whole is kept, one of
    0.72 m is a wall.
    """
    x = y = np.arange(-0.3, 0.3, 0.003)
    tx, ty = np.meshgrid(x, y)
    panel = (np.abs(2.0 * tx) < reach) & (np.abs(2.0 * ty) < 0.1)
    z = np.where(panel, 2.0, np.nan)
    scan = Scan(points=np.stack([z * tx, z * ty, z], axis=-1), tangent_x=x, tangent_y=y)
    taken = background(scan, panel, 0.5, SensorModel(focal=1.0 / 0.003), np.random.default_rng(0))
    assert taken[panel].mean() == pytest.approx(1.0 if reach > 0.35 else 0.0, abs=0.01)


def test_finder_lays_the_path_in_the_world(frame: DepthImage, within):
    X_WT = pose(exp_so3([0, 0, 0.7]), [5.0, -2.0, -9.0])
    X_BC = pose(exp_so3([-1.9, 0.1, 0.0]), [0.5, 0.0, -0.2])
    X_WB = X_WT @ inverse(VIEW) @ inverse(X_BC)
    finder = KnownObjectFinder(
        BARREL, "transverse", X_WT[:3, 3] + 0.1, X_WT[:3, :3] @ exp_so3([0.0, 0.2, 0.1])
    )
    assert isinstance(finder, TargetFinder)
    state, target = finder.step(finder.init(), standing(X_WB), replace(frame, X_BC=X_BC))
    assert target is not None
    assert target.accepted, target.reason
    assert target.path is not None
    within("position [m]", BARREL.symmetry.error(target.X_WT, X_WT)[0], 5e-3)
    within("range [m]", target.range_m - np.linalg.norm(VIEW[:3, 3]), 5e-3)
    radial = (target.path.p - X_WT[:3, 3]) @ X_WT[:3, 1:3]
    within("radius [m]", np.linalg.norm(radial, axis=1) - 0.3, 5e-3)
    assert state.last is not None
    cloud_W = state.in_world(state.last.cloud)
    assert np.linalg.norm(np.median(cloud_W, axis=0) - X_WT[:3, 3]) < 0.5


def test_finder_never_raises_on_what_it_sees(frame: DepthImage):
    finder = KnownObjectFinder(BARREL, "longitudinal", VIEW[:3, 3] + 0.1, VIEW[:3, :3])
    state = finder.init()
    rng = np.random.default_rng(0)
    for depth in (
        np.full((480, 640), np.nan),
        np.full((480, 640), 1.3),
        rng.uniform(0.3, 5.0, (480, 640)),
    ):
        state, target = finder.step(state, standing(np.eye(4)), replace(frame, depth=depth))
        assert target is not None
        assert not target.accepted
        assert target.reason
        assert target.path is None
    assert state.frames == 3
    encoders = EncoderMeasurement(time=0.0, q=np.zeros(1), qd=np.zeros(1))
    with pytest.raises(ConfigurationError, match="DepthImage"):
        finder.step(state, standing(np.eye(4)), encoders)
    with pytest.raises(ConfigurationError, match="longitudinal"):
        KnownObjectFinder(BARREL, "diagonal", np.zeros(3))


def test_a_view_that_holds_not_all_of_the_pose_is_refused():
    """A long round bar with both ends out of view can slide and, without a declared axis, turn."""
    bar = barrel_like_bar()
    X_CT = camera_pose(np.array([0.0, -0.5, 0.05]))
    image = look(bar, X_CT, np.random.default_rng(0), floor=False)
    result = identify(Scan.from_depth(image), bar, X_CT[:3, 3], X_CT[:3, :3])
    assert not result.accepted
    assert result.reason


def barrel_like_bar() -> TargetModel:
    vertices, triangles = revolve([(-1.5, 0.0), (-1.5, 0.1), (1.5, 0.1), (1.5, 0.0)], 60)
    return TargetModel(
        name="bar",
        vertices=vertices,
        triangles=triangles,
        symmetry=Symmetry(axis=np.array([1.0, 0.0, 0.0])),
    )


def test_importing_the_room_is_light():
    code = (
        "import sys; from uuv import perception; assert 'embreex' not in sys.modules and 'scipy' "
        "not in sys.modules; "
        "assert callable(perception.identify)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

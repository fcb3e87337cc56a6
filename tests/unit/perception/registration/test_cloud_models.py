"""A model given as a point cloud, by every door: the pose of its mesh on the same scan, and what
was done in words.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.identification.cloud_models import sampled_cloud
from uuv import perception
from uuv.clouds.object_scenes import object_scene, target_of
from uuv.models.meshes.ply_files import write_ply
from uuv.models.objects.targets import TargetModel
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import transform_points

NAME = "starfish"


@pytest.fixture(scope="module")
def scene():
    return object_scene(NAME, 5000)


@pytest.fixture(scope="module")
def by_mesh(scene):
    return identified(scene, target_of(NAME))


@pytest.fixture(scope="module")
def cloud():
    return sampled_cloud(target_of(NAME), 5000)


def identified(scene, model):
    return perception.identify(
        scene.scan, model, scene.approach, scene.orientation, sensor=scene.sensor.model
    )


def target_by(model) -> TargetModel:
    """The mesh that `identify` makes of a model, whatever is seen."""
    return perception.identify(np.zeros((0, 3)), model).surface.target


@pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_cloud_models.py::test_a_cloud_gives_the_pose_of_its_mesh"
)
def test_every_door_makes_the_same_mesh_of_a_cloud(cloud, tmp_path, within):
    points, normals = cloud
    file = tmp_path / "star.ply"
    write_ply(file, points)
    plain = target_by(points)
    oriented = target_by(np.column_stack([points, normals]))
    for model, expected, rounding in (
        # as Open3D's: normals are there, but none
        (SimpleNamespace(points=list(points), normals=[]), plain, 0.0),
        (SimpleNamespace(points=list(points), normals=list(normals)), oriented, 0.0),
        (file, plain, 1e-7),  # single precision
        (TargetModel.from_cloud(points, normals, "star"), oriented, 0.0),
    ):
        target = target_by(model)
        assert np.array_equal(target.triangles, expected.triangles)
        within("vertices [m]", target.vertices - expected.vertices, rounding)
    assert not np.array_equal(plain.vertices, oriented.vertices)


PLAIN = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_cloud_models.py::test_a_cloud_gives_the_pose_of_its_mesh"
)


@pytest.mark.parametrize("with_normals", [pytest.param(False, marks=PLAIN), True])
def test_a_cloud_gives_the_pose_of_its_mesh(scene, by_mesh, cloud, with_normals: bool, within):
    points, normals = cloud
    identification = identified(
        scene, np.column_stack([points, normals]) if with_normals else points
    )
    assert identification.accepted, identification.reason
    X = scene.target.symmetry.nearest_pose(
        identification.X_sensor_target, by_mesh.X_sensor_target[:3, :3]
    )
    center = scene.target.center
    apart = transform_points(X, center) - transform_points(by_mesh.X_sensor_target, center)
    within("from the mesh's pose [m]", np.linalg.norm(apart), 1e-3)  # measured 1.2e-4 to 6e-4
    assert "meshed from a cloud of 5000 points" in identification.model_note
    assert not by_mesh.model_note


def test_an_open_scan_is_seen_from_its_side_only_and_its_border_is_no_edge():
    points, normals = sampled_cloud(target_of(NAME), 8000)
    upper = normals[:, 2] > 0.2
    surface = ModelSurface.of(TargetModel.from_cloud(points[upper], normals[upper]))
    assert surface.is_open
    assert surface.exposed(np.array([0.0, 0.0, 1.0]), np.deg2rad(75.0)).mean() > 0.6
    assert surface.exposed(np.array([0.0, 0.0, -1.0]), np.deg2rad(75.0)).mean() < 0.01
    assert surface.border is not None
    assert surface.on_border(surface.border.data).all()
    assert not surface.on_border(
        points[upper][np.linalg.norm(points[upper][:, :2], axis=1) < 0.03]
    ).any()
    assert not ModelSurface.of(target_of(NAME)).is_open


def test_what_is_no_model_is_told_by_kind():
    for model, words in (
        (np.zeros((10, 4)), r"or a cloud: an array \(n, 3\).*got an array of shape \(10, 4\)"),
        (np.zeros((10, 3)), "at least 100 distinct points, got 1"),
        (SimpleNamespace(points=np.zeros((0, 3))), "got 0"),
        (7, "got int"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            perception.identify(np.zeros((0, 3)), model)

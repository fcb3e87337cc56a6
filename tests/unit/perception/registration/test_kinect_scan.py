"""A real scan of a milk carton, with two partial clouds of it as models: upright by every door,
never upside down.

The data (Point Cloud Library) lie beside the checkout, or where UUV_SHARED says, and the tests skip
without them. Both models are cut from this very scan, so that their poses are known: the points of
`milk.pcd` are pixels of the scene, and those of `milk_other_view.pcd` are, after the motion below,
found by ICP with a residual below 0.01 mm.
"""

import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from uuv import perception
from uuv.models.meshes.surfel_files import read_surfels
from uuv.models.objects.targets import TargetModel
from uuv.perception.clouds.scan import Scan
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import exp_so3, rotation_angle, transform_points

SHARED = Path(os.environ.get("UUV_SHARED", Path(__file__).resolve().parents[4].parent / "shared"))
DATA = SHARED / "data" / "kinect"
SCENE = DATA / "milk_cartoon_all_small_clorox.pcd"
K = np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]])
X_SENSOR = {
    "milk": np.eye(4),
    "milk_other_view": np.array(
        [
            [0.9689, -0.1197, 0.2167, -0.1590],
            [-0.1168, -0.9928, -0.0261, -0.2125],
            [0.2182, 0.0000, -0.9759, 0.0421],
            [0.0, 0.0, 0.0, 1.0],
        ]
    ),
}
pytestmark = pytest.mark.skipif(not SCENE.is_file(), reason=f"no real scan in {DATA}")


@cache
def doors() -> dict[str, Scan | np.ndarray]:
    scene = read_surfels(SCENE)
    points, shape = scene.points, scene.shape
    assert shape is not None
    organised = points.reshape(*shape, 3)
    image = DepthImage(time=0.0, depth=organised[..., 2], K=K, X_BC=np.eye(4))
    listed = points[np.isfinite(points).all(axis=1)]
    return {"depth frame": Scan.from_depth(image), "organised": organised, "list": listed[::-1]}


def off(found: perception.Identification, name: str) -> tuple[float, float]:
    """Distance [m] of the model's centre from where it is, and angle [deg]."""
    X = found.X_sensor_target
    center = found.surface.center
    apart = transform_points(X, center) - transform_points(X_SENSOR[name], center)
    return float(np.linalg.norm(apart)), float(
        np.rad2deg(rotation_angle(X[:3, :3], X_SENSOR[name][:3, :3]))
    )


FRAME = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_kinect_scan.py::test_organised_points_are_the_depth_frame"
)
CLOUD_AS_MODEL = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_cloud_models.py::test_a_cloud_gives_the_pose_of_its_mesh"
)


def test_organised_points_are_the_depth_frame(within):
    """So that a pose found in one is found in the other."""
    frame, points = doors()["depth frame"], doors()["organised"]
    assert isinstance(frame, Scan)
    assert not isinstance(points, Scan)
    gridded = Scan.from_cloud(points)
    assert np.array_equal(np.isfinite(gridded.depth), np.isfinite(frame.depth))
    within("depth [m]", np.nan_to_num(gridded.depth) - np.nan_to_num(frame.depth), 1e-9)
    within("pixel", 525.0 * (gridded.tangent_x - frame.tangent_x), 1e-2)
    within("pixel", 525.0 * (gridded.tangent_y - frame.tangent_y), 1e-2)


@pytest.mark.parametrize(
    ("name", "door"),
    [
        pytest.param("milk", "depth frame", marks=FRAME),
        pytest.param("milk", "list", marks=CLOUD_AS_MODEL),
        pytest.param("milk", "organised", marks=FRAME),
        pytest.param("milk_other_view", "depth frame", marks=FRAME),
        pytest.param("milk_other_view", "list", marks=CLOUD_AS_MODEL),
        pytest.param("milk_other_view", "organised", marks=CLOUD_AS_MODEL),
    ],
)
def test_the_carton_is_found_upright(name: str, door: str, within):
    identification = perception.identify(doors()[door], DATA / f"{name}.pcd")
    assert identification.accepted, identification.reason
    assert "open" in identification.model_note
    position, angle = off(identification, name)
    within("position [m]", position, 3e-3)  # measured 3e-4
    within("angle [deg]", angle, 0.6)  # measured 0.06


UPSIDE_DOWN = pytest.mark.long(
    guarded_by="tests/unit/perception/registration/test_identification.py::test_wrong_poses_are_refused"
)


@UPSIDE_DOWN
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", X_SENSOR)
def test_it_is_not_accepted_upside_down_where_that_is_expected(name: str, axis: int):
    """The search begins from attitudes near the wrong one only; the upright pose lies too far from
    what is expected.
    """
    model = perception.identify(np.zeros((0, 3)), DATA / f"{name}.pcd").surface
    main = np.linalg.eigh(np.cov(model.points.T))[1][:, axis]
    center = transform_points(X_SENSOR[name], model.center)
    identification = perception.identify(
        doors()["organised"], model, center, X_SENSOR[name][:3, :3] @ exp_so3(np.pi * main)
    )
    assert not identification.accepted


@pytest.mark.skipif(not find_spec("open3d"), reason="extra open3d is not installed")
@pytest.mark.parametrize("name", X_SENSOR)
def test_a_mesh_made_elsewhere_is_found_upright(name: str, within):
    from uuv.models.meshes.open3d_loader import load

    open3d = load()
    cloud = open3d.io.read_point_cloud(str(DATA / f"{name}.pcd"))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(20))
    cloud.orient_normals_consistent_tangent_plane(20)
    radii = open3d.utility.DoubleVector([0.003, 0.005, 0.008])
    mesh = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, radii)
    target = TargetModel(
        name=name, vertices=np.asarray(mesh.vertices), triangles=np.asarray(mesh.triangles)
    )
    for model in (target, cloud):
        for cloud_of_scene in doors().values():
            identification = perception.identify(cloud_of_scene, model)
            assert identification.accepted, identification.reason
            position, angle = off(identification, name)
            within("position [m]", position, 6e-3)  # measured 6e-4
            within("angle [deg]", angle, 1.5)  # measured 0.15

"""Registrations of other libraries: those of Open3D, and peers on unseen objects behind one
interface.

A peer gets the scan points that may show the object and the model's surface, sampled evenly, both
with normals. Each registers the scan to the whole model, so that hidden parts of the model need no
partner, and those that give a rough pose are refined by Open3D's ICP. Lengths scale with the
model's radius, its spacing and the sensor's noise. They were chosen on the first scenes of seed
1001, by the most found; each peer says what was tried.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.models.meshes import open3d_loader
from uuv.sim.interfaces.spatial import Array, inverse, pose, transform_points

IcpKind = Literal["point", "plane", "generalised"]
ICP_STEPS = 40  # in each stage of ICP, at most
ROUGH = 0.1  # [radii] correspondence distance of the first stage of ICP
START_REACHES = (0.3, 0.15)  # [radii] correspondence distances of ICP from each of many starts
STARTS_KEPT = 5  # of those, whose ICP is finished
FEATURE_VOXEL = 0.05  # [radii] edge of the cubes to which clouds are thinned for FPFH
KISS_VOXEL = 0.05  # [radii] the same for KISS-Matcher
VIEW_DISTANCE = 5.0  # [radii] from the model's centre to the eye of a view
# [diameters] resolutions of PPF in position, of which the first that is cheap
PPF_STEPS = (0.08, 0.1, 0.12, 0.15)
# of the thinned model, at most: time grows with the fourth power, to minutes on flat shapes
PPF_POINTS = 700
PPF_ANGLES = 30.0  # resolution of PPF in angle: parts of a whole turn
# share of the scan's points that vote, [diameters] to which the scan is thinned
PPF_SCENE = (0.2, 0.03)
PPF_KEPT = 20  # poses of PPF, by votes, whose ICP is finished
# edge of the cubes in KISS-Matcher's own unit: its default; it refuses those below 0.01
KISS_UNIT = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """Surface of the object."""

    points: Array  # (m, 3) [m] in T
    normals: Array  # (m, 3) unit, outwards
    spacing: float  # [m] between neighbouring points
    radius: float  # [m]
    center: Array  # (3,) [m] in T


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationTask:
    """What a peer gets of one scene."""

    points: Array  # (n, 3) [m] in the sensor frame S
    normals: Array  # (n, 3) unit, towards the sensor
    sigma: float  # [m] standard deviation of a depth reading, median of the points
    model: Model
    approach: Array  # (3,) [m] expected position of the model's centre in S
    approach_error: float  # [m] largest error of `approach`
    X_near: Array  # (4, 4) pose of T in S near the truth: the start of peers that need one
    seed: int  # of random samples

    @property
    def stages(self) -> tuple[float, float]:
        """Correspondence distances [m] of ICP: from a rough pose, and to the end."""
        last = max(3.0 * self.model.spacing, 2.0 * self.sigma)

        return max(ROUGH * self.model.radius, last), last

    def admits(self, X_ST: Array) -> bool:
        """Whether `X_ST` (4, 4) lies within 1.5 times the error of the expected position."""
        off = transform_points(X_ST, self.model.center) - self.approach
        return bool(np.linalg.norm(off) < 1.5 * self.approach_error)


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer:
    """A registration of another library."""

    title: str  # in tables
    needs: Mapping[str, str]  # packages by the modules that are imported
    prepare: Callable[[Model], Any]  # what needs to be done once for a model
    # from a task and what was prepared: X_ST (4, 4)
    register: Callable[[RegistrationTask, Any], Array]

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages that are not installed."""
        return tuple(package for module, package in self.needs.items() if find_spec(module) is None)

    def load(self) -> None:
        """Import the modules, so that no time is that of an import."""
        for module in self.needs:
            open3d_loader.load() if module == "open3d" else import_module(module)


def _open3d() -> Any:
    """Open3D's module of registrations."""
    return open3d_loader.load().pipelines.registration


def point_cloud(points: Array, normals: Array) -> Any:
    """Open3D point cloud of points (n, 3) [m] with unit normals (n, 3)."""
    o3d = open3d_loader.load()

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud


def _model_cloud(model: Model) -> Any:
    return point_cloud(model.points, model.normals)


def _thinned(cloud: Any, edge: float) -> Any:
    """The cloud with one mean point in each cube of `edge` [m]."""
    thin = cloud.voxel_down_sample(edge)
    thin.normalize_normals()
    return thin


def icp(
    scan: Any, model: Any, reaches: Iterable[float], X_TS: Array, kind: IcpKind = "plane"
) -> Any:
    """Result of Open3D's ICP, with correspondence distances `reaches` [m] one after the other.

    Args:
        scan: Point cloud in S.
        model: Point cloud in T.
        reaches: [m]
        X_TS: (4, 4) pose of S in T at the start.
        kind: Point to point, point to plane, or generalised.

    Point to plane, tried on 29 scenes, from 25 deg off: the first distance 0.07, 0.1, 0.15, 0.3
    radii: 19, 22, 20, 18 found; an absolute 20 cm, then 5 cm: 12; point to point: 15; Tukey weights
    of 1, 2, 3 sigma: 13, 18, 19.
    """
    registration = _open3d()
    criteria = registration.ICPConvergenceCriteria(max_iteration=ICP_STEPS)

    method, estimation = {
        "point": (registration.registration_icp, registration.TransformationEstimationPointToPoint),
        "plane": (registration.registration_icp, registration.TransformationEstimationPointToPlane),
        "generalised": (
            registration.registration_generalized_icp,
            registration.TransformationEstimationForGeneralizedICP,
        ),
    }[kind]

    result = None
    for reach in reaches:
        result = method(scan, model, reach, X_TS, estimation(), criteria)
        X_TS = result.transformation
    return result


def _refined(task: RegistrationTask, model: Any, X_ST: Array) -> Array:
    """The rough pose `X_ST` (4, 4) refined by ICP."""
    refined = icp(point_cloud(task.points, task.normals), model, task.stages, inverse(X_ST))
    return inverse(np.array(refined.transformation))


def _from_near(task: RegistrationTask, model: Any) -> Array:
    """ICP from the start near the truth; X_ST (4, 4)."""
    return _refined(task, model, task.X_near)


def _from_all_sides(task: RegistrationTask, model: Any) -> Array:
    """ICP from the 60 rotations of the icosahedron, centroid on centroid, on thinned clouds; the
    best go on.

    Tried on 15 scenes: correspondences within 0.3, then 0.15 radii: 6 found; within 0.15 alone: 5.
    """
    scan = point_cloud(task.points, task.normals)
    edge = FEATURE_VOXEL * task.model.radius
    thin, thin_model = _thinned(scan, edge), _thinned(model, edge)

    middle, reaches = (
        task.points.mean(axis=0),
        [share * task.model.radius for share in START_REACHES],
    )

    # Rough: short runs on the thinned clouds.
    rough = []
    for R in Rotation.create_group("I").as_matrix():
        X_ST = pose(R, middle - R @ task.model.center)
        rough.append(icp(thin, thin_model, reaches, inverse(X_ST)))
    rough.sort(key=lambda found: -found.fitness)

    # Fine: the best of them on all points.
    finished = [
        icp(scan, model, task.stages, start.transformation) for start in rough[:STARTS_KEPT]
    ]

    return inverse(np.array(max(finished, key=lambda found: found.fitness).transformation))


def features(cloud: Any, edge: float) -> tuple[Any, Any]:
    """The cloud thinned to cubes of `edge` [m], and its FPFH features."""
    o3d = open3d_loader.load()
    thin = _thinned(cloud, edge)

    return thin, _open3d().compute_fpfh_feature(
        thin, o3d.geometry.KDTreeSearchParamHybrid(5.0 * edge, 100)
    )


def ransac(of_scan: tuple[Any, Any], of_model: tuple[Any, Any], near: float, seed: int) -> Array:
    """Rough pose X_TS (4, 4) by Open3D's RANSAC on FPFH features.

    Args:
        of_scan: Thinned cloud and features in S.
        of_model: Likewise in T.
        near: [m] largest distance of partners.
        seed: Of Open3D's global generator, from which it draws.
    """
    registration = _open3d()
    open3d_loader.load().utility.random.seed(seed % 2**31)

    return registration.registration_ransac_based_on_feature_matching(
        of_scan[0],
        of_model[0],
        of_scan[1],
        of_model[1],
        True,
        near,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(near),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    ).transformation


def _by_features(task: RegistrationTask, prepared: tuple[Any, Any, Any]) -> Array:
    """RANSAC on FPFH features, then ICP; X_ST (4, 4).

    Tried on 29 scenes: cubes of 0.03, 0.05, 0.08 radii: 7, 15, 13 found; of 1 to 4 spacings: 4, 8,
    15, 9; one-sided matches: 14; features of 8 cubes: 10; normals estimated anew: 9.
    """
    model, *of_model = prepared
    edge = FEATURE_VOXEL * task.model.radius
    of_scan = features(point_cloud(task.points, task.normals), edge)

    # the distance is that of Open3D's tutorial
    X_TS = ransac(of_scan, (of_model[0], of_model[1]), 1.5 * edge, task.seed)
    return _refined(task, model, inverse(np.array(X_TS)))


def _prepared_features(model: Model) -> tuple[Any, Any, Any]:
    cloud = _model_cloud(model)
    return cloud, *features(cloud, FEATURE_VOXEL * model.radius)


def _prepared_small_gicp(model: Model) -> tuple[Any, Any]:
    library = import_module("small_gicp")

    return library.preprocess_points(
        model.points, downsampling_resolution=model.spacing, num_neighbors=20
    )


def _small_gicp(task: RegistrationTask, prepared: tuple[Any, Any]) -> Array:
    """small_gicp, point to plane, from the start near the truth; X_ST (4, 4).

    Tried on 29 scenes: generalised ICP in the same stages: 14 found, point to plane: 19; thinned to
    2 spacings: 16, 17;
    the first stage at 0.15, 0.3 radii: 17, 14; its default bounds of convergence, 0.1 deg and 1 mm:
    fewer.
    """
    library = import_module("small_gicp")

    target, tree = prepared
    source, _ = library.preprocess_points(
        task.points, downsampling_resolution=task.model.spacing, num_neighbors=20
    )

    X_TS = inverse(task.X_near)
    for reach in task.stages:
        X_TS = library.align(
            target,
            source,
            tree,
            X_TS,
            registration_type="PLANE_ICP",
            max_correspondence_distance=reach,
            max_iterations=100,
            rotation_epsilon=1e-4,  # [rad]
            translation_epsilon=1e-5,  # [m]
        ).T_target_source

    return inverse(X_TS)


def _views(model: Model) -> tuple[Any, list[tuple[Array, Array]]]:
    """The model's cloud, and from 14 sides the eye (3,) [m] in T and the visible points (k, 3) [m]
    seen from it.
    """
    cloud, distance, views = _model_cloud(model), VIEW_DISTANCE * model.radius, []

    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(
        3.0
    )

    for way in np.vstack([np.eye(3), -np.eye(3), corners]):
        eye = model.center + distance * way
        # Open3D's tutorial has 100 too
        _, visible = cloud.hidden_point_removal(eye, 100.0 * distance)
        part = cloud.select_by_index(visible)
        facing = (
            np.einsum("ni,ni->n", eye - np.asarray(part.points), np.asarray(part.normals)) > 0.0
        )

        thin = part.select_by_index(np.flatnonzero(facing)).voxel_down_sample(
            0.5 * KISS_VOXEL * model.radius
        )
        views.append((eye, np.asarray(thin.points) - eye))

    return cloud, views


def _kiss_matcher(task: RegistrationTask, prepared: tuple[Any, list[tuple[Array, Array]]]) -> Array:
    """KISS-Matcher with each view of the model, that with most inliers, then ICP; X_ST (4, 4).

    Its normals face the origin, so that the model is shown as a sensor at the origin would see it.
    Tried on 29 scenes
    with the whole model at once: cubes of 0.03, 0.05, 0.08, 0.12 radii: 0, 0, 1, 1 found; noise
    bounds twice as wide, radii of features 1.5 times as large, its filter of lines at 0.9: 0. Tried
    on 15 of them: views and cubes of 0.05,
    0.08 radii: 3, 3; views and features of 8 cubes: 1; the whole model and an origin behind the
    scan: 1 or 2.
    """
    library = import_module("kiss_matcher")

    cloud, views = prepared
    scale = KISS_UNIT / (KISS_VOXEL * task.model.radius)
    scan = list((scale * task.points).astype(np.float32))
    most, X_TS = -1, np.eye(4)

    for eye, points in views:
        matcher = library.KISSMatcher(library.KISSMatcherConfig(KISS_UNIT))
        estimate = matcher.estimate(scan, list((scale * points).astype(np.float32)))

        if (count := matcher.get_num_final_inliers()) > most:
            most, X_TS = (
                count,
                pose(np.array(estimate.rotation), np.array(estimate.translation) / scale + eye),
            )

    return _refined(task, cloud, inverse(X_TS))


def _oriented(points: Array, normals: Array) -> np.ndarray:
    """Points and normals (n, 6) as OpenCV wants them."""
    return np.ascontiguousarray(np.hstack([points, normals]), dtype=np.float32)


def _prepared_pairs(model: Model) -> tuple[Any, Any]:
    """The model's cloud, and OpenCV's detector trained with it."""
    share = (model.points - model.points.min(axis=0)) / np.ptp(model.points, axis=0)
    # as OpenCV thins it
    counts = [len(np.unique((share / step).astype(int), axis=0)) for step in PPF_STEPS]
    step = next(
        (step for step, count in zip(PPF_STEPS, counts, strict=True) if count <= PPF_POINTS),
        PPF_STEPS[-1],
    )

    detector = import_module("cv2").ppf_match_3d_PPF3DDetector(step, step, PPF_ANGLES)
    detector.trainModel(_oriented(model.points, model.normals))

    return _model_cloud(model), detector


def _point_pairs(task: RegistrationTask, prepared: tuple[Any, Any]) -> Array:
    """OpenCV's point pair features; of its poses, those where the object is expected refined by
    ICP; X_ST (4, 4).

    Tried on 6 scenes: scans thinned to 0.03, 0.05, 0.08 diameters: 4 found each; OpenCV's own ICP
    in place of Open3D's, chosen by the share of the scan within reach or by its residual: 1, 0.
    Training takes 40 s and more at a step of 0.05 diameters; at 0.1 none of the first poses came
    near on 2 scenes.
    """
    cloud, detector = prepared

    poses = detector.match(_oriented(task.points, task.normals), PPF_SCENE[0], PPF_SCENE[1])
    admitted = [X for X in (np.array(pose.pose) for pose in poses) if task.admits(X)][:PPF_KEPT]

    scan = point_cloud(task.points, task.normals)
    finished = [icp(scan, cloud, task.stages, inverse(X_ST)) for X_ST in admitted]

    if not finished:
        return np.eye(4)

    return inverse(np.array(max(finished, key=lambda each: each.fitness).transformation))


_OPEN3D, _GICP = {"open3d": "open3d"}, {"small_gicp": "small_gicp"}
PEERS: Mapping[str, Peer] = {
    "icp": Peer(
        title="Open3D ICP, 25 deg off", needs=_OPEN3D, prepare=_model_cloud, register=_from_near
    ),
    "small_gicp": Peer(
        title="small_gicp, 25 deg off",
        needs=_GICP,
        prepare=_prepared_small_gicp,
        register=_small_gicp,
    ),
    "icp_all_sides": Peer(
        title="Open3D ICP, 60 starts", needs=_OPEN3D, prepare=_model_cloud, register=_from_all_sides
    ),
    "fpfh": Peer(
        title="Open3D FPFH, RANSAC, ICP",
        needs=_OPEN3D,
        prepare=_prepared_features,
        register=_by_features,
    ),
    "kiss_matcher": Peer(
        title="KISS-Matcher, ICP",
        needs={**_OPEN3D, "kiss_matcher": "kiss-matcher"},
        prepare=_views,
        register=_kiss_matcher,
    ),
    "ppf": Peer(
        title="OpenCV PPF, ICP",
        needs={**_OPEN3D, "cv2": "opencv-contrib-python-headless"},
        prepare=_prepared_pairs,
        register=_point_pairs,
    ),
}

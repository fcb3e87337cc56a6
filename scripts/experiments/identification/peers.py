"""Benchmark: object identification against Open3D and small_gicp, from the same points and start.

    # against Open3D
    ./uvw run --extra open3d scripts/experiments/identification/peers.py

    # against small_gicp too
    ./uvw run --extra open3d --with small_gicp scripts/experiments/identification/peers.py

All methods get the points that our segmentation assigns to the object, and the model sampled
evenly. They start from the coarse attitude with the centroids of both clouds aligned; RANSAC on
FPFH features needs no start. The peers match scan to whole model in three stages, whose
correspondence distance narrows from 20 cm to three spacings.

Times are processor times, the methods in turn. They exclude segmentation, except for "ours, whole",
which begins at the depth frame. A pose counts as found within 1 % of the range and 5 deg, modulo
declared symmetry.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from time import process_time
from typing import Any

import numpy as np

from uuv.clouds.frames import ObjectScene
from uuv.clouds.object_scenes import object_scene, target_of
from uuv.experiment import Row, Study, StudyOptions, Summary, Table
from uuv.models.meshes import open3d_loader
from uuv.perception.clouds.scan import facing_normals
from uuv.perception.registration.evidence import Evidence, score
from uuv.perception.registration.fine_fit import fine_fit
from uuv.perception.registration.identification import identify
from uuv.perception.registration.initialiser import Expected, initial_poses
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose
from uuv.sim.interfaces.streams import Streams
from uuv.start import parse, run_scenario

FIT_POINTS = 10_000  # scan points of a fit that is timed alone
FIT_START = (0.01, np.deg2rad(2.0))  # [m], [rad] offset from the truth, where a fit alone starts
Method = Callable[["SceneInput"], Array]


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Scenes of the benchmark."""

    objects: tuple[str, ...] = ("barrel", "manifold", "rock", "starfish", "valve")
    """Names of objects."""
    runs: int = 10
    """Number of scenes of each object; their seeds are --seed and those that follow."""
    sensor: str = "stereo"
    """Name of the sensor."""
    workers: int = 1
    """Number of processes; 0: one for each core, 1: this one.

    Computing times are comparable with 1 only.
    """


@dataclass(frozen=True)
class RaceCase:
    """One scene for all methods; a case of the benchmark."""

    object: str
    seed: int
    sensor: str


@dataclass(frozen=True, eq=False)
class SceneInput:
    """Input of every method."""

    scene: ObjectScene
    surface: ModelSurface
    evidence: Evidence
    X_start: Array  # (4, 4) start pose of T in S

    @property
    def stages(self) -> tuple[float, ...]:
        """Correspondence distances [m] of the peers' three stages."""
        return 0.2, 0.05, 3.0 * self.surface.spacing  # [m]


def whole(case: SceneInput) -> Array:
    """Our identification from the depth frame on; X_ST (4, 4)."""
    scene = case.scene
    found = identify(
        scene.scan, case.surface, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    return found.X_sensor_target


def ours(case: SceneInput) -> Array:
    """Our search and fit on the segmented points; X_ST (4, 4)."""
    scene, evidence = case.scene, case.evidence

    expected = Expected(p=scene.approach, error=0.45, R=scene.orientation)
    starts = initial_poses(evidence.scan, evidence.mask, case.surface, evidence.sensor, expected)
    best = max(starts, key=lambda X: score(evidence, case.surface, X), default=case.X_start)

    return fine_fit(evidence, case.surface, best).X_ST


def open3d_icp(kind: str) -> Method:
    """Open3D's ICP in three stages; `kind` is "point", "plane" or "generalised"."""

    def method(case: SceneInput) -> Array:
        registration = open3d_loader.load().pipelines.registration
        X_TS = inverse(case.X_start)
        for reach in case.stages:
            X_TS = _open3d_stage(registration, kind, _clouds(case), reach, X_TS)
        return inverse(X_TS)

    return method


def fpfh(case: SceneInput) -> Array:
    """Open3D's RANSAC on FPFH features, refined by point-to-plane ICP; X_ST (4, 4)."""
    o3d = open3d_loader.load()

    registration = o3d.pipelines.registration
    # RANSAC draws from Open3D's global generator.
    o3d.utility.random.seed(case.scene.seed % 2**31)

    # Descriptors on thinned clouds.
    voxel = 2.0 * case.surface.spacing
    thin = [cloud.voxel_down_sample(voxel) for cloud in _clouds(case)]
    for cloud in thin:
        cloud.normalize_normals()

    features = [
        registration.compute_fpfh_feature(
            cloud, o3d.geometry.KDTreeSearchParamHybrid(5.0 * voxel, 100)
        )
        for cloud in thin
    ]

    # The rough pose from matches of descriptors.
    rough = registration.registration_ransac_based_on_feature_matching(
        *thin,
        *features,
        True,
        1.5 * voxel,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )

    return inverse(
        _open3d_stage(registration, "plane", _clouds(case), case.stages[-1], rough.transformation)
    )


def small_gicp(case: SceneInput) -> Array:
    """Generalised ICP of small_gicp in three stages; X_ST (4, 4)."""
    library = import_module("small_gicp")
    model, points = case.surface.points, case.evidence.points
    X_TS = inverse(case.X_start)

    for reach in case.stages:
        X_TS = library.align(
            model,
            points,
            X_TS,
            registration_type="GICP",
            max_correspondence_distance=reach,
            downsampling_resolution=case.surface.spacing,
            num_threads=1,
        ).T_target_source

    return inverse(X_TS)


def _clouds(case: SceneInput) -> tuple[Any, Any]:
    """Scan and model as Open3D point clouds with normals."""
    o3d = open3d_loader.load()
    clouds = []
    for thing in (case.evidence, case.surface):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(thing.points))
        cloud.normals = o3d.utility.Vector3dVector(thing.normals)
        clouds.append(cloud)
    return clouds[0], clouds[1]


def _open3d_stage(
    registration: Any, kind: str, clouds: tuple[Any, Any], reach: float, X_TS: Array
) -> Array:
    criteria = registration.ICPConvergenceCriteria(max_iteration=40)
    if kind == "generalised":
        found = registration.registration_generalized_icp(
            *clouds, reach, X_TS, registration.TransformationEstimationForGeneralizedICP(), criteria
        )
    else:
        estimation = {
            "point": registration.TransformationEstimationPointToPoint(),
            "plane": registration.TransformationEstimationPointToPlane(),
        }[kind]
        found = registration.registration_icp(*clouds, reach, X_TS, estimation, criteria)
    return np.array(found.transformation)


METHODS: dict[str, Method] = {
    "ours, whole": whole,
    "ours, search and fit": ours,
    "Open3D ICP, point to point": open3d_icp("point"),
    "Open3D ICP, point to plane": open3d_icp("plane"),
    "Open3D generalised ICP": open3d_icp("generalised"),
    "Open3D RANSAC on FPFH, then planes": fpfh,
}
if find_spec("small_gicp"):
    METHODS["small_gicp"] = small_gicp


@cache
def surface_of(name: str) -> ModelSurface:
    """Surface model of the object `name`."""
    return ModelSurface.of(target_of(name))


def input_of(scene: ObjectScene, surface: ModelSurface) -> SceneInput | None:
    """Input for the methods from a scene; None if the segmentation leaves no points."""
    found = identify(
        scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    if found.evidence is None:
        return None

    R = scene.orientation
    middle = found.evidence.points.mean(axis=0)

    return SceneInput(
        scene, surface, found.evidence, pose(R, middle - R @ surface.points.mean(axis=0))
    )


def fit_times(case: SceneInput, streams: Streams) -> dict[str, float]:
    """Processor time [s] of a fit alone from a close start on 10 000 scan points, ours and
    Open3D's.
    """
    evidence, scene = case.evidence, case.scene

    points = evidence.scan.points[evidence.mask]
    few = len(points) < FIT_POINTS
    points = points[streams["points"].choice(len(points), FIT_POINTS, replace=few)]

    dense = replace(
        evidence,
        points=points,
        normals=facing_normals(points),
        sigma=evidence.sensor.sigma(points[:, 2]),
        independent=np.ones(FIT_POINTS),
    )

    # The start lies FIT_START off the truth, in a random direction.
    turn, aside = (streams[name].normal(size=3) for name in ("turn axis", "shift direction"))
    X_near = scene.X_CT @ pose(exp_so3(FIT_START[1] * turn / np.linalg.norm(turn)))
    X_near[:3, 3] += FIT_START[0] * aside / np.linalg.norm(aside)

    near = SceneInput(scene, case.surface, dense, X_near)
    registration, clouds = open3d_loader.load().pipelines.registration, _clouds(near)
    fits: dict[str, Callable[[], Any]] = {"ours": lambda: fine_fit(dense, case.surface, X_near)}
    for kind in ("point", "plane", "generalised"):
        fits[f"Open3D, {kind}"] = lambda kind=kind: _open3d_stage(
            registration, kind, clouds, 0.05, inverse(X_near)
        )

    return {name: _timed(fit)[0] for name, fit in fits.items()}


def _timed(what: Callable[[], Any]) -> tuple[float, Any]:
    began = process_time()
    result = what()
    return process_time() - began, result


def run(case: RaceCase) -> Row:
    """Errors and times of all methods on one scene, and times of the fits alone; nothing where
    there are no points.
    """
    scene, surface = object_scene(case.object, case.seed, case.sensor), surface_of(case.object)
    given = input_of(scene, surface)
    if given is None:
        return {"methods": [], "fits": None}

    rows = []
    for method, find in METHODS.items():
        spent, X = _timed(lambda find=find: find(given))
        position, angle = scene.error(X)
        degrees = float(np.rad2deg(angle))

        rows.append(
            {
                "object": case.object,
                "seed": case.seed,
                "method": method,
                "found": scene.is_found(X),
                "position_m": position,
                "angle_deg": degrees,
                "process_s": spent,
            }
        )

    return {"methods": rows, "fits": fit_times(given, Streams(case.seed))}


def summarise(scenes: list[Row]) -> Summary:
    """Table by method and object, with the errors of found poses, and the times of a fit alone."""
    rows = [row for scene in scenes for row in scene["methods"]]
    fits = [scene["fits"] for scene in scenes if scene["fits"]]
    objects = dict.fromkeys(row["object"] for row in rows)
    base = np.median([row["process_s"] for row in rows if row["method"] == "ours, search and fit"])

    lines = []
    for method in METHODS:
        cells = []
        for name in objects:
            of = [row for row in rows if row["method"] == method and row["object"] == name]
            found = [1e3 * row["position_m"] for row in of if row["found"]]
            error = f"{np.median(found):.2f} mm" if found else "-"
            cells.append(f"{len(found)}/{len(of)}, {error}")

        spent = float(np.median([row["process_s"] for row in rows if row["method"] == method]))
        lines.append((method, *cells, f"{1e3 * spent:.0f}", f"{spent / base:.2f}"))

    alone = {name: float(np.median([fit[name] for fit in fits])) for name in fits[0]}
    times = ", ".join(f"{name} {1e3 * spent:.0f} ms" for name, spent in alone.items())

    return Summary(
        metrics={"rows": rows, "fit_alone_s": alone},
        tables=[
            Table(
                title="Poses found, their median error, and time",
                columns=("method", *objects, "time: median [ms]", "to ours"),
                rows=lines,
            )
        ],
        lines=[f"a fit alone of {FIT_POINTS} points, from 1 cm and 2 deg off, median: {times}"],
    )


def main() -> int:
    """Runs or resumes the benchmark and returns the exit code."""
    options = parse(Options)
    open3d_loader.load()

    cases = [
        RaceCase(name, options.seed + k, options.sensor)
        for name in options.objects
        for k in range(options.runs)
    ]

    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out(
        "bench_identification", options, "Identification against other libraries"
    )


if __name__ == "__main__":
    run_scenario(main)

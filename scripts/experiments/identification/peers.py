"""Object identification against Open3D and small_gicp, from the same points and start.

    # against Open3D
    ./uvw run --extra open3d scripts/experiments/identification/peers.py

    # against small_gicp too
    ./uvw run --extra open3d --with small_gicp scripts/experiments/identification/peers.py

All methods get the points that our segmentation assigns to the object, and the model sampled
evenly. They start from the coarse attitude with the centroids of both clouds aligned; RANSAC on
FPFH features needs no start. The peers match scan to whole model in three stages, whose
correspondence distance narrows from 20 cm to three spacings.

Times are processor times, the methods in turn, comparable with --workers 1 only. They exclude
segmentation, except for "ours, whole", which begins at the depth frame. A pose counts as found
within 1 % of the range and 5 deg, modulo declared symmetry.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from math import degrees, radians
from typing import Any

import numpy as np

from experiments.identification.registration_peers import (
    IcpKind,
    features,
    icp,
    point_cloud,
    ransac,
)
from experiments.identification.scene_cases import identified, surface_of, timed
from uuv.clouds.frames import SENSORS, ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.experiment import Page, column, experiment, stat
from uuv.models.meshes import open3d_loader
from uuv.perception.clouds.scan import facing_normals
from uuv.perception.registration.evidence import Evidence, score
from uuv.perception.registration.fine_fit import fine_fit
from uuv.perception.registration.initialiser import Expected, initial_poses
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, one_of, pose
from uuv.sim.interfaces.streams import Streams

FIT_POINTS = 10_000  # scan points of a fit that is timed alone
FIT_START = (0.01, radians(2.0))  # [m], [rad] offset from the truth, where a fit alone starts
FIT_REACH = 0.05  # [m] correspondence distance of Open3D's fits alone
Method = Callable[["SceneInput"], Array]


@dataclass(frozen=True, kw_only=True)
class PeerCase:
    """One scene for all methods."""

    object: str
    """Name of the object."""
    sensor: str = "stereo"
    """Name of the sensor."""
    seed: int

    def __post_init__(self) -> None:
        one_of(self.sensor, SENSORS, "--sensor")


@dataclass(frozen=True, kw_only=True)
class PeerRow:
    """Errors and times of all methods, and times of the fits alone; None where segmentation leaves
    no points.
    """

    found: Mapping[str, bool] | None = column("found", by="method", default=None)
    position: Mapping[str, float] | None = column(
        "position", "mm", digits=2, factor=1e3, by="method", default=None
    )
    angle: Mapping[str, float] | None = column(
        "angle", "deg", digits=2, factor=degrees(1.0), by="method", default=None
    )
    time: Mapping[str, float] | None = column(
        "time", "ms", digits=0, factor=1e3, tolerance=None, by="method", default=None
    )
    fit_time: Mapping[str, float] | None = column(
        "time", "ms", digits=0, factor=1e3, tolerance=None, by="fit", default=None
    )


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
        return 0.2, 0.05, 3.0 * self.surface.spacing

    @property
    def clouds(self) -> tuple[Any, Any]:
        """Scan and model as Open3D point clouds with normals."""
        return (
            point_cloud(self.evidence.points, self.evidence.normals),
            point_cloud(self.surface.points, self.surface.normals),
        )


def whole(case: SceneInput) -> Array:
    """Our identification from the depth frame on; X_ST (4, 4)."""
    return identified(case.scene, case.surface).X_sensor_target


def ours(case: SceneInput) -> Array:
    """Our search and fit on the segmented points; X_ST (4, 4)."""
    scene, evidence = case.scene, case.evidence

    expected = Expected(p=scene.approach, error=0.45, R=scene.orientation)
    starts = initial_poses(evidence.scan, evidence.mask, case.surface, evidence.sensor, expected)
    best = max(starts, key=lambda X: score(evidence, case.surface, X), default=case.X_start)

    return fine_fit(evidence, case.surface, best).X_ST


def open3d_icp(case: SceneInput, kind: IcpKind) -> Array:
    """Open3D's ICP in three stages; X_ST (4, 4)."""
    result = icp(*case.clouds, case.stages, inverse(case.X_start), kind)
    return inverse(np.array(result.transformation))


def fpfh(case: SceneInput) -> Array:
    """Open3D's RANSAC on FPFH features, refined by point-to-plane ICP; X_ST (4, 4)."""
    edge = 2.0 * case.surface.spacing
    of_scan, of_model = (features(cloud, edge) for cloud in case.clouds)
    rough = ransac(of_scan, of_model, 1.5 * edge, case.scene.seed)

    result = icp(*case.clouds, case.stages[-1:], rough)
    return inverse(np.array(result.transformation))


def small_gicp(case: SceneInput) -> Array:
    """Generalised ICP of small_gicp in three stages; X_ST (4, 4)."""
    library = import_module("small_gicp")
    X_TS = inverse(case.X_start)

    for reach in case.stages:
        X_TS = library.align(
            case.surface.points,
            case.evidence.points,
            X_TS,
            registration_type="GICP",
            max_correspondence_distance=reach,
            downsampling_resolution=case.surface.spacing,
            num_threads=1,
        ).T_target_source

    return inverse(X_TS)


METHODS: dict[str, Method] = {
    "ours, whole": whole,
    "ours, search and fit": ours,
    "Open3D ICP, point to point": partial(open3d_icp, kind="point"),
    "Open3D ICP, point to plane": partial(open3d_icp, kind="plane"),
    "Open3D generalised ICP": partial(open3d_icp, kind="generalised"),
    "Open3D RANSAC on FPFH, then planes": fpfh,
}
if find_spec("small_gicp"):
    METHODS["small_gicp"] = small_gicp


@experiment(
    "peers",
    seeds=10,
    vary={"object": ("barrel", "manifold", "rock", "starfish", "valve")},
    paired=True,
    quick={"runs": 1, "object": ("manifold", "starfish")},
)
def peers(case: PeerCase) -> PeerRow:
    """Runs all methods on one scene, and the fits alone."""
    open3d_loader.load()  # so that no time is that of its import
    scene, surface = object_scene(case.object, case.seed, case.sensor), surface_of(case.object)
    task = input_of(scene, surface)
    if task is None:
        return PeerRow()

    # the methods in turn, then their errors
    timings = {name: timed(partial(method, task)) for name, method in METHODS.items()}
    poses = {name: X for name, (_, X) in timings.items()}
    errors = {name: scene.error(X) for name, X in poses.items()}

    return PeerRow(
        found={name: scene.is_found(X) for name, X in poses.items()},
        position={name: position for name, (position, _) in errors.items()},
        angle={name: angle for name, (_, angle) in errors.items()},
        time={name: time for name, (time, _) in timings.items()},
        fit_time=fit_times(task, Streams(case.seed)),
    )


def input_of(scene: ObjectScene, surface: ModelSurface) -> SceneInput | None:
    """Input for the methods from a scene; None if the segmentation leaves no points."""
    evidence = identified(scene, surface).evidence
    if evidence is None:
        return None

    R = scene.orientation
    middle = evidence.points.mean(axis=0)
    return SceneInput(scene, surface, evidence, pose(R, middle - R @ surface.points.mean(axis=0)))


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

    clouds = replace(case, evidence=dense).clouds
    kinds: tuple[IcpKind, ...] = ("point", "plane", "generalised")
    fits: dict[str, Callable[[], Any]] = {"ours": lambda: fine_fit(dense, case.surface, X_near)}
    for kind in kinds:
        fits[f"Open3D, {kind}"] = partial(icp, *clouds, (FIT_REACH,), inverse(X_near), kind)
    return {name: timed(fit)[0] for name, fit in fits.items()}


ERROR = stat(
    "median",
    lambda row: 1e3 * row["position"] if row["found"] else None,
    "error of those found, median",
    unit="mm",
    digits=2,
)
peers.page = (
    Page()
    .table(
        "Poses found, their error, and time",
        by="method",
        columns=[stat("share", "found"), ERROR, stat("median", "time")],
    )
    .table("Poses found, by object", by="method", across="object", columns=[stat("count", "found")])
    .table("Error of those found, median [mm]", by="method", across="object", columns=[ERROR])
    .table(
        f"A fit alone of {FIT_POINTS} points, from 1 cm and 2 deg off",
        by="fit",
        columns=[stat("median", "fit_time")],
    )
)

if __name__ == "__main__":
    run_scenario(peers.main)

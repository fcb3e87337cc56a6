"""Processor time from a sonar cloud to the path on the seabed by size of the cloud, beside other
triangulations.

The clouds cover 4 x 4 m of rippled ground with 5 mm of noise and 3 % of false echoes. The error is
vertical, at 2000 drawn places; missed are those where a triangulation has a hole.
"""

from uuv.start import run_scenario  # isort: skip

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuv.experiment import Page, Row, column, experiment
from uuv.experiment.options import at_least
from uuv.models.meshes import open3d_loader
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.site.seabed import Seabed, seabed
from uuv.perception.seabed.terrain import build_terrain
from uuv.perception.seabed.terrain_path import plan_seabed_work
from uuv.sim.interfaces.errors import MissingLibraryError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams

FALSE = 0.03  # share of false echoes in the clouds
SIZES = (5_000, 20_000, 50_000, 100_000, 200_000, 400_000)  # points
LARGEST = 20_000  # points, up to which the others are run
OURS = "ours"
B = np.array([[-0.4, -0.2, 2.0], [0.4, 0.2, 2.0]])  # [m] points above the path


@dataclass(frozen=True, kw_only=True)
class GroundCloud:
    """A cloud of one size."""

    points: int
    """Points of the cloud."""
    seed: int = 0
    """Seed of ground, cloud and places."""

    def __post_init__(self) -> None:
        at_least(self, points=100)


@dataclass(frozen=True, kw_only=True)
class GroundCloudRow:
    """Times, and the errors of each triangulation."""

    path_time: float = column("cloud to path", "s", digits=3, tolerance=None)
    time: Mapping[str, float | None] = column(
        "triangulated in", "s", digits=2, by="triangulation", tolerance=None
    )
    error: Mapping[str, float] = column(
        "error, 95 %", "mm", digits=1, factor=1e3, by="triangulation"
    )
    missed: Mapping[str, float] = column("missed", "%", digits=1, factor=100.0, by="triangulation")
    lacking: str = column("library that is lacking", tolerance=None)


@experiment("seabed_speed", vary={"points": SIZES}, quick={"points": SIZES[:2]})
def seabed_speed(case: GroundCloud) -> GroundCloudRow:
    """Plans the path on one cloud, and triangulates it in other ways."""
    streams = Streams(case.seed)
    ground = seabed("ripples", streams["ground"])
    plan_seabed_work(_scatter(ground, SIZES[0], streams["first cloud"]), B)  # loads compiled code

    cloud = _scatter(ground, case.points, streams[f"cloud of {case.points}"])
    path_time = min(_timed(lambda: plan_seabed_work(cloud, B))[0] for _ in range(3))
    level = streams[f"places under {case.points}"].uniform(-1.5, 1.5, (2_000, 2))
    at = np.column_stack([level, np.full(2_000, 2.0)])

    # Ours, then the others.
    errors_of = {OURS: _errors(build_terrain(cloud).scene, at - cloud.mean(axis=0), ground, at)}
    times: dict[str, float | None] = {OURS: None}  # it is a part of the path's
    lacking = ""
    try:
        others = _others(cloud) if case.points <= LARGEST else {}
    except MissingLibraryError as error:
        others = {}
        lacking = str(error)
    for name, triangulate in others.items():
        times[name], mesh = _timed(triangulate)
        scene = RayScene(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
        errors_of[name] = _errors(scene, at, ground, at)

    return GroundCloudRow(
        path_time=path_time,
        time=times,
        error={name: error for name, (error, _) in errors_of.items()},
        missed={name: missed for name, (_, missed) in errors_of.items()},
        lacking=lacking,
    )


def _scatter(ground: Seabed, points: int, rng: np.random.Generator) -> Array:
    """Points of uniform density over 4 x 4 m, with 5 mm of noise and false echoes."""
    xy = rng.uniform(-2.0, 2.0, (points, 2))
    z = ground.height(xy) + rng.normal(0.0, 0.005, points)
    wild = rng.random(points) < FALSE
    z[wild] += rng.uniform(-0.6, 0.3, wild.sum())
    return np.column_stack([xy, z])


def _timed(work: Callable[[], Any]) -> tuple[float, Any]:
    began = time.process_time()
    outcome = work()
    return time.process_time() - began, outcome


def _errors(scene: Any, starts: Array, ground: Seabed, at: Array) -> tuple[float, float]:
    """95 % quantile of the vertical error [m] at places `at`, and the share of rays that miss."""
    t = scene.cast(starts, np.broadcast_to([0.0, 0.0, -1.0], starts.shape))["t"]
    hit = np.isfinite(t)
    error = np.abs(at[hit, 2] - t[hit] - ground.height(at[hit]))
    return float(np.quantile(error, 0.95)), float(1.0 - hit.mean())


def _others(cloud: Array) -> dict[str, Callable[[], Any]]:
    """Other triangulations of a cloud (N, 3) [m], which take a clean one with normals.

    Raises:
        MissingLibraryError: Open3D is not there.
    """
    o3d = open3d_loader.load()
    shape = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))

    def clean() -> Any:
        sound, _ = shape.remove_statistical_outlier(nb_neighbors=24, std_ratio=1.0)
        sound.estimate_normals()
        sound.orient_normals_to_align_with_direction(np.array([0.0, 0.0, 1.0]))
        return sound

    def ball_pivoting() -> Any:
        sound = clean()
        gap = float(np.mean(sound.compute_nearest_neighbor_distance()))
        radii = o3d.utility.DoubleVector([1.5 * gap, 3.0 * gap, 6.0 * gap])
        return o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(sound, radii)

    def poisson() -> Any:
        create = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson
        return create(clean(), depth=8, n_threads=1)[0]

    return {"ball pivoting": ball_pivoting, "Poisson": poisson}


def lacking(rows: list[Row]) -> list[str]:
    """A line if the other triangulations are not there."""
    return sorted({f"no other triangulations: {row['lacking']}" for row in rows if row["lacking"]})


seabed_speed.page = (
    Page()
    .table("Time from the cloud to the path", by="points", columns=["path_time"])
    .table(
        "Triangulations of the cloud",
        by=("points", "triangulation"),
        columns=["time", "error", "missed"],
    )
    .add(lacking)
)

if __name__ == "__main__":
    run_scenario(seabed_speed.main)

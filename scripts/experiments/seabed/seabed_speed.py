"""Processor time from a sonar cloud to the path on the seabed by size of the cloud, beside other
triangulations.
"""

import time
from typing import Any

import numpy as np

from uuv.experiment import Row, Summary, Table
from uuv.models.meshes import open3d_loader
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.site.seabed import Seabed, seabed
from uuv.perception.seabed.terrain import build_terrain
from uuv.perception.seabed.terrain_path import plan_seabed_work
from uuv.sim.interfaces.errors import MissingLibraryError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams

FALSE = 0.03  # share of false echoes in the clouds


def run(seed: int) -> Row:
    """Times and errors for each size of the cloud, the points drawn from `seed`."""
    try:
        o3d, said = open3d_loader.load(), ""
    except MissingLibraryError as error:
        o3d = None
        said = f"no other ways to triangulate: {error}"
    rows: list[Row] = []
    streams = Streams(seed)
    ground = seabed("ripples", streams["ground"])
    B = np.array([[-0.4, -0.2, 2.0], [0.4, 0.2, 2.0]])
    plan_seabed_work(_scatter(ground, 5_000, streams["first cloud"]), B)  # loads all compiled code
    for points in (5_000, 20_000, 50_000, 100_000, 200_000, 400_000):
        cloud = _scatter(ground, points, streams[f"cloud of {points}"])
        ours = min(_timed(lambda cloud=cloud: plan_seabed_work(cloud, B))[0] for _ in range(3))
        row: Row = {"points": points, "cloud_to_path_s": ours}
        level = streams[f"places under {points}"].uniform(-1.5, 1.5, (2_000, 2))
        at = np.column_stack([level, np.full(2_000, 2.0)])
        row["ours_mm"], row["ours_missed"] = _off(
            build_terrain(cloud).scene, at - cloud.mean(axis=0), ground, at
        )
        if o3d and points <= 20_000:
            shape = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
            for name, make in (("ball_pivoting", _pivot), ("poisson", _poisson)):
                seconds, mesh = _timed(lambda make=make, shape=shape: make(o3d, shape))
                scene = RayScene(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
                row[f"{name}_s"] = seconds
                row[f"{name}_mm"], row[f"{name}_missed"] = _off(scene, at, ground, at)
        rows.append(row)
    return {"said": said, "rows": rows}


def summarise(runs: list[Row]) -> Summary:
    """Table over the size of the cloud."""
    (run,) = runs
    cells = [
        (
            str(row["points"]),
            f"{row['cloud_to_path_s']:.3f}",
            *(
                f"{row[f'{name}_s']:.2f}, {row[f'{name}_mm']:.1f}, {row[f'{name}_missed']:.1%} "
                "missed"
                if f"{name}_s" in row
                else "-"
                for name in ("ball_pivoting", "poisson")
            ),
            f"{row['ours_mm']:.1f}, {row['ours_missed']:.1%} missed",
        )
        for row in run["rows"]
    ]
    table = Table(
        title="Time from the cloud to the path",
        columns=(
            "points",
            "cloud to path, s",
            "ball pivoting: s, mm off",
            "Poisson: s, mm off",
            "ours: mm off",
        ),
        rows=cells,
    )
    return Summary(
        metrics={"rows": run["rows"]}, tables=[table], lines=[run["said"]] if run["said"] else []
    )


def _scatter(ground: Seabed, points: int, rng: np.random.Generator) -> Array:
    """Points of uniform density over 4 x 4 m, with 5 mm of noise and false echoes."""
    xy = rng.uniform(-2.0, 2.0, (points, 2))
    z = ground.height(xy) + rng.normal(0.0, 0.005, points)
    wild = rng.random(points) < FALSE
    z[wild] += rng.uniform(-0.6, 0.3, wild.sum())
    return np.column_stack([xy, z])


def _timed(work: Any) -> tuple[float, Any]:
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def _off(scene: Any, starts: Array, ground: Seabed, at: Array) -> tuple[float, float]:
    """95 % quantile of the vertical error [mm] at places `at`, and the share of rays without a
    hit.
    """
    t = scene.cast(starts, np.broadcast_to([0.0, 0.0, -1.0], starts.shape))["t"]
    hit = np.isfinite(t)
    off = np.abs(at[hit, 2] - t[hit] - ground.height(at[hit]))
    return 1e3 * float(np.quantile(off, 0.95)), float(1.0 - hit.mean())


def _pivot(o3d: Any, cloud: Any) -> Any:
    clean = _clean(cloud)
    gap = float(np.mean(clean.compute_nearest_neighbor_distance()))
    radii = o3d.utility.DoubleVector([1.5 * gap, 3.0 * gap, 6.0 * gap])
    return o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(clean, radii)


def _poisson(o3d: Any, cloud: Any) -> Any:
    return o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        _clean(cloud), depth=8, n_threads=1
    )[0]


def _clean(cloud: Any) -> Any:
    """Removes statistical outliers and adds normals upwards, which both triangulations need."""
    clean, _ = cloud.remove_statistical_outlier(nb_neighbors=24, std_ratio=1.0)
    clean.estimate_normals()
    clean.orient_normals_to_align_with_direction(np.array([0.0, 0.0, 1.0]))
    return clean

"""Models given as point clouds, over random scenes: how far the pose lies from that of the mesh on
the same scan.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import trimesh

from experiments.identification.pose_errors import Start, surface_of
from uuv.clouds.frames import ObjectScene
from uuv.clouds.object_scenes import object_scene, target_of
from uuv.experiment import Row, Summary, Table
from uuv.models.objects.targets import TargetModel
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, transform_points


@dataclass(frozen=True)
class CloudCase:
    """One scene for one sensor, and the size of the clouds; a case of the study."""

    name: str
    points: tuple[int, ...]  # of each cloud
    sensor: str
    seed: int
    start: Start


def sampled_cloud(target: TargetModel, count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points (n, 3) [m] drawn evenly from the mesh of `target`, and outward normals (n, 3)."""
    mesh = trimesh.Trimesh(target.vertices, target.triangles, process=False)
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)[:2]
    return np.asarray(points), np.asarray(mesh.face_normals)[faces]


@cache
def cloud_surface(name: str, count: int, with_normals: bool) -> ModelSurface:
    """The object `name` given as a cloud of `count` points."""
    points, normals = sampled_cloud(target_of(name), count)
    return ModelSurface.of(TargetModel.from_cloud(points, normals if with_normals else None, name))


def run(task: CloudCase) -> dict[str, Any]:
    """Row of one scene: the pose by the mesh, and by each cloud."""
    start = task.start
    start_error = (start.error[0], float(np.deg2rad(start.error[1])))
    scene = object_scene(
        task.name,
        task.seed,
        task.sensor,
        ranges=start.ranges,
        start_error=start_error,
        gap=start.gap,
    )

    def found_by(surface: ModelSurface) -> Identification:
        return identify(
            scene.scan,
            surface,
            scene.approach if start.known != "any" else None,
            scene.orientation if start.known == "coarse" else None,
            sensor=scene.sensor.model,
        )

    by_mesh = found_by(surface_of(task.name))

    clouds = []
    for count in task.points:
        for with_normals in (True, False):
            found = found_by(cloud_surface(task.name, count, with_normals))
            off, angle = _between(scene, found.X_sensor_target, by_mesh.X_sensor_target)
            said = {
                "off_m": off,
                "angle_deg": angle,
                "accepted": bool(found.accepted),
                "reason": found.reason,
            }
            clouds.append({"points": count, "normals": with_normals, **said})

    return {
        "object": task.name,
        "sensor": task.sensor,
        "seed": task.seed,
        "mesh_m": scene.error(by_mesh.X_sensor_target)[0],
        "mesh_accepted": bool(by_mesh.accepted),
        "clouds": clouds,
    }


def _between(scene: ObjectScene, A: Array, B: Array) -> tuple[float, float]:
    """Distance [m] of the object's centres at two poses (4, 4), and angle [deg] modulo symmetry."""
    symmetry, center = scene.target.symmetry, scene.target.center

    A = symmetry.nearest_pose(A, B[:3, :3])
    off = float(np.linalg.norm(transform_points(A, center) - transform_points(B, center)))
    return off, float(np.rad2deg(symmetry.error(A, B)[1]))


def line(row: Row) -> str:
    """Line about a scene in which a cloud gave another pose than the mesh; empty for others."""
    far = [
        f"{each['points']} points {'with' if each['normals'] else 'without'} normals "
        f"{1e3 * each['off_m']:.1f} mm"
        for each in row["clouds"]
        if each["off_m"] > 1e-3
    ]
    return f"{row['object']}, {row['sensor']}, seed {row['seed']}: {', '.join(far)}" if far else ""


def summarise(rows: list[Row], title: str) -> Summary:
    """Figures by object and cloud.

    Args:
        rows: Rows of all scenes.
        title: Title of the table.
    """
    figures: dict[str, dict[str, float]] = {}
    for name in sorted({row["object"] for row in rows}):
        of_object = [row for row in rows if row["object"] == name]
        for k, first in enumerate(of_object[0]["clouds"]):
            clouds = [row["clouds"][k] for row in of_object]
            off = 1e3 * np.array([each["off_m"] for each in clouds])
            figures[f"{name}, {first['points']}, {'with' if first['normals'] else 'without'}"] = {
                "scenes": len(clouds),
                "median_mm": float(np.median(off)),
                "largest_mm": float(off.max()),
                "within_1_mm_percent": 100.0 * float(np.mean(off < 1.0)),
                "median_deg": float(np.median([each["angle_deg"] for each in clouds])),
                "accepted_percent": 100.0 * float(np.mean([each["accepted"] for each in clouds])),
                "mesh_accepted_percent": 100.0
                * float(np.mean([row["mesh_accepted"] for row in of_object])),
            }

    columns = (
        "object, points, normals",
        "scenes",
        "from the mesh's pose: median, largest [mm]",
        "within 1 mm [%]",
        "angle, median [deg]",
        "accepted, by the mesh [%]",
    )

    table = [
        (
            name,
            f"{f['scenes']:.0f}",
            f"{f['median_mm']:.2f}, {f['largest_mm']:.2f}",
            f"{f['within_1_mm_percent']:.0f}",
            f"{f['median_deg']:.2f}",
            f"{f['accepted_percent']:.0f}, {f['mesh_accepted_percent']:.0f}",
        )
        for name, f in figures.items()
    ]

    return Summary(
        metrics={"figures": figures},
        tables=[Table(title=title, columns=columns, rows=table)],
        pictures=[],
    )

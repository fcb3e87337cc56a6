"""Models given as point clouds, over random scenes: how far the pose lies from that by the mesh.

Both are found in the same scan. The clouds are drawn evenly from the mesh, and given with and
without normals.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product
from math import degrees

import numpy as np
import trimesh

from experiments.identification.scene_cases import SceneCase, conditions, identified, surface_of
from uuv.clouds.frames import SENSORS, ObjectScene
from uuv.clouds.scene_kinds import object_of
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.objects import targets
from uuv.models.objects.targets import TargetModel
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, transform_points

NORMALS = {"with": True, "without": False}


@dataclass(frozen=True, kw_only=True)
class CloudCase(SceneCase):
    """One scene for one sensor, and the size of the clouds."""

    points: tuple[int, ...] = (20_000, 5_000)
    """Numbers of points of the clouds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for count in self.points:
            if count < 1:
                raise ConfigurationError(f"--points: must be at least 1, got {count}")


@dataclass(frozen=True, kw_only=True)
class CloudRow:
    """The pose by each cloud beside that by the mesh."""

    mesh_position: float = column("position by the mesh", "mm", digits=2, factor=1e3)
    mesh_accepted: bool = column("accepted by the mesh")
    off: Mapping[str, float] = column(
        "from the mesh's pose", "mm", digits=2, factor=1e3, by="cloud"
    )
    angle: Mapping[str, float] = column("angle", "deg", digits=2, factor=degrees(1.0), by="cloud")
    accepted: Mapping[str, bool] = column("accepted", by="cloud")
    reason: Mapping[str, str] = column("reason", by="cloud")


def sampled_cloud(target: TargetModel, count: int, seed: int = 0) -> tuple[Array, Array]:
    """Points (n, 3) [m] drawn evenly from the mesh of `target`, and outward normals (n, 3)."""
    mesh = trimesh.Trimesh(target.vertices, target.triangles, process=False)
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)[:2]
    return np.asarray(points), np.asarray(mesh.face_normals)[faces]


@cache
def cloud_surface(name: str, count: int, with_normals: bool) -> ModelSurface:
    """The object `name` given as a cloud of `count` points."""
    points, normals = sampled_cloud(object_of(name), count)
    return ModelSurface.of(TargetModel.from_cloud(points, normals if with_normals else None, name))


@experiment(
    "cloud_models",
    seeds=2,
    vary={"object": targets.available(), "sensor": tuple(SENSORS)},
    paired=True,
    quick={"runs": 1, "object": ("manifold", "valve"), "sensor": ("stereo",)},
)
def cloud_models(case: CloudCase) -> CloudRow:
    """Identifies the object of a scene by its mesh, and by each cloud."""
    scene = case.scene()
    by_mesh = identified(scene, surface_of(case.object), case.start)

    verdicts = {
        f"{count} points {words} normals": identified(
            scene, cloud_surface(case.object, count, with_normals), case.start
        )
        for count, (words, with_normals) in product(case.points, NORMALS.items())
    }
    errors = {
        cloud: _between(scene, verdict.X_sensor_target, by_mesh.X_sensor_target)
        for cloud, verdict in verdicts.items()
    }

    return CloudRow(
        mesh_position=scene.error(by_mesh.X_sensor_target)[0],
        mesh_accepted=bool(by_mesh.accepted),
        off={cloud: off for cloud, (off, _) in errors.items()},
        angle={cloud: angle for cloud, (_, angle) in errors.items()},
        accepted={cloud: bool(verdict.accepted) for cloud, verdict in verdicts.items()},
        reason={cloud: verdict.reason for cloud, verdict in verdicts.items()},
    )


def _between(scene: ObjectScene, X_CT: Array, X_CM: Array) -> tuple[float, float]:
    """Distance [m] of the object's centres at two poses (4, 4), and angle [rad] modulo symmetry.

    Args:
        scene: The scene.
        X_CT: (4, 4) a pose.
        X_CM: (4, 4) the pose by the mesh.
    """
    symmetry, center = scene.target.symmetry, scene.target.center
    X = symmetry.nearest_pose(X_CT, X_CM[:3, :3])
    off = float(np.linalg.norm(transform_points(X, center) - transform_points(X_CM, center)))
    return off, symmetry.error(X, X_CM)[1]


def line(row: Row) -> str:
    """Line about a scene in which a cloud gave another pose than the mesh; empty for others."""
    far = [f"{cloud} {1e3 * off:.1f} mm" for cloud, off in row["off"].items() if off > 1e-3]
    return f"{row['object']}, {row['sensor']}, seed {row['seed']}: {', '.join(far)}" if far else ""


FIGURES = [
    stat("median", "off"),
    stat("largest", "off"),
    stat("share", lambda row: row["off"] < 1e-3, "within 1 mm", digits=0),
    stat("median", "angle"),
    stat("share", "accepted", digits=0),
    stat("share", "mesh_accepted", digits=0),
]
cloud_models.line = line
cloud_models.page = (
    Page()
    .add(conditions)
    .table("Poses by point clouds, beside that by the mesh", by="cloud", columns=FIGURES)
    .table("By object", by=("object", "cloud"), columns=FIGURES)
)

if __name__ == "__main__":
    run_scenario(cloud_models.main)

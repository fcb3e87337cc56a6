"""Water of a UR5 and a Panda from the meshes of their URDF, beside the volumes of trimesh.

The robots are of the package example-robot-data:

    ./uvw run --with example-robot-data scripts/experiments/water/robot_geometry.py

trimesh adds the volumes of a body's meshes without uniting them; "closed" is the number of them
that are watertight.
"""

from uuv.start import run_scenario  # isort: skip

import importlib.metadata
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from uuv.experiment import Page, column, experiment, stat
from uuv.models.water_from_geometry.files import read_model
from uuv.models.water_from_geometry.geoms import geoms_of, moving_bodies
from uuv.models.water_from_geometry.wetting import wet
from uuv.sim.interfaces.errors import ConfigurationError

PACKAGE = "example-robot-data"
# files of the package
ROBOTS = {"UR5": "ur_description/urdf/ur5_robot.urdf", "Panda": "panda_description/urdf/panda.urdf"}


@dataclass(frozen=True, kw_only=True)
class RobotCase:
    """One robot."""

    robot: str
    """Name of the robot."""


@dataclass(frozen=True, kw_only=True)
class RobotRow:
    """Water of its bodies; None for what trimesh has of a body without meshes."""

    volume: Mapping[str, float] = column("volume", "l", digits=3, factor=1e3, by="body")
    mesh_volume: Mapping[str, float | None] = column(
        "by trimesh", "l", digits=3, factor=1e3, by="body"
    )
    closed: Mapping[str, str | None] = column("closed", by="body")
    added_mass: Mapping[str, Sequence[float]] = column("added mass x, y, z", "kg", by="body")
    drag: Mapping[str, str] = column("drag of", by="body")
    uncertainty: Mapping[str, str] = column("uncertainty", by="body")
    seconds: float = column("time", "s", digits=0, tolerance=None)


@experiment("robot_geometry", vary={"robot": tuple(ROBOTS)}, quick={"robot": ("UR5",)})
def robot_geometry(case: RobotCase) -> RobotRow:
    """Reads and wets a robot."""
    begun = time.perf_counter()
    spec, _ = read_model(file_of(case.robot))
    wetted = wet(spec)
    seconds = time.perf_counter() - begun

    meshes = _mesh_volumes(spec)
    bodies = wetted.bodies
    uncertainties = {
        (origin.body, origin.quantity): origin.uncertainty for origin in wetted.origins
    }
    return RobotRow(
        volume={name: float(water.volume) for name, water in bodies.items()},
        mesh_volume={name: meshes.get(name, (None, None))[0] for name in bodies},
        closed={name: meshes.get(name, (None, None))[1] for name in bodies},
        added_mass={
            name: water.added_mass.diagonal()[:3].tolist() for name, water in bodies.items()
        },
        drag={name: "strip" if water.segments else "areas" for name, water in bodies.items()},
        uncertainty={
            name: "; ".join(uncertainties[name, what] for what in ("volume", "added mass", "drag"))
            for name in bodies
        },
        seconds=seconds,
    )


def file_of(robot: str) -> Path:
    """File of a robot of the package.

    Raises:
        ConfigurationError: The package is not installed, or has no such file.
    """
    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        raise ConfigurationError(f"needs the package {PACKAGE}: uv run --with {PACKAGE}") from None

    for file in files:
        if str(file).endswith(ROBOTS[robot]):
            return Path(str(file.locate()))
    raise ConfigurationError(f"package {PACKAGE}: has no file {ROBOTS[robot]}")


def _mesh_volumes(spec: mujoco.MjSpec) -> dict[str, tuple[float, str]]:
    """Sum of a body's mesh volumes by trimesh, without union, and how many meshes are closed."""
    import trimesh

    model = spec.copy().compile()
    volumes = {}
    for body in moving_bodies(model):
        meshes = []
        for g in geoms_of(model, body, "auto")[0]:
            if (at := int(model.geom_dataid[g])) < 0:
                continue
            v, f = int(model.mesh_vertadr[at]), int(model.mesh_faceadr[at])
            vertices = model.mesh_vert[v : v + model.mesh_vertnum[at]]
            faces = model.mesh_face[f : f + model.mesh_facenum[at]]
            meshes.append(trimesh.Trimesh(vertices, faces))

        if meshes:
            closed = sum(bool(mesh.is_watertight) for mesh in meshes)
            volume = sum(float(mesh.volume) for mesh in meshes)
            volumes[model.body(body).name] = (volume, f"{closed} of {len(meshes)}")
    return volumes


robot_geometry.page = (
    Page()
    .table(
        "Robots",
        by="robot",
        columns=[
            stat("value", lambda row: len(row["volume"]), "bodies"),
            stat(
                "value",
                lambda row: sum(row["volume"].values()),
                "volume",
                unit="l",
                digits=2,
                factor=1e3,
            ),
            "seconds",
        ],
    )
    .table(
        "Water of their bodies",
        by=("robot", "body"),
        columns=["volume", "mesh_volume", "closed", "added_mass", "drag", "uncertainty"],
    )
)

if __name__ == "__main__":
    run_scenario(robot_geometry.main)

"""Meshes of a vehicle's links in its spec, read by MuJoCo or by this project's reader."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from uuv.models.files.urdf_joints import listed
from uuv.models.meshes.mesh_files import read_mesh
from uuv.sim.interfaces.errors import MissingLibraryError
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation

MESHES = (".stl", ".obj", ".msh")  # endings of the mesh files that MuJoCo reads
# endings of the other files that `read_mesh` reads
OTHERS = (".dae", ".ply", ".gltf", ".glb", ".off")
_SEEN = 1  # group of geoms that are only visual, as in MuJoCo's reader of URDF


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkMesh:
    """A mesh on a link."""

    link: str
    file: Path
    X_LG: Array  # (4, 4) frame of the mesh in the link's
    scale: tuple[float, float, float]
    collides: bool  # False: it is only visual
    weighs: bool  # True: the mass of the link is that of its shapes, filled with water


def add_meshes(spec: mujoco.MjSpec, meshes: list[LinkMesh]) -> list[str]:
    """Add meshes to their links; returns a line about meshes whose reader is not installed.

    Raises:
        ConfigurationError: a file cannot be read as a mesh.
    """
    without: list[str] = []
    reason = ""

    for mesh in meshes:
        try:
            _add_mesh(spec, mesh)
        except MissingLibraryError as error:
            without.append(mesh.file.name)
            reason = str(error)

    return [f"meshes left out, {listed(without)}: {reason}"] if without else []


def _add_mesh(spec: mujoco.MjSpec, mesh: LinkMesh) -> None:
    """Add a mesh as a geom of its link, with the density of water, or without mass if it is only
    visual.

    Raises:
        ConfigurationError: the file cannot be read as a mesh.
        MissingLibraryError: the package that reads it is not installed.
    """
    in_mujoco = mesh.file.suffix.lower() in MESHES
    vertices, triangles = (None, None) if in_mujoco else read_mesh(mesh.file, "mesh")
    name = _unused(spec, mesh.file.stem)
    asset = spec.add_mesh(name=name, scale=list(mesh.scale))
    if not mesh.weighs:  # a visual mesh may be open, since its volume does not matter
        asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL

    if in_mujoco:
        asset.file = str(mesh.file)
    else:
        asset.uservert = np.asarray(vertices, dtype=np.float32).ravel()
        asset.userface = np.asarray(triangles, dtype=np.int32).ravel()

    geom = spec.body(mesh.link).add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=mesh.X_LG[:3, 3],
        quat=quat_wxyz_from_rotation(mesh.X_LG[:3, :3]),
    )

    if not mesh.collides:
        geom.contype = geom.conaffinity = 0
        geom.group = _SEEN
        geom.density = 0.0


def _unused(spec: mujoco.MjSpec, name: str) -> str:
    """A name that no mesh of the spec has yet."""
    taken = {mesh.name for mesh in spec.meshes}
    numbers = (f"{name}_{k}" for k in range(len(taken) + 1))
    return name if name not in taken else next(other for other in numbers if other not in taken)

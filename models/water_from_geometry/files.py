"""Reading of models that are to get hydrodynamics (URDF, MJCF, one mesh), and writing of the
resulting MJCF.

    spec, notes = read_model("arm.urdf")
    write_model(wet(spec), "arm.wet.xml")

The function `wet` is in `uuv.models.water_from_geometry.wetting`.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

from uuv.models import hydrodynamics
from uuv.models.files import sidecar
from uuv.models.files.holding import hold, massless
from uuv.models.files.mesh_shapes import MESHES
from uuv.models.files.mjcf_files import read_mjcf
from uuv.models.files.urdf import is_urdf, parse
from uuv.models.files.urdf_vehicle import spec_of_urdf
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import finite_number, shown

if TYPE_CHECKING:
    from uuv.models.water_from_geometry.wetting import Wetted

_DIRECTIVES = {"discardvisual": "false", "strippath": "false", "fusestatic": "false"}


def read_model(
    file: str | os.PathLike[str],
    *,
    free: bool = False,
    scale: float | None = None,
    visual: bool = True,
) -> tuple[mujoco.MjSpec, list[str]]:
    """Read a model, whatever its format.

    Args:
        file: URDF, MJCF, or a mesh (STL, OBJ, MSH), which becomes one floating body of the water's
            density.
        free: True: a URDF's root link floats; False: it is fixed to the world, as MuJoCo reads it.
        scale: [m] of a mesh file's unit: 0.001 for millimetres. URDF and MJCF state it themselves.
        visual: True: the visual meshes of a URDF are needed; False: visual meshes that cannot be
            read are left out.

    Returns:
        The spec, and notes on what was left out.

    Raises:
        ConfigurationError: the file cannot be read, MuJoCo does not accept it, or its meshes are
            missing.
    """
    path = existing_file(file, "model")
    is_mesh = path.suffix.lower() in MESHES
    of_urdf = not is_mesh and is_urdf(path, "model")
    if free and not of_urdf:
        reason = "a mesh always floats" if is_mesh else "write <freejoint/> into the root body"
        raise ConfigurationError(f"free: for a URDF only; {shown(path.name)}: {reason}")

    if is_mesh:
        return _of_mesh(
            path, 1.0 if scale is None else finite_number(scale, "scale", least=1e-9, most=1e9)
        ), []
    if scale is not None:
        raise ConfigurationError(
            f"scale: for a mesh file only; {shown(path.name)} states the scale of its meshes itself"
        )

    if of_urdf:
        return _of_urdf(path, free, visual)

    spec, _ = read_mjcf(path, "model")
    sidecar.attach_beside(spec, path)  # thrusters, and water that is to be replaced
    return spec, []


def write_model(
    wetted: "Wetted", file: str | os.PathLike[str], *, with_sidecar: bool = False
) -> tuple[Path, ...]:
    """Write an MJCF with its hydrodynamics; the table of their origins is a comment at the head of
    the file.

    Args:
        wetted: the model.
        file: MJCF to write; paths of meshes are relative to its folder.
        with_sidecar: True: the water is written to NAME.water.yaml beside the MJCF; False: to
            custom elements of the MJCF.

    Returns:
        The files written.

    Raises:
        ConfigurationError: a file cannot be written.
    """
    path = Path(file)
    spec = wetted.spec
    _rebase(spec, path.parent)

    lines = [
        f"{o.body}: {o.quantity} {o.value}; {o.origin}; uncertainty {o.uncertainty}"
        for o in wetted.origins
    ]
    lines += [f"without water: {reason}" for reason in wetted.dry]

    try:
        if not with_sidecar:
            path.write_text(_commented(sidecar.xml_with_elements(spec), lines), encoding="utf-8")
            return (path,)
        path.write_text(sidecar.xml_without_water(spec), encoding="utf-8")
        beside = sidecar.write_sidecar(spec, sidecar.beside(path))
        head = "".join(f"# {line}\n" for line in lines)
        beside.write_text(head + beside.read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(
            f"{shown(str(path))}: cannot be written ({error.strerror})"
        ) from error
    return path, beside


def _commented(xml: str, lines: list[str]) -> str:
    """MJCF with a comment after its first line."""
    first, _, rest = xml.partition("\n")
    comment = "\n".join(line.replace("--", "- -") for line in lines)
    return f"{first}\n  <!--\n{comment}\n  -->\n{rest}"


def _rebase(spec: mujoco.MjSpec, folder: Path) -> None:
    """Make paths of meshes, textures and height fields relative to another folder."""
    home = Path(spec.modelfiledir or ".")
    texture_folder = spec.texturedir or spec.meshdir
    for asset, folder_of_asset in (
        *((mesh, spec.meshdir) for mesh in spec.meshes),
        *((field, spec.meshdir) for field in spec.hfields),
        *((texture, texture_folder) for texture in spec.textures),
    ):
        if asset.file:
            asset.file = os.path.relpath(
                (home / folder_of_asset / asset.file).resolve(), folder.resolve()
            )

    spec.meshdir = ""
    spec.texturedir = ""
    spec.modelfiledir = str(folder.resolve())


def _of_mesh(path: Path, scale: float) -> mujoco.MjSpec:
    """One floating body from a mesh file."""
    spec = mujoco.MjSpec()
    spec.modelname = path.stem
    spec.modelfiledir = str(path.parent.resolve())
    spec.add_mesh(
        name=path.stem,
        file=path.name,
        scale=[scale] * 3,
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # the mesh of a user may be open
    )

    body = spec.worldbody.add_body(name=path.stem)
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=path.stem, mass=1.0)
    return _compiling(spec, f"model {shown(str(path))}")


def make_neutral(spec: mujoco.MjSpec) -> None:
    """Set the mass of a model read from one mesh to the mass of the water that it displaces."""
    (water,) = hydrodynamics.attached(spec).values()
    spec.geoms[0].mass = water.volume * hydrodynamics.density_of(spec)


def _of_urdf(path: Path, free: bool, visual: bool) -> tuple[mujoco.MjSpec, list[str]]:
    """Spec of a URDF with its welded links kept; a link without mass is fixed to its parent."""
    robot = parse(path, f"model {shown(str(path))}")
    needed = ("visual", "collision") if visual else ("collision",)
    spec, notes = spec_of_urdf(robot, path.resolve().parent, floats=free, needed=needed)

    root = spec.worldbody.bodies[0]
    # A link with shapes and no <inertial> is an error; a link with neither, or of 1 g, is a frame.
    frames = [
        joint for joint in massless(spec) if joint.parent.explicitinertial or not joint.parent.geoms
    ]
    notes += hold(spec, frames, "since the bodies that they move have no mass or inertia")
    if free:
        root.add_freejoint()
    return _compiling(spec, robot.name), notes


def _compiling(spec: mujoco.MjSpec, message: str) -> mujoco.MjSpec:
    """`spec` if MuJoCo compiles it, else `spec` with inertias from the surfaces of meshes, which
    may be open.
    """
    try:
        spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        if "inertia of moving bodies" in str(error):
            raise ConfigurationError(
                f"{message}: each link that moves needs an <inertial>: {_line(error)}"
            ) from error

        # Meshes that are not closed have no volume, but their surfaces have an inertia.
        if "mesh" not in str(error):
            raise ConfigurationError(
                f"{message}: MuJoCo cannot compile it: {_line(error)}"
            ) from error

        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        try:
            spec.compile()
        except (ValueError, mujoco.FatalError) as second:
            raise ConfigurationError(
                f"{message}: MuJoCo cannot compile it: {_line(second)}"
            ) from second
    return spec


def _line(error: Exception) -> str:
    return " ".join(str(error).split())

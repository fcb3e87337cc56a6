"""A vehicle from a URDF: hull and arm as MuJoCo reads them, with a free hull, motors, and collision bits.

Links keep their names and frames, those on fixed joints too. A mesh that is not found, or not of a format of MuJoCo, is
left out; the vehicle then keeps the shapes that it has.
"""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from uuv.models.completing.mapping import add_motor
from uuv.models.files import urdf
from uuv.models.files.floating_root import with_floating_root
from uuv.models.naming import HULL_BODY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import shown

_BITS = 1, 2  # contype, conaffinity: parts of a vehicle meet the world (1, 1), never each other
_UNCOUPLED = ("floating", "planar")


def spec_of_urdf(file: str | Path) -> tuple[mujoco.MjSpec, list[str]]:
    """Read the URDF of a vehicle.

    Args:
        file: path.

    Returns:
        The spec, its root link a free body; and what was left out, one line each.

    Raises:
        ConfigurationError: it is no URDF, or MuJoCo does not accept it.
    """
    name = f"vehicle {shown(str(file))}"
    existing_file(file, "vehicle")
    robot, notes = with_floating_root(urdf.parse(Path(file), name))
    unweighed = [
        link.get("name", "")
        for link in robot.xml.findall("link")
        if link.find("inertial") is None and any(link.find(shape) is not None for shape in ("visual", "collision"))
    ]
    if unweighed:
        notes.append(f"links without <inertial> weigh as their shapes filled with water: {', '.join(unweighed)}")
    left_out = sorted(set(_resolve_meshes(robot.xml, Path(file).resolve().parent)))
    if left_out:
        notes.append(f"meshes left out, not found or not of {', '.join(urdf.MESHES)}: {', '.join(left_out)}")
    coupled = []
    for joint in robot.xml.findall("joint"):
        if joint.find("mimic") is not None or joint.get("type") in _UNCOUPLED:
            coupled.append(joint.get("name", ""))
            joint.set("type", "fixed")
        if joint.get("type") == "continuous":  # a serial arm needs a range
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            limit.attrib.update({"lower": str(-np.pi), "upper": str(np.pi)})
    if coupled:
        notes.append(f"joints held at zero, mimic, floating or planar: {', '.join(coupled)}")
    for old in robot.xml.findall("mujoco"):
        robot.xml.remove(old)
    settings = {"fusestatic": "false", "discardvisual": "false", "strippath": "false", "angle": "radian"}
    ElementTree.SubElement(ElementTree.SubElement(robot.xml, "mujoco"), "compiler", settings)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot.xml, encoding="unicode"))
        root = spec.body(robot.root)
        root.add_freejoint(name=HULL_BODY)
    except (ValueError, TypeError, AttributeError, RecursionError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name}: MuJoCo does not accept it: {' '.join(str(error).split())}") from error
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = _BITS
    return spec, notes


def add_motors(spec: mujoco.MjSpec, joints: list[str], name: str) -> None:
    """Drive those of `joints` that no actuator drives, with the effort of the URDF.

    Raises:
        ConfigurationError: a joint has no effort.
    """
    driven = {each.target for each in spec.actuators if each.trntype == mujoco.mjtTrn.mjTRN_JOINT}
    for joint in joints:
        if joint not in driven:
            add_motor(spec, spec.joint(joint), None, name)


def _resolve_meshes(xml: ElementTree.Element, folder: Path) -> list[str]:
    """Make the paths of mesh files absolute; remove shapes whose file is not there, and return their names."""
    missing = []
    for link in xml.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            given = mesh.get("filename", "")
            found = urdf.mesh_file(given, folder) if Path(given).suffix.lower() in urdf.MESHES else None
            if found is None:
                missing.append(Path(given).name)
                link.remove(shape)
            else:
                mesh.set("filename", str(found))
    return missing

"""A vehicle from a URDF, as MuJoCo reads it: links with their names and frames, those on fixed joints too.

ROS's link `world` is taken off, and a massless root gets the mass fixed to it, so that the root can float. A mesh that
is not found, or not of a format of MuJoCo, is left out; the vehicle then keeps the shapes that it has.
"""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from uuv.models.files import urdf
from uuv.models.files.urdf import UrdfRobot, origin_of, parse
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import shown

_WORLD = "world"  # link of ROS that stands for the world
_BITS = 1, 2  # contype, conaffinity: parts of a vehicle meet the world (1, 1), never each other
_UNCOUPLED = ("floating", "planar")


def spec_of_urdf(file: str | Path) -> tuple[mujoco.MjSpec, list[str]]:
    """Read the URDF of a vehicle.

    Args:
        file: path.

    Returns:
        The spec, its root link a body on the world without a joint; and what was left out, one line each.

    Raises:
        ConfigurationError: it is no URDF, or MuJoCo does not accept it.
    """
    name = f"vehicle {shown(str(file))}"
    existing_file(file, "vehicle")
    robot, notes = with_floating_root(parse(Path(file), name))

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
    except (ValueError, TypeError, RecursionError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name}: MuJoCo does not accept it: {' '.join(str(error).split())}") from error

    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = _BITS
    return spec, notes


def with_floating_root(robot: UrdfRobot) -> tuple[UrdfRobot, list[str]]:
    """A robot whose root link can be the body that floats, and one line about each change.

    Args:
        robot: as parsed; its XML is changed in place.

    Raises:
        ConfigurationError: an origin in it is no origin.
    """
    notes: list[str] = []
    if robot.root == _WORLD:
        hung = [joint for joint in robot.xml.findall("joint") if _end(joint, "parent") == _WORLD]
        if len(hung) == 1 and hung[0].get("type") in ("floating", "fixed"):
            robot.xml.remove(hung[0])
            for link in robot.xml.findall("link"):
                if link.get("name") == _WORLD:
                    robot.xml.remove(link)
            notes.append(f"link world left out: {_end(hung[0], 'child')} floats")
            robot = parse(ElementTree.tostring(robot.xml), robot.name)
    links = {link.get("name", ""): link for link in robot.xml.findall("link")}
    if not _weighs(links[robot.root]):
        for joint in robot.xml.findall("joint"):
            child = links[_end(joint, "child")]
            if joint.get("type") == "fixed" and _end(joint, "parent") == robot.root and _weighs(child):
                _take_inertia(links[robot.root], child, joint, robot.name)
                named = child.get("name", "")
                notes.append(f"link {robot.root} has no mass: it takes that of {named!r}, which is fixed to it")
                break
    return robot, notes


def _end(joint: ElementTree.Element, which: str) -> str:
    end = joint.find(which)
    return "" if end is None else end.get("link", "")


def _weighs(link: ElementTree.Element) -> bool:
    mass = link.find("inertial/mass")
    try:
        return mass is not None and float(mass.get("value", "0")) > 0.0
    except ValueError:
        return True  # MuJoCo says what is wrong with it


def _take_inertia(root: ElementTree.Element, child: ElementTree.Element, joint: ElementTree.Element, name: str) -> None:
    """Move the <inertial> of a link to that which it is fixed to."""
    from scipy.spatial.transform import Rotation

    inertial = child.find("inertial")
    assert inertial is not None
    X = origin_of(joint, name) @ origin_of(inertial, name)
    place = inertial.find("origin")
    place = ElementTree.SubElement(inertial, "origin") if place is None else place
    place.set("xyz", " ".join(f"{value!r}" for value in X[:3, 3].tolist()))
    yaw_pitch_roll = Rotation.from_matrix(X[:3, :3]).as_euler("ZYX").tolist()
    place.set("rpy", " ".join(f"{value!r}" for value in reversed(yaw_pitch_roll)))
    child.remove(inertial)
    for old in root.findall("inertial"):
        root.remove(old)
    root.append(inertial)


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

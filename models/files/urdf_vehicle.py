"""A vehicle from a URDF, as MuJoCo reads it: links with their names, those on fixed joints too.

ROS's link `world` is taken off, and a massless root gets the mass fixed to it, so that the root can
float. A mesh that is not there, or not of a format of MuJoCo, is left out; the vehicle then keeps
the shapes that it has.
"""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from uuv.models.files import urdf
from uuv.models.files.urdf import UrdfRobot, origin_of, parse
from uuv.sim.interfaces.errors import ConfigurationError

_WORLD = "world"  # link of ROS that stands for the world
_SHAPES = ("visual", "collision")
_BITS = 1, 2  # contype, conaffinity: parts of a vehicle meet the world (1, 1), never each other
_UNCOUPLED = ("floating", "planar")
_KEPT = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}


def spec_of_urdf(robot: UrdfRobot, folder: Path) -> tuple[mujoco.MjSpec, list[str]]:
    """The model of a vehicle, or of an arm, from its URDF.

    Args:
        robot: as parsed; its XML is changed in place.
        folder: of its file, from which the paths of its meshes count.

    Returns:
        The spec, its root link a body on the world without a joint; and what was left out, one
        line each.

    Raises:
        ConfigurationError: MuJoCo does not accept it.
    """
    robot, notes = with_floating_root(robot)

    # What MuJoCo would refuse, or read in a way of its own.
    notes += _weightless_links(robot.xml)
    notes += _missing_meshes(robot.xml, folder)
    notes += _held_joints(robot.xml)
    for old in robot.xml.findall("mujoco"):
        robot.xml.remove(old)
    extension = ElementTree.SubElement(robot.xml, "mujoco")
    ElementTree.SubElement(extension, "compiler", {**_KEPT, "angle": "radian"})

    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot.xml, encoding="unicode"))
    except (ValueError, TypeError, RecursionError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise ConfigurationError(f"{robot.name}: MuJoCo does not accept it: {reason}") from error

    # What a URDF does not say: integrator, friction cone, which shapes meet.
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
    if _weighs(links[robot.root]):
        return robot, notes

    # MuJoCo needs a mass at the root: it may take that of a link fixed to it.
    for joint in robot.xml.findall("joint"):
        child = links[_end(joint, "child")]
        fixed = joint.get("type") == "fixed" and _end(joint, "parent") == robot.root
        if fixed and _weighs(child):
            _take_inertia(links[robot.root], child, joint, robot.name)
            change = f"it takes that of {child.get('name', '')!r}, which is fixed to it"
            notes.append(f"link {robot.root} has no mass: {change}")
            break
    return robot, notes


def _weightless_links(xml: Element) -> Iterator[str]:
    """A line about links that have shapes and no inertia."""
    names = [
        link.get("name", "")
        for link in xml.findall("link")
        if link.find("inertial") is None and any(link.find(shape) is not None for shape in _SHAPES)
    ]
    if names:
        listed = ", ".join(names)
        yield f"links without <inertial> weigh as their shapes filled with water: {listed}"


def _missing_meshes(xml: Element, folder: Path) -> Iterator[str]:
    """Make the paths of mesh files absolute; a line about shapes removed for want of their file."""
    missing: set[str] = set()
    for link in xml.findall("link"):
        for shape in [part for kind in _SHAPES for part in link.findall(kind)]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue

            filename = mesh.get("filename", "")
            readable = Path(filename).suffix.lower() in urdf.MESHES
            path = urdf.mesh_file(filename, folder) if readable else None
            if path is None:
                missing.add(Path(filename).name)
                link.remove(shape)
            else:
                mesh.set("filename", str(path))

    if missing:
        endings = ", ".join(urdf.MESHES)
        yield f"meshes left out, not found or not of {endings}: {', '.join(sorted(missing))}"


def _held_joints(xml: Element) -> Iterator[str]:
    """Fix joints that MuJoCo cannot have, with a line about them; give continuous ones a range."""
    held = []
    for joint in xml.findall("joint"):
        if joint.find("mimic") is not None or joint.get("type") in _UNCOUPLED:
            held.append(joint.get("name", ""))
            joint.set("type", "fixed")
        if joint.get("type") == "continuous":  # a serial arm needs a range
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            limit.attrib.update({"lower": str(-np.pi), "upper": str(np.pi)})

    if held:
        yield f"joints held at zero, mimic, floating or planar: {', '.join(held)}"


def _end(joint: Element, which: str) -> str:
    end = joint.find(which)
    return "" if end is None else end.get("link", "")


def _weighs(link: Element) -> bool:
    mass = link.find("inertial/mass")
    try:
        return mass is not None and float(mass.get("value", "0")) > 0.0
    except ValueError:
        return True  # MuJoCo says what is wrong with it


def _take_inertia(root: Element, child: Element, joint: Element, name: str) -> None:
    """Move the <inertial> of a link to that which it is fixed to."""
    from scipy.spatial.transform import Rotation

    inertial = child.find("inertial")
    assert inertial is not None
    X = origin_of(joint, name) @ origin_of(inertial, name)
    origin = inertial.find("origin")
    origin = ElementTree.SubElement(inertial, "origin") if origin is None else origin
    origin.set("xyz", " ".join(f"{number!r}" for number in X[:3, 3].tolist()))
    yaw_pitch_roll = Rotation.from_matrix(X[:3, :3]).as_euler("ZYX").tolist()
    origin.set("rpy", " ".join(f"{number!r}" for number in reversed(yaw_pitch_roll)))

    child.remove(inertial)
    for old in root.findall("inertial"):
        root.remove(old)
    root.append(inertial)

"""A vehicle from a URDF, read by MuJoCo. All links keep their names, also those on fixed joints.

ROS's link `world` is removed, and a massless root gets the mass of a link fixed to it, so that the
root can float. A mesh that is not found, or that no reader can read, is left out; the vehicle keeps
its other shapes.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from uuv.models.files.holding import follow
from uuv.models.files.mesh_shapes import MESHES, OTHERS, LinkMesh, add_meshes
from uuv.models.files.ros_packages import look_anew, mesh_file
from uuv.models.files.urdf import UrdfRobot, parse
from uuv.models.files.urdf_joints import listed, taken_mimics
from uuv.models.files.urdf_places import (
    INERTIA_ENTRIES,
    end_of,
    figure,
    numbers_of,
    origin_of,
    set_origin,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, shown

_WORLD = "world"  # link that represents the world in ROS
_SHAPES = ("visual", "collision")
# contype, conaffinity: parts of a vehicle collide with the world (1, 1), never with each other
_BITS = 1, 2
_UNCOUPLED = ("floating", "planar")
_KEPT = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
# options of MuJoCo's extension of URDF that are used: they correct inertias
_MENDING = ("balanceinertia", "boundmass", "boundinertia")
_ONCE = ("inertial", "origin", "mass", "inertia", "geometry", "axis", "limit", "dynamics")
_BY = 'by <mujoco><compiler balanceinertia="true"/></mujoco> within <robot>'
_ROUNDED = 1e-3  # relative error that is accepted in principal inertias, as rounding


def spec_of_urdf(
    robot: UrdfRobot, folder: Path, *, floats: bool = True, needed: tuple[str, ...] = ()
) -> tuple[mujoco.MjSpec, list[str]]:
    """The model of a vehicle, or of an arm, from its URDF.

    Joints that follow another (`mimic`) are held to it by an equality.

    Args:
        robot: as parsed; its XML is changed in place.
        folder: folder of the file; paths of meshes are relative to it.
        floats: the root link is to float, so that ROS's `world` is removed.
        needed: kinds of shapes, "visual" or "collision", whose meshes must be found; other meshes
            are left out if they are not found.

    Returns:
        The spec, its root link a body on the world without a joint; and what was left out, one
        line each.

    Raises:
        ConfigurationError: an inertia is not that of any body, a needed mesh is not found, or
            MuJoCo does not accept the robot.
    """
    look_anew()
    _check_masses(robot)
    robot, notes = with_floating_root(robot) if floats else (robot, [])
    notes += robot.notes
    coupled = taken_mimics(robot.xml, robot.name)

    # Content that MuJoCo would refuse, or read differently.
    options, meshdir = _own_options(robot.xml)
    if "boundinertia" not in options:
        _check_root_inertia(robot)
    notes += _repeated_elements(robot.xml)
    notes += _weightless_links(robot.xml)
    if options.get("balanceinertia") != "true":
        notes += _mended_inertias(robot)
    meshes, lines = _taken_meshes(robot, folder / meshdir, needed)
    notes += lines
    notes += _loose_joints(robot.xml)
    extension = ElementTree.SubElement(robot.xml, "mujoco")
    ElementTree.SubElement(extension, "compiler", {**_KEPT, **options, "angle": "radian"})

    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot.xml, encoding="unicode"))
    except (ValueError, TypeError, RecursionError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise ConfigurationError(
            f"{robot.name}: MuJoCo does not accept the robot: {reason}"
        ) from error

    follow(spec, coupled)
    notes += add_meshes(spec, meshes)
    as_vehicle(spec)

    return spec, notes


def as_vehicle(spec: mujoco.MjSpec) -> None:
    """Set options that neither a URDF nor an SDF states: integrator, friction cone, collision of
    shapes.
    """
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC

    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = _BITS


def with_floating_root(robot: UrdfRobot) -> tuple[UrdfRobot, list[str]]:
    """A robot whose root link can be the floating body, and one line about each change.

    Args:
        robot: as parsed; its XML is changed in place.

    Raises:
        ConfigurationError: the numbers of an origin cannot be read.
    """
    notes: list[str] = []

    if robot.root == _WORLD:
        hung = [joint for joint in robot.xml.findall("joint") if end_of(joint, "parent") == _WORLD]
        if len(hung) == 1 and hung[0].get("type") in ("floating", "fixed"):
            robot.xml.remove(hung[0])
            for link in robot.xml.findall("link"):
                if link.get("name") == _WORLD:
                    robot.xml.remove(link)

            notes.append(f"link world left out: {end_of(hung[0], 'child')} floats")
            settled = robot.notes
            robot = replace(parse(ElementTree.tostring(robot.xml), robot.name), notes=settled)

    links = {link.get("name", ""): link for link in robot.xml.findall("link")}
    if _weighs(links[robot.root]):
        return robot, notes

    # MuJoCo requires a mass at the root: the mass of a link fixed to the root can be used.
    for joint in robot.xml.findall("joint"):
        child = links[end_of(joint, "child")]
        fixed = joint.get("type") == "fixed" and end_of(joint, "parent") == robot.root
        if fixed and _weighs(child):
            _take_inertia(links[robot.root], child, joint, robot.name)
            change = f"the mass of {child.get('name', '')!r}, which is fixed to it, is used"
            notes.append(f"link {robot.root} has no mass: {change}")
            break

    return robot, notes


def _check_masses(robot: UrdfRobot) -> None:
    """Refuse a link whose mass is not a finite number, or below zero.

    MuJoCo takes a mass below zero or NaN for none, and the vehicle for that of its other links.
    """
    for link in robot.xml.findall("link"):
        mass = link.find("inertial/mass")
        if mass is not None:
            subject = f"{robot.name}: link {link.get('name')!r}: mass [kg]"
            finite_number(figure(mass.get("value", "0"), subject), subject, least=0.0)


def _check_root_inertia(robot: UrdfRobot) -> None:
    """Refuse a root with a mass and no moments of inertia, which has no attitude to hold."""
    root = next(link for link in robot.xml.findall("link") if link.get("name") == robot.root)
    inertia = root.find("inertial/inertia")
    if inertia is None or not _weighs(root):
        return

    subject = f"{robot.name}: link {robot.root!r}: inertia"
    if not _tensor(inertia, subject).any():
        raise ConfigurationError(
            f"{subject}: the moments of the hull are all zero; state them, for a box about "
            "m (b^2 + c^2) / 12 with its edges b and c across the axis"
        )


def _weightless_links(xml: Element) -> Iterator[str]:
    """A line about links that have shapes and no inertia."""
    names = [
        link.get("name", "")
        for link in xml.findall("link")
        if link.find("inertial") is None and any(link.find(shape) is not None for shape in _SHAPES)
    ]

    if names:
        listed = ", ".join(names)
        yield f"links without <inertial> have the mass of their shapes filled with water: {listed}"


def _repeated_elements(xml: Element) -> Iterator[str]:
    """Keep the first of elements that a link or joint states twice, as ROS does; returns a line
    about them.
    """
    twice = []
    for owner in [*xml.findall("link"), *xml.findall("joint")]:
        for part in [
            owner,
            *owner.iter("inertial"),
            *owner.iter("visual"),
            *owner.iter("collision"),
        ]:
            for tag in _ONCE:
                for element in part.findall(tag)[1:]:
                    part.remove(element)
                    twice.append(f"{owner.get('name')} <{tag}>")

    if twice:
        yield f"stated twice, only the first is used: {listed(twice)}"


def _own_options(xml: Element) -> tuple[dict[str, str], str]:
    """Options for the correction of inertias in the file's <mujoco> element, and its folder of
    meshes.

    The element is removed.
    """
    options = {}
    meshdir = ""

    for extension in xml.findall("mujoco"):
        for compiler in extension.findall("compiler"):
            options.update(
                {key: compiler.attrib[key] for key in _MENDING if key in compiler.attrib}
            )
            meshdir = compiler.get("meshdir", meshdir)

        xml.remove(extension)

    return options, meshdir


def _mended_inertias(robot: UrdfRobot) -> Iterator[str]:
    """Correct inertias that rounding has made impossible; returns a line about them.

    Raises:
        ConfigurationError: an inertia is impossible by more than rounding; the message states the
            remedy.
    """
    mended = []

    for link in robot.xml.findall("link"):
        inertia = link.find("inertial/inertia")
        if inertia is None:
            continue
        subject = f"{robot.name}: link {link.get('name')!r}: inertia"
        tensor, changed = mended_tensor(
            _tensor(inertia, subject), subject, f"correct it, or let MuJoCo take their mean, {_BY}"
        )

        if changed:
            for i, j, key in INERTIA_ENTRIES:
                inertia.set(key, repr(float(tensor[i, j])))
            mended.append(link.get("name", ""))

    if mended:
        yield (
            "inertias raised slightly, since rounding had made them impossible for a body: "
            f"{listed(mended)}"
        )


def mended_tensor(tensor: Array, subject: str, remedy: str) -> tuple[Array, bool]:
    """An inertia (3, 3) that a body can have, and True if a rounding error was corrected for it.

    Raises:
        ConfigurationError: the inertia is impossible by more than rounding.
    """
    principal, R = np.linalg.eigh(tensor)
    lacking = float(principal[2] - principal[0] - principal[1])
    if lacking <= 1e-12 * abs(float(principal[2])):
        return tensor, False

    if lacking > _ROUNDED * principal[2]:
        figures = ", ".join(f"{entry:.4g}" for entry in principal)
        raise ConfigurationError(
            f"{subject}: the principal moments {figures} kg m^2 are impossible, since the largest "
            f"exceeds the sum of the others; {remedy}"
        )

    principal[:2] += 0.51 * lacking

    return R @ np.diag(principal) @ R.T, True


def _tensor(inertia: Element, subject: str) -> np.ndarray:
    tensor = np.zeros((3, 3))
    for i, j, key in INERTIA_ENTRIES:
        tensor[i, j] = tensor[j, i] = figure(inertia.get(key, "0"), f"{subject} {key}")
    return tensor


def _taken_meshes(
    robot: UrdfRobot, folder: Path, needed: tuple[str, ...]
) -> tuple[list[LinkMesh], list[str]]:
    """Remove the meshes from the links; returns the meshes, and a line about those left out.

    Raises:
        ConfigurationError: a needed mesh is not found, or its format cannot be read.
    """
    meshes = []
    missing: set[str] = set()

    for link in robot.xml.findall("link"):
        for shape in [part for kind in _SHAPES for part in link.findall(kind)]:
            element = shape.find("geometry/mesh")
            if element is None:
                continue
            subject = f"{robot.name}: link {link.get('name')!r}: mesh"
            filename = element.get("filename", "")
            file = _file_of(filename, folder, subject, shape.tag in needed, link)
            link.remove(shape)

            if file is None:
                missing.add(Path(filename).name)
                continue

            x, y, z = numbers_of(element.get("scale"), (1.0, 1.0, 1.0), f"{subject} scale").tolist()
            collides = shape.tag == "collision"
            meshes.append(
                LinkMesh(
                    link=link.get("name", ""),
                    file=file,
                    X_LG=origin_of(shape, f"{subject} origin"),
                    scale=(x, y, z),
                    collides=collides,
                    weighs=collides and link.find("inertial") is None,
                )
            )

    endings = ", ".join((*MESHES, *OTHERS))
    line = (
        f"meshes left out, since they were not found or are none of {endings}: "
        f"{', '.join(sorted(missing))}"
    )
    return meshes, [line] if missing else []


def _file_of(filename: str, folder: Path, subject: str, needed: bool, link: Element) -> Path | None:
    """File of a mesh; None if the mesh is left out.

    Raises:
        ConfigurationError: the mesh is needed, and no readable file is found.
    """
    if needed and not filename:
        raise ConfigurationError(f"{subject}: must have a filename")
    readable = Path(filename).suffix.lower() in (*MESHES, *OTHERS)
    file = mesh_file(filename, folder) if readable else None
    if file is not None or not needed:
        return file

    if readable:
        raise ConfigurationError(
            f"{subject} {shown(filename)}: there is no such file (looked in {shown(str(folder))})"
        )

    if link.find("collision/geometry/mesh") is not None or link.find("collision") is None:
        raise ConfigurationError(
            f"{subject} {shown(filename)}: must be of one of the formats "
            f"{', '.join((*MESHES, *OTHERS))}; convert the file"
        )

    return None  # the collision shapes of the link are used instead


def _loose_joints(xml: Element) -> Iterator[str]:
    """Fix joints of types that MuJoCo does not have; returns a line about them."""
    held = []
    for joint in xml.findall("joint"):
        if joint.get("type") in _UNCOUPLED:
            held.append(joint.get("name", ""))
            joint.set("type", "fixed")

    if held:
        yield f"joints held at zero, since they are floating or planar: {listed(held)}"


def _weighs(link: Element) -> bool:
    mass = link.find("inertial/mass")
    try:
        return mass is not None and float(mass.get("value", "0")) > 0.0
    except ValueError:
        return True  # MuJoCo reports the fault


def _take_inertia(root: Element, child: Element, joint: Element, name: str) -> None:
    """Move the <inertial> of a link to its parent, to which it is fixed."""
    inertial = child.find("inertial")
    assert inertial is not None
    set_origin(inertial, origin_of(joint, name) @ origin_of(inertial, name))

    child.remove(inertial)
    for old in root.findall("inertial"):
        root.remove(old)
    root.append(inertial)

    # Otherwise the shapes of the child would add mass.
    empty = ElementTree.SubElement(child, "inertial")
    ElementTree.SubElement(empty, "mass", value="0")
    ElementTree.SubElement(
        empty, "inertia", dict.fromkeys((key for *_, key in INERTIA_ENTRIES), "0")
    )

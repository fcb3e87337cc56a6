"""Root of a URDF that is to float: ROS's `world` link is taken off, and a massless root gets the mass fixed to it."""

from xml.etree import ElementTree

from uuv.models.files.urdf import UrdfRobot, origin_of, parse

_WORLD = "world"  # link of ROS that stands for the world


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

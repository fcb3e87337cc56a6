"""URDF files as MuJoCo models, for chains of the inverse kinematics (`controllers.mkps_chain`).

MuJoCo reads URDF, but for chains three things are missing: it asks for mesh files, merges links that do not move, and
drops `mimic`, by which URDF couples joints.
"""

from pathlib import Path
from xml.etree import ElementTree

import mujoco

from sim.interfaces.errors import ConfigurationError

TIP_SITE = "chain tip"
_JOINTS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def model_from_urdf(urdf: str | Path, tip_link: str) -> tuple[mujoco.MjModel, str]:
    """The kinematics of `urdf` (a file or its text) with TIP_SITE in the frame of `tip_link`, and the root link's name.

    The root link is MuJoCo's world body. Shapes, masses and efforts are left out. `mimic` becomes a joint equality.

    Raises ConfigurationError for a file that cannot be read, text that is not URDF, an unknown tip link, links that do
    not form one tree, and whatever MuJoCo does not accept.
    """
    robot = _parsed(urdf)
    links = [link.get("name", "") for link in robot.findall("link")]
    if tip_link not in links:
        raise ConfigurationError(f"tip_link: the robot has {', '.join(links)}, got {tip_link!r}")
    mimics = []
    children = set()
    for joint in robot.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind not in _JOINTS:
            raise ConfigurationError(f"joint {name!r}: allowed types {', '.join(_JOINTS)}, got {kind!r}")
        child = joint.find("child")
        children.add("" if child is None else child.get("link", ""))
        mimic = joint.find("mimic")
        if mimic is not None:
            mimics.append((name, mimic.get("joint", ""), mimic.get("multiplier", "1"), mimic.get("offset", "0")))
            joint.remove(mimic)
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise ConfigurationError(f"the links of a URDF must form one tree, found the roots {roots}")
    for link in robot.findall("link"):
        for part in list(link):
            link.remove(part)
        # MuJoCo wants mass in whatever moves
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "mass", value="1")
        ElementTree.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    extension = ElementTree.SubElement(robot, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false")
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
        carrier = spec.worldbody if tip_link == roots[0] else spec.body(tip_link)
        carrier.add_site(name=TIP_SITE)
        for follower, leader, multiplier, offset in mimics:
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                name1=follower,
                name2=leader,
                data=[float(offset), float(multiplier), *(0.0,) * 10],
            )
        return spec.compile(), roots[0]
    except ValueError as error:
        raise ConfigurationError(f"MuJoCo does not accept this URDF: {error}") from error


def _parsed(urdf: str | Path) -> ElementTree.Element:
    text = str(urdf)
    try:
        if not text.lstrip().startswith("<"):
            text = Path(urdf).read_text()
        robot = ElementTree.fromstring(text)
    except OSError as error:
        raise ConfigurationError(f"urdf: cannot read {str(urdf)!r}: {error}") from error
    except ElementTree.ParseError as error:
        raise ConfigurationError(f"urdf: not XML: {error}") from error
    if robot.tag != "robot":
        raise ConfigurationError(f"urdf: the root element must be <robot>, got <{robot.tag}>")
    return robot

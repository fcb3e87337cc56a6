"""URDF files as MuJoCo models, for chains of the inverse kinematics (`controllers.ik.chain`).

MuJoCo reads URDF, but for chains three things are missing: it asks for mesh files, merges links that do not move, and
drops `mimic`, by which URDF couples joints.
"""

import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import bytes_of
from sim.interfaces.spatial import finite_number, shown

TIP_SITE = "chain tip"
_UNSOLVED = ("floating", "planar")
_JOINTS = ("revolute", "continuous", "prismatic", "fixed", *_UNSOLVED)


def model_from_urdf(urdf: str | Path, base_link: str, tip_link: str) -> tuple[mujoco.MjModel, str]:
    """The kinematics of `urdf` (a file or its text) with TIP_SITE in the frame of `tip_link`, and the root link's name.

    The root link is MuJoCo's world body. Shapes, masses and efforts are left out. `mimic` becomes a joint equality.

    Raises ConfigurationError for a file that cannot be read, text that is not URDF, an unknown link, links that do not
    form one tree, a floating or planar joint between the two links, and whatever MuJoCo does not accept.
    """
    robot = _parsed(urdf)
    links = [link.get("name", "") for link in robot.findall("link")]
    for argument, link in (("base_link", base_link), ("tip_link", tip_link)):
        if not isinstance(link, str) or link not in links:
            raise ConfigurationError(f"{argument}: the robot has {', '.join(links)}, got {shown(link)}")
    mimics = []
    carriers: dict[str, tuple[str, ElementTree.Element]] = {}  # of each link: its parent link and the joint between
    for joint in robot.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind not in _JOINTS:
            raise ConfigurationError(f"joint {name!r}: allowed types {', '.join(_JOINTS)}, got {kind!r}")
        ends = [end.get("link", "") for end in (joint.find("parent"), joint.find("child")) if end is not None]
        if len(ends) != 2 or not set(ends) <= set(links) or ends[1] in carriers:
            raise ConfigurationError(f"joint {name!r}: must join a parent link to a child of no other, got {ends}")
        carriers[ends[1]] = ends[0], joint
        mimic = joint.find("mimic")
        if mimic is not None:
            mimics.append((name, mimic))
            joint.remove(mimic)
    roots = [link for link in links if link not in carriers]
    if len(roots) != 1:
        raise ConfigurationError(f"the links of a URDF must form one tree, found the roots {roots}")
    link = tip_link
    while link != base_link and link in carriers:
        link, joint = carriers[link]
        if joint.get("type") in _UNSOLVED:
            raise ConfigurationError(
                f"joint {joint.get('name')!r}: only hinges and slides can be solved for, not {joint.get('type')}"
            )
    for _, joint in carriers.values():
        if joint.get("type") in _UNSOLVED:
            joint.set("type", "fixed")  # beside the chain, where MuJoCo would refuse it
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
        for follower, mimic in mimics:
            multiplier = _figure(mimic.get("multiplier", "1"), f"joint {follower!r}: mimic's multiplier")
            offset = _figure(mimic.get("offset", "0"), f"joint {follower!r}: mimic's offset")
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                name1=follower,
                name2=mimic.get("joint", ""),
                data=[offset, multiplier, *(0.0,) * 10],
            )
        return spec.compile(), roots[0]
    except ConfigurationError:
        raise
    except (ValueError, TypeError, AttributeError, RecursionError, mujoco.FatalError) as error:
        raise ConfigurationError(f"MuJoCo does not accept this URDF: {error}") from error


def _figure(text: str, name: str) -> float:
    try:
        return finite_number(float(text), name)
    except ValueError:
        raise ConfigurationError(f"{name}: expected a number, got {shown(text)}") from None


def _parsed(urdf: str | Path) -> ElementTree.Element:
    given: Any = urdf
    if not isinstance(given, str | os.PathLike) or isinstance(given, bytes):
        raise ConfigurationError(f"urdf: expected a file or its text, got {shown(given)}")
    try:
        text = given.lstrip("\ufeff \t\r\n") if isinstance(given, str) else ""
        # A file is read as bytes: XML says its encoding itself.
        robot = ElementTree.fromstring(text if text.startswith("<") else bytes_of(given, "urdf"))
    except (ElementTree.ParseError, UnicodeError, LookupError) as error:
        raise ConfigurationError(f"urdf: not XML: {error}") from error
    except ConfigurationError:
        raise
    except ValueError as error:  # an encoding that it does not know
        raise ConfigurationError(f"urdf: not XML: {error}") from error
    if robot.tag != "robot":
        raise ConfigurationError(f"urdf: the root element must be <robot>, got <{robot.tag}>")
    return robot

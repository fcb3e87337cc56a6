"""URDF files: the tree of links and joints, the arm between two links, the robot in MuJoCo.

    robot = urdf.parse("arm.urdf")
    arm = robot.chain(tip="flange").arm()                       # SerialArm, from the root link
    model, root = urdf.model_from_urdf("arm.urdf", "base_link", "flange")

MuJoCo reads URDF, but its reader does not suit chains: it requires the mesh files, merges links
that do not move, and ignores `mimic`, by which URDF couples joints.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from uuv.models.files.holding import follow
from uuv.models.files.urdf_joints import DRIVEN, limits_of, settle, speeds, taken_mimics
from uuv.models.files.urdf_places import axis_of, origin_of
from uuv.models.files.xacro_files import TAGS, expanded, is_xacro
from uuv.models.files.xml_files import xml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.interfaces.spatial import Array, readonly, shown

if TYPE_CHECKING:
    from uuv.models.arms.serial_arm import SerialArm

CHAIN_TIP = "chain tip"  # site that `model_from_urdf` adds
_UNSOLVED = ("floating", "planar")
_JOINTS = (*DRIVEN, "fixed", *_UNSOLVED)
# [bytes] within which the root element of a URDF with another ending is searched for
_HEAD = 20_000


def is_urdf(file: str | os.PathLike[str], what: str) -> bool:
    """True for a file that ends in .urdf, or whose root element is a robot.

    Args:
        file: path of a file that exists.
        what: role of the file, as first words of error messages.

    Raises:
        ConfigurationError: the file cannot be read.
    """
    return Path(file).suffix.lower() == ".urdf" or b"<robot" in bytes_of(file, what)[:_HEAD]


def robot_of(
    file: str | os.PathLike[str], name: str, arguments: Mapping[str, str] | None = None
) -> "UrdfRobot | None":
    """The robot of a URDF or xacro; None for a file of another format.

    Args:
        file: path of a file that exists.
        name: first words of error messages.
        arguments: arguments of a xacro.

    Raises:
        ConfigurationError: as `parse`.
    """
    return parse(file, name, arguments) if is_urdf(file, name) else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UrdfChain:
    """The joints of a URDF from one link to another, with their poses at zero."""

    name: str  # first words of error messages
    base: str  # name of the link
    tip: str  # name of the link
    joints: tuple[Element, ...]  # base to tip, including fixed joints
    X_parent_child: tuple[Array, ...]  # (4, 4) origin of each joint

    @property
    def driven(self) -> tuple[int, ...]:
        """Indices of the movable joints."""
        return tuple(i for i, joint in enumerate(self.joints) if joint.get("type") in DRIVEN)

    @property
    def X_base_child(self) -> list[Array]:
        """Pose (4, 4) in the base link of the link after each joint, at zero."""
        X = np.eye(4)
        out = []
        for step in self.X_parent_child:
            X = X @ step
            out.append(X)
        return out

    def arm(self) -> "SerialArm":
        """Build the serial arm from the frame of the base link to the frame of the tip link.

        Joints without limits have infinite ones (`uuv.models.files.urdf_joints`).

        Raises:
            ConfigurationError: numbers that cannot be read or lie beyond 1e4, or an axis without
                length.
        """
        # imported here, since its kernels compile on import
        from uuv.models.arms.serial_arm import SerialArm

        X = self.X_base_child
        axes = []
        limits = []
        for i in self.driven:
            joint = self.joints[i]
            axes.append(X[i][:3, :3] @ axis_of(joint, self.name))
            limits.append(limits_of(joint, self.name))

        driven = [self.joints[i] for i in self.driven]
        types = "".join(DRIVEN[str(joint.get("type"))] for joint in driven)
        return replace(
            SerialArm.from_axes(axes, [X[i][:3, 3] for i in self.driven], X[-1], types),
            limits=readonly(limits),
            joint_names=tuple(str(joint.get("name")) for joint in driven),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UrdfRobot:
    """A parsed URDF: its XML, and its links as one tree."""

    name: str  # first words of error messages
    xml: Element
    links: tuple[str, ...]
    root: str  # name of the link
    speeds: Mapping[str, float]  # [rad/s] or [m/s] of the joints that state a speed
    notes: tuple[str, ...]  # one note for each joint that is not used as stated
    # for each link except the root: its parent link and the joint between them
    carriers: Mapping[str, tuple[str, Element]]

    def path(
        self, base: str, tip: str, arguments: tuple[str, str] = ("base_link", "tip_link")
    ) -> list[Element]:
        """Find the joints from one link to another, base to tip.

        Args:
            base: name of the link to start from.
            tip: name of the link to end at.
            arguments: names of the two in error messages.

        Returns:
            The joint elements, fixed ones and mimics too.

        Raises:
            ConfigurationError: a link is unknown, the base does not carry the tip, or a joint
                between the two is floating or planar.
        """
        for argument, link in zip(arguments, (base, tip), strict=True):
            if not isinstance(link, str) or link not in self.links:
                raise ConfigurationError(
                    f"{argument}: must be a link of the robot ({', '.join(self.links)}), got "
                    f"{shown(link)}"
                )

        joints: list[Element] = []
        link = tip
        while link != base and link in self.carriers:
            link, joint = self.carriers[link]
            joints.insert(0, joint)
        if link != base:
            raise ConfigurationError(
                f"{arguments[1]}: {tip!r} must be link {base!r} or a link beyond it"
            )

        for joint in joints:
            if joint.get("type") in _UNSOLVED:
                raise ConfigurationError(
                    f"{self.name}: joint {joint.get('name')!r} between base and tip must be "
                    f"{', '.join(DRIVEN)} or fixed, got type {joint.get('type')}"
                )
        return joints

    def chain(
        self,
        base: str | None = None,
        tip: str | None = None,
        arguments: tuple[str, str] = ("base_link", "tip_link"),
    ) -> UrdfChain:
        """Find the chain of joints between two links that a serial arm can be.

        Args:
            base: name of the link whose frame is the base; default the root.
            tip: name of the link whose frame is the tip; default the only leaf.
            arguments: names of the two in error messages.

        Returns:
            The chain, with at least one driven joint.

        Raises:
            ConfigurationError: as `path`; `tip` is not stated and there are several leaves, there
                is a mimic or no driven joint between the two links, or origins cannot be read or
                are beyond 1e4.
        """
        if tip is None:
            parents = {parent for parent, _ in self.carriers.values()}
            leaves = [link for link in self.links if link not in parents]
            if len(leaves) != 1:
                raise ConfigurationError(
                    f"{self.name}: {arguments[1]}: state which link is the tip, one of the leaves "
                    f"{', '.join(leaves)}"
                )
            tip = leaves[0]

        start = self.root if base is None else base
        joints = self.path(start, tip, arguments)
        for joint in joints:
            if joint.find("mimic") is not None:
                raise ConfigurationError(
                    f"{self.name}: joint {joint.get('name')!r} between base and tip must not be a "
                    "mimic"
                )

        chain = UrdfChain(
            name=self.name,
            base=start,
            tip=tip,
            joints=tuple(joints),
            X_parent_child=tuple(origin_of(joint, self.name) for joint in joints),
        )
        if not chain.driven:
            raise ConfigurationError(
                f"{self.name}: no driven joint between links {start!r} and {tip!r}"
            )
        return chain


def parse(
    urdf: str | os.PathLike[str] | bytes,
    name: str = "urdf",
    arguments: Mapping[str, str] | None = None,
) -> UrdfRobot:
    """Read a URDF, or the xacro of one, and validate that its links form one tree.

    Args:
        urdf: path of a file, or content: text that begins with "<", or bytes.
        name: first words of error messages.
        arguments: arguments of a xacro, which is expanded if it is a file.

    Returns:
        The robot.

    Raises:
        ConfigurationError: the file cannot be read, the text is not XML or not URDF, a type of
            joint is unknown, or the links do not form one tree.
    """
    xml = _parsed(urdf, name, arguments)
    links = tuple(link.get("name", "") for link in xml.findall("link"))
    carriers = _carriers(xml, links, name)

    # From each link up to the one root, without a loop.
    if not links:
        raise ConfigurationError(
            f"{name}: the robot has no links; a file with only xacro macros cannot be read by "
            "itself"
        )
    roots = [link for link in links if link not in carriers]
    if len(roots) != 1:
        raise ConfigurationError(
            f"{name}: the links of a URDF must form one tree, but these links have no parent: "
            f"{roots}"
        )

    carried = {roots[0]}
    for link in links:
        way = []
        at = link
        while at not in carried and at not in way:
            way.append(at)
            at = carriers[at][0]
        if at not in carried:
            raise ConfigurationError(
                f"{name}: the links of a URDF must form one tree, but these form a loop: {way}"
            )
        carried.update(way)

    notes = tuple(settle(xml, name))
    return UrdfRobot(
        name=name,
        xml=xml,
        links=links,
        root=roots[0],
        speeds=speeds(xml, name),
        notes=notes,
        carriers=carriers,
    )


def _carriers(xml: Element, links: tuple[str, ...], name: str) -> dict[str, tuple[str, Element]]:
    """Parent link and joint of each link that a joint carries.

    Raises:
        ConfigurationError: an unknown type of joint, or one that does not join two links.
    """
    carriers: dict[str, tuple[str, Element]] = {}
    moving = {joint.get("name") for joint in xml.findall("joint") if joint.get("type") in DRIVEN}
    names: set[str] = set()

    for joint in xml.findall("joint"):
        subject = f"{name}: joint {joint.get('name', '')!r}"
        kind = joint.get("type", "")
        if kind not in _JOINTS:
            raise ConfigurationError(
                f"{subject}: type must be one of {', '.join(_JOINTS)}, got {kind!r}"
            )

        # A repeated name is ambiguous unless all joints of the name are fixed
        if (joint_name := joint.get("name", "")) in names and joint_name in moving:
            raise ConfigurationError(f"{subject}: the name is that of another joint too; rename it")
        names.add(joint_name)

        ends = [
            end.get("link", "")
            for end in (joint.find("parent"), joint.find("child"))
            if end is not None
        ]
        if len(ends) != 2 or not set(ends) <= set(links) or ends[1] in carriers:
            raise ConfigurationError(
                f"{subject}: must join a parent link to a child link that is the child of no other "
                f"joint, got {ends}"
            )
        carriers[ends[1]] = ends[0], joint
    return carriers


def model_from_urdf(
    urdf: str | os.PathLike[str] | bytes, base_link: str, tip_link: str
) -> tuple[mujoco.MjModel, str]:
    """Compile the kinematics of a URDF, with the site CHAIN_TIP in the frame of a link.

    The root link is MuJoCo's world body. Shapes, masses and efforts are left out. `mimic` becomes a
    joint equality.

    Args:
        urdf: path of a file, or content as of `parse`.
        base_link: name of the link at which the chain begins.
        tip_link: name of the link that gets the site.

    Returns:
        The model, and the name of the root link.

    Raises:
        ConfigurationError: as `parse` and `UrdfRobot.path`, or MuJoCo does not accept the model.
    """
    robot = parse(urdf)
    for joint in robot.path(base_link, tip_link):
        limits_of(joint, robot.name)
    coupled = taken_mimics(robot.xml, robot.name)

    # Joints outside the chain that MuJoCo would refuse.
    for _, joint in robot.carriers.values():
        if joint.get("type") in _UNSOLVED:
            joint.set("type", "fixed")

    # Bodies without shapes.
    for link in robot.xml.findall("link"):
        for part in list(link):
            link.remove(part)
        # MuJoCo requires a mass for every moving body
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "mass", value="1")
        ElementTree.SubElement(
            inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0"
        )

    extension = ElementTree.SubElement(robot.xml, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false")

    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot.xml, encoding="unicode"))
        carrier = spec.worldbody if tip_link == robot.root else spec.body(tip_link)
        carrier.add_site(name=CHAIN_TIP)
        follow(spec, coupled)
        return spec.compile(), robot.root
    except ConfigurationError:
        raise
    except (ValueError, TypeError, AttributeError, RecursionError, mujoco.FatalError) as error:
        raise ConfigurationError(
            f"{robot.name}: MuJoCo does not accept the robot: {error}"
        ) from error


def _parsed(urdf: Any, name: str, arguments: Mapping[str, str] | None) -> Element:
    text = urdf.lstrip("\ufeff \t\r\n") if isinstance(urdf, str) else ""
    if isinstance(urdf, bytes):
        content = urdf
    elif text.startswith("<"):
        content = text
    elif isinstance(urdf, str | os.PathLike):
        content = bytes_of(urdf, name)  # as bytes, since XML states its encoding itself
        if is_xacro(content):
            content = expanded(urdf, name, arguments)
    else:
        raise ConfigurationError(f"{name}: expected a file or its text, got {shown(urdf)}")

    xml = xml_of(content, name)
    if xml.tag != "robot":
        raise ConfigurationError(f"{name}: the root element must be <robot>, got <{xml.tag}>")
    if any(
        str(element.tag).startswith("{" + tag.decode()) for element in xml.iter() for tag in TAGS
    ):
        raise ConfigurationError(
            f"{name}: is a xacro text, which must be converted first: xacro FILE > rov.urdf"
        )
    return xml

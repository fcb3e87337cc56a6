"""SDF of Gazebo: the model of a vehicle with its links, joints and shapes, and its plugins.

    model = parse_sdf("model.sdf")
    spec, notes = spec_of_sdf(model, folder)

Joints are settled as in `uuv.models.files.urdf_joints`. Nested models and includes are left out.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from uuv.models.files.gazebo.content import DrivenJoint
from uuv.models.files.urdf_joints import DRIVEN, settle
from uuv.models.files.urdf_places import LONGEST, figure, rotation_from_rpy
from uuv.models.files.xml_files import xml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    inverse,
    pose,
    rotation_from_quat_wxyz,
    shown,
)

_TURNS = {"revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic"}
_OF_MODEL = ("", "__model__")
_AXES_OF_JOINTS = (1, 5)  # first version of SDF that states a joint's axis in the joint's frame
_NEWEST = (1, 12)
WORLD = "world"


@dataclass(slots=True, kw_only=True, eq=False)
class SdfJoint:
    """A joint of an SDF, with limits and leader in the form of a URDF."""

    name: str
    parent: str  # name of a link
    child: str  # name of a link
    X_CJ: Array  # (4, 4) pose of the joint's frame in the child's
    axis: Array  # (3,) unit vector, in the child's frame
    element: Element  # the joint as an element of a URDF, settled
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SdfModel:
    """A parsed SDF: the elements of one model, and the poses of its frames."""

    name: str  # first words of error messages
    xml: Element  # <model>
    axes_of_model: bool = False  # axes of joints are stated in the model's frame: SDF up to 1.4
    notes: list[str] = field(default_factory=list)

    @cached_property
    def links(self) -> dict[str, Element]:
        """The model's links by name.

        Raises:
            ConfigurationError: two links have one name.
        """
        names = [link.get("name", "") for link in self.xml.findall("link")]
        if repeated := [name for name in names if names.count(name) > 1]:
            raise ConfigurationError(f"{self.name}: two links have the name {repeated[0]!r}")

        return {link.get("name", ""): link for link in self.xml.findall("link")}

    @cached_property
    def root(self) -> str:
        """The link that floats: the first link that is no child of a joint."""
        carried = {joint.child for joint in self.joints.values() if joint.parent != WORLD}
        roots = [link for link in self.links if link not in carried]
        if not roots:
            raise ConfigurationError(
                f"{self.name}: the links must form a tree, but every link is the child of a joint"
            )
        canonical = self.xml.get("canonical_link", "")
        root = canonical if canonical in roots else roots[0]
        if loose := [link for link in roots if link != root]:
            self.notes.append(f"links without a joint to the rest, left out: {', '.join(loose)}")

        return root

    @cached_property
    def joints(self) -> dict[str, SdfJoint]:
        """The model's joints by name. Each link is the child of at most one of them.

        Raises:
            ConfigurationError: a joint cannot be read, or two have one name.
        """
        robot = Element("robot")
        joints: dict[str, SdfJoint] = {}
        carried: set[str] = set()

        for element in self.xml.findall("joint"):
            joint = self._joint(element, robot)
            if joint.name in joints:
                raise ConfigurationError(f"{self.name}: two joints have the name {joint.name!r}")
            if joint.child in carried:
                self.notes.append(
                    f"closed loop: joint {joint.name} left out, since its child {joint.child} is "
                    "the child of another joint"
                )
                robot.remove(joint.element)
                continue

            carried.add(joint.child)
            joints[joint.name] = joint

        self.notes.extend(settle(robot, self.name))

        return joints

    @cached_property
    def driven(self) -> dict[str, DrivenJoint]:
        """Joints that a plugin can drive."""
        return {
            name: DrivenJoint(child=joint.child, axis=joint.axis)
            for name, joint in self.joints.items()
        }

    def X_MF(self, frame: str, passed: tuple[str, ...] = ()) -> Array:
        """Pose (4, 4) of a frame, link or joint in the model.

        Raises:
            ConfigurationError: there is no such frame, or the frame is relative to itself.
        """
        if frame in _OF_MODEL:
            return np.eye(4)
        if frame in passed:
            raise ConfigurationError(f"{self.name}: frame {frame!r} is relative to itself")
        passed = (*passed, frame)
        element = self._frames.get(frame)
        if element is None:
            raise ConfigurationError(f"{self.name}: there is no link, joint or frame {frame!r}")

        # The frame is relative to a stated frame, to the child of a joint, or to the part that it
        # is attached to.
        default = ""
        if element.tag == "joint":
            default = (element.findtext("child") or "").strip()
        elif element.tag == "frame":
            default = element.get("attached_to", "")

        place = element.find("pose")
        base = default if place is None else place.get("relative_to") or default

        return self.X_MF(base, passed) @ pose_of(element, self.name)

    def X_LP(self, link: str, part: Element) -> Array:
        """Pose (4, 4) in a link of its shape or inertia.

        Raises:
            ConfigurationError: the pose is not six numbers, or is relative to a frame that the
                model does not have.
        """
        place = part.find("pose")
        base = "" if place is None else place.get("relative_to", "")
        X_FP = pose_of(part, f"{self.name}: link {link!r}")

        return inverse(self.X_MF(link)) @ self.X_MF(base) @ X_FP if base else X_FP

    @cached_property
    def _frames(self) -> dict[str, Element]:
        return {
            element.get("name", ""): element
            for tag in ("link", "joint", "frame")
            for element in self.xml.findall(tag)
        }

    def _joint(self, element: Element, robot: Element) -> SdfJoint:
        """A joint; an element in the form of a URDF is added to `robot`."""
        name = element.get("name", "")
        subject = f"{self.name}: joint {name!r}"
        parent, child = ((element.findtext(end) or "").strip() for end in ("parent", "child"))
        parent, child = (self._link_of(end, subject) for end in (parent, child))
        X_CJ = inverse(self.X_MF(child)) @ self.X_MF(name)

        kind = element.get("type", "")
        axis_element = element.find("axis")
        axis = np.array([0.0, 0.0, 1.0])
        if axis_element is not None:
            axis = self._axis(axis_element, child, X_CJ, subject)
        if kind not in (*_TURNS, "fixed"):
            self.notes.append(f"joint {name} is held, since its type is {kind or 'none'}")

        as_urdf = SubElement(robot, "joint", name=name, type=_TURNS.get(kind, "fixed"))
        SubElement(as_urdf, "axis", xyz=" ".join(f"{entry!r}" for entry in axis.tolist()))
        numbers: dict[str, float] = {}
        if axis_element is not None:
            numbers = _of_axis(axis_element, as_urdf, subject)

        return SdfJoint(
            name=name,
            parent=parent,
            child=child,
            X_CJ=X_CJ,
            axis=axis,
            element=as_urdf,
            damping=numbers.get("damping", 0.0),
            friction=numbers.get("friction", 0.0),
        )

    def _link_of(self, end: str, subject: str) -> str:
        """Link of a joint's end, which may be stated as a frame on the link."""
        passed: list[str] = []
        while end not in self.links and end != WORLD:
            element = self._frames.get(end)
            if element is None or element.tag != "frame" or end in passed:
                known = ", ".join(self.links)
                raise ConfigurationError(
                    f"{subject}: must join two of the links {known}, got {end!r}"
                )

            passed.append(end)
            end = element.get("attached_to", "") or next(iter(self.links))

        return end

    def _axis(self, element: Element, child: str, X_CJ: Array, subject: str) -> Array:
        """Unit axis (3,) of a joint in the child's frame."""
        xyz = element.find("xyz")
        text = "0 0 1" if xyz is None else xyz.text or ""
        axis = _numbers(text, 3, f"{subject}: axis")
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise ConfigurationError(f"{subject}: the axis must be longer than zero")

        base = None if xyz is None else xyz.get("expressed_in")
        stated = (element.findtext("use_parent_model_frame") or "").strip()
        of_model = stated in ("1", "true") if stated else self.axes_of_model
        if base is None and not of_model:
            return X_CJ[:3, :3] @ axis / length
        R_MC = self.X_MF(child)[:3, :3]

        return R_MC.T @ self.X_MF(base or "")[:3, :3] @ axis / length


def parse_sdf(file: Path, name: str) -> SdfModel:
    """Read the first model of an SDF.

    Args:
        file: path of the file.
        name: first words of error messages.

    Raises:
        ConfigurationError: the file is not XML, or has no model with links.
    """
    xml = xml_of(bytes_of(file, name), name)
    model = next((model for model in xml.iter("model") if model.find("link") is not None), None)
    if model is None:
        raise ConfigurationError(f"{name}: must be an SDF with a <model> that has links")
    notes = []

    for tag in ("include", "model"):
        if inner := model.findall(tag):
            named = [part.findtext("uri") or part.get("name") or tag for part in inner]
            notes.append(f"<{tag}> within the model left out: {', '.join(named)}")

    old = _version_of(xml) < _AXES_OF_JOINTS
    return SdfModel(name=name, xml=model, axes_of_model=old, notes=notes)


def _version_of(xml: Element) -> tuple[int, ...]:
    """Version of an SDF in parts; the newest, if it states none."""
    parts = xml.get("version", "").strip().split(".")
    return tuple(map(int, parts)) if all(part.isdecimal() for part in parts) else _NEWEST


def pose_of(element: Element, name: str) -> Array:
    """Pose (4, 4) that an element states, in the frame that it is relative to.

    Raises:
        ConfigurationError: the pose is not six numbers, or seven with a quaternion.
    """
    place = element.find("pose")
    if place is None or not (place.text or "").strip():
        return np.eye(4)
    subject = f"{name}: pose of {element.get('name') or element.tag}"
    if place.get("rotation_format") == "quat_xyzw":
        numbers = checked_place(_numbers(place.text or "", 7, subject), (7,), subject, LONGEST)
        x, y, z, w = numbers[3:]
        if not np.hypot.reduce(numbers[3:]) > 0.0:
            raise ConfigurationError(f"{subject}: the quaternion must not be zero")
        return pose(rotation_from_quat_wxyz([w, x, y, z]), numbers[:3])

    numbers = checked_place(_numbers(place.text or "", 6, subject), (6,), subject, LONGEST)
    angles = np.radians(numbers[3:]) if place.get("degrees") == "true" else numbers[3:]

    return pose(rotation_from_rpy(angles), numbers[:3])


def tree_order(model: SdfModel) -> Iterator[tuple[str, SdfJoint | None]]:
    """Links of the tree from the root on, parents first, each with the joint whose child it is."""
    carried: Mapping[str, list[SdfJoint]] = {}
    for joint in model.joints.values():
        carried.setdefault(joint.parent, []).append(joint)
    waiting: list[tuple[str, SdfJoint | None]] = [(model.root, None)]

    while waiting:
        link, joint = waiting.pop(0)
        yield link, joint
        waiting += [(onward.child, onward) for onward in carried.get(link, [])]


def _of_axis(axis: Element, as_urdf: Element, subject: str) -> dict[str, float]:
    """Write limits and leader of an axis into an element of a URDF; return damping and friction."""
    limit = axis.find("limit")
    if limit is not None:
        stated = {
            tag: (limit.findtext(tag) or "").strip()
            for tag in ("lower", "upper", "effort", "velocity")
        }
        SubElement(as_urdf, "limit", {tag: text for tag, text in stated.items() if text})

    mimic = axis.find("mimic")

    if mimic is not None and as_urdf.get("type") in DRIVEN:
        # SDF: q = multiplier (q_leader - reference) + offset.
        multiplier, offset, reference = (
            figure((mimic.findtext(tag) or usual).strip(), f"{subject}: mimic's {tag}")
            for tag, usual in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
        )
        shifted = offset - multiplier * reference
        follows = {"multiplier": f"{multiplier!r}", "offset": f"{shifted!r}"}
        SubElement(as_urdf, "mimic", {"joint": mimic.get("joint", ""), **follows})

    dynamics = axis.find("dynamics")
    if dynamics is None:
        return {}
    numbers = {}

    for tag in ("damping", "friction"):
        text = (dynamics.findtext(tag) or "").strip()
        if text:
            numbers[tag] = figure(text, f"{subject}: {tag}")

    return numbers


def _numbers(text: str, count: int, subject: str) -> Array:
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise ConfigurationError(
            f"{subject}: expected {count} numbers, got {shown(text)}"
        ) from error

    return checked(numbers, (count,), subject)

"""Origins of joints, links and shapes of a URDF, and axes of joints, as numbers."""

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked_place, exp_so3, finite_number, pose, shown

INERTIA_ENTRIES = (  # entries of an inertia tensor, by their names in URDF and SDF
    (0, 0, "ixx"),
    (1, 1, "iyy"),
    (2, 2, "izz"),
    (0, 1, "ixy"),
    (0, 2, "ixz"),
    (1, 2, "iyz"),
)
LONGEST = 1e4  # [m] or [rad] larger numbers are refused, since they are errors or millimetres


def rotation_from_rpy(angles: Sequence[float] | Array) -> Array:
    """Rotation (3, 3) of URDF's `angles` roll, pitch, yaw [rad]: Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = angles
    return exp_so3([0.0, 0.0, yaw]) @ exp_so3([0.0, pitch, 0.0]) @ exp_so3([roll, 0.0, 0.0])


def origin_of(owner: Element, name: str) -> Array:
    """Pose (4, 4) from the <origin> of a joint, an inertia or a shape; identity if there is none.

    Raises:
        ConfigurationError: numbers that cannot be read or lie beyond 1e4.
    """
    element = owner.find("origin")
    if element is None:
        return np.eye(4)
    subject = f"{name}: joint {owner.get('name')!r}" if owner.tag == "joint" else name
    p = numbers_of(element.get("xyz"), (0.0, 0.0, 0.0), subject)

    return pose(rotation_from_rpy(numbers_of(element.get("rpy"), (0.0, 0.0, 0.0), subject)), p)


def set_origin(owner: Element, X: Array) -> None:
    """Write a pose (4, 4) into the <origin> of `owner`."""
    from scipy.spatial.transform import Rotation

    element = owner.find("origin")
    element = ElementTree.SubElement(owner, "origin") if element is None else element
    yaw_pitch_roll = Rotation.from_matrix(X[:3, :3]).as_euler("ZYX").tolist()
    element.set("xyz", " ".join(f"{entry!r}" for entry in X[:3, 3].tolist()))
    element.set("rpy", " ".join(f"{entry!r}" for entry in reversed(yaw_pitch_roll)))


def axis_of(joint: Element, name: str) -> Array:
    """Unit axis (3,) of a joint in its child's frame; URDF's default is x.

    Raises:
        ConfigurationError: the axis is not three numbers, or is zero.
    """
    element = joint.find("axis")
    subject = f"{name}: joint {joint.get('name')!r}"
    axis = numbers_of(None if element is None else element.get("xyz"), (1.0, 0.0, 0.0), subject)
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise ConfigurationError(f"{subject}: the axis must be longer than zero")

    return axis / length


def numbers_of(text: str | None, default: tuple[float, float, float], subject: str) -> Array:
    """Three numbers of an attribute, or `default` where it is missing.

    Raises:
        ConfigurationError: the text is not three numbers, or one is beyond 1e4.
    """
    if text is None:
        return np.array(default)

    try:
        numbers = [float(word) for word in text.split()]
    except ValueError as error:
        raise ConfigurationError(f"{subject}: expected three numbers, got {shown(text)}") from error

    return checked_place(numbers, (3,), subject, LONGEST)


def end_of(joint: Element, which: str) -> str:
    """Link at an end of a joint, "parent" or "child"; empty if the joint states none."""
    end = joint.find(which)
    return "" if end is None else end.get("link", "")


def figure(text: str, name: str) -> float:
    """A finite number of an attribute.

    Raises:
        ConfigurationError: the text is not a finite number.
    """
    try:
        return finite_number(float(text), name)
    except ValueError:
        raise ConfigurationError(f"{name}: expected a number, got {shown(text)}") from None

"""Ranges of the joints of a URDF and couplings between them, by one rule for all readers.

`settle` rewrites the joints of a robot once, where it is parsed, so that the readers of arms, of
vehicles and of MuJoCo get the same joints:

- Stated limits apply, also those of a `continuous` joint.
- A joint whose limits are missing or too large for any arm turns or slides without end.
- A joint whose limits are equal is fixed at that value.
- A lower limit above the upper one is refused when the joint is used (`limits_of`).
- An effort or a velocity below zero (SDF's -1) or infinite is ignored.
"""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

import numpy as np

from uuv.models.files.urdf_places import axis_of, figure, origin_of, set_origin
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

DRIVEN = {"revolute": "r", "continuous": "r", "prismatic": "p"}
ENDLESS = 1e3  # [rad] or [m] limits from here on are ignored
_LISTED = 6  # largest number of names in a line
_HELD = "joints whose limits are equal are fixed"
_TURNS = 20.0  # [rad] a limit beyond three turns may have been meant in degrees
_DEGREES = "limits of more than three turns, which a URDF states in radians; degrees were meant?"


def settle(xml: Element, name: str) -> list[str]:
    """Rewrite the joints of a robot by the rule of this module.

    Args:
        xml: XML of the robot, changed in place.
        name: first words of error messages.

    Returns:
        A line about each kind of change.

    Raises:
        ConfigurationError: a limit is not a number.
    """
    changes: dict[str, list[str]] = {}
    held: dict[str, float] = {}
    joints = {joint.get("name", ""): joint for joint in xml.findall("joint")}

    for joint_name, joint in joints.items():
        _settle_ratings(joint)
        if joint.get("type") not in DRIVEN:
            continue
        subject = f"{name}: joint {joint_name!r}"
        lower, upper = _stated(joint, subject)
        farthest = max(abs(lower or 0.0), abs(upper or 0.0))
        if joint.get("type") == "revolute" and _TURNS < farthest <= 360.0:
            changes.setdefault(_DEGREES, []).append(joint_name)
        if change := _settled(joint, subject):
            changes.setdefault(change, []).append(joint_name)
        if joint.get("type") == "fixed" and lower is not None:
            held[joint_name] = lower

    # A joint that follows a held joint is held too.
    for follower, (leader, factor, offset) in followers(joints, name).items():
        if leader in held and joints[follower].get("type") in DRIVEN:
            _fix(joints[follower], factor * held[leader] + offset, f"{name}: joint {follower!r}")
            changes.setdefault(_HELD, []).append(follower)

    return [f"{change}: {listed(names)}" for change, names in changes.items()]


def listed(names: list[str]) -> str:
    """Names in a line; of many names only the first ones."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def limits_of(joint: Element, name: str) -> tuple[float, float]:
    """Limits [rad] or [m] of a settled joint; infinite if it has none.

    Raises:
        ConfigurationError: the lower one lies above the upper.
    """
    if joint.get("type") == "continuous" or joint.find("limit") is None:
        return -np.inf, np.inf
    lower, upper = _stated(joint, f"{name}: joint {joint.get('name', '')!r}")
    if lower is None or upper is None:
        return -np.inf, np.inf

    if lower > upper:
        raise ConfigurationError(
            f"{name}: joint {joint.get('name')!r}: its lower limit {lower:g} is above its upper "
            f"limit {upper:g}; exchange them in the URDF"
        )

    return lower, upper


def followers(joints: Mapping[str, Element], name: str) -> dict[str, tuple[str, float, float]]:
    """Leader, factor and offset of each joint that follows another.

    A joint that follows a follower gets the leader of that follower.

    Args:
        joints: joint elements of a robot by their names.
        name: first words of error messages.

    Returns:
        Leader, factor and offset [rad] or [m] by the follower's name: q = factor q_leader + offset.

    Raises:
        ConfigurationError: the robot has no such leader, an entry must be a number and is not, or
            joints follow each other in a loop.
    """
    direct = {}

    for follower, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        subject = f"{name}: joint {follower!r}: mimic"
        leader = mimic.get("joint", "")
        if leader not in joints:
            raise ConfigurationError(
                f"{subject}: the robot has no joint {leader!r} that it could follow"
            )
        factor = figure(mimic.get("multiplier", "1"), f"{subject}'s multiplier")
        offset = figure(mimic.get("offset", "0"), f"{subject}'s offset")
        direct[follower] = leader, factor, offset

    resolved = {}
    for follower, (leader, factor, offset) in direct.items():
        passed = [follower]
        while leader in direct:
            if leader in passed:
                raise ConfigurationError(
                    f"{name}: joints follow each other in a loop: {', '.join(passed)}"
                )
            passed.append(leader)
            leader, further, shift = direct[leader]
            offset += factor * shift
            factor *= further

        resolved[follower] = leader, factor, offset

    return resolved


def taken_mimics(xml: Element, name: str) -> dict[str, tuple[str, float, float]]:
    """Remove the `mimic` elements, which MuJoCo does not read, from a robot; returns its
    `followers`.
    """
    joints = {joint.get("name", ""): joint for joint in xml.findall("joint")}
    coupled = followers(joints, name)

    for joint in joints.values():
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)

    return coupled


def speeds(xml: Element, name: str) -> dict[str, float]:
    """Rated speed [rad/s] or [m/s] of each settled joint that states a speed.

    Raises:
        ConfigurationError: the speed is not a number.
    """
    stated = {}

    for joint in xml.findall("joint"):
        limit = joint.find("limit")
        text = None if limit is None else limit.get("velocity")
        if text is not None:
            joint_name = joint.get("name", "")
            stated[joint_name] = figure(text, f"{name}: joint {joint_name!r}: velocity")

    return stated


def moved(kind: str, axis: Array, value: float) -> Array:
    """Motion (4, 4) of a joint at a value [rad] or [m]: about its axis (3,), or along the axis."""
    if DRIVEN[kind] == "p":
        return pose(None, value * axis)
    return pose(exp_so3(value * axis))


def _settled(joint: Element, subject: str) -> str:
    """Rewrite a joint; returns a note about the change, or an empty text."""
    lower, upper = _stated(joint, subject)
    kind = joint.get("type")
    change = ""

    # No limits, or limits larger than those of any arm.
    if lower is None or upper is None:
        if kind == "revolute":
            joint.set("type", "continuous")
        return ""

    if max(abs(lower), abs(upper)) > ENDLESS:
        _without_limits(joint)
        return f"limits beyond {ENDLESS:g} are ignored"

    # Equal limits, and limits of a joint that is declared continuous.
    if lower == upper:
        if kind == "continuous":
            _without_limits(joint)
            return ""

        _fix(joint, lower, subject)
        return _HELD

    if kind == "continuous":
        if lower > upper:
            _without_limits(joint)
            return "continuous joints whose lower limit is above the upper one turn without end"

        joint.set("type", "revolute")
        change = "continuous joints keep the limits that are stated for them"

    # write both, since other readers ignore a limit that is alone
    for limit in joint.findall("limit"):
        limit.attrib.update(lower=repr(lower), upper=repr(upper))

    return change


def _settle_ratings(joint: Element) -> None:
    """Remove efforts and velocities that mean no limit. Text that is not a number fails where it is
    used.
    """
    for limit in joint.findall("limit"):
        for rating in ("effort", "velocity"):
            try:
                stated = float(limit.get(rating, "0"))
            except ValueError:
                continue
            if stated < 0.0 or np.isinf(stated):
                del limit.attrib[rating]


def _stated(joint: Element, subject: str) -> tuple[float | None, float | None]:
    """Limits as stated; a single missing limit is 0 by URDF's default. (None, None): no limits."""
    limit = joint.find("limit")
    texts = [limit.get(side) for side in ("lower", "upper")] if limit is not None else [None, None]
    if texts == [None, None]:
        return None, None

    try:
        lower, upper = (float(text) if text is not None else 0.0 for text in texts)
    except ValueError as error:
        raise ConfigurationError(f"{subject}: limits must be numbers") from error

    if np.isnan([lower, upper]).any():
        raise ConfigurationError(f"{subject}: limits must be numbers, got nan")

    return lower, upper


def _without_limits(joint: Element) -> None:
    for limit in joint.findall("limit"):
        limit.attrib.pop("lower", None)
        limit.attrib.pop("upper", None)

    if joint.get("type") == "revolute":
        joint.set("type", "continuous")


def _fix(joint: Element, value: float, subject: str) -> None:
    """Replace a joint by a fixed one, at a value."""
    if value != 0.0:
        X = origin_of(joint, subject)
        set_origin(joint, X @ moved(joint.get("type", ""), axis_of(joint, subject), value))

    joint.set("type", "fixed")
    for element in [*joint.findall("mimic"), *joint.findall("limit")]:
        joint.remove(element)

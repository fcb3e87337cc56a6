"""Joints of a URDF by one rule for every door: what range they have, and which of them follow.

`settle` rewrites the joints of a robot once, where it is parsed, so that the reader of arms, the
one of vehicles and MuJoCo's own see the same:

- stated limits count, of a `continuous` joint too;
- missing ones, and those beyond every arm, are none: the joint turns or slides without end;
- equal ones hold the joint there: it is fixed;
- a lower one above the upper is refused where the joint is used (`limits_of`);
- an effort or a velocity below zero (SDF's -1) or infinite is none.
"""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

import numpy as np

from uuv.models.files.urdf_places import axis_of, figure, origin_of, set_origin
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

DRIVEN = {"revolute": "r", "continuous": "r", "prismatic": "p"}
ENDLESS = 1e3  # [rad] or [m] from which on a limit is none
_LISTED = 6  # names of a line
_HELD = "joints that their limits hold are fixed"


def settle(xml: Element, name: str) -> list[str]:
    """Rewrite the joints of a robot by the rule of this module.

    Args:
        xml: of the robot, changed in place.
        name: begins the error messages.

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
        lower, _ = _stated(joint, subject)
        if change := _settled(joint, subject):
            changes.setdefault(change, []).append(joint_name)
        if joint.get("type") == "fixed" and lower is not None:
            held[joint_name] = lower

    # What follows a joint that is held stands still too.
    for follower, (leader, factor, offset) in followers(joints, name).items():
        if leader in held and joints[follower].get("type") in DRIVEN:
            _fix(joints[follower], factor * held[leader] + offset, f"{name}: joint {follower!r}")
            changes.setdefault(_HELD, []).append(follower)

    return [f"{change}: {listed(names)}" for change, names in changes.items()]


def listed(names: list[str]) -> str:
    """Names in a line, the first ones of many."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def limits_of(joint: Element, name: str) -> tuple[float, float]:
    """Limits [rad] or [m] of a settled joint; infinite: it has none.

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
            f"{name}: joint {joint.get('name')!r}: its lower limit {lower:g} lies above the upper "
            f"{upper:g}; exchange them in the URDF"
        )

    return lower, upper


def followers(joints: Mapping[str, Element], name: str) -> dict[str, tuple[str, float, float]]:
    """Joints that follow another: its name, factor and offset.

    A follower of a follower follows the one that leads both.

    Args:
        joints: elements of a robot by their names.
        name: begins the error messages.

    Returns:
        Leader, factor and offset [rad] or [m] by the follower's name: q = factor q_leader + offset.

    Raises:
        ConfigurationError: a leader that the robot has not, a number that is none, or a loop.
    """
    direct = {}

    for follower, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        subject = f"{name}: joint {follower!r}: mimic"
        leader = mimic.get("joint", "")
        if leader not in joints:
            raise ConfigurationError(f"{subject}: there is no joint {leader!r} to follow")
        factor = figure(mimic.get("multiplier", "1"), f"{subject}'s multiplier")
        offset = figure(mimic.get("offset", "0"), f"{subject}'s offset")
        direct[follower] = leader, factor, offset

    resolved = {}
    for follower, (leader, factor, offset) in direct.items():
        passed = [follower]
        while leader in direct:
            if leader in passed:
                raise ConfigurationError(f"{name}: joints follow each other: {', '.join(passed)}")
            passed.append(leader)
            leader, further, shift = direct[leader]
            offset += factor * shift
            factor *= further

        resolved[follower] = leader, factor, offset

    return resolved


def taken_mimics(xml: Element, name: str) -> dict[str, tuple[str, float, float]]:
    """Take the `mimic` elements, which MuJoCo lacks, out of a robot; returns its `followers`."""
    joints = {joint.get("name", ""): joint for joint in xml.findall("joint")}
    coupled = followers(joints, name)

    for joint in joints.values():
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)

    return coupled


def speeds(xml: Element, name: str) -> dict[str, float]:
    """Rated speed [rad/s] or [m/s] of each settled joint that states one.

    Raises:
        ConfigurationError: it is not a number.
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
    """Motion (4, 4) of a joint at a value [rad] or [m]: about its axis (3,), or along it."""
    if DRIVEN[kind] == "p":
        return pose(None, value * axis)
    return pose(exp_so3(value * axis))


def _settled(joint: Element, subject: str) -> str:
    """Rewrite a joint; returns what was changed, in words, or nothing."""
    lower, upper = _stated(joint, subject)
    kind = joint.get("type")
    change = ""

    # No limits, or none that an arm can meet.
    if lower is None or upper is None:
        if kind == "revolute":
            joint.set("type", "continuous")
        return ""

    if max(abs(lower), abs(upper)) > ENDLESS:
        _without_limits(joint)
        return f"limits beyond {ENDLESS:g} count as none"

    # Limits that hold it, and those of a joint that is called endless.
    if lower == upper:
        if kind == "continuous":
            _without_limits(joint)
            return ""

        _fix(joint, lower, subject)
        return _HELD

    if kind == "continuous":
        if lower > upper:
            _without_limits(joint)
            return "continuous joints whose lower limit lies above the upper turn without end"

        joint.set("type", "revolute")
        change = "continuous joints keep the limits that are stated beside"

    for limit in joint.findall("limit"):  # both, for a missing one counts as none elsewhere
        limit.attrib.update(lower=repr(lower), upper=repr(upper))

    return change


def _settle_ratings(joint: Element) -> None:
    """Take out efforts and velocities that mean no limit; other words fail where they are used."""
    for limit in joint.findall("limit"):
        for rating in ("effort", "velocity"):
            try:
                stated = float(limit.get(rating, "0"))
            except ValueError:
                continue
            if stated < 0.0 or np.isinf(stated):
                del limit.attrib[rating]


def _stated(joint: Element, subject: str) -> tuple[float | None, float | None]:
    """Limits as stated, the missing one of a pair 0 as URDF has it; (None, None): neither is."""
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
    """Make a joint a fixed one, at a value."""
    if value != 0.0:
        X = origin_of(joint, subject)
        set_origin(joint, X @ moved(joint.get("type", ""), axis_of(joint, subject), value))

    joint.set("type", "fixed")
    for element in [*joint.findall("mimic"), *joint.findall("limit")]:
        joint.remove(element)

"""Plugins in the <gazebo> blocks of a URDF: its water and thrusters."""

import math
from xml.etree.ElementTree import Element

from uuv.models.files.gazebo.content import DrivenJoint, FileContent, ModelFacts
from uuv.models.files.gazebo.plugins import content_of
from uuv.models.files.urdf_joints import DRIVEN
from uuv.models.files.urdf_places import axis_of, figure


def content_of_urdf(xml: Element, name: str) -> FileContent:
    """Water and thrusters of a robot's blocks.

    Args:
        xml: of the robot.
        name: begins the error messages.

    Raises:
        ConfigurationError: a number in them that is none.
    """
    plugins = [plugin for block in xml.findall("gazebo") for plugin in block.iter("plugin")]
    if not plugins:
        return FileContent()
    joints = {
        joint.get("name", ""): DrivenJoint(child=_end(joint, "child"), axis=axis_of(joint, name))
        for joint in xml.findall("joint")
        if joint.get("type") in DRIVEN or joint.find("axis") is not None
    }

    return content_of(plugins, ModelFacts(name=name, masses=_masses(xml, name), joints=joints))


def _masses(xml: Element, name: str) -> dict[str, float]:
    """Mass [kg] of each link with what is fixed to it, which Gazebo makes one with it."""
    stated = {}
    for link in xml.findall("link"):
        mass = link.find("inertial/mass")
        text = "0" if mass is None else mass.get("value", "0")
        stated[link.get("name", "")] = figure(text, f"{name}: link {link.get('name')!r}: mass")

    fixed: dict[str, list[str]] = {}

    for joint in xml.findall("joint"):
        if joint.get("type") == "fixed":
            fixed.setdefault(_end(joint, "parent"), []).append(_end(joint, "child"))

    def lumped(link: str) -> float:
        return math.fsum([stated.get(link, 0.0), *(lumped(child) for child in fixed.get(link, []))])

    return {link: lumped(link) for link in stated}


def _end(joint: Element, which: str) -> str:
    end = joint.find(which)
    return "" if end is None else end.get("link", "")

"""Plugins in the <gazebo> blocks of a URDF: its water and thrusters."""

from xml.etree.ElementTree import Element

from uuv.models.files.gazebo.content import DrivenJoint, FileContent, ModelFacts
from uuv.models.files.gazebo.plugins import content_of
from uuv.models.files.urdf_joints import DRIVEN
from uuv.models.files.urdf_places import axis_of, end_of, figure


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
        joint.get("name", ""): DrivenJoint(child=end_of(joint, "child"), axis=axis_of(joint, name))
        for joint in xml.findall("joint")
        if joint.get("type") in DRIVEN or joint.find("axis") is not None
    }

    # What is fixed to a link Gazebo makes one with it.
    carriers = {
        end_of(joint, "child"): end_of(joint, "parent")
        for joint in xml.findall("joint")
        if joint.get("type") == "fixed"
    }

    facts = ModelFacts.of(name, _masses(xml, name), carriers, joints=joints)
    return content_of(plugins, facts)


def _masses(xml: Element, name: str) -> dict[str, float]:
    """Mass [kg] that each link states."""
    stated = {}
    for link in xml.findall("link"):
        mass = link.find("inertial/mass")
        text = "0" if mass is None else mass.get("value", "0")
        stated[link.get("name", "")] = figure(text, f"{name}: link {link.get('name')!r}: mass")

    return stated

"""Water and thrusters of a URDF from the plugins in its <gazebo> blocks."""

from xml.etree.ElementTree import Element

from uuv.models.files.gazebo.content import DrivenJoint, FileContent, ModelFacts
from uuv.models.files.gazebo.plugins import content_of
from uuv.models.files.urdf_joints import DRIVEN
from uuv.models.files.urdf_places import axis_of, end_of, figure


def content_of_urdf(xml: Element, name: str) -> FileContent:
    """Water and thrusters in the <gazebo> blocks of a robot.

    Args:
        xml: XML of the robot.
        name: first words of error messages.

    Raises:
        ConfigurationError: an entry of a block must be a number and is not.
    """
    plugins = [plugin for block in xml.findall("gazebo") for plugin in block.iter("plugin")]
    if not plugins:
        return FileContent()
    joints = {
        joint.get("name", ""): DrivenJoint(child=end_of(joint, "child"), axis=axis_of(joint, name))
        for joint in xml.findall("joint")
        if joint.get("type") in DRIVEN or joint.find("axis") is not None
    }

    # Gazebo merges a link with the links that are fixed to it.
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

"""MJCF of a vehicle for composer, as a whole or separated into hull, arm and tool, with all
digits.
"""

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count

import mujoco
from dm_control import mjcf
from lxml import etree

from uuv.models.files.exact_mjcf import exact_xml
from uuv.models.files.notes import COMPUTED
from uuv.models.naming import ARM_BASE_BODY, HULL_BODY, PAD_BODY, TIP_SITE
from uuv.sim.interfaces.errors import ConfigurationError, one_line

MOUNT = "mount"  # site of hull or arm at which the next part is attached
_PLACE = ("pos", "quat")
_SCOPE = "/"  # of PyMJCF
_NAMES = ("name", "class")
_TEXTS = ("file", "data", "model")  # attributes that hold no name of an element
# elements that may tie parts together
_JOINED = ("tendon", "equality", "contact", "sensor", "deformable", "skin")


@dataclass(frozen=True, slots=True)
class VehicleParts:
    """MJCF of hull, arm and tool, as separate models; None if the vehicle has no such part."""

    hull: str
    arm: str | None
    tool: str | None
    folder: str = ""  # of the files that they name, such as meshes
    renamed: Mapping[str, str] = field(default_factory=dict)  # names in them, by those of the spec


def root_of(xml: str, name: str, folder: str = "") -> mjcf.RootElement:
    """PyMJCF model of an MJCF text, without keyframes, which do not fit a larger scene.

    Args:
        xml: MJCF.
        name: Name of the model.
        folder: Folder of the files that it names.

    Raises:
        ConfigurationError: PyMJCF cannot read it, for instance because a file is missing.
    """
    document = etree.fromstring(xml.encode())
    for section in document.findall("keyframe"):
        document.remove(section)
    for custom in document.findall("custom"):
        for text in custom.findall("text"):
            # text that says how a keyframe was computed; PyMJCF would lose it
            if text.get("name", "").startswith(COMPUTED):
                custom.remove(text)

    for size in document.findall("size"):
        size.attrib.pop("nkey", None)

    try:
        root = mjcf.from_xml_string(etree.tostring(document).decode(), model_dir=folder)
    except Exception as error:  # an exception of any type, since PyMJCF's parser raises its own
        raise ConfigurationError(
            f"{name}: dm_control cannot read its MJCF: {one_line(str(error), 200)}"
        ) from error

    root.model = name
    return root


def parts_of(spec: mujoco.MjSpec) -> VehicleParts:
    """Hull, arm and tool of a vehicle.

    The free joint of the hull is removed, since the scene adds it. Parts that tendons, equalities,
    contact pairs or sensors may couple stay in one model, and so does a vehicle without an arm.
    Those of a tool alone, such as a gripper's, go with it.

    Raises:
        ConfigurationError: The vehicle has no body `hull`.
    """
    whole = etree.fromstring(exact_xml(spec).encode())
    folder = spec.modelfiledir
    renamed = _without_slashes(whole)

    hull = _named(whole, "body", HULL_BODY)
    if hull is None:
        raise ConfigurationError(f"vehicle: must have a body {HULL_BODY!r}, which floats freely")
    for joint in [*hull.findall("freejoint"), *hull.findall("joint")]:
        hull.remove(joint)

    base, tip = _named(whole, "body", ARM_BASE_BODY), _named(whole, "site", TIP_SITE)
    if (
        base is None
        or tip is None
        or base not in tip.iterancestors()
        or not _joined_in_tool(whole, tip)
    ):
        return VehicleParts(_text(whole), None, None, folder, renamed)

    of_tool = _end_of(whole, tip)
    arm = _document(whole, _cut_out(whole, [base]))
    tool = _document(whole, _cut_out(arm, of_tool))

    for document in (whole, arm):
        for section in _joining(document):
            document.remove(section)
    for document in (whole, arm, tool):
        _keep_own_actuators(document)
    return VehicleParts(_text(whole), _text(arm), _text(tool), folder, renamed)


def _joining(document: etree._Element) -> list[etree._Element]:
    """Sections with elements that may tie parts together."""
    return [section for name in _JOINED for section in document.findall(name)]


def _joined_in_tool(whole: etree._Element, tip: etree._Element) -> bool:
    """Whether all that ties parts together lies in the tool."""
    sections = [section for section in _joining(whole) if len(section)]
    if not sections:
        return True
    try:
        of_tool = _end_of(whole, tip)
    except ConfigurationError:
        return False

    # A reference is an attribute whose value is the name of a part.
    parts = {element.get("name") for element in whole.iterfind(".//worldbody//*")}
    in_tool = {element.get("name") for part in of_tool for element in part.iter()}
    tied = {
        value
        for section in sections
        for element in section.iter()
        for key, value in element.attrib.items()
        if key not in _NAMES
    }
    return tied & parts <= in_tool


def _without_slashes(document: etree._Element) -> dict[str, str]:
    """Rename elements with a slash in their name, which is PyMJCF's sign of a scope, and references
    to them.

    Returns:
        The new names by the old ones.
    """
    names = {element.get(key) for element in document.iter() for key in _NAMES if element.get(key)}
    renamed: dict[str, str] = {}
    for name in sorted(name for name in names if _SCOPE in name):
        wish = name.replace(_SCOPE, "_")
        renamed[name] = next(free for free in _numbered(wish) if free not in names)
        names.add(renamed[name])

    # A reference is an attribute whose whole value is a name; texts and files are none.
    for element in document.iter():
        for key, value in element.attrib.items():
            if key not in _TEXTS and value in renamed:
                element.set(key, renamed[value])
    return renamed


def _end_of(document: etree._Element, tip: etree._Element) -> list[etree._Element]:
    """Bodies at the last driven link: tip and pad, each with the bodies of its mount."""
    driven = {actuator.get("joint") for actuator in document.iterfind("actuator/*")}
    pad = _named(document, "body", PAD_BODY)
    carried: list[etree._Element] = []

    for part in [tip] if pad is None else [tip, pad]:
        at = part
        while not any(joint.get("name") in driven for joint in at.getparent().findall("joint")):
            at = at.getparent()
            if at.getparent() is None or at.tag == "worldbody":
                raise ConfigurationError(
                    f"vehicle: {part.tag} {part.get('name')!r} must be on a link that a driven "
                    "joint moves"
                )

        if at not in carried:
            carried.append(at)
    return carried


def _cut_out(document: etree._Element, parts: list[etree._Element]) -> list[etree._Element]:
    """Cut sibling elements out; a site MOUNT replaces them, at the pose of the first body."""
    first = parts[0]
    parent = first.getparent()
    mount = etree.SubElement(parent, "site", name=_free_name(document, MOUNT))
    taken = []

    if first.tag == "body":
        mount.attrib.update({key: first.attrib.pop(key) for key in _PLACE if key in first.attrib})

    for part in parts:
        inherited = _inherited_class(part)
        if inherited is not None:
            key = "childclass" if part.tag == "body" else "class"
            part.set(key, part.get(key, inherited))
        part.getparent().remove(part)
        part.tail = None
        taken.append(part)

    return taken


def _document(whole: etree._Element, tree: list[etree._Element]) -> etree._Element:
    """A model with settings, defaults, assets and actuators of `whole`, and with `tree` as its
    world.
    """
    document = copy.deepcopy(whole)
    for world in document.findall("worldbody"):
        document.remove(world)
    world = etree.SubElement(document, "worldbody")
    world.extend(tree)
    return document


def _keep_own_actuators(document: etree._Element) -> None:
    """Remove actuators of joints and sites that are not in the document."""
    parts = {
        (element.tag, element.get("name"))
        for element in document.iterfind(".//worldbody//*")
        if element.get("name")
    }
    parts |= {("tendon", tendon.get("name")) for tendon in document.iterfind("tendon/*")}

    for section in document.findall("actuator"):
        for actuator in list(section):
            places = [
                (kind, actuator.get(kind))
                for kind in ("joint", "site", "body", "tendon")
                if actuator.get(kind)
            ]
            if any(target not in parts for target in places):
                section.remove(actuator)


def _inherited_class(part: etree._Element) -> str | None:
    """Default class that `part` inherits from the bodies above it, unless it names its own."""
    for above in part.iterancestors("body"):
        if above.get("childclass"):
            return above.get("childclass")
    return None


def _free_name(document: etree._Element, wish: str) -> str:
    taken = {site.get("name") for site in document.iter("site")}
    return next(name for name in _numbered(wish) if name not in taken)


def _numbered(wish: str) -> Iterator[str]:
    yield wish
    yield from (f"{wish}_{number}" for number in count(2))


def _named(document: etree._Element, tag: str, name: str) -> etree._Element | None:
    return next((element for element in document.iter(tag) if element.get("name") == name), None)


def _text(document: etree._Element) -> str:
    return etree.tostring(document).decode()

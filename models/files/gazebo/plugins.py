"""Readers of Gazebo's plugins by their names: UUV Simulator, gz-sim, ArduPilot, PX4.

Other plugins, for instance sensors, do not describe the vehicle's body and are ignored.
"""

from collections.abc import Callable, Iterable
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from uuv.models.files import gz_sim
from uuv.models.files.gazebo import uuv_simulator
from uuv.models.files.gazebo.content import (
    FileContent,
    ModelFacts,
    number_in,
    number_or,
    numbers_in,
    positive_in,
)
from uuv.models.files.gazebo.thruster_limits import limited_thruster
from uuv.models.files.urdf_places import figure
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.water.forms import CrossTerms
from uuv.sim.interfaces.errors import ConfigurationError

_DIAMETER = 0.02  # [m] diameter of a propeller, if gz-sim's plugin states none
_GZ_DENSITY = 1000.0  # [kg/m^3] for thrusters and buoyancy, if gz-sim's plugin states none
_NOT_WATER = ("water_density", "default_current", "disable_coriolis", "disable_added_mass")


def content_of(plugins: Iterable[Element], facts: ModelFacts) -> FileContent:
    """Water and thrusters of the plugins of a model.

    Args:
        plugins: the elements <plugin>.
        facts: data of the model.

    Raises:
        ConfigurationError: an entry of a plugin must be a number and is not.
    """
    content = FileContent()
    elements = list(plugins)
    limits = _ardupilot_limits(elements, facts)

    for plugin in elements:
        kind = f"{plugin.get('filename', '')} {plugin.get('name', '')}"
        if "gz-sim-thruster" in kind or "systems::Thruster" in kind:
            _gz_thruster(plugin, facts, content, limits)
            continue

        for mark, reader in _READERS:
            if mark in kind:
                reader(plugin, facts, content)
                break

    return content


def _gz_hydrodynamics(plugin: Element, facts: ModelFacts, content: FileContent) -> None:
    """Read plugin Hydrodynamics of gz-sim: water of one link, with the volume of its shapes."""
    link = (plugin.findtext("link_name") or "").strip()
    if link not in facts.masses:
        content.tell(link, "water", "", "left out", "the model has no such link")
        return

    # A volume of a mass has the density in which it will swim.
    usual = content.water_density or _GZ_DENSITY
    content.water_density = density = positive_in(plugin, "water_density", facts.name, usual)

    parameters = {}

    for element in plugin:
        tag = element.tag
        if tag in ("link_name", "namespace", "topic", *_NOT_WATER) or len(element):
            continue

        try:
            parameters[tag] = figure((element.text or "").strip(), f"{facts.name}: <{tag}>")
        except ConfigurationError:
            if gz_sim.is_known(tag):
                raise
            continue  # text, for instance the name of a topic

    known = {name: entry for name, entry in parameters.items() if gz_sim.is_known(name)}
    for name in parameters.keys() - known.keys():
        content.tell(link, name, "", "left out", "unknown to gz-sim's Hydrodynamics")

    volume, center = _volume_of(link, facts, density, content)
    known = _signed(known, link, content)
    water = gz_sim.body_hydrodynamics(known, volume=volume, center_of_buoyancy=center)
    content.bodies[link] = _body_tree(water)
    stated = sum(entry != 0.0 for entry in known.values())
    content.tell(link, "added mass and damping", f"{stated} terms", "read", "gz-sim Hydrodynamics")


def _signed(parameters: dict[str, float], link: str, content: FileContent) -> dict[str, float]:
    """Parameters with the signs of gz-sim: added masses and damping are negative derivatives."""
    signed = dict(parameters)
    for name, entry in parameters.items():
        diagonal = name[:1] == "xyzkmn"["UVWPQR".find(name[-1:])]
        if entry > 0.0 and diagonal and ("Dot" in name or len(name) == 2 or "abs" in name):
            signed[name] = -entry
            content.tell(
                link,
                name,
                f"{entry:g}",
                "guessed",
                "taken as negative; as stated it would add energy",
            )

    return signed


def _volume_of(
    link: str, facts: ModelFacts, density: float, content: FileContent
) -> tuple[float, np.ndarray]:
    """Volume [m^3] and centre (3,) of a link's collision shapes, as gz-sim's Buoyancy has them."""
    if link in facts.volumes and facts.volumes[link][0] > 0.0:
        volume, center = facts.volumes[link]
        content.tell(link, "volume", f"{volume:.6g} m^3", "read", "collision shapes (Buoyancy)")
        return volume, center

    volume = facts.masses[link] / density
    content.tell(
        link,
        "volume",
        f"{volume:.6g} m^3",
        "guessed",
        "assumed neutral: no shapes that displace water",
    )

    return volume, np.zeros(3)


def _body_tree(water: BodyHydrodynamics) -> dict:
    """Coefficients as an entry of a sidecar."""
    tree: dict = {
        "volume": water.volume,
        "center_of_buoyancy": water.center_of_buoyancy.tolist(),
        "added_mass": water.added_mass.tolist(),
        "linear_damping": water.linear_damping.tolist(),
        "quadratic_damping": water.quadratic_damping.tolist(),
    }

    terms = [form.terms.tolist() for form in water.terms if isinstance(form, CrossTerms)]
    if terms:
        tree["forms"] = [{"cross_terms": {"terms": rows}} for rows in terms]

    return tree


def _gz_thruster(
    plugin: Element, facts: ModelFacts, content: FileContent, limits: dict[str, tuple[float, float]]
) -> None:
    """Read plugin Thruster of gz-sim, with thrust k rho D^4 w |w| along its joint."""
    name = (plugin.findtext("joint_name") or "").strip()
    joint = facts.joints.get(name)

    if joint is None:
        content.tell(f"thruster {name}", "thruster", "", "left out", "the model has no such joint")
        return

    subject = f"{facts.name}: thruster {name}"
    least = number_in(plugin, "min_thrust_cmd", subject)
    most = number_in(plugin, "max_thrust_cmd", subject)
    if most is None and name in limits:
        least, most = limits[name]

    factor = abs(number_or(0.0, plugin, "thrust_coefficient", subject))
    factor *= positive_in(plugin, "fluid_density", subject, _GZ_DENSITY)
    factor *= positive_in(plugin, "propeller_diameter", subject, _DIAMETER) ** 4
    bounds = {"thrust": (least, most), "command": (None, None)}
    curve = (lambda w: factor * w * np.abs(w)) if factor > 0.0 else None
    content.thrusters.append(
        limited_thruster(
            name.removesuffix("_joint"),
            joint.child,
            joint.axis,
            curve,
            bounds,
            0.0,
            facts.weight,
            content,
        )
    )


def _ardupilot_limits(
    plugins: Iterable[Element], facts: ModelFacts
) -> dict[str, tuple[float, float]]:
    """Least and largest command [N] of each joint that ArduPilot's plugin drives."""
    limits = {}
    for plugin in plugins:
        if "ArduPilot" not in f"{plugin.get('filename', '')} {plugin.get('name', '')}":
            continue
        for control in plugin.findall("control"):
            subject = f"{facts.name}: control of ArduPilot"
            multiplier = number_in(control, "multiplier", subject)
            offset = number_or(0.0, control, "offset", subject)
            kind = (control.findtext("type") or "COMMAND").strip()
            joint = (control.findtext("jointName") or "").strip()

            if multiplier and kind == "COMMAND":
                ends = (multiplier * offset, multiplier * (1.0 + offset))
                limits[joint] = min(ends), max(ends)

    return limits


def _px4_water(plugin: Element, facts: ModelFacts, content: FileContent) -> None:
    """Read plugin uuv of PX4: diagonal added mass, linear damping, and buoyancy as a factor of the
    weight.
    """
    link = (plugin.findtext("baseLinkName") or "base_link").strip()
    subject = f"{facts.name}: PX4's uuv plugin"

    if link not in facts.masses:
        content.tell(link, "water", "", "left out", "the model has no such link")
        return

    def six(linear: str, angular: str) -> list[float]:
        first = numbers_in(plugin, linear, subject, (3,)) or [0.0] * 3
        return [
            *map(abs, first),
            *map(abs, numbers_in(plugin, angular, subject, (3,)) or [0.0] * 3),
        ]

    buoyancy = plugin.find("buoyancy")
    factor = 1.0
    center = [0.0, 0.0, 0.0]

    if buoyancy is not None:
        factor = number_or(1.0, buoyancy, "compensation", subject)
        center = numbers_in(buoyancy, "origin", subject, (3,)) or center

    density = content.water_density or _GZ_DENSITY
    content.water_density = density
    content.bodies[link] = {
        "volume": factor * facts.masses[link] / density,
        "center_of_buoyancy": center,
        "added_mass": six("addedMassLinear", "addedMassAngular"),
        "linear_damping": six("dampingLinear", "dampingAngular"),
    }

    content.tell(link, "added mass, damping, buoyancy", "", "read", "PX4's uuv plugin")


def _px4_motor(plugin: Element, facts: ModelFacts, content: FileContent) -> None:
    """Read plugin motor_model of PX4, with thrust k w^2 along its joint up to a maximum speed."""
    name = (plugin.findtext("jointName") or "").strip()
    joint = facts.joints.get(name)

    if joint is None:
        content.tell(f"thruster {name}", "thruster", "", "left out", "the model has no such joint")
        return

    subject = f"{facts.name}: motor {name}"
    constant = number_or(0.0, plugin, "motorConstant", subject)
    speed = number_in(plugin, "maxRotVelocity", subject)
    bounds = {"thrust": (None, None), "command": (None, None) if speed is None else (-speed, speed)}
    lag = number_or(0.0, plugin, "timeConstantUp", subject)
    content.thrusters.append(
        limited_thruster(
            name.removesuffix("_joint"),
            joint.child,
            joint.axis,
            lambda w: constant * w * np.abs(w),
            bounds,
            lag,
            facts.weight,
            content,
        )
    )


def _fin(plugin: Element, facts: ModelFacts, content: FileContent) -> None:
    """Record the plugin of a fin: the fin is held, and its lift is not read."""
    del facts
    link = (plugin.findtext("linkName") or plugin.findtext("link_name") or "").strip()
    content.tell(link or "fin", "fin", "", "left out", "fins are held still, without lift")


_Reader = Callable[[Element, ModelFacts, FileContent], None]
_READERS: Final[tuple[tuple[str, _Reader], ...]] = (
    ("uuv_underwater_object", uuv_simulator.read_water),
    ("uuv_thruster", uuv_simulator.read_thruster),
    ("uuv_fin", _fin),
    ("gz-sim-hydrodynamics", _gz_hydrodynamics),
    ("systems::Hydrodynamics", _gz_hydrodynamics),
    ("libgazebo_uuv_plugin", _px4_water),
    ("libgazebo_motor_model", _px4_motor),
    ("MulticopterMotorModel", _px4_motor),
    ("LiftDrag", _fin),
)

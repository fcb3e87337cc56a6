"""Mapping of a user's model to the contract of `uuv.models.naming`: `NAME.parts.yaml` beside the model.

    hull: base_link                    # body, or link of a URDF; default: the only body on the world
    arm_base: arm_mount                # body fixed to the hull that carries the arm
    tip: {body: wrist, pos: [0, 0, 0.19], z: [0, 0, 1]}         # of the tool, z out of it; or the name of a site
    camera: {body: base_link, pos: [0.2, 0, 0], z: [1, 0, -0.5]}  # z along the view; or the name of a site
    tool: gripper                      # geom that may touch
    joints: {shoulder: 10, elbow: 10}  # base to tip, with torque limits [N m]; or a list of names
    thrusters:
      - {name: port, pos: [-0.2, 0.1, 0], direction: [1, 0, 0], kind: t200}
      - {actuator: thr_2, kind: {forward: 300, reverse: 220, dead_band: 0.05, time_constant: 0.15}}
      - {site: thr_3, kind: {of_table: {command: [-1, 0, 1], thrust: [-40, 0, 50]}}}  # as in `uuv.models.files.sidecar`
    trim: 0.05                         # [m] ballast the hull: neutral, and this metacentric height, with the arm folded

Every key may be left out where the model has that part by its usual name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from uuv.models.files.sidecar import thruster_of
from uuv.models.files.yaml_files import document_of
from uuv.models.water.thrusters import Thruster
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import Array, checked, finite_number, readonly, shown, unit_vector

PARTS_SUFFIX = ".parts.yaml"
_PLACE = ("body", "pos", "z")
_T200 = {"t200": {}}
_THRUSTER = ("name", "actuator", "site", "body", "pos", "direction", "kind")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartPlace:
    """A place on a body, for a site that the model has not."""

    body: str
    pos: Array  # (3,) [m] in the body's frame
    z: Array  # (3,) unit vector of the site's z in the body's frame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MappedThruster:
    """A thruster of the mapping: an actuator or a site of the model, or a place on the hull."""

    name: str
    actuator: str | None = None
    site: str | None = None
    place: PartPlace | None = None  # its z is the direction of positive thrust
    direction: Array | None = None  # (3,) of positive thrust in the frame of `site`; None: the site's x
    thruster: Thruster


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartsMap:
    """Names in a user's model of the parts of the contract; None: by its usual name."""

    hull: str | None = None
    arm_base: str | None = None
    tip: str | PartPlace | None = None
    camera: str | PartPlace | None = None
    tool: str | None = None
    joints: Mapping[str, float | None] | None = None  # base to tip, with torque limits [N m]; None: the model's
    thrusters: tuple[MappedThruster, ...] = ()
    trim: float | None = None  # [m] metacentric height to which the hull is ballasted


def read_parts(file: str | Path) -> PartsMap:
    """Read a mapping of parts.

    Raises:
        ConfigurationError: it cannot be read, or a key or value is none of those that the module's docstring lists.
    """
    name = f"parts {shown(str(file))}"
    document = document_of(text_of(file, "parts"), name)
    if not isinstance(document, Mapping):
        raise ConfigurationError(f"{name}: expected a mapping of names, got {shown(document)}")
    _known(document, [each.name for each in fields(PartsMap)], name)
    hull = _word(document.get("hull"), f"{name}: hull")
    listed = document.get("thrusters", [])
    if not isinstance(listed, Sequence) or isinstance(listed, str):
        raise ConfigurationError(f"{name}: thrusters: expected a list, got {shown(listed)}")
    trim = document.get("trim")
    return PartsMap(
        hull=hull,
        arm_base=_word(document.get("arm_base"), f"{name}: arm_base"),
        tip=_site(document.get("tip"), f"{name}: tip"),
        camera=_site(document.get("camera"), f"{name}: camera"),
        tool=_word(document.get("tool"), f"{name}: tool"),
        joints=_joints(document.get("joints"), f"{name}: joints"),
        thrusters=tuple(_thruster(each, i, hull, name) for i, each in enumerate(listed, start=1)),
        trim=None if trim is None else finite_number(trim, f"{name}: trim [m]", least=0.0, most=10.0),
    )


def _known(given: Mapping[str, Any], allowed: Sequence[str], name: str) -> None:
    for key in given:
        if key not in allowed:
            meant = did_you_mean(str(key), allowed)
            raise ConfigurationError(f"{name}: no key {shown(key)}; there are {', '.join(allowed)}{meant}")


def _word(value: Any, name: str) -> str | None:
    if value is not None and (not isinstance(value, str) or not value):
        raise ConfigurationError(f"{name}: expected a name, got {shown(value)}")
    return value


def _required(value: Any, name: str) -> str:
    found = _word(value, name)
    if found is None:
        raise ConfigurationError(f"{name}: is missing")
    return found


def _vector(value: Any, name: str, default: Sequence[float] | None = None) -> Array:
    given = default if value is None else value
    if given is None:
        raise ConfigurationError(f"{name}: three numbers are missing")
    return readonly(checked(given, (3,), name))


def _site(value: Any, name: str) -> str | PartPlace | None:
    if not isinstance(value, Mapping):
        return _word(value, name)
    _known(value, _PLACE, name)
    return PartPlace(
        body=_required(value.get("body"), f"{name}: body"),
        pos=_vector(value.get("pos"), f"{name}: pos [m]", (0.0, 0.0, 0.0)),
        z=unit_vector(_vector(value.get("z"), f"{name}: z", (0.0, 0.0, 1.0)), f"{name}: z"),
    )


def _joints(value: Any, name: str) -> Mapping[str, float | None] | None:
    if value is None:
        return None
    if isinstance(value, Mapping) and value:
        return {
            _required(joint, name): None if limit is None else finite_number(limit, f"{name}: {joint} [N m]", above=0.0)
            for joint, limit in value.items()
        }
    if isinstance(value, Sequence) and not isinstance(value, str) and value:
        return {_required(joint, name): None for joint in value}
    raise ConfigurationError(f"{name}: expected names, or names with torque limits [N m], got {shown(value)}")


def _thruster(value: Any, number: int, hull: str | None, name: str) -> MappedThruster:
    said = f"{name}: thruster {number}"
    if not isinstance(value, Mapping):
        raise ConfigurationError(f"{said}: expected a mapping, got {shown(value)}")
    _known(value, _THRUSTER, said)
    actuator, site = _word(value.get("actuator"), f"{said}: actuator"), _word(value.get("site"), f"{said}: site")
    placed = "pos" in value or "body" in value
    if (actuator is not None) + (site is not None) + placed != 1:
        raise ConfigurationError(f"{said}: needs one of actuator, site, and pos with direction, got {shown(value)}")
    direction = value.get("direction")
    if direction is not None or placed:
        direction = unit_vector(_vector(direction, f"{said}: direction"), f"{said}: direction")
    if actuator is not None and direction is not None:
        raise ConfigurationError(f"{said}: the actuator has a direction, that of its gear; leave it out")
    place = None
    if placed and direction is not None:
        body = _word(value.get("body"), f"{said}: body") or hull or ""
        place = PartPlace(body=body, pos=_vector(value.get("pos"), f"{said}: pos [m]"), z=direction)
    return MappedThruster(
        name=_word(value.get("name"), f"{said}: name") or actuator or site or str(number),
        actuator=actuator,
        site=site,
        place=place,
        direction=None if placed else direction,
        thruster=_kind(value.get("kind", "t200"), f"{said}: kind"),
    )


def _kind(value: Any, said: str) -> Thruster:
    if isinstance(value, str) and value != "t200":
        raise ConfigurationError(
            f"{said}: t200 is the only one by name, got {value!r}; others by figures: {{forward: N, reverse: N}}, "
            "{of_table: ...} or {of_polynomial: ...}"
        )
    return thruster_of(_T200 if value == "t200" else value, said)

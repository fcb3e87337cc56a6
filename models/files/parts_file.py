"""Mapping of a user's model to the contract of `uuv.models.naming`: `NAME.parts.yaml` beside it.

    hull: base_link                    # body, or link of a URDF; default: the only one on the world
    arm_base: arm_mount                # body fixed to the hull that carries the arm

    # Frames, or the name of a site. z points out of the tool, and along the camera's view.
    tip: {body: wrist, pos: [0, 0, 0.19], z: [0, 0, 1]}
    camera: {body: base_link, pos: [0.2, 0, 0], z: [1, 0, -0.5]}

    tool: gripper                      # geom that may be in contact
    joints: {shoulder: 10, elbow: 10}  # base to tip, with torque limits [N m]; or a list of names
    thrusters:
      - {name: port, pos: [-0.2, 0.1, 0], direction: [1, 0, 0], kind: t200}
      - {actuator: thr_2, kind: {forward: 300, reverse: 220, dead_band: 0.05, time_constant: 0.15}}
      - {site: thr_3, kind: {of_table: {command: [-1, 0, 1], thrust: [-40, 0, 50]}}}

    # Ballasts the hull: neutral, and this metacentric height [m], with the arm folded.
    trim: 0.05

    home: [0, 1.2, -2]                 # postures [rad], base to tip, or by joint; also `ready`
    armature: {shoulder: 0.02}         # rotor inertia [kg m^2] by joint, or one number for all
    up: -z                             # axis of the file that points up; x is ahead
    masses: {base_link: 30}            # [kg] of links whose file states none
    xacro: {namespace: rov}            # arguments of a xacro file

Every key may be left out if the model has the part under its usual name. The fields of `kind` are
listed in `uuv.models.files.sidecar`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from uuv.models.files.sidecar import water_kind
from uuv.models.water.bounds import LONGEST
from uuv.models.water.thrusters import Thruster, t200
from uuv.sim.interfaces.documents import named, yaml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked_place, readonly, shown, unit_vector
from uuv.sim.interfaces.tables import TableReader

PARTS_SUFFIX = ".parts.yaml"
_MOST_BYTES = 1_000_000  # of a file
_NAME = {"schema": {"minLength": 1, "title": "a name"}}
_SITE = {"schema": {"minLength": 1, "title": "the name of a site, or a position {body, pos, z}"}}
_LENGTH = {"schema": {"unit": "m", "title": "three numbers"}}
_DIRECTION = {"schema": {"title": "three numbers"}}
_T200 = "t200"
_KIND = {"schema": {"title": f"{_T200}, or a table of figures"}}
_POSTURE = {"schema": {"title": "joint values, base to tip, or by joint [rad]", "minItems": 1}}
_ARMATURE = {
    "schema": {
        "unit": "kg m^2",
        "minimum": 0,
        "additionalProperties": {"unit": "kg m^2", "minimum": 0},
    }
}
_MASSES = {"schema": {"additionalProperties": {"unit": "kg", "exclusiveMinimum": 0}}}
_ORIGIN = readonly([0.0, 0.0, 0.0])
_UP = readonly([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartPlace:
    """A frame on a body, for a site that the model does not have.

    Raises:
        ConfigurationError: A shape is wrong, a number is out of bounds, or z is zero.
    """

    body: str = field(metadata=_NAME)
    # (3,) in the body's frame
    pos: Array = field(default_factory=lambda: _ORIGIN, metadata=_LENGTH)
    # (3,), kept as a unit vector
    z: Array = field(default_factory=lambda: _UP, metadata=_DIRECTION)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pos", checked_place(self.pos, (3,), "pos [m]", LONGEST))
        object.__setattr__(self, "z", unit_vector(self.z, "z"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MappedThruster:
    """A thruster of the mapping: an actuator or a site of the model, or a place on the hull.

    Raises:
        ConfigurationError: It is none or several of these, its direction is missing, or a direction
            is stated where none is allowed.
    """

    name: str = field(default="", metadata=_NAME)  # empty: that of the actuator or site
    actuator: str | None = field(default=None, metadata=_NAME)
    site: str | None = field(default=None, metadata=_NAME)
    body: str | None = field(default=None, metadata=_NAME)  # body of the place; None: the hull
    # (3,) position of the place, in the body
    pos: Array | None = field(default=None, metadata=_LENGTH)
    # (3,) direction of positive thrust, of a site in the site's frame; None: x of the site
    direction: Array | None = field(default=None, metadata=_DIRECTION)
    kind: Thruster | str = field(default=_T200, metadata=_KIND)

    def __post_init__(self) -> None:
        placed = self.pos is not None or self.body is not None
        if (self.actuator is not None) + (self.site is not None) + placed != 1:
            places = ("actuator", "site", "body", "pos")
            stated = " and ".join(name for name in places if getattr(self, name) is not None)
            raise ConfigurationError(
                f"must have one of actuator, site, or pos with direction, got {stated or 'none'}"
            )

        lacking = [name for name in ("pos", "direction") if placed and getattr(self, name) is None]
        if lacking:
            raise ConfigurationError(f"{' and '.join(lacking)}: three numbers each are missing")
        if self.actuator is not None and self.direction is not None:
            raise ConfigurationError(
                "direction: must be left out, since the gear of the actuator states it"
            )

        # so that wrong figures are refused here and not where they are used
        _ = self.axis, self.place
        if isinstance(self.kind, str) and self.kind != _T200:
            raise ConfigurationError(
                f"kind: {_T200} is the only name that is allowed, got {shown(self.kind)}; state "
                f"others by figures: {{forward: N, reverse: N}}, {{t200: {{voltage: V}}}}, "
                f"{{from_table: {{path: FILE}}}}, {{of_table: ...}} or {{of_polynomial: ...}}"
            )

        object.__setattr__(self, "name", self.name or self.actuator or self.site or "")

    @property
    def axis(self) -> Array | None:
        """Unit vector (3,) along `direction`; None without a direction."""
        return None if self.direction is None else unit_vector(self.direction, "direction")

    @property
    def place(self) -> PartPlace | None:
        """Frame of a site to be added, z along the positive thrust; None if the model has the
        site.
        """
        if self.pos is None or self.direction is None:
            return None
        return PartPlace(body=self.body or "", pos=self.pos, z=self.direction)

    @property
    def thruster(self) -> Thruster:
        """The curve and dynamics of the thruster."""
        return self.kind if isinstance(self.kind, Thruster) else t200()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartsMap:
    """Names that the parts of the contract have in a user's model; None: the usual name."""

    hull: str | None = field(default=None, metadata=_NAME)
    arm_base: str | None = field(default=None, metadata=_NAME)
    tip: str | PartPlace | None = field(default=None, metadata=_SITE)
    camera: str | PartPlace | None = field(default=None, metadata=_SITE)
    tool: str | None = field(default=None, metadata=_NAME)
    joints: Mapping[str, float | None] | list[str] | None = field(  # base to tip
        default=None,
        metadata={
            "schema": {
                "title": "names, or names with torque limits [N m]",
                "minItems": 1,
                "minProperties": 1,
                "items": _NAME["schema"],
                "additionalProperties": {"unit": "N m", "exclusiveMinimum": 0},
            }
        },
    )
    thrusters: tuple[MappedThruster, ...] = ()
    trim: float | None = field(  # metacentric height to which the hull is ballasted
        default=None, metadata={"schema": {"unit": "m", "minimum": 0, "maximum": 10}}
    )
    home: Mapping[str, float] | list[float] | None = field(default=None, metadata=_POSTURE)
    ready: Mapping[str, float] | list[float] | None = field(default=None, metadata=_POSTURE)
    armature: Mapping[str, float] | float | None = field(default=None, metadata=_ARMATURE)
    up: Literal["z", "-z", "y", "-y"] = "z"  # axis of the file that points up
    masses: Mapping[str, float] = field(default_factory=dict, metadata=_MASSES)
    xacro: Mapping[str, str] = field(default_factory=dict)  # arguments of a xacro file

    @property
    def torque_limits(self) -> Mapping[str, float | None] | None:
        """Torque limit [N m] of each joint, base to tip; None: the limit of the model.

        The result is None if the joints have their usual names.
        """
        return dict.fromkeys(self.joints) if isinstance(self.joints, list) else self.joints


def read_parts(file: str | Path) -> PartsMap:
    """Read a mapping of parts.

    Raises:
        ConfigurationError: the file cannot be read, or has a key or value that the module's
            docstring does not list.
    """
    document = yaml_of(file, "parts", _MOST_BYTES)
    try:
        parts = _READER.made(PartsMap, document)
    except ConfigurationError as error:
        raise ConfigurationError(f"{named(file, 'parts')}: {error}") from error

    numbered = enumerate(parts.thrusters, start=1)
    named_all = (replace(thruster, name=thruster.name or str(k)) for k, thruster in numbered)
    return replace(parts, thrusters=tuple(named_all))


_READER = TableReader(choose=water_kind, places_faults=True)

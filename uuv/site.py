"""The site: the work object with pose, fouling and dents, or the seabed; and current and gusts."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from uuv.models.objects.block import RADIUS as BLOCK_RADIUS
from uuv.models.registry import Registry
from uuv.models.site.terrain_kinds import KINDS, Kind
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.options import DEGREE, MILLIMETRE, option
from uuv.sim.interfaces.spatial import Array, checked_pose, exp_so3, finite_number, pose, shown
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.water.flow_field import FlowField, checked_flow, total_velocity

if TYPE_CHECKING:
    from uuv.models.objects.manifold import Manifold as ManifoldBlock
    from uuv.models.objects.target_model import ModelPath
    from uuv.models.objects.targets import TargetModel
    from uuv.models.site.plugged_panel import PluggedPanel, Seat
    from uuv.models.site.seabed import Seabed
    from uuv.models.site.turned_valve import TurnedValve
    from uuv.models.site.valve_site import HingeFriction

ALTITUDE = 2.5  # [m] height of the hull above the seabed during the scan
HALF = 3.0  # [m] half the side of the terrain
# [rad] largest tilt of the manifold on the seabed, about x and about y
TILT = float(np.radians(5.0))
LEAN = float(np.radians(0.5))  # [rad] standard deviation of the pile's tilt about x and about y
SHORTEST_LINE = 0.05  # [m]
BESIDE = 41  # number of positions across an object at which a path over the object is tried
OVER = "over"  # name of a path that is projected onto an object
_HIGHEST = 1.0  # [m] largest height of growth, or depth of dents
_FLOW_TIMES = (0.0, 3.0, 10.0, 30.0, 100.0)  # [s] times at which a flow field is evaluated
_PATCHES = 3  # number of patches of growth or dents on an object
Pose = tuple[tuple[float, float, float, float], ...]  # 4 rows


@dataclass(frozen=True, kw_only=True)
class SiteObject:
    """Work object of a site; the base of all kinds."""

    def draw_pose(self, rng: np.random.Generator) -> Array:
        """True pose X_WT (4, 4): on the seabed 1.5 m below the origin, up to 0.6 rad about z."""
        return pose(
            exp_so3([0.0, 0.0, rng.uniform(-0.6, 0.6)]), rng.uniform(-0.2, 0.2, 3) - [0.0, 0.0, 1.5]
        )

    def clean(self) -> Self:
        """The same object without growth and dents, which take seconds to draw."""
        return self


@dataclass(frozen=True, kw_only=True)
class OpenWater(SiteObject):
    """No object: the vehicle is alone in the water."""


@dataclass(frozen=True, kw_only=True)
class Workpiece(SiteObject, ABC):
    """Object with tool paths, and growth and dents along them; the vehicle's model of it is
    clean.
    """

    fouled: float = option(
        0.0,
        "Growth on the object, up to this height [m], along the path where there is one; the "
        "vehicle knows the clean object only.",
        group="object",
    )
    dented: float = option(
        0.0,
        "Dents in the object, up to this depth [m], along the path where there is one; the vehicle "
        "knows the undamaged object only.",
        group="object",
    )

    def clean(self) -> Self:
        """The object in the vehicle's model."""
        return replace(self, fouled=0.0, dented=0.0)

    def model(self) -> "TargetModel":
        """Clean model, for tasks that need no path.

        Raises ConfigurationError if there is no such object.
        """
        return self.target(None)[0]

    @abstractmethod
    def target(self, path: str | None) -> "tuple[TargetModel, str]":
        """Clean model and name of the path; None: the object's first path.

        Raises:
            ConfigurationError: There is no such object or path.
        """

    def as_it_is(
        self, target: "TargetModel", path: str | None, rng: np.random.Generator
    ) -> "TargetModel":
        """The true object: `target` with growth and dents near `path`, or all over the object if
        `path` is None.

        Raises:
            ConfigurationError: A height is out of range.
        """
        near = None if path is None else target.path(path).p
        return with_growth_and_dents(target, self.fouled, self.dented, rng, near=near) or target


@dataclass(frozen=True, kw_only=True)
class Barrel(Workpiece):
    """Barrel on its stand, with the paths "longitudinal", "transverse" and "corner"."""

    length: float = option(0.6, "Length of the longitudinal path [m].", group="object")
    arc: float = float(np.pi)  # [rad] angle of the transverse path
    azimuth: float = option(
        0.0,
        "Azimuth of the path around the barrel [deg], from the top; a large one is out of reach.",
        group="object",
        unit=DEGREE,
    )
    corner: float = option(
        float(0.5 * np.pi),
        "Angle [deg] by which the path corner turns, on the barrel's top.",
        group="object",
        unit=DEGREE,
    )

    def target(self, path: str | None) -> "tuple[TargetModel, str]":
        """The barrel, and the path's name; the default is longitudinal."""
        from uuv.models.objects import targets

        barrel = targets.barrel(
            line_length=self.length,
            line_azimuth=self.azimuth,
            arc=self.arc,
            arc_azimuth=self.azimuth,
            corner=self.corner,
        )

        barrel.path(name := path or "longitudinal")
        return barrel, name


@dataclass(frozen=True, kw_only=True)
class Block(Workpiece):
    """Block with rounded edges, with the paths "edge" and "corner"."""

    radius: float = BLOCK_RADIUS  # [m] radius of the edges
    corner: float = float(0.5 * np.pi)  # [rad] by which the path "corner" turns on the top

    def target(self, path: str | None) -> "tuple[TargetModel, str]":
        """The block, and the path's name; the default is edge."""
        from uuv.models.objects import targets

        block = targets.block(radius=self.radius, corner=self.corner)
        block.path(name := path or "edge")
        return block, name


@dataclass(frozen=True, kw_only=True)
class Pile(Workpiece):
    """Vertical pile with a flange, and one path on it: "vertical", "ring" or "helix"."""

    length: float = option(0.5, "Length of the vertical path [m].", group="object")
    arc: float = float(np.radians(100.0))  # [rad] angle of ring and helix
    rise: float = 0.3  # [m] pitch of the helix
    azimuth: float = option(
        0.0,
        "Azimuth of the path's middle [deg], from the side that the vehicle approaches.",
        group="object",
        unit=DEGREE,
    )
    height: float = option(
        -0.15,
        "Height of the path's middle above the pile's [m]; the flange is 0.2 to 0.3 m above it.",
        group="object",
    )

    def target(self, path: str | None) -> "tuple[TargetModel, str]":
        """The pile with only that path; the default is vertical."""
        from uuv.models.objects.targets import helix, pile, ring, vertical

        name = path or "vertical"
        shapes = {
            "vertical": lambda: vertical(self.length, self.azimuth, self.height),
            "ring": lambda: ring(self.arc, self.azimuth, self.height),
            "helix": lambda: helix(self.arc, self.rise, self.azimuth, self.height),
        }

        if name not in shapes:
            raise ConfigurationError(f"task.path: allowed {', '.join(shapes)}, got {name!r}")
        return pile({name: shapes[name]()}), name

    def draw_pose(self, rng: np.random.Generator) -> Array:
        """True pose: nearly upright, approached from -x with an azimuth within 0.6 rad of 0."""
        lean = LEAN * rng.standard_normal(3) * [1.0, 1.0, 0.0]
        return pose(
            exp_so3(lean) @ exp_so3([0.0, 0.0, np.pi + rng.uniform(-0.6, 0.6)]),
            rng.uniform(-0.2, 0.2, 3),
        )


@dataclass(frozen=True, kw_only=True)
class KnownObject(Workpiece):
    """Object of the library or another package by name, or a mesh file with a line over its top."""

    object: str = option(
        "rock", "A name of `uuv list objects`, a mesh file, or MODULE:FUNCTION.", group="object"
    )
    scale: float | None = option(
        None, "Unit of a mesh file [m]: 0.001 for one in mm; default: metres.", group="object"
    )
    length: float = option(
        0.3, "Length of the line over a mesh [m].", group="object", everywhere=False
    )
    line: tuple[float, float, float, float] | None = option(
        None,
        "Another path instead: x0 y0 x1 y1 [m] in the object's frame, straight over it, "
        "projected from above.",
        group="object",
        everywhere=False,
    )

    def __post_init__(self) -> None:
        if self.line is None:
            return
        for coordinate in self.line:
            finite_number(coordinate, "site.object.line [m]")
        if math.dist(self.line[:2], self.line[2:]) < SHORTEST_LINE:
            raise ConfigurationError(
                f"site.object.line: must be at least {SHORTEST_LINE:g} m long, got "
                f"{shown(self.line)}"
            )

    def model(self) -> "TargetModel":
        """Clean model from the library or the file."""
        from uuv.models.objects import targets

        return targets.of(self.object, self.scale)

    def target(self, path: str | None) -> "tuple[TargetModel, str]":
        """The object and the path's name; the path "over" is `line`, or a line along x on a mesh
        without paths.
        """
        if self.line is not None and path not in (None, OVER):
            raise ConfigurationError(
                f"task.path {shown(path)} and site.object.line: give only one of the two"
            )

        model = self.model()
        if self.line is not None or not model.paths:
            above = float(model.center[2] + model.radius)
            path = OVER if self.line is not None else path
            lines = (self.line,) if self.line is not None else self._lines_over(model)
            model = model.with_path(OVER, _first_laid(model, lines, above))

        name = path or next(iter(model.paths), "none")
        model.path(name)  # raises an error for an unknown name, with the known ones
        return model, name

    def _lines_over(self, model: "TargetModel") -> Iterator[tuple[float, float, float, float]]:
        """Lines along x over the middle, and next to it in case the object has a hole there."""
        x, y = model.center[:2]
        half = 0.5 * self.length
        for aside in sorted(np.linspace(-model.radius, model.radius, BESIDE), key=abs):
            yield x - half, y + aside, x + half, y + aside


def _first_laid(
    model: "TargetModel", lines: Iterable[tuple[float, float, float, float]], above: float
) -> "ModelPath":
    """The first of the lines (x, y of both ends) that is completely on the object, as seen from
    above.
    """
    from uuv.perception.toolpath.path_shapes import laid_on, line  # imports the ray caster

    refused: ConfigurationError | None = None
    for x0, y0, x1, y1 in lines:
        try:
            return laid_on(model, line([x0, y0, above], [x1, y1, above]), [0.0, 0.0, -1.0])
        except ConfigurationError as error:
            refused = refused or error

    assert refused is not None
    raise ConfigurationError(
        f"{refused}; set site.object.line = x0 y0 x1 y1 [m] for another path"
    ) from refused


@dataclass(frozen=True, kw_only=True)
class HoleManifold(SiteObject):
    """Subsea manifold with two holes, "a" and "b"."""

    clearance: float = option(
        2e-3, "Radial clearance between sampler and hole [mm].", unit=MILLIMETRE
    )
    depth: float = 0.08  # [m] depth of the holes
    chamfer: float = option(2e-3, "Chamfer of the hole's mouth [mm].", unit=MILLIMETRE)

    def __post_init__(self) -> None:
        finite_number(self.clearance, "site.object.clearance [m]", above=0.0)

    def block(self, tool_radius: float) -> "ManifoldBlock":
        """The manifold for a tool of the radius `tool_radius` [m]."""
        from uuv.models.objects.manifold import manifold

        return manifold(tool_radius + self.clearance, self.depth, self.chamfer)

    def draw_pose(self, rng: np.random.Generator) -> Array:
        """True pose: on the seabed, tilted by up to TILT."""
        lean = exp_so3([*rng.uniform(-TILT, TILT, 2), 0.0])
        return pose(
            exp_so3([0.0, 0.0, rng.uniform(-0.6, 0.6)]) @ lean,
            rng.uniform(-0.2, 0.2, 3) - [0.0, 0.0, 1.5],
        )


@dataclass(frozen=True, kw_only=True)
class HandValve(SiteObject):
    """Quarter-turn valve with a handle that turns: a lever, or a T-bar."""

    handle: Literal["lever", "bar"] = "lever"
    radius: float = option(0.285, "Distance from the stem to where a lever is turned [m].")
    torque: float = option(20.0, "Moment at which the valve breaks away [N m].")
    viscous: float = option(20.0, "Viscous friction of the valve [N m s/rad].")
    stuck: bool = option(False, "The valve does not turn at all.")

    def __post_init__(self) -> None:
        self.friction()
        self.shape()

    def shape(self) -> "TurnedValve":
        """The valve's shape, as the vehicle knows it."""
        from uuv.models.site.turned_valve import TurnedValve

        return TurnedValve(handle=self.handle, radius=self.radius)

    def friction(self) -> "HingeFriction":
        """Resistance of its hinge."""
        from uuv.models.site.valve_site import SEIZED, HingeFriction

        resists = HingeFriction(stiction=self.torque, viscous=self.viscous)
        return replace(resists, stiction=SEIZED) if self.stuck else resists


@dataclass(frozen=True, kw_only=True)
class PlugBoard(SiteObject):
    """Panel with two receptacles, and a plug in one of them."""

    start: Literal["a", "b"] = option("a", "Receptacle in which the plug is.")
    friction: float = option(20.0, "Force at which the plug breaks away from its seat [N].")
    mass: float = option(0.8, "Mass of the plug [kg], which the vehicle knows.")
    clearance: float = option(
        2e-3, "Radial clearance between plug and receptacle [mm].", unit=MILLIMETRE
    )
    stuck: bool = option(False, "The plug does not come out at all.")
    debris: bool = option(False, "The other receptacle is filled with debris.")

    def __post_init__(self) -> None:
        self.seat()
        self.shape()

    def shape(self) -> "PluggedPanel":
        """Panel and plug, as the vehicle knows them."""
        from uuv.models.site.plugged_panel import PluggedPanel

        return PluggedPanel(start=self.start, clearance=self.clearance, mass=self.mass)

    def seat(self) -> "Seat":
        """Friction of the receptacles, and what is wrong with them."""
        from uuv.models.site.plugged_panel import Seat

        return Seat(friction=self.friction, stuck=self.stuck, debris=self.debris)

    def draw_pose(self, rng: np.random.Generator) -> Array:
        """True pose: on the seabed, tilted by up to TILT."""
        return HoleManifold().draw_pose(rng)


@dataclass(frozen=True, kw_only=True)
class Ground(SiteObject):
    """Terrain of the seabed, drawn from the seed, and its soil."""

    terrain: Kind | Literal["any"] = option(
        "ripples", "Kind of terrain, drawn from the seed; any: the kinds in turn."
    )
    soil: str = option("sand", "Kind of soil, of `uuv list soils`.")

    def draw(self, seed: int, rng: np.random.Generator) -> "Seabed":
        """The terrain, ALTITUDE below the origin."""
        from uuv.models.site.seabed import seabed

        kind = KINDS[seed % len(KINDS)] if self.terrain == "any" else self.terrain
        middle = rng.uniform(-0.2, 0.2, 3) - np.array([0.0, 0.0, ALTITUDE])
        return seabed(kind, rng, center_W=middle, half=HALF)


SITE_OBJECTS: Registry[SiteObject] = Registry(
    "site_object",
    {
        "Barrel": Barrel,
        "Block": Block,
        "Pile": Pile,
        "KnownObject": KnownObject,
        "Manifold": HoleManifold,
        "HandValve": HandValve,
        "PlugBoard": PlugBoard,
        "Ground": Ground,
        "OpenWater": OpenWater,
    },
)


_WAKE = "uuv.sim.water.cylinder_wake:CylinderWake"
FLOWS: Registry[FlowField] = Registry("flow", {"CylinderWake": _WAKE})


def flow_of(name: str) -> FlowField:
    """The flow field of a kind, given as a registered name or MODULE:CLASS, with the defaults of
    its keys.

    Raises:
        ConfigurationError: There is no such kind, or one of its keys has no default.
    """
    where = "site.flow"
    kind: Any = FLOWS.class_of(name, FlowField, f"[{where}]")

    # Keys without a default can only be set together with the kind.
    free = {MISSING}
    keys = [key for key in fields(kind) if key.init]
    needs = [key.name for key in keys if {key.default, key.default_factory} == free]
    if needs:
        lacks = ", ".join(needs)
        first = f"{where}.kind={name}, {where}.{needs[0]}=..."
        raise ConfigurationError(
            f"{where}: {name} has keys without a default, {lacks}; set the kind and these keys one "
            f"by one: {first}"
        )
    return TableReader().made(kind, {}, where)


@dataclass(frozen=True, kw_only=True)
class Site:
    """Work site: object, pose, and the current as the sum of steady current, flow field, wave and
    gusts.
    """

    object: SiteObject = field(default_factory=Barrel)
    X_WT: Pose | None = None  # true pose of the object; None: drawn from the seed
    current: tuple[float, float, float] = option(
        (0.15, 0.0, 0.0),
        "Steady current [m/s], world axes; flow, wave and gusts come on top.",
        group="water",
    )
    flow: FlowField | None = option(
        None,
        "Flow field, a velocity by position and time: a kind, or MODULE:CLASS "
        "(docs/own_current.md).",
        group="water",
        named=flow_of,
    )
    gust: float = option(0.03, "Standard deviation of the gusts [m/s] per axis.", group="water")
    wave: tuple[float, float, float] = option(
        (0.0, 0.0, 0.0), "Amplitude [m/s] of a regular wave, world axes.", group="water"
    )
    wave_frequency: float = option(0.1, "Frequency of the wave [Hz].", group="water")

    def __post_init__(self) -> None:
        if self.X_WT is not None:
            checked_pose(self.X_WT, "X_WT")
            if isinstance(self.object, Ground):
                raise ConfigurationError("X_WT: terrain has no pose; leave it out")
        if self.flow is not None:
            checked_flow(self.flow, "site.flow")
            if not is_dataclass(self.flow):
                needs = "must be a dataclass, whose fields are keys of a scenario"
                raise ConfigurationError(f"site.flow: {needs}, got {shown(self.flow)}")

    def strongest_water(self, p_W: Array) -> Array:
        """Velocity (3,) [m/s] of steady current and flow field at a point (3,) [m], at the time
        when it is largest.

        Waves and gusts are left out, and a flow field is evaluated at a few times of a run.
        """
        current = np.array(self.current, dtype=np.float64)
        if self.flow is None:
            return current
        velocities = [current + total_velocity((self.flow,), p_W, time) for time in _FLOW_TIMES]
        return max(velocities, key=lambda velocity: float(np.linalg.norm(velocity)))

    def pose(self, rng: np.random.Generator) -> Array:
        """True pose X_WT (4, 4) of the object; drawn even if it is set, so that later draws do not
        change.
        """
        drawn = self.object.draw_pose(rng)
        return drawn if self.X_WT is None else np.array(self.X_WT)


def with_growth_and_dents(
    target: "TargetModel",
    fouled: float,
    dented: float,
    rng: np.random.Generator,
    near: Array | None = None,
) -> "TargetModel | None":
    """`target` with random growth and dents.

    Args:
        target: Model of the clean object.
        fouled: [m] largest height of the growth.
        dented: [m] largest depth of the dents.
        rng: Draws the patches.
        near: (N, 3) [m] points in T around which the patches are drawn; None: all over the object.

    Returns:
        The deformed object; None, without any draw, if both heights are 0.

    Raises:
        ConfigurationError: A height is out of range.
    """
    shown = target
    for name, height in (("fouled", fouled), ("dented", dented)):
        finite_number(height, f"site.object.{name} [m]", least=0.0, most=_HIGHEST)
        if height > 0.0:
            from uuv.models.objects import deformed  # imports compiled kernels

            shown = getattr(deformed, name)(
                shown, rng, _PATCHES, (0.4 * height, height), near=near
            ).target
    return None if shown is target else shown

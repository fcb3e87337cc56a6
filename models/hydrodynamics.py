"""Hydrodynamic coefficients of bodies: data, their table in an MjSpec, forms of plain shapes.

Coefficients are in the body frame, six-vectors (linear; angular) at the body-frame origin (Fossen's
order). They are stored in `body.userdata`, one row of `LAYOUT.size` numbers per body. A compiled
`MjModel` therefore contains its coefficients, and one stateless callback (`uuv.sim.hydrodynamics`)
serves every model of the process.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.bounds import (
    LONGEST,
    SEA_WATER,
    bounded,
    damping_matrix,
    inertia_matrix,
    lengths,
    not_negative,
    positive,
    segment,
)
from uuv.models.water.forms import KINDS, Form, MunkFactor
from uuv.models.water.native_mark import mark
from uuv.sim.interfaces.errors import ConfigurationError, PhysicsWarning
from uuv.sim.interfaces.spatial import Array, checked, readonly, rotation_from_z, shown, skew

ORIGIN: Final = readonly([0.0, 0.0, 0.0])
MAX_STRIPS: Final = 2  # largest number of segments with strip drag per body
MAX_STATIONS: Final = 8  # Gauss-Legendre stations per segment
# prefixes of custom elements with the water of bodies, and with thrusters
ELEMENTS: Final = "water/", "thruster/"
CEILING: Final = 10.0  # [m] above the sea surface z = 0; a wet body above it causes a warning

# numbers per strip: start (3), end (3), normal drag, tangential drag, number of stations
_STRIP_SIZE: Final = 9
_UPPER: Final = np.triu_indices(6)

# Index of each number in a row of `body_user`. The world body has a row of its own. Both kinds of
# row begin with a stamp that changes with the layout, so that a table of another layout or project
# is rejected. The stamp has six digits and is below 1, because MJCF has six digits and, from MuJoCo
# 4.0 on, rounds off numbers that are small beside the others. The records of a body's forms follow
# its row: kind, length, and that many numbers. A kind of 0 ends them.
LAYOUT: Final = SimpleNamespace(
    stamp_value=0.620263,
    stamp=0,
    # stamp of a body's row
    volume=1,
    center_of_buoyancy=2,  # 3
    added_mass=5,  # 21, upper triangle by rows
    linear_damping=26,  # 36, by rows
    quadratic_damping=62,  # 6
    strip_count=68,
    strips=69,  # MAX_STRIPS times 9 numbers
    strip_size=_STRIP_SIZE,
    # [kg/m^3] density of the water; the world's row takes precedence
    body_density=69 + MAX_STRIPS * _STRIP_SIZE,
    size=70 + MAX_STRIPS * _STRIP_SIZE,
    # stamp of the world's row; MJCF does not keep this row
    density=1,
    current_acceleration=2,  # 3
    current_shear=5,  # 3
    compiled=8,  # sum of dof_invweight0, set by uuv.sim.hydrodynamics.compile
    drag_rate=9,  # 2: drag over inertia [1/s] at rest, and its increase per m/s or rad/s
    ceiling=11,  # [m] above z = 0; a wet body above it causes a warning (`attach` sets CEILING)
    seen=12,  # sum of the flags below that the callback has raised, each counted once
    told=13,  # sum of the flags that a Python warning has reported already
    # 2 numbers: 1 + index in `data.userdata` of a simulation's current, or 0; count of numbers
    # there
    flow=14,
)
TOO_FAST: Final = 1  # flag: drag beyond the range for which the time step was found stable
TOO_HIGH: Final = 2  # flag: a wet body above the ceiling
INDEFINITE: Final = 4  # flag: inertia with added mass not positive definite
# flag: `data.userdata` holds other numbers where a simulation has its current
NO_CURRENT: Final = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class StripDrag:
    """Drag of a slender part, integrated along a segment by Gauss-Legendre stations.

    Each station has its own velocity. A swinging link is therefore damped correctly, which is not
    possible with a single 6x6 matrix. Force per length: `-normal |u_n| u_n - tangential |u_t| u_t`,
    the cross-flow principle [Faltinsen 1990, section 7].

    Raises:
        ConfigurationError: a number that is not finite or is negative, or a segment without length.
    """

    start: Array  # (3,) [m], body frame
    end: Array  # (3,) [m], body frame
    normal: float  # [kg/m^2] = 0.5 rho C_d d
    tangential: float = 0.0  # [kg/m^2] = 0.5 rho C_f pi d
    stations: int = field(default=4, metadata={"schema": {"minimum": 1, "maximum": MAX_STATIONS}})

    def __post_init__(self) -> None:
        for name, point in zip(
            ("start", "end"), segment(self.start, self.end, "strip"), strict=True
        ):
            object.__setattr__(self, name, point)
        object.__setattr__(self, "normal", not_negative(self.normal, "strip normal drag [kg/m^2]"))
        object.__setattr__(
            self, "tangential", not_negative(self.tangential, "strip tangential drag [kg/m^2]")
        )
        if not (isinstance(self.stations, int | np.integer) and 1 <= self.stations <= MAX_STATIONS):
            raise ConfigurationError(
                f"strip stations: expected 1 to {MAX_STATIONS}, got {self.stations!r}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyHydrodynamics:
    """Hydrodynamic coefficients of one body, in the body frame. Arrays are read-only copies.

    An asymmetry of the added mass up to 1e-3 of its largest number is removed (PhysicsWarning).

    Raises:
        ConfigurationError: a wrong shape; a number that is not finite or beyond `LARGEST` (lengths:
            `LONGEST`); a negative volume or damping; an added mass that is not symmetric or not
            positive semidefinite; a linear damping whose symmetric part is not positive
            semidefinite.
    """

    volume: float  # [m^3] of displaced water
    center_of_buoyancy: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m]
    added_mass: Array = field(default_factory=lambda: np.zeros((6, 6)))  # (6, 6) [kg, kg m, kg m^2]
    # (6,) or (6, 6) [N s/m, N m s]; kept as (6, 6)
    linear_damping: Array = field(default_factory=lambda: np.zeros(6))
    # (6,) [N s^2/m^2, N m s^2]
    quadratic_damping: Array = field(default_factory=lambda: np.zeros(6))
    strips: StripDrag | tuple[StripDrag, ...] | None = ()  # at most MAX_STRIPS; kept as a tuple
    forms: Form | tuple[Form, ...] = ()  # further terms (`uuv.models.water.forms`); kept as a tuple

    def __post_init__(self) -> None:
        object.__setattr__(self, "volume", not_negative(self.volume, "volume [m^3]"))
        center = bounded(self.center_of_buoyancy, (3,), "center_of_buoyancy [m]", LONGEST)
        object.__setattr__(self, "center_of_buoyancy", center)
        object.__setattr__(self, "added_mass", inertia_matrix(self.added_mass))
        object.__setattr__(self, "linear_damping", damping_matrix(self.linear_damping))

        quadratic = bounded(self.quadratic_damping, (6,), "quadratic_damping")
        if np.any(quadratic < 0.0):
            raise ConfigurationError(
                f"quadratic_damping: must not be negative, got {quadratic.tolist()}"
            )
        object.__setattr__(self, "quadratic_damping", quadratic)

        object.__setattr__(self, "strips", _strips(self.strips))
        object.__setattr__(self, "forms", _forms(self.forms))

    @property
    def segments(self) -> tuple[StripDrag, ...]:
        """The strips, as the tuple in which they are stored."""
        return _strips(self.strips)

    @property
    def terms(self) -> tuple[Form, ...]:
        """The forms, as the tuple in which they are stored."""
        return _forms(self.forms)


def attach(
    spec: mujoco.MjSpec, bodies: Mapping[str, BodyHydrodynamics], water_density: float | None = None
) -> None:
    """Write the coefficients of `bodies` and the density of the water into `spec`.

    Repeated calls add or replace bodies; the last density holds for all. `MjSpec.attach` keeps the
    rows of bodies, MJCF with six digits. No force acts on a body welded to the world.

    Args:
        spec: model to extend.
        bodies: coefficients by body name.
        water_density: [kg/m^3]; by default that of the spec, else `SEA_WATER`.

    Raises:
        ConfigurationError: no MjSpec or mapping, an unknown body, a density <= 0, or foreign user
            data.
    """
    _check_spec(spec)
    if not isinstance(bodies, Mapping):
        raise ConfigurationError(
            f"bodies: expected a mapping of names to BodyHydrodynamics, got {bodies!r}"
        )
    density = (
        density_of(spec)
        if water_density is None
        else float(checked([water_density], (1,), "water_density")[0])
    )
    if not density > 0.0:
        raise ConfigurationError(f"water_density [kg/m^3]: must be positive, got {density}")
    targets = _targets_of(spec, bodies)

    mark(spec)
    rows = {name: pack(coefficients) for name, coefficients in bodies.items()}
    # if negative, MuJoCo uses the longest row, so that attached specs do not conflict
    if spec.nuser_body >= 0:
        spec.nuser_body = max(spec.nuser_body, LAYOUT.size, *map(len, rows.values()))

    world = _row_of(spec.worldbody)
    world[LAYOUT.density] = density
    world[LAYOUT.ceiling] = world[LAYOUT.ceiling] or CEILING
    spec.worldbody.userdata = world

    for name, row in rows.items():
        targets[name].userdata = row
        # MuJoCo stores only the diagonal of a "simple" body's inertia; added mass needs the whole
        # block.
        targets[name].simple = 0

    # The density also holds for bodies of earlier calls.
    for body in spec.bodies[1:]:
        row = body.userdata
        if carries(row) and row[LAYOUT.body_density] != density:
            row[LAYOUT.body_density] = density


def density_of(spec: mujoco.MjSpec) -> float:
    """Density of water [kg/m^3] in `spec`: the world's, else its bodies', else `SEA_WATER`.

    Raises:
        ConfigurationError: the bodies have different densities.
    """
    if carries(spec.worldbody.userdata):
        return float(spec.worldbody.userdata[LAYOUT.density])
    rows = {
        body.name: float(body.userdata[LAYOUT.body_density])
        for body in spec.bodies
        if carries(body.userdata)
    }
    return _common_density(rows) if rows else SEA_WATER


def is_wet(model: mujoco.MjModel) -> bool:
    """True if any row of a compiled model, of the world or of a body, holds hydrodynamics."""
    return any(carries(row) for row in model.body_user)


def water_density(model: mujoco.MjModel) -> float:
    """Density of the water [kg/m^3] of a compiled wet model: the world's, else that of its bodies.

    MJCF does not keep the world's row, so a model that MuJoCo loads from MJCF does not have it.

    Raises:
        ConfigurationError: the bodies have different densities, or the model has no hydrodynamics.
    """
    if carries(model.body_user[0]):
        return float(model.body_user[0, LAYOUT.density])
    rows = {
        model.body(i).name: float(row[LAYOUT.body_density])
        for i, row in enumerate(model.body_user)
        if carries(row)
    }
    if not rows:
        raise ConfigurationError(
            "the model has no hydrodynamics: call uuv.models.hydrodynamics.attach on its spec"
        )
    return _common_density(rows)


def world_row(model: mujoco.MjModel) -> Array:
    """Row of the world of a compiled wet model, a live view; created where it is missing.

    Raises:
        ConfigurationError: as `water_density`.
    """
    row = model.body_user[0]
    if not carries(row):
        row[LAYOUT.density] = water_density(model)
        row[LAYOUT.ceiling] = CEILING
        row[LAYOUT.stamp] = LAYOUT.stamp_value
    return row


def set_current(
    spec: mujoco.MjSpec,
    velocity: ArrayLike = ORIGIN,
    acceleration: ArrayLike = ORIGIN,
    shear: ArrayLike = ORIGIN,
) -> None:
    """Set the current of a model: velocity at z = 0, acceleration and shear, in world axes.

    A simulation can have its own current (`uuv.sim.hydrodynamics.set_current`). A body is exposed
    to the current at the body's origin. A compiled model has the velocity in `opt.wind`, the rest
    in `body_user[0]` (`LAYOUT.current_acceleration`, `current_shear`). MJCF has only the velocity.

    Args:
        spec: model with hydrodynamics attached.
        velocity: (3,) [m/s] at z = 0.
        acceleration: (3,) [m/s^2].
        shear: (3,) [1/s] dv/dz.

    Raises:
        ConfigurationError: no MjSpec, a wrong shape, or `attach` has not been called.
    """
    _check_spec(spec)
    if not any(carries(body.userdata) for body in spec.bodies):
        raise ConfigurationError("set_current: this spec has no hydrodynamics; call attach first")

    attach(spec, {})
    world = _row_of(spec.worldbody)
    world[LAYOUT.current_acceleration :][:3] = checked(
        acceleration, (3,), "current acceleration [m/s^2]"
    )
    world[LAYOUT.current_shear :][:3] = checked(shear, (3,), "current shear [1/s]")
    spec.option.wind = checked(velocity, (3,), "current velocity [m/s]")
    spec.worldbody.userdata = world


def attached(spec: mujoco.MjSpec) -> dict[str, BodyHydrodynamics]:
    """Coefficients stored in `spec`, by body name."""
    return {
        body.name: unpack(_numbers(body.userdata))
        for body in spec.bodies[1:]
        if carries(body.userdata)
    }


def carries(row: Sequence[float] | Array) -> bool:
    """True if a row of user data holds hydrodynamics in the current layout."""
    return len(row) >= LAYOUT.size and bool(row[LAYOUT.stamp] == LAYOUT.stamp_value)


def pack(body: BodyHydrodynamics) -> Array:
    """Encode `body` as a row of user data, (LAYOUT.size,), or longer with forms (see `LAYOUT`)."""
    row = np.zeros(LAYOUT.size)
    row[LAYOUT.stamp] = LAYOUT.stamp_value
    row[LAYOUT.volume] = body.volume
    row[LAYOUT.center_of_buoyancy :][:3] = body.center_of_buoyancy
    row[LAYOUT.added_mass :][:21] = body.added_mass[_UPPER]
    row[LAYOUT.linear_damping :][:36] = body.linear_damping.ravel()
    row[LAYOUT.quadratic_damping :][:6] = body.quadratic_damping
    row[LAYOUT.strip_count] = len(body.segments)

    for k, strip in enumerate(body.segments):
        row[LAYOUT.strips + k * _STRIP_SIZE :][:_STRIP_SIZE] = [
            *strip.start,
            *strip.end,
            strip.normal,
            strip.tangential,
            strip.stations,
        ]

    records = [
        (form.kind, len(numbers), *numbers) for form in body.terms for numbers in [form.numbers()]
    ]
    return np.concatenate([row, *records])


def unpack(row: ArrayLike) -> BodyHydrodynamics:
    """Decode a row of `body_user`; the inverse of `pack`.

    A matrix that is no longer semidefinite because MJCF keeps six digits is replaced by the nearest
    semidefinite one.

    Raises:
        ConfigurationError: the row holds numbers that `BodyHydrodynamics` refuses.
    """
    return _unpacked(checked(row, np.shape(row), "hydrodynamics of a body").tobytes())


@lru_cache(maxsize=512)
def _unpacked(content: bytes) -> BodyHydrodynamics:
    """The body of a row; stored, since an assembly asks for the same bodies dozens of times."""
    row = np.frombuffer(content)

    # After rounding to MJCF's six digits a matrix may no longer be definite.
    added_mass = np.zeros((6, 6))
    added_mass[_UPPER] = row[LAYOUT.added_mass :][:21]
    added_mass = _restored(added_mass + np.triu(added_mass, 1).T)
    linear_damping = row[LAYOUT.linear_damping :][:36].reshape(6, 6)
    symmetric = 0.5 * (linear_damping + linear_damping.T)
    linear_damping = linear_damping + (_restored(symmetric) - symmetric)

    strips = []
    for k in range(min(int(row[LAYOUT.strip_count]), MAX_STRIPS)):
        numbers = row[LAYOUT.strips + k * _STRIP_SIZE :][:_STRIP_SIZE]
        strips.append(
            StripDrag(
                start=numbers[:3],
                end=numbers[3:6],
                normal=float(numbers[6]),
                tangential=float(numbers[7]),
                stations=int(numbers[8]),
            )
        )

    return BodyHydrodynamics(
        volume=float(row[LAYOUT.volume]),
        center_of_buoyancy=row[LAYOUT.center_of_buoyancy :][:3],
        added_mass=added_mass,
        linear_damping=linear_damping,
        quadratic_damping=row[LAYOUT.quadratic_damping :][:6],
        strips=tuple(strips),
        forms=_unpacked_forms(row[LAYOUT.size :]),
    )


def without_forms(row: ArrayLike, whose: str) -> BodyHydrodynamics:
    """Decode a row for a model that does not support forms.

    A PhysicsWarning that begins with `whose` names the forms left out.

    Raises:
        ConfigurationError: as `unpack` does.
    """
    body = unpack(row)
    if body.terms:
        names = ", ".join(sorted({type(form).__name__ for form in body.terms}))
        warnings.warn(
            f"{whose} does not include forms that the plant has: {names}", PhysicsWarning, 3
        )
    return replace(body, forms=())


def trim(
    spec: mujoco.MjSpec, body: str, *, metacentric_height: float, qpos: ArrayLike | None = None
) -> BodyHydrodynamics:
    """Ballast a tree: set volume and centre of buoyancy of `body` so that it floats upright.

    Afterwards the tree's buoyancy equals its weight. The centre of buoyancy is vertically above the
    centre of mass. All other coefficients are unchanged. All bodies must have their coefficients
    attached first.

    Args:
        spec: model, changed in place.
        body: name of the body to ballast.
        metacentric_height: [m] centre of buoyancy above the centre of mass.
        qpos: (nq,) pose of the vehicle; by default qpos0.

    Returns:
        The coefficients now attached to `body`.

    Raises:
        ConfigurationError: a wrong type or shape of an argument, no coefficients on `body`, zero
            gravity, or other bodies that alone displace more mass than the tree has.
    """
    _check_spec(spec)
    here = attached(spec)
    if body not in here:
        raise ConfigurationError(
            f"{body}: has no hydrodynamics; bodies with it are {', '.join(sorted(here))}"
        )

    metacentric_height = float(checked([metacentric_height], (1,), "metacentric_height [m]")[0])
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos = checked(qpos, (model.nq,), "qpos")
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)

    gravity = np.array(model.opt.gravity)
    if not np.any(gravity):
        raise ConfigurationError("trim: gravity is zero")
    up = -gravity / np.linalg.norm(gravity)

    ballasted = model.body(body).id
    root = int(model.body_rootid[ballasted])
    density = density_of(spec)
    mass = float(model.body_subtreemass[root])
    displaced = 0.0  # [kg] displaced by the other bodies
    moment = np.zeros(3)  # [kg m]
    for i in np.flatnonzero(model.body_rootid == root):
        if i != ballasted and carries(model.body_user[i]):
            other = unpack(model.body_user[i])
            p_W = data.xpos[i] + data.xmat[i].reshape(3, 3) @ other.center_of_buoyancy
            displaced += density * other.volume
            moment += density * other.volume * p_W

    needed = mass - displaced
    if needed <= 0.0:
        raise ConfigurationError(
            f"trim: the tree of {body} weighs {mass:.6g} kg, but its other bodies alone displace "
            f"{displaced:.6g} kg"
        )
    p_W = (mass * (data.subtree_com[root] + metacentric_height * up) - moment) / needed
    trimmed = replace(
        here[body],
        volume=needed / density,
        center_of_buoyancy=data.xmat[ballasted].reshape(3, 3).T @ (p_W - data.xpos[ballasted]),
    )
    attach(spec, {body: trimmed})
    return trimmed


# -- plain shapes ----------------------------------------------------------------------------------


def sphere(
    radius: float,
    *,
    center: ArrayLike = ORIGIN,
    drag_coefficient: float = 0.47,
    water_density: float = SEA_WATER,
) -> BodyHydrodynamics:
    """Hydrodynamics of a sphere.

    Added mass is half the displaced mass [Lamb 1932, art. 92]. The drag coefficient is that at
    Reynolds numbers of 1e4 to 1e5 [Hoerner 1965, p. 3-8]. Drag acts at the body origin, so keep
    `center` near it or use strips.

    Args:
        radius: [m].
        center: (3,) [m] in the body frame.
        drag_coefficient: on the frontal area.
        water_density: [kg/m^3].

    Returns:
        Coefficients at the body origin.
    """
    radius = float(lengths([radius], (1,), "radius [m]")[0])
    center = bounded(center, (3,), "center [m]", LONGEST)
    water_density = positive(water_density, "water_density [kg/m^3]")
    drag_coefficient = not_negative(drag_coefficient, "drag_coefficient")

    volume = 4.0 / 3.0 * np.pi * radius**3
    local = np.diag([0.5 * water_density * volume] * 3 + [0.0] * 3)
    drag = 0.5 * water_density * drag_coefficient * np.pi * radius**2

    return BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=center,
        added_mass=moved_added_mass(local, np.eye(3), center),
        quadratic_damping=np.array([drag] * 3 + [0.0] * 3),
    )


def ellipsoid(
    semi_axes: ArrayLike,
    *,
    center: ArrayLike = ORIGIN,
    drag_coefficient: float = 0.47,
    water_density: float = SEA_WATER,
) -> BodyHydrodynamics:
    """Hydrodynamics of an ellipsoid with semi-axes along the body axes.

    Added mass is that of [Lamb 1932, art. 114 and 115]; for two equal axes these are his k-factors
    of spheroids. Drag acts at the body origin.

    Args:
        semi_axes: (3,) [m].
        center: (3,) [m] in the body frame.
        drag_coefficient: on the frontal area of each axis.
        water_density: [kg/m^3].

    Returns:
        Coefficients at the body origin.
    """
    a, b, c = axes = lengths(semi_axes, (3,), "semi_axes [m]")
    center = bounded(center, (3,), "center [m]", LONGEST)
    water_density = positive(water_density, "water_density [kg/m^3]")
    drag_coefficient = not_negative(drag_coefficient, "drag_coefficient")

    volume = 4.0 / 3.0 * np.pi * a * b * c
    area = np.pi * np.array([b * c, a * c, a * b])
    return BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=center,
        added_mass=moved_added_mass(
            np.diag(water_density * volume * _ellipsoid_factors(axes)), np.eye(3), center
        ),
        quadratic_damping=np.concatenate(
            [0.5 * water_density * drag_coefficient * area, np.zeros(3)]
        ),
    )


def box(
    size: ArrayLike,
    *,
    center: ArrayLike = ORIGIN,
    drag_coefficient: float = 1.05,
    water_density: float = SEA_WATER,
) -> BodyHydrodynamics:
    """Estimated hydrodynamics of a rectangular prism with edges along the body axes.

    Added mass along each axis is that of a square prism of the same frontal area [DNV C205, table
    D-2], which becomes a square plate as the length goes to 0. Added inertia is that of the
    inscribed ellipsoid, multiplied by the ratio of the volumes. Drag acts on the frontal areas with
    the coefficient of a cube [Hoerner 1965, p. 3-17]. In rotation the same coefficient applies to
    the local speed of each face. Drag acts at the body origin.

    Args:
        size: (3,) [m] edges.
        center: (3,) [m] in the body frame.
        drag_coefficient: on the frontal areas.
        water_density: [kg/m^3].

    Returns:
        Coefficients at the body origin.
    """
    edges = lengths(size, (3,), "size [m]")
    center = bounded(center, (3,), "center [m]", LONGEST)
    water_density = positive(water_density, "water_density [kg/m^3]")
    drag_coefficient = not_negative(drag_coefficient, "drag_coefficient")

    volume = float(np.prod(edges))
    area = volume / edges
    side = np.sqrt(area)  # [m] side of a square of equal frontal area

    # C_A b/a over b/a: finite at 0, a plate (0.579 pi/4 a^3), and constant for long prisms.
    slenderness = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 10.0]
    reduced = [0.579 * np.pi / 4.0, 0.68, 0.72, 0.72, 0.76, 0.75, 0.78, 0.77, 0.80]
    translation = water_density * side**3 * np.interp(edges / side, slenderness, reduced)

    rotation = water_density * volume * _ellipsoid_factors(edges / 2.0)[3:]
    x, y, z = edges
    # integral of |r|^3 over faces
    spin = np.array([x * (y**4 + z**4), y * (x**4 + z**4), z * (x**4 + y**4)]) / 32.0

    return BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=center,
        added_mass=moved_added_mass(
            np.diag(np.concatenate([translation, rotation])), np.eye(3), center
        ),
        quadratic_damping=0.5 * water_density * drag_coefficient * np.concatenate([area, spin]),
    )


def cylinder(
    radius: float,
    start: ArrayLike,
    end: ArrayLike,
    *,
    normal_coefficient: float = 1.1,
    friction_coefficient: float = 0.02,
    stations: int = 4,
    water_density: float = SEA_WATER,
) -> BodyHydrodynamics:
    """Hydrodynamics of a slender cylinder, such as a link of an arm.

    Added mass is by strip theory: the displaced mass across, none along [Newman 1977, section
    4.15]. Drag is one strip: cross flow on the diameter, skin friction on the circumference
    [Hoerner 1965, p. 3-9 and 3-12].

    Args:
        radius: [m].
        start: (3,) [m] of one end, body frame.
        end: (3,) [m] of the other end, body frame.
        normal_coefficient: drag coefficient across, on the diameter.
        friction_coefficient: drag coefficient along, on the circumference.
        stations: Gauss-Legendre stations of the strip.
        water_density: [kg/m^3].

    Returns:
        Coefficients at the body origin.

    Raises:
        ConfigurationError: a radius that is not positive, or ends that coincide.
    """
    radius = float(lengths([radius], (1,), "radius [m]")[0])
    water_density = positive(water_density, "water_density [kg/m^3]")
    normal_coefficient = not_negative(normal_coefficient, "normal_coefficient")
    friction_coefficient = not_negative(friction_coefficient, "friction_coefficient")
    strip = StripDrag(
        start=bounded(start, (3,), "start [m]", LONGEST),
        end=bounded(end, (3,), "end [m]", LONGEST),
        normal=0.5 * water_density * normal_coefficient * 2.0 * radius,
        tangential=0.5 * water_density * friction_coefficient * 2.0 * np.pi * radius,
        stations=stations,
    )

    # Strip theory: the displaced mass across, none along the axis.
    axis = strip.end - strip.start
    length = float(np.linalg.norm(axis))
    volume = np.pi * radius**2 * length
    mass = water_density * volume
    local = np.diag([mass, mass, 0.0, mass * length**2 / 12.0, mass * length**2 / 12.0, 0.0])
    R = rotation_from_z(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    center = 0.5 * (strip.start + strip.end)

    return BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=center,
        added_mass=moved_added_mass(local, R, center),
        strips=strip,
    )


def moved_added_mass(added_mass: ArrayLike, R: ArrayLike, p: ArrayLike) -> Array:
    """Transform an added mass from a shape's own frame to the body frame.

    Args:
        added_mass: (6, 6) at the shape's origin, in its axes.
        R: (3, 3) orientation of the shape in the body frame.
        p: (3,) [m] origin of the shape in the body frame.

    Returns:
        Added mass (6, 6) at the body origin, in body axes.
    """
    turn = np.kron(np.eye(2), checked(R, (3, 3), "R"))
    shift = np.eye(6)
    shift[:3, 3:] = -skew(checked(p, (3,), "p [m]"))
    moved = shift.T @ turn @ checked(added_mass, (6, 6), "added_mass") @ turn.T @ shift
    return 0.5 * (moved + moved.T)


def _ellipsoid_factors(axes: Array) -> Array:
    """Added mass over displaced mass (6,) [-, -, -, m^2, m^2, m^2] of an ellipsoid.

    Equations (8) of article 114 and (5) of article 115 [Lamb 1932].
    """
    from scipy.special import elliprd

    squares = axes**2

    # Lamb's alpha_0 = abc int_0^inf dl / ((a^2 + l) Delta), which is 2/3 abc R_D.
    alpha = np.array(
        [
            2.0 / 3.0 * np.prod(axes) * elliprd(squares[i - 2], squares[i - 1], squares[i])
            for i in range(3)
        ]
    )

    factors = np.zeros(6)
    factors[:3] = alpha / (2.0 - alpha)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        difference = squares[j] - squares[k]
        total = squares[j] + squares[k]
        slip = alpha[k] - alpha[j]
        # a body of revolution has no added inertia about its axis
        if abs(difference) > 1e-9 * total:
            factors[3 + i] = difference**2 * slip / (5.0 * (2.0 * difference - total * slip))

    return factors


# -- checks ----------------------------------------------------------------------------------------


def _check_spec(spec: mujoco.MjSpec) -> None:
    if not isinstance(spec, mujoco.MjSpec):
        raise ConfigurationError(
            f"spec: expected a mujoco.MjSpec, which is not compiled yet, got {spec!r}"
        )


def _targets_of(spec: mujoco.MjSpec, bodies: Mapping[str, BodyHydrodynamics]) -> dict[str, Any]:
    """Bodies of `spec` by the names of `bodies`, once all of them can have coefficients."""
    targets = {name: _body_named(spec, name) for name in bodies}
    if unknown := sorted((name for name, body in targets.items() if body is None), key=str):
        have = (
            ", ".join(sorted(body.name for body in spec.bodies[1:] if body.name))
            or "no body with a name"
        )
        raise ConfigurationError(
            f"no such body: {', '.join(map(repr, unknown))}; the spec has {have}"
        )

    for name, coefficients in bodies.items():
        if not isinstance(coefficients, BodyHydrodynamics):
            raise ConfigurationError(
                f"{name}: must be BodyHydrodynamics, got {type(coefficients).__name__}"
            )
    for body in [spec.worldbody, *targets.values()]:
        if len(body.userdata) and not carries(body.userdata):
            raise ConfigurationError(f"body {body.name}: its user data holds other data already")
    return targets


def _common_density(rows: dict[str, float]) -> float:
    """Common density [kg/m^3] of all rows, whose keys are body names."""
    if len(set(rows.values())) > 1:
        listed = ", ".join(f"{name} {density:g}" for name, density in rows.items())
        raise ConfigurationError(
            f"the bodies have different densities of water [kg/m^3]: {listed}; attach all of them "
            "with the same density"
        )
    return next(iter(rows.values()))


def _body_named(spec: mujoco.MjSpec, name: object) -> Any:
    """Body of `spec` with that name, other than the world; None if there is none."""
    return (
        spec.body(name) if isinstance(name, str) and name not in ("", spec.worldbody.name) else None
    )


def _numbers(userdata: Sequence[float]) -> Array:
    """Array of MuJoCo's vector `userdata`, number by number: fifteen times as fast as NumPy."""
    return np.array([userdata[k] for k in range(len(userdata))])


def _row_of(body: mujoco.MjsBody) -> Array:
    numbers = _numbers(body.userdata)
    row = np.zeros(max(LAYOUT.size, len(numbers)))
    row[: len(numbers)] = numbers
    row[LAYOUT.stamp] = LAYOUT.stamp_value
    return row


def _restored(symmetric: Array) -> Array:
    """`symmetric` (6, 6), or the nearest semidefinite matrix if rounding made it indefinite."""
    eigenvalues, vectors = np.linalg.eigh(symmetric)
    if not -1e-5 * eigenvalues[-1] < eigenvalues[0] < -1e-9 * eigenvalues[-1]:
        return symmetric
    return (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T


def _strips(values: StripDrag | tuple[StripDrag, ...] | None) -> tuple[StripDrag, ...]:
    if isinstance(values, StripDrag) or not isinstance(values, tuple | list | None):
        values = (values,)
    strips = tuple(values or ())
    if len(strips) > MAX_STRIPS or not all(isinstance(strip, StripDrag) for strip in strips):
        raise ConfigurationError(f"strips: expected at most {MAX_STRIPS} StripDrag, got {strips!r}")
    return strips


def _forms(values: Form | tuple[Form, ...]) -> tuple[Form, ...]:
    forms = tuple(values) if isinstance(values, tuple | list) else (values,)
    if not all(type(form) in KINDS.values() for form in forms):
        names = ", ".join(kind.__name__ for kind in KINDS.values())
        raise ConfigurationError(f"forms: expected any of {names}, got {shown(values)}")
    if sum(isinstance(form, MunkFactor) for form in forms) > 1:
        raise ConfigurationError("forms: a body must have at most one MunkFactor")
    return forms


def _unpacked_forms(tail: Array) -> tuple[Form, ...]:
    forms = []
    at = 0
    while at + 1 < len(tail) and tail[at]:
        kind = tail[at]
        count = tail[at + 1]
        end = at + 2 + int(count)
        if kind not in KINDS or not (count >= 0 and count == int(count)) or end > len(tail):
            raise ConfigurationError(
                f"forms: unknown record of kind {kind:g} with {count:g} numbers"
            )
        forms.append(KINDS[kind].of(tail[at + 2 : end]))
        at = end
    return tuple(forms)

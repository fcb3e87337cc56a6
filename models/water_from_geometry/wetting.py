"""Hydrodynamics of every moving body of a model from its geoms, with origin and uncertainty of each
number.

    spec, notes = read_model("arm.urdf")
    wetted = wet(spec)
    wetted.bodies["forearm"].added_mass

Volume and centre are exact along lines through the union of a body's geoms. Added mass is the
closed form for a sphere or an ellipsoid, else it is computed by panels. Drag is computed from
projected areas. Linear damping cannot be computed from geometry and is set to 0.
"""

import hashlib
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import SEA_WATER, BodyHydrodynamics, moved_added_mass
from uuv.models.water_from_geometry import panels as panel_method
from uuv.models.water_from_geometry.choices import (
    CHOICES,
    FEWEST_PANELS,
    MOST_PANELS,
    PANELS,
    Choice,
)
from uuv.models.water_from_geometry.drag import drag_of, figures
from uuv.models.water_from_geometry.geoms import (
    GeomShells,
    exact_volume,
    geoms_of,
    moving_bodies,
    shells_in_body,
)
from uuv.models.water_from_geometry.panels import PanelSolution
from uuv.models.water_from_geometry.scan import scanned
from uuv.models.water_from_geometry.shells import convex_hull
from uuv.models.water_from_geometry.surface import UnionSurface, union_surface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, finite_number, shown

_COARSER = 4.0  # ratio of the number of panels of the fine surface to that of the coarse one
# multiple of the desired number of panels up to which it is doubled if two surfaces disagree
_FINER = 4
_LINES = 240  # number of lines across the longer side of a body, for its volume
# axes of the lines, such that no face of a usual body is parallel to a line
_ASKEW = exp_so3([0.4, -0.7, 0.3])
_MISSED = 0.1  # relative difference of projected areas, from which on a finer surface is tried
_SOLID = 0.7  # ratio of the volume to that of the convex hull, below which a body is an open frame
_CLOSED_FORMS = ("sphere", "ellipsoid")  # relative uncertainty of the added mass of an open frame
# factor by which drag may be wrong in either direction
_FACTORS = {"plain": 1.3, "solid": 1.5, "frame": 2.0}
_LEAST = 0.01  # relative uncertainty of panels if the extrapolation changes almost nothing
_HULL_FACTOR = 2.0  # factor by which added mass may be wrong if a convex hull replaces a thin body


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """One number, or row of numbers, of a body's hydrodynamics, with its origin and uncertainty."""

    body: str
    quantity: str
    value: str
    origin: str
    uncertainty: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wetted:
    """A model with its water attached."""

    spec: mujoco.MjSpec
    bodies: dict[str, BodyHydrodynamics]
    origins: tuple[Origin, ...]
    dry: tuple[str, ...]  # bodies without hydrodynamics, and the reason


def wet(
    spec: mujoco.MjSpec,
    *,
    geoms: Choice = "auto",
    density: float = SEA_WATER,
    panels: int = PANELS,
    metacentric_height: float | None = None,
) -> Wetted:
    """Attach hydrodynamic coefficients of every moving body of a model, computed from its geoms.

    Earlier substitutes are switched off: `gravcomp`, and density and viscosity of MuJoCo's own
    fluid.

    Args:
        spec: changed in place; bodies without a name get one.
        geoms: geoms that displace water: "visual" those that do not collide, "collision" those that
            do, "all" of both, or "auto" the visual geoms of a body that has some, else its
            collision geoms.
        density: [kg/m^3] of the water.
        panels: desired number of triangles of each body's surface.
        metacentric_height: [m] for a floating vehicle: foam or ballast on its root makes it neutral
            and level (`uuv.models.hydrodynamics.trim`). None: no trimming.

    Returns:
        The model, and the table of its numbers.

    Raises:
        ConfigurationError: the model does not compile, no moving body has geoms, a geom or body has
            no volume or is larger than 20 m, or an argument is out of range.
    """
    density = _checked(geoms, density, panels)
    for k, body in enumerate(spec.bodies[1:], start=1):
        body.name = body.name or f"body_{k}"

    model = _compiled(spec)
    if not moving_bodies(model):
        raise ConfigurationError(
            "no body moves, so none can have hydrodynamics; a vehicle needs a free joint (for a "
            "URDF: --free), an arm needs joints"
        )

    bodies, origins, dry = _waters(spec, model, geoms, density, panels)
    hydrodynamics.attach(spec, bodies, density)
    spec.option.density = spec.option.viscosity = 0.0
    for body in spec.bodies[1:]:
        body.gravcomp = 0.0

    if metacentric_height is not None:
        name, row = _trimmed(spec, model, bodies, metacentric_height)
        bodies[name] = hydrodynamics.attached(spec)[name]
        origins = [
            row,
            *(
                o
                for o in origins
                if o.body != name or o.quantity not in ("volume", "centre of buoyancy")
            ),
        ]

    return Wetted(spec=spec, bodies=bodies, origins=tuple(origins), dry=tuple(dry))


def _checked(geoms: Choice, density: float, panels: int) -> float:
    """The density as a number; ConfigurationError for arguments of `wet` that are out of range."""
    if geoms not in CHOICES:
        raise ConfigurationError(f"geoms: must be one of {', '.join(CHOICES)}, got {shown(geoms)}")
    density = finite_number(density, "density [kg/m^3]", above=0.0, most=1e5)
    if (
        isinstance(panels, bool)
        or not isinstance(panels, int)
        or not FEWEST_PANELS <= panels <= MOST_PANELS
    ):
        raise ConfigurationError(
            f"panels: expected a whole number from {FEWEST_PANELS} to {MOST_PANELS}, got "
            f"{shown(panels)}"
        )
    return density


def _waters(
    spec: mujoco.MjSpec, model: mujoco.MjModel, geoms: Choice, density: float, panels: int
) -> tuple[dict[str, BodyHydrodynamics], list[Origin], list[str]]:
    """Hydrodynamics of the moving bodies by name, the table of their numbers, and the bodies
    without, with the reason.
    """
    bodies: dict[str, BodyHydrodynamics] = {}
    origins: list[Origin] = []
    alike: dict[bytes, str] = {}  # bodies by their shape
    dry = [
        f"{model.body(i).name}: fixed to the world"
        for i in range(1, model.nbody)
        if model.body_weldid[i] == 0
    ]

    for i in moving_bodies(model):
        name = model.body(i).name
        chosen, which = geoms_of(model, i, geoms)
        if not chosen:
            remark = (
                "; it keeps its coefficients"
                if hydrodynamics.carries(spec.body(name).userdata)
                else ""
            )
            dry.append(
                f"{name}: no {'geom' if geoms in ('auto', 'all') else f'{geoms} geom'}{remark}"
            )
            continue

        parts = list(shells_in_body(model, i, chosen))
        solid = [part for part in parts if len(part.shells.corners)]
        if not solid:
            raise ConfigurationError(
                f"{parts[0].name}: encloses no volume ({parts[0].shells.said})"
            )

        first = alike.setdefault(_shape(solid, which), name)
        if first == name:
            bodies[name], rows = _body(name, solid, _counted(len(chosen), which), density, panels)
        else:  # equal bodies, such as stones of a pile or links of a chain, are computed once
            bodies[name] = bodies[first]
            rows = [replace(o, body=name) for o in origins if o.body == first]

        origins += rows
        dry += [
            f"{part.name}: {part.shells.said}" for part in parts if not len(part.shells.corners)
        ]

    if not bodies:
        raise ConfigurationError(f"no moving body has geoms to displace water: {'; '.join(dry)}")
    return bodies, origins, dry


def water_of_shells(
    corners: Array, *, density: float = SEA_WATER, panels: int = PANELS
) -> tuple[float, Array, PanelSolution, UnionSurface]:
    """Volume, centre and added mass of the union of closed shells, by lines and panels.

    Args:
        corners: (T, 3, 3) [m], each shell counter-clockwise from outside.
        density: [kg/m^3].
        panels: desired number of triangles.

    Returns:
        Volume [m^3], centre (3,) [m], added mass at the origin, and the surface for which it was
            computed.

    Raises:
        ConfigurationError: the volume is zero, or the body is so thin that the surface does not
            contain it.
    """
    volume, center, _, _ = _volume(corners)
    surface, solution = _panelled(corners, volume, density, panels)
    if solution is None:
        raise ConfigurationError(
            f"panels: {panels} are too few for so thin a body: their surface encloses "
            f"{surface.held:.0%} of its volume"
        )
    return volume, center, solution, surface


def _shape(parts: list[GeomShells], which: str) -> bytes:
    """Key of a body's shape, equal for bodies of equal geoms."""
    digest = hashlib.sha256(which.encode())
    for part in parts:
        digest.update(f"{part.kind} {part.shells.said} {part.shells.doubt}".encode())
        for numbers in (part.size, part.R, part.p, part.shells.corners):
            digest.update(np.ascontiguousarray(numbers).tobytes())
    return digest.digest()


def _body(
    name: str, parts: list[GeomShells], which: str, density: float, panels: int
) -> tuple[BodyHydrodynamics, list[Origin]]:
    """Coefficients of one body, and their origins."""
    corners = np.vstack([part.shells.corners for part in parts])
    plain = len(parts) == 1 and parts[0].kind != "mesh"
    volume, center, spread, wander, source = _measured(parts, corners, which, plain)
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    closing = sum(part.shells.doubt for part in parts) / volume
    spread = max(spread, closing)

    if plain and parts[0].kind in _CLOSED_FORMS:
        surface = union_surface(corners, volume, panels)
        solution = None
    else:
        surface, solution = _panelled(corners, volume, density, panels)
    matrix, from_where, doubt = _added_mass(
        parts, corners, density, surface, solution, panels, closing
    )

    sort = "plain" if plain else "solid" if volume > _SOLID * convex_hull(corners)[1] else "frame"
    strip, quadratic, drag_source, drag_figure = drag_of(corners, center, surface, density)

    water = BodyHydrodynamics(
        volume=volume,
        center_of_buoyancy=center,
        added_mass=matrix,
        quadratic_damping=quadratic,
        strips=strip,
    )

    factor = f"factor {_FACTORS[sort]:g}"
    rows = (
        (
            "volume",
            f"{1e3 * volume:.4g} l",
            source,
            _percent(max(spread, 1e-4)) if spread else "exact",
        ),
        (
            "centre of buoyancy",
            f"{figures(1e3 * center)} mm",
            source,
            f"{1e3 * max(wander, 0.25 * min(closing, 1.0) * extent):.2g} mm" if spread else "exact",
        ),
        ("added mass", figures(np.diag(matrix)) + " kg, kg m^2", from_where, doubt),
        ("drag", drag_figure, drag_source, factor),
        ("linear damping", "0", "cannot be computed from geometry", "unknown"),
    )

    return water, [
        Origin(body=name, quantity=quantity, value=figure, origin=origin, uncertainty=uncertainty)
        for quantity, figure, origin, uncertainty in rows
    ]


def _measured(
    parts: list[GeomShells], corners: Array, which: str, plain: bool
) -> tuple[float, Array, float, float, str]:
    """Volume [m^3], centre (3,) [m], their spread as in `_volume`, and their origin as text.

    For a `plain` shape they have a closed form, without spread.
    """
    volume, center, spread, wander = _volume(corners)
    if plain:
        source = f"closed form of a {parts[0].kind}, {which}"
        return exact_volume(parts[0]), parts[0].p, 0.0, 0.0, source

    how = "; ".join(dict.fromkeys(part.shells.said for part in parts if part.kind == "mesh"))
    method = "ray integration over the union" if spread else "tetrahedra of its triangles"
    source = f"{method}, {which}" + (f" ({how})" if how else "")
    return volume, center, spread, wander, source


def _volume(corners: Array) -> tuple[float, Array, float, float]:
    """Volume [m^3] and centre (3,) [m] of a union, and their spread over directions of the lines
    [-], [m].

    If the shells do not overlap, volume and centre are exact, from the tetrahedra between the
    origin and the triangles.
    """
    scans = [scanned(corners @ _ASKEW, _LINES, axis) for axis in range(3)]
    volumes = np.array([scan.volume for scan in scans])
    if not volumes.min() > 0.0:
        raise ConfigurationError("the geoms enclose no volume")
    centers = np.array(
        [_ASKEW @ scan.moment / volume for scan, volume in zip(scans, volumes, strict=True)]
    )

    if all(scan.disjoint for scan in scans):
        a, b, c = corners.transpose(1, 0, 2)
        tetrahedra = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        whole = float(tetrahedra.sum())
        return whole, 0.25 * tetrahedra @ (a + b + c) / whole, 0.0, 0.0

    mean = float(volumes.mean())
    return (
        mean,
        centers.mean(axis=0),
        float(np.ptp(volumes)) / mean,
        float(np.ptp(centers, axis=0).max()),
    )


def _panelled(
    corners: Array, volume: float, density: float, panels: int
) -> tuple[UnionSurface, PanelSolution | None]:
    """Surface and added mass, extrapolated if two surfaces agree; None if no surface contains the
    body.
    """

    def solved(count: int) -> tuple[UnionSurface, PanelSolution | None]:
        surface = union_surface(corners, volume, count)
        if not surface.holds_body:
            return surface, None
        return surface, panel_method.added_mass(surface.vertices, surface.triangles, density)

    finest = min(_FINER * panels, MOST_PANELS)
    _, coarse = solved(round(panels / _COARSER))
    while True:
        surface, fine = solved(panels)
        best = fine
        if fine is not None and coarse is not None and fine.panels > coarse.panels:
            best = panel_method.extrapolated(coarse, fine)
            if (
                best.changed is not None
                and best.changed <= panel_method.TRUSTED
                and surface.missed < _MISSED
            ):
                return surface, best

        if 2 * panels > finest:
            return surface, best
        coarse = fine
        panels = 2 * panels


def _added_mass(
    parts: list[GeomShells],
    corners: Array,
    density: float,
    surface: UnionSurface,
    solution: PanelSolution | None,
    panels: int,
    closing: float,
) -> tuple[Array, str, str]:
    """Added mass (6, 6) at the body's origin, with its source and its uncertainty as text.

    The relative uncertainty `closing` of the volume is added to that of the added mass.
    """
    part = parts[0]
    if len(parts) == 1 and part.kind in _CLOSED_FORMS:
        axes = np.full(3, part.size[0]) if part.kind == "sphere" else part.size
        local = hydrodynamics.ellipsoid(axes, water_density=density).added_mass
        return moved_added_mass(local, part.R, part.p), f"closed form of a {part.kind}", "exact"

    if solution is not None:
        source = (
            f"{solution.panels} panels, volume error {100 * (surface.held - 1.0):+.1f} % before "
            "its correction by an offset"
        )
        if surface.missed > _MISSED:
            source += f", projected areas within {100 * surface.missed:.0f} %"
        if solution.changed is None:
            return solution.added_mass, f"{source}; no coarser surface to compare with", "unknown"
        if solution.changed <= panel_method.TRUSTED:
            source += ", extrapolated"

        return (
            solution.added_mass,
            source,
            _percent(
                max(
                    _LEAST,
                    solution.changed,
                    closing,
                    surface.missed if surface.missed > _MISSED else 0.0,
                )
            ),
        )

    # The convex hull replaces a body that is too thin.
    solid, hull_volume = convex_hull(corners)
    whole = union_surface(solid, hull_volume, panels)
    hull_solution = panel_method.added_mass(whole.vertices, whole.triangles, density)
    source = (
        f"{hull_solution.panels} panels on the convex hull, since the body is too thin: panels on "
        f"its surface enclose {surface.held:.0%} of its volume"
    )
    return hull_solution.added_mass, source, f"factor {_HULL_FACTOR:g}"


def _trimmed(
    spec: mujoco.MjSpec, model: mujoco.MjModel, bodies: dict[str, BodyHydrodynamics], height: float
) -> tuple[str, Origin]:
    """Make the floating vehicle neutral; returns the trimmed body, and the table row of its
    volume.
    """
    floating = [
        int(b) for b, kind in zip(model.jnt_bodyid, model.jnt_type, strict=True) if kind == 0
    ]
    names = [model.body(b).name for b in floating]
    if len(names) != 1 or names[0] not in bodies:
        listed = ", ".join(names) or "none"
        raise ConfigurationError(
            f"neutral: the model must have one floating body with water, got {listed}"
        )

    before = bodies[names[0]]
    after = hydrodynamics.trim(spec, names[0], metacentric_height=height)
    change = 1e3 * (after.volume - before.volume)

    return names[0], Origin(
        body=names[0],
        quantity="volume, trimmed",
        value=f"{1e3 * after.volume:.4g} l, centre {figures(1e3 * after.center_of_buoyancy)} mm",
        origin=(
            f"{abs(change):.4g} l of {'foam added' if change > 0.0 else 'volume taken away'} for "
            f"neutral buoyancy, the centre of buoyancy {1e3 * height:g} mm above the centre of mass"
        ),
        uncertainty="that of the masses",
    )


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.copy().compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(
            f"MuJoCo cannot compile the model: {' '.join(str(error).split())}"
        ) from error


def _counted(number: int, which: str) -> str:
    return f"{number} {which}" if number > 1 else f"one {which.removesuffix('s')}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.995 else f"{100.0 * share:.0f} %"

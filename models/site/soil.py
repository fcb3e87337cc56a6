"""Soil resistance of the seabed against a tool, along its axis and sideways, by depth.

Along the axis the tool is treated as a skirt: R(d) = k_p A q_c(d) + k_f U int_0^d q_c dz, with the
cone resistance q_c(z) = q_0 + q_1 z. A is the area of the cutting edge and U the circumference in
contact with soil [DNV 1992]. The extraction force is the second term alone; suction and plug are
neglected.

Sideways, the pressure on a narrow tool of breadth b is a multiple of the passive pressure p(z) =
p_0 + p_1 z. In clay that is 3 s_u at the surface: [Matlock 1970] has p = 3 s_u + gamma' z + J s_u z
/ b per breadth, J = 0.5; here only the term 3 s_u is used. In sand it is 3 K_p gamma' z [Broms
1964].

A blade cuts: it moves the plane wedge ahead of it. The force includes the wedge's weight, the
soil's strength, and friction on blade and failure plane [McKyes 1985], after the fundamental
equation of earthmoving [Reece 1964]. The slip angle is that of least resistance. For a smooth
upright blade the result is Rankine's K_p gamma' z and 2 s_u. The component along the tool, and the
soil collected by a box, are neglected.

Verified against the source or a secondary account: the form of both laws, Matlock's 3 s_u, the
wedge. Assumed are:

- the factors k_p and k_f, stated to be the most probable of the Notes (field tests found k_p less
  in medium dense sand);
- the factor 3 of sand;
- gamma' = 9 kN/m^3 with a friction of 32 deg, and two thirds of that for steel;
- q_c in the first decimetres: 8 MPa/m in sand, 12 s_u in mud of s_u = 2 kPa + 3 kPa/m;
- the quake.

These figures are orders of magnitude, not data of a site.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.registry import MadeForm, Registry
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

NARROW = 3.0  # pressure on a narrow tool in sand, as a multiple of Rankine's
_SLIP_ANGLES = 3_000  # number of slip angles in the search for the least resistance


@dataclass(frozen=True, slots=True, kw_only=True)
class Soil:
    """Soil whose resistances grow linearly with depth."""

    cone: float  # [Pa] cone resistance q_0 at the surface
    cone_growth: float  # [Pa/m] growth q_1 of the cone resistance with depth
    tip_factor: float  # k_p, factor of the cone resistance on the edge
    side_factor: float  # k_f, factor of the cone resistance on the skin
    passive: float  # [Pa] passive pressure p_0 on a wide blade at the surface
    passive_growth: float  # [Pa/m] growth p_1 of the passive pressure with depth
    narrow: float  # factor of that pressure on a narrow tool
    friction: float = 0.0  # [rad] angle of internal friction
    wall_friction: float = 0.0  # [rad] friction of steel on the soil
    quake: float = 1e-3  # [m] elastic displacement before the soil yields

    def __post_init__(self) -> None:
        for field in fields(self):
            figure = getattr(self, field.name)
            if not (np.isfinite(figure) and figure >= 0.0):
                raise ConfigurationError(
                    f"soil {field.name}: must be finite and >= 0, got {figure}"
                )

        if not (self.quake > 0.0 and self.cone + self.cone_growth > 0.0):
            raise ConfigurationError(
                f"soil: quake must be > 0, and one of the two cone resistances, got {self}"
            )
        if not self.wall_friction <= self.friction < 0.5 * np.pi:
            raise ConfigurationError(
                f"soil: wall_friction <= friction < pi/2 [rad] must hold, got {self}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class SoilTool:
    """Geometry of the part of a tool that penetrates the soil."""

    edge: float  # [m^2] area of the cutting edge
    skin: float  # [m] circumference in contact with soil, inside and outside
    breadth: float  # [m] width across the direction of sideways motion
    rake: float | None = None  # [rad] angle of a blade from the horizontal; None: a tube

    def __post_init__(self) -> None:
        if not (self.edge > 0.0 and self.skin > 0.0 and self.breadth > 0.0):
            raise ConfigurationError(f"soil tool: edge, skin and breadth must be > 0, got {self}")
        if self.rake is not None and not 0.0 < self.rake <= 0.5 * np.pi:
            raise ConfigurationError(f"soil tool: rake must lie in (0, pi/2] rad, got {self.rake}")


def sand(growth: float = 8e6) -> Soil:
    """Sand whose cone resistance grows by `growth` [Pa/m]."""
    friction = float(np.radians(32.0))

    return Soil(
        cone=0.0,
        cone_growth=growth,
        tip_factor=0.3,
        side_factor=0.001,
        passive=0.0,
        passive_growth=rankine(friction) * 9e3,
        narrow=NARROW,
        friction=friction,
        wall_friction=friction * 2.0 / 3.0,
    )


def mud(strength: float = 2e3, growth: float = 3e3) -> Soil:
    """Soft clay of undrained shear `strength` [Pa] at the surface, growing by `growth` [Pa/m]."""
    return Soil(
        cone=12.0 * strength,
        cone_growth=12.0 * growth,
        tip_factor=0.4,
        side_factor=0.03,
        passive=2.0 * strength,
        passive_growth=2.0 * growth,
        narrow=1.5,
    )


def rankine(friction: float) -> float:
    """Rankine's K_p: passive over vertical pressure at a smooth wall; internal `friction` [rad]."""
    return float(np.tan(0.25 * np.pi + 0.5 * friction) ** 2)


_FORM = MadeForm("a uuv.models.site.soil.Soil", lambda candidate: isinstance(candidate, Soil))
SOILS = Registry("soil", {"sand": sand, "mud": mud}, form=_FORM)


def core_tube(radius: float, wall: float) -> SoilTool:
    """Open tube of outer `radius` and `wall` [m] as a soil tool."""
    if not 0.0 < wall < radius:
        raise ConfigurationError(
            f"core tube: wall must be above 0 and below radius, got wall {wall} m and radius "
            f"{radius} m"
        )

    inner = radius - wall
    return SoilTool(
        edge=float(np.pi * (radius**2 - inner**2)),
        skin=float(2.0 * np.pi * (radius + inner)),
        breadth=2.0 * radius,
    )


def box(width: float, length: float, wall: float, rake: float) -> SoilTool:
    """Box open below, as a soil tool that is dragged with its cutting edge ahead.

    Args:
        width: [m] across the direction of motion.
        length: [m] along the direction of motion.
        wall: [m] thickness.
        rake: [rad] of the cutting edge, from the horizontal.

    Returns:
        The tool.

    Raises:
        ConfigurationError: walls thicker than half the box.
    """
    if not 0.0 < 2.0 * wall < min(width, length):
        raise ConfigurationError(
            f"box: wall must be above 0 and below half of width and length, got wall {wall}, width "
            f"{width} and length {length} m"
        )

    outer = 2.0 * (width + length)
    inner = 2.0 * (width + length - 4.0 * wall)
    edge = width * length - (width - 2.0 * wall) * (length - 2.0 * wall)

    return SoilTool(edge=edge, skin=outer + inner, breadth=width, rake=rake)


def push_resistance(soil: Soil, tool: SoilTool, depth: ArrayLike) -> Array:
    """Axial force [N] of the soil against further penetration.

    Args:
        soil: parameters.
        tool: geometry.
        depth: [m] of the edge below the surface, of any shape.

    Returns:
        Force, of the shape of `depth`.
    """
    d = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    tip = soil.tip_factor * tool.edge * (soil.cone + soil.cone_growth * d)
    return np.where(d > 0.0, tip + pull_resistance(soil, tool, d), 0.0)


def pull_resistance(soil: Soil, tool: SoilTool, depth: ArrayLike) -> Array:
    """Axial force [N] of the soil against extraction.

    Args:
        soil: parameters.
        tool: geometry.
        depth: [m] of the edge below the surface, of any shape.

    Returns:
        Force, of the shape of `depth`.
    """
    d = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    return soil.side_factor * tool.skin * (soil.cone * d + 0.5 * soil.cone_growth * d**2)


def side_resistance(soil: Soil, tool: SoilTool, depth: ArrayLike) -> Array:
    """Force [N] of the soil against sideways motion of the tool.

    Args:
        soil: parameters.
        tool: geometry.
        depth: [m] of the edge below the surface, of any shape.

    Returns:
        Force, of the shape of `depth`.
    """
    d = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    factor = soil.narrow if tool.rake is None else cutting_factor(soil, tool.rake)
    return factor * tool.breadth * (soil.passive * d + 0.5 * soil.passive_growth * d**2)


def cutting_factor(soil: Soil, rake: float) -> float:
    """Horizontal cutting force on a blade at `rake` [rad] over Rankine's passive pressure on it.

    The wedge's factors are N_gamma = (cot a + cot b) / 2 D and N_c = (1 + cot b cot(b + phi)) / D,
    with D = cos(a + delta) + sin(a + delta) cot(b + phi) [McKyes 1985]. Here a is the rake and b
    the slip angle of the least force. Soil with internal friction is taken without cohesion, other
    soil without weight.
    """
    phi = soil.friction
    out = rake + soil.wall_friction

    b = np.linspace(0.0, 0.5 * np.pi, _SLIP_ANGLES)[1:-1]
    least = np.cos(out) + np.sin(out) / np.tan(b + phi)

    if phi > 0.0:
        force = 0.5 * (1.0 / np.tan(rake) + 1.0 / np.tan(b))
        smooth = 0.5 * rankine(phi)
    else:
        force = 1.0 + 1.0 / (np.tan(b) * np.tan(b + phi))
        smooth = 2.0

    return float(np.min(force[least > 0.0] / least[least > 0.0]) * np.sin(out) / smooth)


def depth_for(soil: Soil, tool: SoilTool, push: float) -> float:
    """Depth [m] at which the soil stops `tool`, where `push_resistance` reaches `push`.

    Args:
        soil: parameters.
        tool: geometry.
        push: [N] axial force.

    Returns:
        Depth of the edge, 0 where the surface already resists.
    """
    # The force `push` is reached where a d^2 + b d + c = 0.
    a = 0.5 * soil.side_factor * tool.skin * soil.cone_growth
    b = soil.tip_factor * tool.edge * soil.cone_growth + soil.side_factor * tool.skin * soil.cone
    c = soil.tip_factor * tool.edge * soil.cone - push

    if c >= 0.0:
        return 0.0
    return float(-2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c)))

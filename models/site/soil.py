"""Soils of the seabed, and how they resist a tool: along its axis, and sideways, over the depth.

Along the axis as a skirt: R(d) = k_p A q_c(d) + k_f U int_0^d q_c dz, with the cone resistance q_c(z) = q_0 + q_1 z,
the area A of the cutting edge and the circumference U that the soil rubs on: the method of Det Norske Veritas 1992,
Classification Notes 30.4, Foundations. Drawing it out costs the second term alone; no suction, no plug.

Sideways a narrow tool of breadth b bears a multiple of the passive pressure p(z) = p_0 + p_1 z: in clay 3 s_u at the
surface (Matlock 1970: p = 3 s_u + gamma' z + J s_u z / b per breadth, J = 0.5; of which 3 s_u is kept), in sand
3 K_p gamma' z (Broms 1964). A blade cuts: the plane wedge before it, whose weight, strength, and friction on blade and
failure plane (McKyes 1985, Soil Cutting and Tillage, after Reece 1964, the fundamental equation of earthmoving), at the
slip angle of least resistance; for a smooth upright blade that is Rankine's K_p gamma' z and 2 s_u. What of it acts
along the tool, and the soil that a box has taken up, are left out.

Checked against the source or another's account of it: the form of both laws, Matlock's 3 s_u, the wedge. Assumed: the
factors k_p and k_f, said to be the most probable of the Notes (field tests found k_p less in medium dense sand); the 3
of sand; gamma' = 9 kN/m^3 with a friction of 32 deg, steel on it two thirds of that; q_c in the first decimetres, 8
MPa/m in sand, 12 s_u in mud of s_u = 2 kPa + 3 kPa/m; the quake. They are orders of magnitude, not a place.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

NARROW = 3.0  # times Rankine's pressure that a narrow tool feels in sand
_SLIP_ANGLES = 3_000  # tried


@dataclass(frozen=True, slots=True, kw_only=True)
class Soil:
    """One soil; resistances grow linearly from the surface down."""

    cone: float  # [Pa] cone resistance at the surface,
    cone_growth: float  # [Pa/m]
    tip_factor: float  # k_p
    side_factor: float  # k_f
    passive: float  # [Pa] pressure on a wide blade at the surface,
    passive_growth: float  # [Pa/m]
    narrow: float  # times as much on a narrow tool
    friction: float = 0.0  # [rad] inner,
    wall_friction: float = 0.0  # [rad] and of steel on it
    quake: float = 1e-3  # [m] it gives way elastically before it yields

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ConfigurationError(f"soil {item.name}: must be finite and >= 0, got {value}")
        if not (self.quake > 0.0 and self.cone + self.cone_growth > 0.0):
            raise ConfigurationError(f"soil: quake and the cone resistance must be > 0, got {self}")
        if not self.wall_friction <= self.friction < 0.5 * np.pi:
            raise ConfigurationError(f"soil: wall_friction <= friction < pi/2 [rad] must hold, got {self}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SoilTool:
    """What of a tool meets the soil."""

    edge: float  # [m^2] area of the cutting edge
    skin: float  # [m] circumference that the soil rubs on, inside and outside
    breadth: float  # [m] that faces the soil when it is moved sideways
    rake: float | None = None  # [rad] of a blade, from level, ahead of which the soil is; None: a tube

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
    """Soft clay of undrained shear strength `strength` [Pa] at the surface, growing by `growth` [Pa/m]."""
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
    """K_p, passive over vertical pressure in soil of inner `friction` [rad] at a smooth wall."""
    return float(np.tan(0.25 * np.pi + 0.5 * friction) ** 2)


SOILS = {"sand": sand(), "mud": mud()}


def core_tube(radius: float, wall: float) -> SoilTool:
    """An open tube of outer `radius` and `wall` [m]."""
    if not 0.0 < wall < radius:
        raise ConfigurationError(f"core tube: 0 < wall < radius, got {wall} and {radius} m")
    inner = radius - wall
    return SoilTool(
        edge=float(np.pi * (radius**2 - inner**2)), skin=float(2.0 * np.pi * (radius + inner)), breadth=2.0 * radius
    )


def box(width: float, length: float, wall: float, rake: float) -> SoilTool:
    """A box of `width` across its way and `length` along it, open below, of `wall` [m]; its cutting edge at `rake`
    [rad] from level."""
    if not 0.0 < 2.0 * wall < min(width, length):
        raise ConfigurationError(f"box: 0 < 2 wall < width, length; got {wall}, {width}, {length} m")
    outer, inner = 2.0 * (width + length), 2.0 * (width + length - 4.0 * wall)
    edge = width * length - (width - 2.0 * wall) * (length - 2.0 * wall)
    return SoilTool(edge=edge, skin=outer + inner, breadth=width, rake=rake)


def push_resistance(soil: Soil, tool: SoilTool, depth: ArrayLike) -> Array:
    """Force [N] with which `soil` stops `tool` from going deeper, its edge `depth` [m] below the surface."""
    d = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    tip = soil.tip_factor * tool.edge * (soil.cone + soil.cone_growth * d)
    return np.where(d > 0.0, tip + pull_resistance(soil, tool, d), 0.0)


def pull_resistance(soil: Soil, tool: SoilTool, depth: ArrayLike) -> Array:
    """Force [N] with which it holds the tool back on the way out."""
    d = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    return soil.side_factor * tool.skin * (soil.cone * d + 0.5 * soil.cone_growth * d**2)


def side_resistance(soil: Soil, tool: SoilTool, depth: ArrayLike) -> Array:
    """Force [N] against which the tool moves sideways."""
    d = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    factor = soil.narrow if tool.rake is None else cutting_factor(soil, tool.rake)
    return factor * tool.breadth * (soil.passive * d + 0.5 * soil.passive_growth * d**2)


def cutting_factor(soil: Soil, rake: float) -> float:
    """Level part of the force that cuts `soil` with a blade at `rake` [rad], over Rankine's passive pressure on it.

    Of the wedge's factors (McKyes 1985): N_gamma = (cot a + cot b) / 2 D, N_c = (1 + cot b cot(b + phi)) / D, with
    D = cos(a + delta) + sin(a + delta) cot(b + phi), at the slip angle b of the least; a is the rake. Soil with inner
    friction is taken as without strength of its own, other soil as without weight.
    """
    phi, out = soil.friction, rake + soil.wall_friction
    b = np.linspace(0.0, 0.5 * np.pi, _SLIP_ANGLES)[1:-1]
    least = np.cos(out) + np.sin(out) / np.tan(b + phi)
    if phi > 0.0:
        force, smooth = 0.5 * (1.0 / np.tan(rake) + 1.0 / np.tan(b)), 0.5 * rankine(phi)
    else:
        force, smooth = 1.0 + 1.0 / (np.tan(b) * np.tan(b + phi)), 2.0
    return float(np.min(force[least > 0.0] / least[least > 0.0]) * np.sin(out) / smooth)


def depth_for(soil: Soil, tool: SoilTool, push: float) -> float:
    """Depth [m] at which the soil stops `tool` under `push` [N]: where `push_resistance` reaches it."""
    a = 0.5 * soil.side_factor * tool.skin * soil.cone_growth
    b = soil.tip_factor * tool.edge * soil.cone_growth + soil.side_factor * tool.skin * soil.cone
    c = soil.tip_factor * tool.edge * soil.cone - push
    if c >= 0.0:
        return 0.0
    return float(-2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c)))

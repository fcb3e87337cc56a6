"""Soils of the seabed, and how they resist a tool: along its axis, and sideways, over the depth.

Along the axis as a skirt: R(d) = k_p A q_c(d) + k_f U int_0^d q_c dz, with the cone resistance q_c(z) = q_0 + q_1 z,
the area A of the cutting edge and the circumference U that the soil rubs on (Det Norske Veritas 1992, Classification
Notes 30.4, Foundations, sec. 7; most probable k_p 0.3 and k_f 0.001 in sand, 0.4 and 0.03 in clay). Drawing it out
costs the second term alone; no suction, no plug.

Sideways as a pile's or a wall's passive pressure p(z) = p_0 + p_1 z over the breadth b that faces the motion: of a
narrow tool 3 K_p gamma' z in sand and 3 s_u, its value at the surface, in clay (Broms 1964; Matlock 1970), of a wide
blade K_p gamma' z and 2 s_u (Rankine).

Sand grows firmer from nothing, gamma' = 9 kN/m^3 and K_p = 3.3 (friction 32 deg); the growth of q_c in the first
decimetres, 3 to 15 MPa/m from loose to medium dense, and the strength of mud, s_u = 2 kPa + 3 kPa/m with q_c = 12 s_u,
are orders of magnitude, not a place.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

NARROW = 3.0  # share of Rankine's pressure that a narrow tool feels in sand, Broms


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
    quake: float = 1e-3  # [m] it gives way elastically before it yields, a thirtieth of a small tube's diameter

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ConfigurationError(f"soil {item.name}: must be finite and >= 0, got {value}")
        if not (self.quake > 0.0 and self.cone + self.cone_growth > 0.0):
            raise ConfigurationError(f"soil: quake and the cone resistance must be > 0, got {self}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SoilTool:
    """What of a tool meets the soil."""

    edge: float  # [m^2] area of the cutting edge
    skin: float  # [m] circumference that the soil rubs on, inside and outside
    breadth: float  # [m] that faces the soil when it is moved sideways
    wide: bool  # a blade, not a tube

    def __post_init__(self) -> None:
        if not (self.edge > 0.0 and self.skin > 0.0 and self.breadth > 0.0):
            raise ConfigurationError(f"soil tool: edge, skin and breadth must be > 0, got {self}")


def sand(growth: float = 8e6) -> Soil:
    """Sand whose cone resistance grows by `growth` [Pa/m]."""
    return Soil(
        cone=0.0, cone_growth=growth, tip_factor=0.3, side_factor=0.001, passive=0.0, passive_growth=3.3 * 9e3,
        narrow=NARROW,
    )  # fmt: skip


def mud(strength: float = 2e3, growth: float = 3e3) -> Soil:
    """Soft clay of undrained shear strength `strength` [Pa] at the surface, growing by `growth` [Pa/m]."""
    return Soil(
        cone=12.0 * strength, cone_growth=12.0 * growth, tip_factor=0.4, side_factor=0.03, passive=2.0 * strength,
        passive_growth=2.0 * growth, narrow=1.5,
    )  # fmt: skip


SOILS = {"sand": sand(), "mud": mud()}


def core_tube(radius: float, wall: float) -> SoilTool:
    """An open tube of outer `radius` and `wall` [m]."""
    if not 0.0 < wall < radius:
        raise ConfigurationError(f"core tube: 0 < wall < radius, got {wall} and {radius} m")
    inner = radius - wall
    return SoilTool(
        edge=float(np.pi * (radius**2 - inner**2)), skin=float(2.0 * np.pi * (radius + inner)), breadth=2.0 * radius,
        wide=False,
    )  # fmt: skip


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
    factor = 1.0 if tool.wide else soil.narrow
    return factor * tool.breadth * (soil.passive * d + 0.5 * soil.passive_growth * d**2)


def depth_for(soil: Soil, tool: SoilTool, push: float) -> float:
    """Depth [m] at which the soil stops `tool` under `push` [N]: where `push_resistance` reaches it."""
    a = 0.5 * soil.side_factor * tool.skin * soil.cone_growth
    b = soil.tip_factor * tool.edge * soil.cone_growth + soil.side_factor * tool.skin * soil.cone
    c = soil.tip_factor * tool.edge * soil.cone - push
    if c >= 0.0:
        return 0.0
    return float(-2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c)))

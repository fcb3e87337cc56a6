"""Contact geometry and limits of a tool."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolContact:
    """The geom that touches, and the force that the tool bears."""

    shape: str
    radius: float  # [m] of the part that touches, across the tool
    length: float  # [m] from the mount to the tool's end, where the tip then is
    mass: float  # [kg] dry
    stiffness: float  # [N/m] along the tool
    give: float  # [m] travel of the mount along the tool
    friction: float = 0.3  # coefficient

    @property
    def most_force(self) -> float:
        """Force [N] along the tool at which its mount meets the end of its travel."""
        return self.stiffness * self.give


def touching(friction: float) -> dict[str, Any]:
    """Fields of the massless geom by which a tool touches the world; its contact parameters take
    precedence.

    Args:
        friction: coefficient of sliding.
    """
    return {
        "mass": 0.0,
        "contype": 1,
        "conaffinity": 2,
        "priority": 1,
        "friction": [friction, 0.005, 0.0001],
        "solref": [0.006, 1.0],
        "solimp": [0.95, 0.99, 0.0005, 0.5, 2.0],
    }

"""Contact geometry and limits of a tool."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolContact:
    """What touches, and what the tool bears."""

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

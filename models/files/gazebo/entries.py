"""Entries of the table of what a vehicle's file carries."""

from dataclasses import dataclass
from typing import Literal

Way = Literal["read", "guessed", "left out"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadEntry:
    """One thing of a file: what became of it, and where it is from."""

    part: str  # link, joint or thruster
    quantity: str
    value: str
    way: Way
    origin: str  # the element or plugin, or the reason

    def line(self) -> str:
        """It in one line."""
        figure = f" {self.value}" if self.value else ""
        return f"{self.part}: {self.quantity}{figure}, {self.way} ({self.origin})"

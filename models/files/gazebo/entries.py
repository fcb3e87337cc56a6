"""Entries of the table of a vehicle file's content."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self, get_args

Way = Literal["read", "guessed", "left out"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadEntry:
    """One item of a file, how it was used, and its source."""

    part: str  # link, joint or thruster
    quantity: str
    value: str
    way: Way
    origin: str  # the element or plugin, or the reason

    @classmethod
    def of(cls, row: Sequence[str]) -> Self:
        """Entry from its five columns, in the order of the fields."""
        part, quantity, value, way, origin = row
        known = next(word for word in get_args(Way) if word == way)
        return cls(part=part, quantity=quantity, value=value, way=known, origin=origin)

    def line(self) -> str:
        """The entry in one line."""
        figure = f" {self.value}" if self.value else ""
        return f"{self.part}: {self.quantity}{figure}, {self.way} ({self.origin})"

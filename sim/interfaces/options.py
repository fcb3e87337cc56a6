"""Options: values of a description that a command line and a call of a job take by a word.

    speed: float = option(0.02, "Speed of the tool along the path [m/s].", group="work")

The word, its unit and what it means stand beside the value; `uuv.jobs` finds them in a scenario.
"""

import math
from collections.abc import Callable
from dataclasses import Field, dataclass, field
from typing import Any, TypeVar

Value = TypeVar("Value")
DEGREE = math.pi / 180.0  # [rad]
MILLIMETRE = 1e-3  # [m]
_METADATA = "option"  # key of a field's metadata
KEPT: Any = object()  # an option with this `closed` neither makes nor removes its table


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """How a field of a description is set from outside."""

    about: str  # what it is, with its unit
    group: str = "job"  # title under which a help text lists it
    word: str = ""  # as a keyword argument; empty: the field's name
    unit: float = 1.0  # value, in the field's unit, of 1 of the option's unit
    everywhere: bool = True  # of every job; False: of those alone whose task heeds it
    closed: Any = KEPT  # value at which its table is absent; another one makes the table
    named: Callable[[str], Any] | None = None  # makes the field's value of a name


def option(
    default: Value,
    about: str,
    *,
    group: str = "job",
    word: str = "",
    unit: float = 1.0,
    everywhere: bool = True,
    closed: Any = KEPT,
    named: Callable[[str], Any] | None = None,
) -> Value:
    """Dataclass field that is also an option of the command.

    A field that is a table or None is true or false as an option: the usual table, or none.

    Args:
        default: Default of the field.
        about: What it is, with the option's unit.
        group: As in `Option`, like the others.
        word: Its keyword.
        unit: Value of 1 of the option's unit.
        everywhere: Whether every job takes it.
        closed: Value at which its table is absent.
        named: Makes the field's value of a name.
    """
    words = {"about": about, "group": group, "word": word}
    declared = Option(**words, unit=unit, everywhere=everywhere, closed=closed, named=named)
    return field(default=default, metadata={_METADATA: declared})


def option_of(of: "Field[Any]") -> Option | None:
    """The option that a field is; None: it is none."""
    return of.metadata.get(_METADATA)


def about_of(of: "Field[Any]") -> str:
    """What a field is, where it is an option; or empty."""
    declared = option_of(of)
    return declared.about if declared is not None else ""

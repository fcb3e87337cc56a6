"""Options: values of a scenario that a command line and a call of a job can set by a keyword.

    speed: float = option(0.02, "Speed of the tool along the path [m/s].", group="work")

The keyword, its unit and its meaning are declared with the value; `uuv.jobs` reads them from a
scenario.
"""

import math
from collections.abc import Callable
from dataclasses import Field, dataclass, field
from typing import Any, TypeVar

Value = TypeVar("Value")
DEGREE = math.pi / 180.0  # [rad]
MILLIMETRE = 1e-3  # [m]
_METADATA = "option"  # key of a field's metadata
KEPT: Any = object()  # value of `closed` for an option that neither makes nor removes its table


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """How a field of a scenario is set from outside."""

    about: str  # description, with the unit
    group: str = "job"  # title under which a help text lists it
    word: str = ""  # keyword; empty: the field's name
    unit: float = 1.0  # value in the field's unit that corresponds to 1 in the option's unit
    everywhere: bool = True  # True: an option of every job; False: only of jobs whose task uses it
    # value at which the field's table is absent; another value creates the table
    closed: Any = KEPT
    named: Callable[[str], Any] | None = None  # function that makes the field's value from a name


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

    The option of a field that is a table or None is true or false: the default table, or None.

    Args:
        default: Default of the field.
        about: Description, with the option's unit.
        group: Title in a help text; see `Option`, also for the following arguments.
        word: Keyword of the option.
        unit: Value in the field's unit of 1 in the option's unit.
        everywhere: Whether every job has the option.
        closed: Value at which the field's table is absent.
        named: Function that makes the field's value from a name.
    """
    words = {"about": about, "group": group, "word": word}
    declared = Option(**words, unit=unit, everywhere=everywhere, closed=closed, named=named)
    return field(default=default, metadata={_METADATA: declared})


def option_of(of: "Field[Any]") -> Option | None:
    """The option that a field declares; None if it declares none."""
    return of.metadata.get(_METADATA)


def about_of(of: "Field[Any]") -> str:
    """Description of a field that is an option; empty for other fields."""
    declared = option_of(of)
    return declared.about if declared is not None else ""

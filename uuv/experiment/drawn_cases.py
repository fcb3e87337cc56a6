"""Drawn cases in a file: values that an experiment drew for each case, to run the same cases again.

    {"experiment": "contact", "cases": [{"case": 0, "values": {"seed": 7, "site.gust": 0.02}}]}

The file is JSON and keeps all digits of a number.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from uuv.sim.interfaces.documents import json_of, named
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import one_of, shown
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.runs.saving import write_json

Case = TypeVar("Case")
_ANY: Mapping[str, Sequence[Any]] = MappingProxyType({})
_WHAT = "drawn cases"
_MOST_BYTES = 64_000_000  # largest size of a file
_READER = TableReader("the table")


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnCase:
    """Values drawn for one case of an experiment."""

    case: int = field(metadata={"schema": {"minimum": 0}})  # number of the case
    values: Mapping[str, Any]  # values by name; the experiment defines the names


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnCases:
    """Content of a file of drawn cases."""

    experiment: str  # name of the experiment that drew them
    cases: tuple[DrawnCase, ...]


def read_cases(file: str | Path, experiment: str) -> tuple[DrawnCase, ...]:
    """The drawn cases in a file, in its order.

    Args:
        file: The file.
        experiment: Name of the experiment that is to run them.

    Raises:
        ConfigurationError: The file cannot be read, has no cases or those of another experiment, or
            has a case number twice.
    """
    where = named(file, _WHAT)
    document = json_of(file, _WHAT, _MOST_BYTES)
    try:
        content = _READER.made(DrawnCases, document)
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from error

    if content.experiment != experiment:
        raise ConfigurationError(
            f"{where}: experiment: allowed {experiment}, got {shown(content.experiment)}"
        )

    if not content.cases:
        raise ConfigurationError(f"{where}: cases: must have at least one entry, got none")
    ((number, count),) = Counter(case.case for case in content.cases).most_common(1)
    if count > 1:
        raise ConfigurationError(f"{where}: case {number} is in it {count} times")
    return content.cases


def made_cases(
    file: str | Path, experiment: str, kind: type[Case], levels: Mapping[str, Sequence[Any]] = _ANY
) -> list[Case]:
    """The drawn cases in a file of an experiment whose values are the fields of its cases.

    Args:
        file: The file.
        experiment: Name of the experiment that is to run them.
        kind: Dataclass of its cases.
        levels: Values of the varied fields, by name. A word must be one of these values, while a
            number may have any value.

    Raises:
        ConfigurationError: As for `read_cases`, or `kind` or `levels` do not allow a value.
    """
    cases = []
    for drawn in read_cases(file, experiment):
        where = f"{named(file, _WHAT)}: case {drawn.case}"
        try:
            case = _READER.made(kind, drawn.values)
            for name, allowed in levels.items():
                if isinstance(word := getattr(case, name, None), str):
                    one_of(word, map(str, allowed), name)
            cases.append(case)
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: {error}") from error
    return cases


def write_cases(file: str | Path, experiment: str, cases: Sequence[DrawnCase]) -> None:
    """Write drawn cases as JSON.

    Args:
        file: The file.
        experiment: Name of the experiment that drew them.
        cases: The cases.
    """
    write_json(file, asdict(DrawnCases(experiment=experiment, cases=tuple(cases))))

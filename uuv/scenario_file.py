"""Scenario files: a `Scenario` as TOML, in SI units and radians, and back.

    name = "clean_barrel"
    seed = 0

    [site]
    current = [0.15, 0.0, 0.0]

    [site.object]
    kind = "Barrel"
    length = 0.6

    [task]
    kind = "SurfaceWork"
    forces = [60.0, 90.0, 60.0]

    [[perturbations]]
    kind = "Water"
    spread = 0.3

A table with a key `kind` is read as the class of that name. A key that is left out has its default.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from uuv.kinds import TRUST, where_moved
from uuv.models.registry import Registry
from uuv.perturbations import perturbation
from uuv.perturbations.perturbation import Perturbation
from uuv.scenario import Scenario, Task
from uuv.sim.interfaces.documents import checked, named, toml_of, toml_text, toml_value
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown
from uuv.sim.interfaces.tables import Table, TableReader
from uuv.sim.runs.run_folder import FORMAT, FORMAT_KEY, checked_format
from uuv.sim.runs.saving import write_whole
from uuv.sim.water.flow_field import FlowField
from uuv.site import FLOWS, SITE_OBJECTS, SiteObject
from uuv.tasks import registry as tasks

PERTURBATIONS = "perturbations"
KIND = "kind"
SCENARIO_FILE = "scenario.toml"  # name of the file in the folder of every run
_MOST = 1_000_000  # [bytes] largest size of a file
_HEADING = "SI units and radians; keys: docs/runs.md, Scenario, and `uuv run JOB --help`"


@cache
def registries() -> Mapping[type, Registry[Any]]:
    """Registry for each base class whose kinds a file names."""
    kinds: dict[type, Registry[Any]] = {SiteObject: SITE_OBJECTS, Task: tasks.registry()}
    return {**kinds, Perturbation: perturbation.registry(), FlowField: FLOWS}


def read_scenario(file: str | Path, *, trust: bool = False) -> Scenario:
    """The scenario in a TOML file.

    Args:
        file: The file.
        trust: Whether to import classes MODULE:CLASS that the file names, which runs their code.

    Raises:
        ConfigurationError: The file cannot be read, has a later format, names code without `trust`
            or code that has moved, or has a key or value that is not allowed; the message names it.
    """
    document = toml_of(file, "scenario", _MOST)
    what = named(file, "scenario")
    checked_format(document, what)
    document.pop(FORMAT_KEY, None)

    refuse_code(document, what, trust=trust)
    try:
        return from_dict(document)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from error


def refuse_code(document: Any, what: str, *, trust: bool) -> None:
    """Refuse a document that names code, MODULE:ATTRIBUTE, before any of the code is imported.

    Code named on the command line needs no permission. Code named in a file does, since the file
    may come from someone else.

    Args:
        document: Tables of the file.
        what: Name of the file, with which the message begins.
        trust: Whether the user has given permission; then nothing is refused.

    Raises:
        ConfigurationError: The document names code, or code of an earlier version that has moved.
    """
    for name in names_of_code(document):
        if moved := where_moved(name):
            raise ConfigurationError(f"{what}: names {shown(name)}: {moved}")

        if trust:
            continue
        raise ConfigurationError(
            f"{what}: names code, {shown(name)}, which is only run with {TRUST}"
        )


def names_of_code(value: Any) -> Iterator[str]:
    """Texts of a document with a colon, except paths, since the name of a module contains no
    slash.
    """
    if isinstance(value, str):
        if ":" in value and "/" not in value:
            yield value
    elif isinstance(value, Mapping | list):
        for entry in value.values() if isinstance(value, Mapping) else value:
            yield from names_of_code(entry)


def write_scenario(scenario: Scenario, file: str | Path) -> None:
    """Write `scenario` as TOML, with all defaults."""
    write_whole(Path(file), f"{FORMAT_KEY} = {FORMAT}\n{to_toml(scenario)}")


def from_dict(nested: Mapping[str, Any]) -> Scenario:
    """The scenario in nested tables.

    Raises:
        ConfigurationError: A key or value is not allowed.
    """
    return _READER.made(Scenario, nested)


def with_values(scenario: Scenario, assignments: Iterable[str], option: str = "--set") -> Scenario:
    """The scenario with other values at some keys of its file.

    Args:
        scenario: The base.
        assignments: As for `assigned`.
        option: Option with the assignments; messages begin with it.

    Raises:
        ConfigurationError: A key or value is not allowed.
    """
    nested = as_dict(scenario)

    try:
        for key, setting in assigned(assignments).items():
            put(nested, key, setting)
        return from_dict(nested)
    except ConfigurationError as error:
        raise ConfigurationError(f"{option}: {error}") from error


def assigned(assignments: Iterable[str]) -> dict[str, Any]:
    """Values by dotted key.

    Args:
        assignments: Each `KEY=VALUE`: a dotted key such as task.speed, and a TOML value; any other
            text is a string.

    Raises:
        ConfigurationError: An assignment has no =, or a value that `documents.checked` refuses.
    """
    settings: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, text = assignment.partition("=")

        if not equals:
            raise ConfigurationError(
                f"must be KEY=VALUE with a key of a scenario file, got {shown(assignment)}"
            )
        settings[key.strip()] = checked(toml_value(text), key.strip())
    return settings


def put(nested: dict[str, Any], key: str, value: Any) -> None:
    """Set the value at a dotted key of a scenario's tables.

    A missing perturbation is appended. A new value of `kind` removes the other keys of its table,
    which belonged to the old kind.

    Raises:
        ConfigurationError: The key is in no table of a scenario.
    """
    *tables, last = key.split(".")

    # The table that holds the key.
    table: Any = nested
    if tables[:1] == [PERTURBATIONS]:
        if len(tables) != 2:
            raise ConfigurationError(f"no parameter {shown(key)}: perturbations.KIND.FIELD")
        several = table.setdefault(PERTURBATIONS, [])
        matching = [entry for entry in several if entry[KIND] == tables[1]]
        if not matching:
            several.append({KIND: tables[1]})
            matching = several[-1:]
        table = matching[0]
    else:
        for name in tables:
            table = table.setdefault(name, {}) if isinstance(table, dict) else None

    if not isinstance(table, dict):
        raise ConfigurationError(
            f"unknown parameter {shown(key)}: no table of a scenario has this key"
        )

    if last == KIND and table.get(KIND) != value:
        table.clear()  # another kind has other keys
    table[last] = value


def as_dict(scenario: Scenario) -> dict[str, Any]:
    """Nested tables of a scenario; None and an empty list of perturbations are left out.

    `kind` is the name of a class that was selected among several.
    """
    return _table(scenario)


def to_toml(scenario: Scenario) -> str:
    """Text of a scenario's file."""
    return toml_text(as_dict(scenario), _HEADING)


def _table(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        several = isinstance(value, tuple(registries()))
        kind = {KIND: _kind_of(value)} if several else {}
        contents = {field.name: getattr(value, field.name) for field in fields(value)}
        return {
            **kind,
            **{
                name: _table(entry)
                for name, entry in contents.items()
                if not _left_out(name, entry)
            },
        }

    return [_table(entry) for entry in value] if isinstance(value, tuple | list) else value


def _left_out(name: str, value: Any) -> bool:
    """True for None, which TOML lacks, and for an empty list of perturbations, so that tables can
    be appended.
    """
    return value is None or (name == "perturbations" and not value)


def _kind_of(value: Any) -> str:
    """Name under which a registry makes the class of `value`; without a registry, MODULE:CLASS."""
    registry = next(known for base, known in registries().items() if isinstance(value, base))
    import_name = f"{type(value).__module__}:{type(value).__qualname__}"
    return registry.name_of(type(value)) or import_name


def flat(nested: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Values of nested tables by their keys, which are joined by dots."""
    flattened: dict[str, Any] = {}
    for key, value in nested.items():
        flattened |= (
            flat(value, f"{before}{key}.") if isinstance(value, dict) else {before + key: value}
        )
    return flattened


def _class_of(kind: type, table: Table, where: str) -> tuple[type, Table, str]:
    """Class for an annotation; for a base class, the class that the table's `kind` names."""
    registry = registries().get(kind)
    if registry is None:
        return kind, table, where

    name = table.get(KIND)
    where_in_file = _READER.place(where)
    if name is None:
        raise ConfigurationError(
            f"{where_in_file}: must have a {KIND}, one of {', '.join(registry.names())}"
        )

    entries = {key: value for key, value in table.items() if key != KIND}
    return registry.class_of(str(name), kind, where_in_file), entries, where


_READER = TableReader(choose=_class_of)

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

Tables with a `kind` are of one of several classes. A key that is left out has its default.
"""

import json
import math
import tomllib
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from models.registry import Registry
from scenarios.perturbations import perturbation
from scenarios.perturbations.perturbation import Perturbation
from scenarios.scenario import Scenario
from scenarios.site import SITE_OBJECTS, SiteObject
from scenarios.tasks import task
from scenarios.tasks.task import Task
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import shown
from sim.runs.saving import write_whole

PERTURBATIONS = "perturbations"
KIND = "kind"
SCENARIO_FILE = "scenario.toml"  # in the folder of every run
_MOST = 1_000_000  # [characters] of a file


@cache
def registries() -> Mapping[type, Registry[Any]]:
    """Registry of each base class of which a file names the kind."""
    return {SiteObject: SITE_OBJECTS, Task: task.registry(), Perturbation: perturbation.registry()}


def read_scenario(file: str | Path) -> Scenario:
    """The scenario in a TOML file.

    Raises:
        ConfigurationError: The file cannot be read, or a key or value is none of those allowed; the message names them.
    """
    path = Path(file)
    try:
        text = path.read_text(encoding="utf-8")
        if len(text) > _MOST:
            raise ConfigurationError(f"scenario {path}: longer than {_MOST} characters")
        found = tomllib.loads(text)
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ConfigurationError(f"scenario {path}: cannot be read ({said})") from error
    try:
        return from_dict(found)
    except ConfigurationError as error:
        raise ConfigurationError(f"scenario {path}: {str(error).removeprefix('--')}") from error


def write_scenario(scenario: Scenario, file: str | Path) -> None:
    """Writes `scenario` as TOML, with every default."""
    write_whole(Path(file), to_toml(scenario))


def from_dict(nested: Mapping[str, Any]) -> Scenario:
    """The scenario in nested tables.

    Raises:
        ConfigurationError: A key or value is none of those allowed.
    """
    return _made(Scenario, nested, "")


def with_values(scenario: Scenario, assignments: Iterable[str], option: str = "--set") -> Scenario:
    """The scenario with other values at some keys of its file.

    Args:
        scenario: The base.
        assignments: As for `assigned`.
        option: Where they were given; messages begin with it.

    Raises:
        ConfigurationError: A key or value is none of those allowed.
    """
    nested = as_dict(scenario)
    try:
        for key, value in assigned(assignments).items():
            put(nested, key, value)
        return from_dict(nested)
    except ConfigurationError as error:
        raise ConfigurationError(f"{option}: {str(error).removeprefix('--')}") from error


def assigned(assignments: Iterable[str]) -> dict[str, Any]:
    """Values by dotted key.

    Args:
        assignments: Each `KEY=VALUE`: a dotted key such as task.speed, and a TOML value; what is none is text.

    Raises:
        ConfigurationError: One has no =.
    """
    values: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals:
            raise ConfigurationError(f"allowed KEY=VALUE with a key of a scenario file, got {shown(assignment)}")
        try:
            values[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            values[key.strip()] = text
    return values


def put(nested: dict[str, Any], key: str, value: Any) -> None:
    """Sets the value at a dotted key of a scenario's tables.

    A perturbation that is missing is appended. Another `kind` empties its table: what it had were keys of the old kind.

    Raises:
        ConfigurationError: The key is in no table of a scenario.
    """
    *tables, last = key.split(".")
    table: Any = nested
    if tables[:1] == [PERTURBATIONS]:
        if len(tables) != 2:
            raise ConfigurationError(f"no parameter {shown(key)}: perturbations.KIND.FIELD")
        several = table.setdefault(PERTURBATIONS, [])
        found = [each for each in several if each[KIND] == tables[1]]
        if not found:
            several.append({KIND: tables[1]})
            found = several[-1:]
        table = found[0]
    else:
        for name in tables:
            table = table.setdefault(name, {}) if isinstance(table, dict) else None
    if not isinstance(table, dict):
        raise ConfigurationError(f"no parameter {shown(key)}: it is in no table of a scenario")
    if last == KIND and table.get(KIND) != value:
        table.clear()  # another kind has other keys
    table[last] = value


def as_dict(scenario: Scenario) -> dict[str, Any]:
    """Nested tables of a scenario; None and an empty list of perturbations are left out.

    `kind` is the name of a class that is one of several.
    """
    return _table(scenario)


def to_toml(scenario: Scenario) -> str:
    """Text of a scenario's file."""
    head = ["# SI units and radians; keys and their meaning: scripts/scenarios/scenario.py, site.py, tasks/"]
    return "\n".join([*head, *_lines(as_dict(scenario), "")]) + "\n"


def _table(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        several = isinstance(value, tuple(registries()))
        kind = {KIND: _kind_of(value)} if several else {}
        own = {field.name: getattr(value, field.name) for field in fields(value)}
        return {**kind, **{name: _table(each) for name, each in own.items() if not _left_out(name, each)}}
    return [_table(each) for each in value] if isinstance(value, tuple | list) else value


def _left_out(name: str, value: Any) -> bool:
    """True for None, which TOML does not know, and for no perturbations: tables of them can then be appended."""
    return value is None or (name == "perturbations" and not value)


def _kind_of(value: Any) -> str:
    """Name under which a registry makes the class of `value`; MODULE:CLASS for one that is in none."""
    registry = next(known for base, known in registries().items() if isinstance(value, base))
    own = f"{type(value).__module__}:{type(value).__qualname__}"
    return registry.name_of(type(value)) or own


def flat(nested: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Values of nested tables by their keys, joined by dots."""
    found: dict[str, Any] = {}
    for key, value in nested.items():
        found |= flat(value, f"{before}{key}.") if isinstance(value, dict) else {before + key: value}
    return found


def _lines(nested: Mapping[str, Any], name: str) -> list[str]:
    plain = {key: value for key, value in nested.items() if not _holds_tables(value)}
    lines = [f"{key} = {_text(value)}" for key, value in plain.items()]
    for key, value in nested.items():
        if key in plain:
            continue
        for each in [value] if isinstance(value, dict) else value:
            brackets = "[{}]" if isinstance(value, dict) else "[[{}]]"
            lines += ["", brackets.format(name + key), *_lines(each, f"{name}{key}.")]
    return lines


def _holds_tables(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # TOML takes no raw delete
    return f"[{', '.join(map(_text, value))}]" if isinstance(value, list) else str(value)


def _made(kind: Any, given: Any, where: str) -> Any:
    """An instance of the dataclass `kind` from the table `given`, which stands at `where` in the file."""
    place = f"[{where}]" if where else "the file"
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{place}: must be a table, got {shown(given)}")
    given = dict(given)
    if kind in registries():
        base, registry, name = kind, registries()[kind], given.pop(KIND, None)
        if name is None:
            raise ConfigurationError(f"{place}: needs a {KIND}; there are {', '.join(registry.names())}")
        kind = registry.maker(str(name))
        if not (isinstance(kind, type) and issubclass(kind, base) and is_dataclass(kind)):
            raise ConfigurationError(
                f"{place}: {registry.kind} {shown(name)} must be a dataclass that inherits {base.__name__}"
            )
    allowed = {field.name: field for field in fields(kind)}
    for key in given:
        if key not in allowed:
            raise ConfigurationError(f"{place} has no {shown(key)}; it has {', '.join(allowed)}")
    for name, field in allowed.items():
        if name not in given and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigurationError(f"{place}: {name} is missing")
    hints = get_type_hints(kind)
    inner = f"{where}." if where else ""
    return kind(**{key: _value(hints[key], value, f"{inner}{key}") for key, value in given.items()})


def _value(hint: Any, given: Any, where: str) -> Any:
    """`given` as the type `hint` asks for."""
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        options = [arg for arg in args if arg is not type(None)]
        if len(options) == 1:
            return _value(options[0], given, where)
        choices = [word for option in options for word in get_args(option)]  # of literals
        return _chosen(choices, given, where)
    if origin is Literal:
        return _chosen(args, given, where)
    if origin is tuple:
        if not isinstance(given, list):
            raise ConfigurationError(f"{where}: must be a list, got {shown(given)}")
        if args[-1] is Ellipsis:
            return tuple(_value(args[0], each, where) for each in given)
        if len(given) != len(args):
            raise ConfigurationError(f"{where}: must be {len(args)} values, got {shown(given)}")
        return tuple(_value(arg, each, where) for arg, each in zip(args, given, strict=True))
    if is_dataclass(hint):
        return _made(hint, given, where)
    return _plain(hint, given, where)


def _chosen(allowed: Any, given: Any, where: str) -> Any:
    if given not in allowed:
        raise ConfigurationError(f"{where}: allowed {', '.join(map(str, allowed))}, got {shown(given)}")
    return given


_WORDS: Mapping[type, tuple[str, Callable[[Any], bool]]] = {
    bool: ("true or false", lambda value: isinstance(value, bool)),
    int: ("a whole number", lambda value: isinstance(value, int) and not isinstance(value, bool)),
    float: ("a number", lambda value: isinstance(value, int | float) and not isinstance(value, bool)),
    str: ("text", lambda value: isinstance(value, str)),
}


def _plain(kind: type, given: Any, where: str) -> Any:
    word, fits = _WORDS[kind]
    if not fits(given):
        raise ConfigurationError(f"{where}: must be {word}, got {shown(given)}")
    try:
        return kind(given)
    except OverflowError as error:
        raise ConfigurationError(f"{where}: must be {word} that a float can hold, got {shown(given)}") from error

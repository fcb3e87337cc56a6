"""Options of a scenario: found in its tables, where they are declared, and set there.

A field that `uuv.sim.interfaces.options.option` declares is an option of every job whose scenario has it. So a job's
function has arguments of its own alone: seed, water, vehicle, sensors, object and task bring theirs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.options import KEPT, Option, option_of
from uuv.sim.interfaces.spatial import shown

_DIGITS = 12  # of a default in another unit: 0.1 mm is no 0.09999999999999999


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioOption:
    """One option of a scenario."""

    word: str  # as a keyword argument
    key: str  # of a scenario file
    declared: Option
    hint: Any  # type of the option's value
    value: Any  # that of the scenario, in the option's unit
    table: type | None = None  # class that a value of True or a table that is absent is made of

    def in_field(self, value: Any) -> Any:
        """An option's value in the unit and type of the field."""
        if self.hint is bool and self.table is not None:
            return self.table() if value else None
        return _scaled(value, self.declared.unit)


def scenario_options(scenario: Scenario) -> dict[str, ScenarioOption]:
    """Options by their words: those of every job, and those that the scenario's task heeds."""
    heeded = scenario.task.heeds
    return {each.word: each for each in _of_table(scenario, "") if each.declared.everywhere or each.word in heeded}


def with_options_set(scenario: Scenario, options: Mapping[str, ScenarioOption], values: Mapping[str, Any]) -> Scenario:
    """The scenario with other values of some options.

    Args:
        scenario: The base.
        options: Of that scenario, by word.
        values: In the options' units, by word.

    Raises:
        ConfigurationError: A value is out of range, or needs another option.
    """
    changes = {options[word].key: (options[word], value) for word, value in values.items()}
    return _changed(scenario, changes, "")


def _of_table(table: Any, before: str) -> Iterator[ScenarioOption]:
    """Options in a table and in the tables within it."""
    hints = _hints(type(table) if not isinstance(table, type) else table)
    for field in fields(table):
        hint, key, declared = hints[field.name], f"{before}{field.name}", option_of(field)
        value = None if isinstance(table, type) else getattr(table, field.name)
        inner = _table_class(hint)

        if declared is not None:
            word = declared.word or field.name
            if inner is not None:
                yield ScenarioOption(
                    word=word, key=key, declared=declared, hint=bool, value=value is not None, table=inner
                )
                continue
            opens = isinstance(table, type)  # the table is absent
            yield ScenarioOption(
                word=word,
                key=key,
                declared=declared,
                hint=hint | None if opens and declared.closed is None else hint,
                value=_absent(declared, field.default) if opens else _shown(value, declared.unit),
            )
        elif is_dataclass(value):
            yield from _of_table(value, f"{key}.")
        elif value is None and inner is not None:
            yield from _of_table(inner, f"{key}.")


def _absent(declared: Option, default: Any) -> Any:
    """Value of an option whose table is absent."""
    return _shown(default, declared.unit) if declared.closed is KEPT else declared.closed


def _table_class(hint: Any) -> type | None:
    """The dataclass of an annotation that allows one or None; None for another annotation."""
    if get_origin(hint) not in (Union, UnionType):
        return None
    several = [each for each in get_args(hint) if each is not NoneType]
    one = several[0] if len(several) == 1 else None
    return one if isinstance(one, type) and is_dataclass(one) else None


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _scaled(value: Any, unit: float) -> Any:
    """A number, or each of several, times a unit."""
    if unit == 1.0 or value is None:
        return value
    return tuple(unit * each for each in value) if isinstance(value, tuple) else unit * value


def _shown(value: Any, unit: float) -> Any:
    """A field's value in the unit of its option."""
    if unit == 1.0 or value is None:
        return value
    if isinstance(value, tuple):
        return tuple(_shown(each, unit) for each in value)
    return float(f"{value / unit:.{_DIGITS}g}")


def _changed(table: Any, changes: Mapping[str, tuple[ScenarioOption, Any]], before: str) -> Any:
    """A table with other values; `changes` by key below it, each an option and its value."""
    values: dict[str, Any] = {}
    inner: dict[str, dict[str, tuple[ScenarioOption, Any]]] = {}
    for key, (option, value) in changes.items():
        name, _, rest = key.partition(".")
        if rest:
            inner.setdefault(name, {})[rest] = option, value
        else:
            values[name] = option.in_field(value)

    for name, within in inner.items():
        place, present = f"{before}{name}", getattr(table, name)
        if present is None:
            values[name] = _opened(table, name, within, f"{place}.")
        elif any(_closes(*pair) for key, pair in within.items() if "." not in key):
            values[name] = None
        else:
            values[name] = _changed(present, within, f"{place}.")
    return replace(table, **values)


def _opened(table: Any, name: str, changes: Mapping[str, tuple[ScenarioOption, Any]], before: str) -> Any:
    """A table that was absent; None where the option that makes it has the value for none.

    Raises:
        ConfigurationError: Options of the table are given without that one.
    """
    kind = _table_class(_hints(type(table))[name])
    assert kind is not None
    openers = {before + field.name: found for field in fields(kind) if (found := _opener(field)) is not None}
    makes = [key for key in changes if before + key in openers]
    if not all(_closes(*changes[key]) for key in makes) and makes:
        given = {key: option.in_field(value) for key, (option, value) in changes.items()}
        return kind(**given)

    others = {key: value for key, (_, value) in changes.items() if key not in makes}
    if others and any(others.values()):
        key, value = next(iter(others.items()))
        raise ConfigurationError(f"{before}{key} {shown(value)}: needs {' or '.join(openers)} too")
    return None


def _opener(field: Any) -> Option | None:
    """The option that makes a table that is absent; None: a field is no such option."""
    declared = option_of(field)
    return declared if declared is not None and declared.closed is not KEPT else None


def _closes(option: ScenarioOption, value: Any) -> bool:
    """True if the value means that there is no table."""
    return option.declared.closed is not KEPT and value == option.declared.closed

"""Options of a scenario, which fields of its tables declare: lists them, and sets their values.

A field that `uuv.sim.interfaces.options.option` declares is an option of every job whose scenario
has the field. So a job's function declares only its own arguments; seed, water, vehicle, sensors,
object and task add theirs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, fields, is_dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.options import KEPT, Option, option_of
from uuv.sim.interfaces.spatial import shown

_DIGITS = 12  # significant, of a default in another unit: 0.1 mm, not 0.09999999999999999


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioOption:
    """One option of a scenario."""

    word: str  # as a keyword argument
    key: str  # key in a scenario file
    declared: Option
    hint: Any  # type of the option's value
    value: Any  # value in the scenario, in the option's unit
    table: type | None = None  # class of the table that an option of true or false adds

    def in_field(self, value: Any) -> Any:
        """An option's value in the unit and type of the field."""
        if self.table is not None:
            return self.table() if value else None
        if self.declared.named is not None and isinstance(value, str):
            return self.declared.named(value)
        return _scaled(value, self.declared.unit)

    def takes(self, value: Any) -> bool:
        """True if the value is an object in place of its name."""
        return self.declared.named is not None and not isinstance(value, str | None)

    def closes(self, value: Any) -> bool:
        """True if the value means that the option's table is absent."""
        return self.declared.closed is not KEPT and value == self.declared.closed


Options = Mapping[str, ScenarioOption]  # by word
Changes = Mapping[str, tuple[ScenarioOption, Any]]  # options and their values, by key below a table


def scenario_options(scenario: Scenario) -> dict[str, ScenarioOption]:
    """Options by name: those of every job, and those that the scenario's task lists in `heeds`.

    Raises:
        ConfigurationError: Two options have the same name.
    """
    options: dict[str, ScenarioOption] = {}
    for option in every_option(scenario):
        if not (option.declared.everywhere or option.word in scenario.task.heeds):
            continue
        if option.word in options:
            both = f"{options[option.word].key} and {option.key}"
            rule = f"both are the option {option.word!r}; rename one of them"
            raise ConfigurationError(f"{both}: {rule}")
        options[option.word] = option
    return options


def every_option(scenario: Scenario) -> Iterator[ScenarioOption]:
    """All options in the scenario's tables, whether its task heeds them or not."""
    yield from _of_table(scenario, "")


def with_options_set(scenario: Scenario, options: Options, values: Mapping[str, Any]) -> Scenario:
    """The scenario with other values of some options.

    Args:
        scenario: The base.
        options: Options of that scenario, by name.
        values: Their values in the options' units, by name.

    Raises:
        ConfigurationError: A value is out of range, or needs another option.
    """
    changes = {options[word].key: (options[word], value) for word, value in values.items()}
    return _changed(scenario, changes, "")


def _of_table(table: Any, before: str) -> Iterator[ScenarioOption]:
    """Options in a table and in its inner tables; a class stands for an absent table."""
    absent = isinstance(table, type)
    hints = _hints(table if absent else type(table))
    for field in fields(table):
        key = f"{before}{field.name}"
        hint = hints[field.name]
        value = None if absent else getattr(table, field.name)
        inner = _table_class(hint)

        # A field without an option may be a table that has some.
        declared = option_of(field)
        if declared is None:
            if is_dataclass(value):
                yield from _of_table(value, f"{key}.")
            elif inner is not None and not absent:
                yield from _of_table(inner, f"{key}.")
            continue

        # An object that is chosen by name.
        word = declared.word or field.name
        if declared.named is not None:
            name = None if value is None else type(value).__name__
            kind = str | None
            yield ScenarioOption(word=word, key=key, declared=declared, hint=kind, value=name)
            continue

        # A table that an option of true or false adds.
        if inner is not None:
            option = ScenarioOption(word=word, key=key, declared=declared, hint=bool, value=False)
            yield replace(option, value=value is not None, table=inner)
            continue

        # A number, a text, or several of them.
        if absent:
            value = _of_absent(declared, field)
            hint = hint | None if declared.closed is None else hint
        else:
            value = _in_unit(value, declared.unit)
        yield ScenarioOption(word=word, key=key, declared=declared, hint=hint, value=value)


def _of_absent(declared: Option, field: "Field[Any]") -> Any:
    """Value of an option whose table is absent."""
    if declared.closed is KEPT:
        return _in_unit(field.default, declared.unit)
    return declared.closed


def _table_class(hint: Any) -> type | None:
    """The dataclass D of an annotation `D | None`; None for another annotation."""
    if get_origin(hint) not in (Union, UnionType):
        return None
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    if len(kinds) == 1 and isinstance(kinds[0], type) and is_dataclass(kinds[0]):
        return kinds[0]
    return None


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _scaled(value: Any, unit: float) -> Any:
    """A number, or each of several, times a unit."""
    if unit == 1.0 or value is None:
        return value
    return tuple(unit * entry for entry in value) if isinstance(value, tuple) else unit * value


def _in_unit(value: Any, unit: float) -> Any:
    """A field's value in the unit of its option."""
    if unit == 1.0 or value is None:
        return value
    if isinstance(value, tuple):
        return tuple(_in_unit(entry, unit) for entry in value)
    return float(f"{value / unit:.{_DIGITS}g}")


def _changed(table: Any, changes: Changes, before: str) -> Any:
    """The table with other values; `before`: its key with a dot."""
    replaced: dict[str, Any] = {}
    within: dict[str, dict[str, tuple[ScenarioOption, Any]]] = {}
    for key, (option, value) in changes.items():
        name, _, rest = key.partition(".")
        if rest:
            within.setdefault(name, {})[rest] = option, value
        else:
            replaced[name] = option.in_field(value)

    # Inner tables are changed, added or removed.
    for name, inner in within.items():
        present = getattr(table, name)
        key = f"{before}{name}."
        if present is None:
            replaced[name] = _opened(_table_class(_hints(type(table))[name]), inner, key)
        elif any(option.closes(value) for k, (option, value) in inner.items() if "." not in k):
            replaced[name] = None
        else:
            replaced[name] = _changed(present, inner, key)
    return replace(table, **replaced)


def _opened(kind: type | None, changes: Changes, before: str) -> Any:
    """The table that the options add; None if the option that adds it is not among them.

    Raises:
        ConfigurationError: Options of the table are given without the one that adds it.
    """
    assert kind is not None
    if any(_makes(option, value) for option, value in changes.values()):
        return kind(**{key: option.in_field(value) for key, (option, value) in changes.items()})

    # Without that option, the others may only have their default values.
    for key, (option, value) in changes.items():
        if option.declared.closed is KEPT and value != option.value:
            makers = [field.name for field in fields(kind) if _is_maker(option_of(field))]
            maker = f"{before}{makers[0]}"
            raise ConfigurationError(f"{before}{key} {shown(value)}: needs {maker} too")
    return None


def _makes(option: ScenarioOption, value: Any) -> bool:
    """True if an option with this value adds the table that it is in."""
    return _is_maker(option.declared) and not option.closes(value)


def _is_maker(declared: Option | None) -> bool:
    return declared is not None and declared.closed is not KEPT

"""Reads tables of documents from outside into dataclasses; an error message names the place of the
fault.

    about = TableReader("study.json").made(About, json_of(folder / "study.json", "study"))

`uuv.sim.interfaces.documents` reads the text. `TableReader` makes dataclasses from the tables
according to the annotations of their fields, or calls functions according to the annotations of
their parameters. A field states its unit and its bounds in its metadata, as keywords of JSON
Schema:

    speed: float = field(metadata={"schema": {"unit": "m/s", "exclusiveMinimum": 0, "maximum": 1}})
"""

import math
import re
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from inspect import Parameter, signature
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.documents import inside
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array, shown

Made = TypeVar("Made")
Schema = Mapping[str, Any]  # keywords of JSON Schema, and `unit`; its `title` is for messages
Table = Mapping[str, Any]
# Function that returns the class or function for a table at a place, together with that table and
# place.
Chooser = Callable[[Any, Table, str], tuple[Callable[..., Any], Table, str]]


@dataclass(frozen=True, slots=True)
class TableReader:
    """Makes dataclasses from tables according to the annotations of their fields.

    Annotations may be numbers, text, literals, lists, tuples, mappings, arrays, dataclasses, `Any`,
    and unions of types that differ in a document: None, text, number, list, table.
    """

    whole: str = "the file"  # name of the outermost table in messages
    choose: Chooser | None = None
    # True: keys that the class lacks are ignored, since a later version may have written them
    passes_unknown: bool = False
    # True: errors that a class itself raises get the place of its table
    places_faults: bool = False

    def made(self, maker: Callable[..., Made], given: Any, where: str = "") -> Made:
        """Object that `maker` makes from the table `given`.

        Args:
            maker: Dataclass or function, or a base class for which `choose` selects one.
            given: Table of a document.
            where: Place of the table in the document; empty for the outermost table.

        Raises:
            ConfigurationError: The table lacks a key, has an unknown key, or has a value of another
                type or out of bounds.
        """
        table = self.table(given, where)
        chosen: Callable[..., Made] = maker
        if self.choose is not None:
            chosen, entry, where = self.choose(maker, table, where)
            table = self.table(entry, where)
        arguments = self.values(chosen, table, where)
        try:
            return chosen(**arguments)
        except ConfigurationError as error:
            if self.places_faults:
                raise ConfigurationError(f"{where or self.whole}: {error}") from error
            raise

    def values(
        self, maker: Callable[..., Any], table: Table, where: str = "", *, complete: bool = True
    ) -> dict[str, Any]:
        """Arguments of `maker` from a table.

        Args:
            maker: Dataclass or function.
            table: Table of a document.
            where: Place of the table in the document.
            complete: False: keys without a default may be missing.

        Raises:
            ConfigurationError: As for `made`.
        """
        slots = _slots(maker)
        known = {key: entry for key, entry in table.items() if key in slots}
        if not self.passes_unknown:
            self.check_keys(table, slots, where)

        missing = [name for name, slot in slots.items() if slot.required and name not in known]
        if complete and missing:
            are = "are" if missing[1:] else "is"
            raise ConfigurationError(f"{self.place(where)}: {', '.join(missing)} {are} missing")

        return {
            key: self._value(slots[key].hint, entry, _Spot(inside(where, key), slots[key].schema))
            for key, entry in known.items()
        }

    def table(self, given: Any, where: str = "") -> dict[str, Any]:
        """Return `given` if it is a table.

        Raises:
            ConfigurationError: It is not a table.
        """
        if not isinstance(given, Mapping):
            raise ConfigurationError(f"{self.place(where)}: must be a table, got {shown(given)}")
        return dict(given)

    def check_keys(self, table: Table, allowed: Iterable[str], where: str = "") -> None:
        """Refuse a table with a key that is not `allowed`.

        Raises:
            ConfigurationError: The table has such a key.
        """
        allowed = list(allowed)
        for key in table:
            if key not in allowed:
                known = ", ".join(allowed) + did_you_mean(key, allowed)
                raise ConfigurationError(f"{self.place(where)} has no {shown(key)}; it has {known}")

    def value(self, hint: Any, item: Any, where: str) -> Any:
        """A value of a document converted to the type `hint`; `where` begins the error message."""
        return self._value(hint, item, _Spot(where, {}))

    def place(self, where: str) -> str:
        """Name of the table at a place, as used in messages."""
        if "[" in where:  # an item of a list: perturbations[0]
            return where
        return f"[{where}]" if where else self.whole

    def _item(self, hint: Any, entry: Any, outer: "_Spot", key: str | int) -> Any:
        """An item of a table or a list, converted to the type `hint`."""
        if not outer.schema and type(entry) in _unchanged(
            hint
        ):  # the most frequent case in a table of rows
            return entry
        return self._value(hint, entry, outer.of(key))

    def _value(self, hint: Any, entry: Any, spot: "_Spot") -> Any:
        """A value converted to the type `hint` and checked against the bounds of its field."""
        typed = self._typed(hint, entry, spot)
        if spot.schema:
            _check_bounds(typed, spot)
        return typed

    def _typed(self, hint: Any, entry: Any, spot: "_Spot") -> Any:
        origin = get_origin(hint)
        args = get_args(hint)
        if entry is None and type(None) in args:
            return None
        if origin in (Union, types.UnionType) and not _is_array(hint):
            return self._typed(_option(args, entry, spot), entry, spot)

        # Single values.
        if hint is Any:
            return entry
        if hint in _WORDS:
            return _plain(hint, entry, spot)
        if origin is Literal:
            return _chosen(args, entry, spot)

        # Lists.
        if _is_array(hint):
            return _array(entry, spot)
        if origin is tuple or origin is list:
            entries = self._several((args[0], Ellipsis) if origin is list else args, entry, spot)
            return entries if origin is list else tuple(entries)

        # Tables.
        if not isinstance(entry, Mapping):
            raise spot.refused("a table", entry)
        if isinstance(origin, type) and issubclass(cast(Any, origin), Mapping):
            return {key: self._item(args[1], element, spot, key) for key, element in entry.items()}
        return self.made(hint, entry, spot.where)

    def _several(self, args: tuple[Any, ...], entry: Any, spot: "_Spot") -> list[Any]:
        """The items of a list: all of one type if `args` ends with an ellipsis, otherwise one type
        for each.
        """
        if not isinstance(entry, list):
            raise spot.refused("a list", entry)
        if args[-1] is Ellipsis:
            args = (args[0],) * len(entry)
        elif len(entry) != len(args):
            raise spot.refused(f"{len(args)} values", entry)

        pairs = enumerate(zip(args, entry, strict=True))
        return [self._item(arg, element, spot, i) for i, (arg, element) in pairs]


# -- what a table is read into ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class WithFields:
    """A function whose `**others` are fields of a class, all of them optional."""

    function: Callable[..., Any]
    others: type

    def __call__(self, **arguments: Any) -> Any:
        """Result of the function."""
        return self.function(**arguments)


@dataclass(frozen=True, slots=True)
class _Slot:
    """A key that a table may have."""

    hint: Any
    required: bool
    schema: Schema


@cache
def _slots(maker: Callable[..., Any]) -> dict[str, _Slot]:
    """Keys in the table of a dataclass or a function; a list of tables calls this for each
    table.
    """
    if isinstance(maker, WithFields):
        slots = _slots(maker.function)
        others = {name: slot for name, slot in _slots(maker.others).items() if name not in slots}
        return slots | {name: _Slot(slot.hint, False, slot.schema) for name, slot in others.items()}

    hints = get_type_hints(maker)
    if is_dataclass(maker):
        return {
            entry.name: _Slot(
                hints[entry.name],
                entry.default is MISSING and entry.default_factory is MISSING,
                entry.metadata.get("schema", {}),
            )
            for entry in fields(maker)
        }

    return {
        name: _Slot(hints[name], parameter.default is Parameter.empty, {})
        for name, parameter in signature(maker).parameters.items()
        if parameter.kind is not Parameter.VAR_KEYWORD
    }


@cache
def _unchanged(hint: Any) -> frozenset[type]:
    """Types whose values are taken unchanged if a document is read as `hint`."""
    plain = {str, int, float, bool, type(None)}
    options = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    return frozenset(plain & {option for option in options if isinstance(option, type)})


# A union. Adding None would give another union or, on newer Pythons, an alias type.
_ARRAY_KINDS = frozenset(get_args(ArrayLike)) or frozenset({ArrayLike})


def _is_array(hint: Any) -> bool:
    if get_origin(hint) is np.ndarray or hint is ArrayLike:
        return True
    return {*get_args(hint)} - {type(None)} == _ARRAY_KINDS


@dataclass(frozen=True, slots=True)
class _Spot:
    """Place of a value in a document, with the metadata of its field."""

    where: str
    schema: Schema

    def of(self, key: str | int) -> "_Spot":
        """Place of an item of this list, or of a value of this table."""
        unit = {"unit": self.schema["unit"]} if "unit" in self.schema else {}
        stated = self.schema.get("items" if isinstance(key, int) else "additionalProperties")
        schema = {**unit, **stated} if isinstance(stated, Mapping) else unit
        return _Spot(inside(self.where, key), schema)

    def refused(self, words: str, entry: Any, hint: str = "") -> ConfigurationError:
        """Error for a value that does not fit its field's title or, without a title, `words`."""
        unit = f" [{self.schema['unit']}]" if "unit" in self.schema else ""
        allowed = self.schema.get("title", words)
        key = f"{self.where}{unit}"
        return ConfigurationError(f"{key}: must be {allowed}, got {shown(entry)}{hint}")

    @property
    def limits(self) -> str:
        """Bounds of a number in words; empty if there are none."""
        words = []
        for key, (word, _) in _BOUNDS.items():
            if key in self.schema:
                bound = self.schema[key]
                words.append(f"{word} {bound if isinstance(bound, int) else f'{bound:g}'}")
        return " and ".join(words)


def _option(options: Iterable[Any], entry: Any, spot: _Spot) -> Any:
    """The type in a union that a value belongs to; literals count as one type."""
    options = [option for option in options if option is not type(None)]
    literals = [option for option in options if get_origin(option) is Literal]
    if literals:
        words = tuple(word for option in literals for word in get_args(option))
        options = [Literal[words], *(option for option in options if option not in literals)]
    if len(options) == 1:
        return options[0]

    fitting = [option for option in options if _kind(option)[1](entry)]
    if not fitting:
        kinds = " or ".join(dict.fromkeys(_kind(option)[0] for option in options))
        raise spot.refused(kinds, entry, _if_quoted(options, entry))
    return fitting[0]


def _kind(hint: Any) -> tuple[str, Callable[[Any], bool]]:
    """Name of the type `hint` in messages, and a function that tests a value for this type."""
    if hint in _WORDS:
        return _WORDS[hint]
    origin = get_origin(hint)
    if origin is Literal:
        return ", ".join(map(str, get_args(hint))), lambda value: isinstance(value, str)
    if origin in (list, tuple) or _is_array(hint):
        return "a list", lambda value: isinstance(value, list)
    return "a table", lambda value: isinstance(value, Mapping)


_LONGEST_NUMBER = 40  # [characters] longest text that is taken for a number written by a person
_WORDS: Mapping[Any, tuple[str, Callable[[Any], bool]]] = {
    bool: ("true or false", lambda value: isinstance(value, bool)),
    int: ("a whole number", lambda value: type(value) is int),
    float: ("a number", lambda value: type(value) in (int, float)),
    str: ("text", lambda value: isinstance(value, str)),
}


# -- single values ---------------------------------------------------------------------------------


def _chosen(allowed: Iterable[Any], entry: Any, spot: _Spot) -> Any:
    words = list(allowed)
    if entry not in words:
        suggestion = did_you_mean(entry, [word for word in words if isinstance(word, str)])
        known = ", ".join(map(str, words))
        raise ConfigurationError(f"{spot.where}: allowed {known}, got {shown(entry)}{suggestion}")
    return entry


def _plain(kind: type, entry: Any, spot: _Spot) -> Any:
    word, fits = _WORDS[kind]
    if not fits(entry):
        words = f"{word}, {spot.limits}" if spot.limits else word
        raise spot.refused(words, entry, _if_quoted([kind], entry))
    try:
        return kind(entry)
    except OverflowError as error:
        raise spot.refused(f"{word} that a float can hold", entry) from error


def _if_quoted(kinds: Iterable[Any], word: Any) -> str:
    """Hint for a number that was written as text."""
    if not isinstance(word, str) or len(word) > _LONGEST_NUMBER or not {int, float} & set(kinds):
        return ""
    try:
        float(word)
    except ValueError:
        return ""
    return "; it is text: leave out the quotes"


def _array(entry: Any, spot: _Spot) -> Array:
    """Array from a number, a list of numbers, or rows of equal length; the callee checks its
    shape.
    """

    def numbers(value: Any, inner: _Spot) -> Any:
        if isinstance(value, list):
            return [numbers(row, inner.of(i)) for i, row in enumerate(value)]
        return _plain(float, value, inner)

    # A text in place of the whole array is not a wrong item of the array.
    if not (isinstance(entry, list) or _WORDS[float][1](entry)):
        raise spot.refused("a list of numbers", entry)
    try:
        return np.array(numbers(entry, spot))
    except ValueError as error:
        if isinstance(error, ConfigurationError):
            raise
        raise spot.refused("rows of one length", entry) from error


# -- bounds ----------------------------------------------------------------------------------------

_BOUNDS: Mapping[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "minimum": ("at least", lambda value, bound: value >= bound),
    "exclusiveMinimum": ("above", lambda value, bound: value > bound),
    "maximum": ("at most", lambda value, bound: value <= bound),
    "exclusiveMaximum": ("below", lambda value, bound: value < bound),
}


def _check_bounds(value: Any, spot: _Spot) -> None:
    """Refuse a value beyond the bounds that its field states as keywords of JSON Schema."""
    schema = spot.schema
    if isinstance(value, int | float) and not isinstance(value, bool):
        bounds = [(keeps, schema[key]) for key, (_, keeps) in _BOUNDS.items() if key in schema]
        if bounds and not math.isfinite(value):
            raise spot.refused(f"finite, {spot.limits}", value)
        if not all(keeps(value, bound) for keeps, bound in bounds):
            raise spot.refused(spot.limits, value)

    elif isinstance(value, str):
        if len(value) < schema.get("minLength", 0):
            raise spot.refused(f"at least {schema['minLength']} characters long", value)
        if not re.search(schema.get("pattern", ""), value):
            raise spot.refused(f"of the form {schema.get('pattern')}", value)

    elif isinstance(value, list | tuple | Mapping):
        word = "Properties" if isinstance(value, Mapping) else "Items"
        least = schema.get(f"min{word}", 0)
        most = schema.get(f"max{word}", len(value))
        if not least <= len(value) <= most:
            limits = f"{least} to {most}" if f"max{word}" in schema else f"{least} or more"
            raise spot.refused(f"{limits} entries", value)

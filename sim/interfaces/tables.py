"""Tables of files that others wrote, as dataclasses; a fault is told with its place in the document.

    about = TableReader("study.json").made(About, json_of(folder / "study.json", "study"))

`json_of` and `toml_of` read a document, `TableReader` makes dataclasses of its tables by their annotations, and
`checked` passes what is kept as it is. Bounds of a field are the keywords of JSON Schema in its metadata, "schema".
"""

import json
import math
import re
import tomllib
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from uuv.sim.interfaces.errors import ConfigurationError, commands_a_terminal, did_you_mean
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import shown

Made = TypeVar("Made")
Chooser = Callable[[type, dict[str, Any], str], type]

MOST_BYTES = 8_000_000  # of a document; its values take some thirty times as much memory
DEEPEST = 32  # tables and lists within each other
_LONGEST_KEY = 200  # [characters]
_LARGEST_WHOLE = 2**63  # whole numbers beyond fit no array and no other language's integer


# -- documents ---------------------------------------------------------------------------------------------------------


def json_of(file: str | Path, what: str, most: int = MOST_BYTES) -> Any:
    """The checked document of a JSON file, at most `most` bytes; `what` begins the error message.

    Raises:
        ConfigurationError: The file cannot be read, is no JSON, or as `checked` says.
    """

    def document(text: str) -> Any:
        return json.loads(text, object_pairs_hook=_table_of, parse_constant=_no_number)

    return _document(file, what, most, document)


def toml_of(file: str | Path, what: str, most: int = MOST_BYTES) -> dict[str, Any]:
    """The checked document of a TOML file, at most `most` bytes; `what` begins the error message.

    Numbers that are not finite are passed: TOML has them, and the classes refuse them where they mean nothing.

    Raises:
        ConfigurationError: The file cannot be read, is no TOML, or as `checked` says.
    """
    return _document(file, what, most, tomllib.loads, finite=False)


def _document(file: str | Path, what: str, most: int, parse: Callable[[str], Any], *, finite: bool = True) -> Any:
    text = text_of(file, what, most)
    try:
        found = parse(text)
    except RecursionError as error:
        raise ConfigurationError(f"{what} {shown(str(file))}: more than {DEEPEST} tables deep") from error
    except ValueError as error:
        raise ConfigurationError(f"{what} {shown(str(file))}: cannot be read ({error})") from error
    try:
        return checked(found, finite=finite)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what} {shown(str(file))}: {error}") from error


def _table_of(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; a key that stands in it twice would hide a value."""
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"the key {shown(key)} stands twice in one table")
        table[key] = value
    return table


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is no JSON")


def checked(value: Any, where: str = "", *, finite: bool = True) -> Any:
    """`value` of a document, if every key, text and number in it can be printed, computed with and drawn.

    Raises:
        ConfigurationError: A text holds a control character, a number is out of range, or it is nested too deeply.
    """
    _check(value, where, DEEPEST, finite)
    return value


def _check(value: Any, where: str, depth: int, finite: bool) -> None:
    if isinstance(value, str):
        if commands_a_terminal(value):
            raise ConfigurationError(f"{_place(where)}: a control character in the text {shown(value)}")
    elif isinstance(value, int | float):
        if isinstance(value, int) and abs(value) >= _LARGEST_WHOLE:
            raise ConfigurationError(f"{_place(where)}: a whole number of more than 63 bits, got {shown(value)}")
        if finite and not math.isfinite(value):
            raise ConfigurationError(f"{_place(where)}: must be a finite number, got {shown(value)}")
    elif isinstance(value, Mapping | list):
        if not depth:
            raise ConfigurationError(f"{_place(where)}: more than {DEEPEST} tables deep")
        for key, each in value.items() if isinstance(value, Mapping) else enumerate(value):
            if isinstance(key, str) and (len(key) > _LONGEST_KEY or commands_a_terminal(key) or "\n" in key):
                raise ConfigurationError(f"{_place(where)}: {shown(key)} is no name of a value")
            _check(each, _inside(where, str(key)), depth - 1, finite)


# -- dataclasses -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TableReader:
    """Makes dataclasses of tables by the annotations of their fields.

    Annotations may be numbers, text, literals, lists, tuples, mappings, dataclasses, `Any`, and each of them or None.
    """

    whole: str = "the file"  # what messages call the outermost table
    choose: Chooser | None = None  # class for an annotation, by a table at a place; it may take a key out of the table
    passes_unknown: bool = False  # keys that the class lacks are passed over, as those of a later version

    def made(self, kind: type[Made], given: Any, where: str = "") -> Made:
        """An instance of the dataclass `kind` from the table `given`.

        Args:
            kind: Dataclass, or a base that `choose` finds one for.
            given: Table of a document.
            where: Place of the table in the document; empty: it is the outermost.

        Raises:
            ConfigurationError: The table lacks a key, has one too many, or a value of another type or out of bounds.
        """
        place = _place(where, self.whole)
        if not isinstance(given, Mapping):
            raise ConfigurationError(f"{place}: must be a table, got {shown(given)}")
        values = dict(given)
        chosen = cast(Any, kind if self.choose is None else self.choose(kind, values, place))

        allowed = {field.name: field for field in fields(chosen)}
        for key in [key for key in values if key not in allowed]:
            if not self.passes_unknown:
                known = ", ".join(allowed)
                raise ConfigurationError(f"{place} has no {shown(key)}; it has {known}{did_you_mean(key, allowed)}")
            del values[key]
        for name, field in allowed.items():
            if name not in values and field.default is MISSING and field.default_factory is MISSING:
                raise ConfigurationError(f"{place}: {name} is missing")

        hints = _hints(chosen)
        made = {key: self._value(hints[key], value, _inside(where, key)) for key, value in values.items()}
        for key, value in made.items():
            _check_bounds(allowed[key], value, _inside(where, key))
        return chosen(**made)

    def value(self, hint: Any, item: Any, where: str) -> Any:
        """A value of a document as the type `hint` asks for; `where` begins the message."""
        return self._value(hint, item, where)

    def _value(self, hint: Any, given: Any, where: str) -> Any:
        """`given` as the type `hint` asks for."""
        origin, args = get_origin(hint), get_args(hint)
        if origin in (Union, types.UnionType):
            if given is None and type(None) in args:
                return None
            options = [arg for arg in args if arg is not type(None)]
            if len(options) == 1:
                return self._value(options[0], given, where)
            return _chosen([word for option in options for word in get_args(option)], given, where)  # of literals
        if origin is Literal:
            return _chosen(args, given, where)
        if origin is tuple:
            return tuple(self._several(args, given, where))
        if origin is list:
            return self._several((args[0], Ellipsis), given, where)
        if isinstance(origin, type) and issubclass(origin, Mapping):
            if not isinstance(given, Mapping):
                raise ConfigurationError(f"{where}: must be a table, got {shown(given)}")
            return {key: self._value(args[1], each, _inside(where, key)) for key, each in given.items()}
        if is_dataclass(hint):
            return self.made(cast(type, hint), given, where)
        return given if hint is Any else _plain(hint, given, where)

    def _several(self, args: tuple[Any, ...], given: Any, where: str) -> list[Any]:
        """The items of a list: of one type, where `args` ends with an ellipsis, else of one type each."""
        if not isinstance(given, list):
            raise ConfigurationError(f"{where}: must be a list, got {shown(given)}")
        if args[-1] is Ellipsis:
            return [self._value(args[0], each, where) for each in given]
        if len(given) != len(args):
            raise ConfigurationError(f"{where}: must be {len(args)} values, got {shown(given)}")
        return [self._value(arg, each, where) for arg, each in zip(args, given, strict=True)]


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Annotations of a class; a table of rows asks for them once a row."""
    return get_type_hints(kind)


def _place(where: str, whole: str = "the file") -> str:
    return f"[{where}]" if where else whole


def _inside(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _chosen(allowed: Iterable[Any], given: Any, where: str) -> Any:
    words = list(allowed)
    if given not in words:
        meant = did_you_mean(given, [word for word in words if isinstance(word, str)])
        raise ConfigurationError(f"{where}: allowed {', '.join(map(str, words))}, got {shown(given)}{meant}")
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


def _check_bounds(field: "Field[Any]", value: Any, where: str) -> None:
    """Refuses a value beyond the bounds that its field states by keywords of JSON Schema."""
    stated = field.metadata.get("schema", {})
    least, most, form = (stated.get(word) for word in ("minimum", "maximum", "pattern"))
    if isinstance(value, int | float):
        if (least is not None and value < least) or (most is not None and value > most):
            limits = [
                f"{word} {bound:g}" for word, bound in (("at least", least), ("at most", most)) if bound is not None
            ]
            raise ConfigurationError(f"{where}: must be {' and '.join(limits)}, got {shown(value)}")
    elif isinstance(value, str) and form is not None and not re.search(form, value):
        raise ConfigurationError(f"{where}: must be of the form {form}, got {shown(value)}")

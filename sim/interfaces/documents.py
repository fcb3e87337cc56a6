"""Documents: text of JSON, TOML and YAML as checked values, and values as text.

    table = toml_of(file, "campaign")             # of a file; parsed_toml: of a text
    write_whole(file, toml_text(table))

Documents that are returned can be printed, computed with and traversed:

- Keys are text, and no key occurs twice in a table.
- Texts hold no control characters.
- A whole number fits 64 bits with its sign. No number is NaN, and in JSON none is infinite.
- Nothing is nested deeper than DEEPEST.

`uuv.sim.interfaces.tables` makes dataclasses of the tables.
"""

import json
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError, commands_a_terminal
from uuv.sim.interfaces.files import text_of
from uuv.sim.interfaces.spatial import shown

MOST_BYTES = 8_000_000  # largest document; its values take some thirty times as much memory
DEEPEST = 32  # most tables and lists within each other
_LONGEST_KEY = 200  # [characters]
_LARGEST_WHOLE = 2**63  # larger whole numbers fit no array, and no integer type of another language
# most values of a YAML document; the values of an alias count at each use
_MOST_UNFOLDED = 1_000_000
_YAML = "tag:yaml.org,2002:"
_PLAIN_TAGS = frozenset(_YAML + word for word in ("null", "bool", "int", "float", "str"))
_EXPONENT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+")  # as YAML 1.2 has it


# -- reading ---------------------------------------------------------------------------------------


def named(file: str | Path, what: str) -> str:
    """Name of a file in messages: `what` it is, and its file name."""
    return f"{what} {shown(str(file))}"


def json_of(file: str | Path, what: str, most: int = MOST_BYTES) -> Any:
    """The checked document of a JSON file, at most `most` bytes; `what` begins the error message.

    Raises:
        ConfigurationError: The file cannot be read, or `parsed_json` refuses its text.
    """
    return parsed_json(text_of(file, what, most), named(file, what))


def toml_of(file: str | Path, what: str, most: int = MOST_BYTES) -> dict[str, Any]:
    """The checked document of a TOML file, at most `most` bytes; `what` begins the error message.

    Raises:
        ConfigurationError: The file cannot be read, or `parsed_toml` refuses its text.
    """
    return parsed_toml(text_of(file, what, most), named(file, what))


def yaml_of(file: str | Path, what: str, most: int = MOST_BYTES) -> Any:
    """The checked document of a YAML file, at most `most` bytes; `what` begins the error message.

    Raises:
        ConfigurationError: The file cannot be read, or `parsed_yaml` refuses its text.
    """
    return parsed_yaml(text_of(file, what, most), named(file, what))


def parsed_json(text: str, what: str) -> Any:
    """The checked document of a JSON text; `what` begins the error message.

    Raises:
        ConfigurationError: The text is no JSON, a number is not finite, or `checked` refuses a
            value.
    """

    def document(text: str) -> Any:
        return json.loads(text, object_pairs_hook=_table_of, parse_constant=_no_number)

    return _document(text, what, document, finite=True)


def parsed_toml(text: str, what: str) -> dict[str, Any]:
    """The checked document of a TOML text; `what` begins the error message.

    Raises:
        ConfigurationError: The text is no TOML, or `checked` refuses a value.
    """
    return _document(text, what, tomllib.loads)


def parsed_yaml(text: str, what: str) -> Any:
    """The checked document of a YAML text; `what` begins the error message.

    Keys are read as text, as they are written, and so are dates. A number may have an exponent
    without a decimal point, such as 1e-3, as in YAML 1.2. A text that has only comments gives None.

    Raises:
        ConfigurationError: The text is no YAML, has user-defined tags or aliases that unfold to too
            many values, or `checked` refuses a value.
    """
    return _document(text, what, _yaml_document)


def toml_value(text: str) -> Any:
    """The TOML value that `text` holds, as written behind `key =`; a text that is no TOML value is
    returned itself.
    """
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text  # a second line would be a second key


def _document(text: str, what: str, parse: Callable[[str], Any], *, finite: bool = False) -> Any:
    try:
        document = parse(text)
    except RecursionError as error:
        raise ConfigurationError(f"{what}: more than {DEEPEST} tables deep") from error
    except ValueError as error:
        raise ConfigurationError(f"{what}: cannot be read ({error})") from error

    try:
        return checked(document, finite=finite)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from error


def checked(value: Any, where: str = "", *, finite: bool = False) -> Any:
    """Return `value` if everything in it can be printed, computed with and plotted.

    Args:
        value: Value of a document or of another input.
        where: Place of the value in the document.
        finite: Whether infinite numbers are refused too.

    Raises:
        ConfigurationError: A text holds a control character, a number is out of range, or it is
            nested too deeply.
    """
    try:
        _check(value, DEEPEST, finite)
    except _FaultError as fault:
        for key in reversed(fault.path[-1:] if fault.is_deep else fault.path):
            where = inside(where, key)
        raise ConfigurationError(f"{where or 'the file'}: {fault}") from None
    return value


class _FaultError(Exception):
    """Fault of a value. Its place is put together while the error propagates, innermost key
    first.
    """

    def __init__(self, fault: str) -> None:
        super().__init__(fault)
        self.path: list[str | int] = []
        self.is_deep = False  # only the outermost key of a deep place is reported


def _check(value: Any, depth: int, finite: bool) -> None:
    fault = _fault_of(value, finite)
    if fault:
        raise _FaultError(fault)

    if not isinstance(value, Mapping | list):
        return
    if not depth:
        error = _FaultError(f"more than {DEEPEST} tables deep")
        error.is_deep = True
        raise error

    pairs: Any = value.items() if isinstance(value, Mapping) else enumerate(value)
    for key, entry in pairs:
        try:
            _check(entry, depth - 1, finite)
        except _FaultError as error:
            error.path.append(key)
            raise


def _fault_of(value: Any, finite: bool) -> str:
    """Fault of one value, without the values in it; empty if there is none."""
    if isinstance(value, str):
        if not value.isprintable() and commands_a_terminal(value):
            return f"a control character in the text {shown(value)}"
    elif isinstance(value, int):
        if abs(value) >= _LARGEST_WHOLE:
            return f"a whole number of more than 63 bits, got {shown(value)}"
    elif isinstance(value, float):
        if math.isnan(value):
            return "must not be NaN"
        if finite and math.isinf(value):
            return f"must be a finite number, got {shown(value)}"
    elif isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str) or len(key) > _LONGEST_KEY or not _is_name(key):
                return f"{shown(key)} is no name of a value"
    return ""


def _is_name(key: str) -> bool:
    return key.isprintable() or not (commands_a_terminal(key) or "\n" in key)


def inside(where: str, key: str | int) -> str:
    """Place of a value in the table or list at the place `where`; items of lists count from 0."""
    if isinstance(key, int):
        return f"{where}[{key}]"
    return f"{where}.{key}" if where else key


# -- JSON ------------------------------------------------------------------------------------------


def _table_of(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object as a dict. A key that occurs twice in it would hide a value, so it is
    refused.
    """
    table: dict[str, Any] = {}

    for key, entry in pairs:
        if key in table:
            raise ValueError(f"the key {shown(key)} occurs twice in one table")
        table[key] = entry
    return table


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is no JSON")


# -- YAML ------------------------------------------------------------------------------------------


def _yaml_document(text: str) -> Any:
    import yaml

    try:
        return _YamlEvents(text).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f" (at line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise ValueError(f"{error.problem or error.context}{line}") from error
    except yaml.YAMLError as error:  # error of PyYAML's reader: bytes that no text can contain
        raise ValueError(" ".join(str(error).split())) from error


class _YamlEvents:
    """Values of a YAML text, built from the parser's events. PyYAML's own loader limits neither
    aliases nor depth.
    """

    def __init__(self, text: str) -> None:
        import yaml

        self._kinds = yaml
        loader = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
        self._events: Any = loader(text)
        self._anchored: dict[str, tuple[Any, int]] = {}  # value of an anchor, and its count
        self._count = 0  # number of values so far, with aliases unfolded

    def document(self) -> Any:
        """The one document; None if there is none."""
        self._events.get_event()  # start of the stream
        if self._events.check_event(self._kinds.StreamEndEvent):
            return None

        self._events.get_event()  # of the document
        document = self._value(self._events.get_event(), DEEPEST)
        self._events.get_event()  # end of the document
        if not self._events.check_event(self._kinds.StreamEndEvent):
            raise ValueError("more than one document, separated by ---")
        return document

    def _value(self, event: Any, depth: int) -> Any:
        """Value that begins with an event."""
        if isinstance(event, self._kinds.AliasEvent):
            return self._alias(event)

        before = self._count
        self._count += 1
        if isinstance(event, self._kinds.ScalarEvent):
            node = self._scalar(event)
        else:
            if event.tag not in (None, "!", f"{_YAML}seq", f"{_YAML}map"):
                raise self._fault(event, self._foreign(event.tag))
            if not depth:
                raise self._fault(event, f"more than {DEEPEST} tables deep")
            is_list = isinstance(event, self._kinds.SequenceStartEvent)
            node = self._list(depth - 1) if is_list else self._table(depth - 1)

        if event.anchor is not None:
            self._anchored[event.anchor] = node, self._count - before
        return node

    def _alias(self, event: Any) -> Any:
        if event.anchor not in self._anchored:
            name = shown(event.anchor)
            raise self._fault(
                event, f"the alias {name} has no anchor before it, or is inside its own anchor"
            )

        node, count = self._anchored[event.anchor]
        self._count += count
        if self._count > _MOST_UNFOLDED:
            raise self._fault(event, f"the aliases unfold to more than {_MOST_UNFOLDED} values")
        return node

    def _list(self, depth: int) -> list[Any]:
        entries = []
        while not isinstance(event := self._events.get_event(), self._kinds.SequenceEndEvent):
            entries.append(self._value(event, depth))
        return entries

    def _table(self, depth: int) -> dict[str, Any]:
        table: dict[str, Any] = {}
        merged: dict[
            str, Any
        ] = {}  # entries merged by the key <<; entries of the table itself have precedence

        while not isinstance(event := self._events.get_event(), self._kinds.MappingEndEvent):
            if not isinstance(event, self._kinds.ScalarEvent):
                raise self._fault(event, "a key must be a scalar, not a list or table")
            node = self._value(self._events.get_event(), depth)
            if event.value == "<<" and event.implicit[0]:
                merged |= self._merged(event, node)
            elif event.value in table:
                raise self._fault(event, f"the key {shown(event.value)} occurs twice in one table")
            else:
                table[event.value] = node
        return merged | table

    def _merged(self, event: Any, value: Any) -> dict[str, Any]:
        """Entries merged by a key `<<`: from one table, or from several, where the first has
        precedence.
        """
        tables = value if isinstance(value, list) else [value]
        if not all(isinstance(table, dict) for table in tables):
            raise self._fault(event, f"<< takes a table, or several, got {shown(value)}")
        return {key: entry for table in reversed(tables) for key, entry in table.items()}

    def _scalar(self, event: Any) -> Any:
        tag = event.tag
        if tag in (None, "!"):
            tag = self._events.resolve(self._kinds.ScalarNode, event.value, event.implicit)
            tag = tag if tag in _PLAIN_TAGS else f"{_YAML}str"  # dates
            unquoted = tag == f"{_YAML}str" and event.implicit[0]
            if unquoted and _EXPONENT.fullmatch(event.value):  # YAML 1.1 wants a point and a sign
                return float(event.value)

        if tag not in _PLAIN_TAGS:
            raise self._fault(event, self._foreign(tag))
        make = getattr(self._events, f"construct_yaml_{tag.removeprefix(_YAML)}")
        try:
            return make(self._kinds.ScalarNode(tag, event.value))
        except (ValueError, KeyError) as error:  # !!int of a word
            raise self._fault(
                event, f"{shown(event.value)} is not a valid value of its tag"
            ) from error

    @staticmethod
    def _foreign(tag: str) -> str:
        return f"the tag {shown(tag.replace(_YAML, '!!'))} is not supported"

    @staticmethod
    def _fault(event: Any, problem: str) -> ValueError:
        mark = event.start_mark
        return ValueError(f"{problem} (at line {mark.line + 1}, column {mark.column + 1})")


# -- writing ---------------------------------------------------------------------------------------


def toml_text(table: Mapping[str, Any], heading: str = "") -> str:
    """Text of a TOML document. Reading it returns every float with the same bits.

    Args:
        table: Tables, lists, text and numbers; numpy's are allowed.
        heading: Lines of a comment above the document.
    """
    import tomlkit

    lines = "".join(f"# {line}\n" for line in heading.splitlines())
    return f"{lines}{tomlkit.dumps(_plain(table))}"


def yaml_text(document: Any, *, width: int = 160) -> str:
    """Text of a YAML document. Reading it returns every float with the same bits.

    Args:
        document: Tables, lists, text and numbers; numpy's are allowed.
        width: [characters] Largest length of a line.
    """
    import yaml

    class Dumper(yaml.SafeDumper):
        """Dumper that quotes a text such as 1e3, which `parsed_yaml` would read as a number."""

    number = re.compile(rf"^(?:{_EXPONENT.pattern})$")
    Dumper.add_implicit_resolver(f"{_YAML}float", number, list("-+.0123456789"))
    layout: dict[str, Any] = {"default_flow_style": None, "width": width, "sort_keys": False}
    return yaml.dump(_plain(document), Dumper=Dumper, allow_unicode=True, **layout)


def _plain(value: Any) -> Any:
    """`value` in Python's own types: arrays as lists, numbers of numpy as int and float."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return _plain(value.tolist()) if hasattr(value, "tolist") else value

"""JSON Schema of a metrics dataclass: types from annotations, units from names, notes from
`metric`.
"""

import types
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, field, fields, is_dataclass
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

DIALECT = "https://json-schema.org/draft/2020-12/schema"
# Unit by the suffix of a name; the longest suffix comes first.
UNITS = {
    "_m_s": "m/s",
    "_rad": "rad",
    "_deg": "deg",
    "_nm": "N m",
    "_wh": "W h",
    "_ah": "A h",
    "_share": "1",
    "_m": "m",
    "_n": "N",
    "_j": "J",
    "_w": "W",
    "_v": "V",
    "_s": "s",
}
_NUMBERS = {int: "integer", float: "number", bool: "boolean", str: "string"}


Metrics = TypeVar("Metrics")


def metric(description: str = "", *, default: Any = MISSING, **keywords: Any) -> Any:
    """Dataclass field of metrics.

    Args:
        description: Description of the metric, for the schema.
        default: Value for a file without the entry. Without a default the entry must be present.
        **keywords: Further keywords of JSON Schema, such as `minimum=0`.

    Returns:
        The field.
    """
    note = {"description": description} if description else {}
    return field(default=default, metadata={"schema": {**keywords, **note}})


def schema_of(kinds: Iterable[type], title: str, description: str) -> dict[str, Any]:
    """JSON Schema of a file.

    Args:
        kinds: Dataclasses whose fields together are the entries of the file.
        title: Title of the schema.
        description: Description of the file.

    Returns:
        The schema, complete in itself.
    """
    parts = [_object(kind) for kind in kinds]
    return {
        "$schema": DIALECT,
        "title": title,
        "description": description,
        **parts[0],
        "required": [name for part in parts for name in part["required"]],
        "properties": {name: entry for part in parts for name, entry in part["properties"].items()},
    }


def unmeasured(kind: type[Metrics], **known: Any) -> Metrics:
    """Metrics of a run that ended before they were measured: None in all fields except `known`."""
    names = [entry.name for entry in fields(cast(Any, kind))]
    return kind(**{name: known.get(name) for name in names})


def unit_of(name: str) -> str | None:
    """Unit by the suffix of a metric's name; None if the name has none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), None)


def _object(kind: type) -> dict[str, Any]:
    hints = get_type_hints(kind)
    properties = {}
    for entry in fields(kind):
        unit = unit_of(entry.name)
        keywords = dict(entry.metadata.get("schema", {}))
        properties[entry.name] = {
            **_type(hints[entry.name]),
            **({"unit": unit} if unit else {}),
            **keywords,
        }

    required = [
        entry.name
        for entry in fields(kind)
        if entry.default is MISSING and entry.default_factory is MISSING
    ]

    return {
        "type": "object",
        "additionalProperties": False,
        "required": required,
        "properties": properties,
    }


def _type(hint: Any) -> dict[str, Any]:
    origin = get_origin(hint)
    args = get_args(hint)
    if origin in (Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))
        inner_type = _type(inner)
        return {**inner_type, "type": [inner_type["type"], "null"]}
    if is_dataclass(hint) and isinstance(hint, type):
        return _object(hint)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {
            "type": "object",
            **({} if args[1] is Any else {"additionalProperties": _type(args[1])}),
        }
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return {"type": "array", "items": _type(args[0])}
    return {"type": _NUMBERS[hint]}

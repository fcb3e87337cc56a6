"""Columns of the rows of an experiment: name, label, unit and format, declared at the field.

    force_rms: float = column("force RMS", "N", digits=2)

A row has a column for each field of its case, which is an option of the command too, and one for
each field of what `run` returns.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.help_texts import help_texts

_METADATA = "column"  # key of a field's metadata
_UNIT = re.compile(r"\[([^\]]+)\]")  # of an option, in its help text
_SAME = 1e-6  # relative; floating-point libraries of other machines differ by less


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultColumn:
    """How a column of rows is named, shown and compared."""

    name: str  # in the rows
    label: str = ""  # in tables; empty: the name
    unit: str = ""  # in tables
    digits: int | None = None  # decimals; None: three significant digits
    factor: float = 1.0  # from the value in the row to the unit
    # what the keys of a value that is a table are, such as "order"; empty: a plain value
    by: str = ""
    # relative deviation of the value when the run is done again that is none; None: never compared
    tolerance: float | None = _SAME

    @property
    def heading(self) -> str:
        """Label with unit."""
        return with_unit(self.label or self.name.replace("_", " "), self.unit)

    def cell(self, value: Any) -> str:
        """A value of a row as text."""
        if value is None:
            return "-"

        # a table or a list of values
        if isinstance(value, Mapping):
            return ", ".join(f"{key} {self.cell(entry)}" for key, entry in value.items())
        if isinstance(value, list):
            return ", ".join(map(self.cell, value))

        # a single value
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, int) and self.factor == 1.0:
            return str(value)
        return self.number(self.factor * value) if isinstance(value, int | float) else str(value)

    def number(self, value: float) -> str:
        """A number in the unit of the column as text."""
        return f"{value:.3g}" if self.digits is None else f"{value:.{self.digits}f}"


def column(
    label: str,
    unit: str = "",
    *,
    digits: int | None = None,
    factor: float = 1.0,
    by: str = "",
    tolerance: float | None = _SAME,
    default: Any = MISSING,
) -> Any:
    """Field of a row; the name of the field is that of the column.

    Args:
        label: What tables call it.
        unit: Unit in tables.
        digits: Decimals; None: three significant digits.
        factor: From the value in the row to the unit.
        by: What the keys are of a value that is a table, such as "method".
        tolerance: Relative deviation of the value, when the run is done again, that counts as none;
            None: it is never compared, such as a computing time.
        default: Default of the field.
    """
    declared = ResultColumn(
        name="", label=label, unit=unit, digits=digits, factor=factor, by=by, tolerance=tolerance
    )
    return field(default=default, metadata={_METADATA: declared})


def columns_of(case: type[Any], row: type[Any]) -> dict[str, ResultColumn]:
    """Columns by name: those of the case, then those of what its run gives.

    Raises:
        ConfigurationError: Both have a field of one name.
    """
    columns: dict[str, ResultColumn] = {}
    texts = help_texts(case)

    for entry in fields(case):
        unit = _UNIT.search(texts.get(entry.name, ""))
        columns[entry.name] = ResultColumn(name=entry.name, unit=unit[1] if unit else "")

    for entry in fields(row):
        if entry.name in columns:
            raise ConfigurationError(
                f"{row.__name__}.{entry.name}: {case.__name__} has a field of that name; a row "
                "holds both"
            )
        declared: ResultColumn = entry.metadata.get(_METADATA, ResultColumn(name=entry.name))
        columns[entry.name] = replace(declared, name=entry.name)
    return columns


def known_column(columns: Mapping[str, ResultColumn], name: str, what: str) -> ResultColumn:
    """The column `name`, for `what`, which begins the message.

    Raises:
        ConfigurationError: There is none.
    """
    if name not in columns:
        known = ", ".join(columns)
        raise ConfigurationError(
            f"{what}: no column {name!r}; there are {known}{did_you_mean(name, columns)}"
        )
    return columns[name]


def check_names(columns: Mapping[str, ResultColumn], row: Mapping[str, Any], where: str) -> None:
    """Refuses a row with other columns: of an earlier version of the experiment.

    Raises:
        ConfigurationError: It lacks one or has one too many; the message begins with `where`.
    """
    lacking = [name for name in columns if name not in row]
    unknown = [name for name in row if name not in columns]

    if lacking or unknown:
        faults = [f"no column {', '.join(lacking)}"] if lacking else []
        faults += [f"{', '.join(unknown)} is none of its columns"] if unknown else []
        raise ConfigurationError(
            f"{where}: rows of another version of the experiment: {'; '.join(faults)}"
        )


def records_by(
    columns: Mapping[str, ResultColumn], rows: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> list[dict[str, Any]]:
    """Rows with plain values where the columns have tables with these keys.

    Args:
        columns: By name.
        rows: Of the experiment.
        keys: What the keys of tables are, such as "order"; others are names of columns.

    Returns:
        One record for each row and key; none for a row whose tables are None.
    """
    records = [dict(row) for row in rows]

    for key in keys:
        if key in columns:
            continue

        tables = [name for name, entry in columns.items() if entry.by == key]
        records = [
            {**record, **{name: (record[name] or {}).get(word) for name in tables}, key: word}
            for record in records
            for word in dict.fromkeys(word for name in tables for word in record[name] or ())
        ]
    return records


def with_unit(label: str, unit: str) -> str:
    """Label with its unit behind it."""
    return f"{label} [{unit}]" if unit else label

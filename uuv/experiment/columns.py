"""Columns of the rows of an experiment: name, label, unit and format, declared at the field.

    force_rms: float = column("force RMS", "N", digits=2)

A row has a column for each field of its case, which is also an option of the command, and for each
field of the result of `run`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.help_texts import help_texts

_METADATA = "column"  # key of a field's metadata
_UNIT = re.compile(r"\[([^\]]+)\]")  # key of an option's description, in its help text
_SAME = 1e-6  # relative tolerance; floating-point libraries of other machines differ by less


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultColumn:
    """Name, format and comparison of a column of rows."""

    name: str  # name in the rows
    label: str = ""  # name in tables; empty: the name in the rows
    unit: str = ""  # unit in tables
    digits: int | None = None  # number of decimals; None: three significant digits
    factor: float = 1.0  # factor from the value in the row to the unit
    # meaning of the keys if a value is a table, such as "order"; empty: a plain value
    by: str = ""
    # relative deviation of a repeated run's value that counts as equal; None: never compared
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
    """Field of a row, whose name is the name of the column.

    Args:
        label: Name of the column in tables.
        unit: Unit in tables.
        digits: Decimals; None: three significant digits.
        factor: Factor from the value in the row to the unit.
        by: Meaning of the keys if a value is a table, such as "method".
        tolerance: Relative deviation of a repeated run's value that counts as equal; None: the
            value is never compared, such as a computing time.
        default: Default of the field.
    """
    declared = ResultColumn(
        name="", label=label, unit=unit, digits=digits, factor=factor, by=by, tolerance=tolerance
    )
    return field(default=default, metadata={_METADATA: declared})


def columns_of(case: type[Any], row: type[Any]) -> dict[str, ResultColumn]:
    """Columns by name: those of the case, followed by those of the result of its run.

    Raises:
        ConfigurationError: Case and row have a field of the same name.
    """
    columns: dict[str, ResultColumn] = {}
    texts = help_texts(case)

    for entry in fields(case):
        unit = _UNIT.search(texts.get(entry.name, ""))
        columns[entry.name] = ResultColumn(name=entry.name, unit=unit[1] if unit else "")

    for entry in fields(row):
        if entry.name in columns:
            raise ConfigurationError(
                f"{row.__name__}.{entry.name}: the name must differ from the fields of "
                f"{case.__name__}, since a row holds both"
            )
        declared: ResultColumn = entry.metadata.get(_METADATA, ResultColumn(name=entry.name))
        columns[entry.name] = replace(declared, name=entry.name)
    return columns


def known_column(columns: Mapping[str, ResultColumn], name: str, what: str) -> ResultColumn:
    """The column `name`, for `what`, which begins the message.

    Raises:
        ConfigurationError: There is no such column.
    """
    if name not in columns:
        known = ", ".join(columns)
        raise ConfigurationError(
            f"{what}: must be one of the columns {known}, got {name!r}{did_you_mean(name, columns)}"
        )
    return columns[name]


def check_names(columns: Mapping[str, ResultColumn], row: Mapping[str, Any], where: str) -> None:
    """Refuse a row with other columns, which is from another version of the experiment.

    Raises:
        ConfigurationError: The row lacks a column or has an unknown one; the message begins with
            `where`.
    """
    lacking = [name for name in columns if name not in row]
    unknown = [name for name in row if name not in columns]

    if lacking or unknown:
        faults = [f"no column {', '.join(lacking)}"] if lacking else []
        faults += [f"{', '.join(unknown)} is not one of its columns"] if unknown else []
        raise ConfigurationError(
            f"{where}: rows of another version of the experiment: {'; '.join(faults)}"
        )


def records_by(
    columns: Mapping[str, ResultColumn], rows: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> list[dict[str, Any]]:
    """Rows in which columns of tables with these keys are replaced by plain values.

    Args:
        columns: Columns by name.
        rows: Rows of the experiment.
        keys: Meanings of the keys of tables, such as "order"; other words are names of columns.

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
    """Label followed by its unit."""
    return f"{label} [{unit}]" if unit else label


def metric_at(metrics: Any, name: str) -> Any:
    """Value at a dotted name, as "contact.force_error_rms_n"; None if the run gave none.

    Args:
        metrics: Of a run (`uuv.sim.evaluation.metrics.Assessment.metrics`).
        name: Keys from the outside in, with a dot between.
    """
    for key in name.split("."):
        metrics = metrics.get(key) if isinstance(metrics, Mapping) else None
    return metrics

"""Statistics of the rows of an experiment: one or a few numbers of a group of rows, as a cell of a
table.

    stat("mean", "looks", none=8)
    stat("share", lambda row: row["looks"] == 2, "second look sufficed")

A value that is a list, for instance one value for each push, counts with all its entries. A
quantity that is not a statistic of single rows, such as the overshoot of a mean response, is a
function of all rows:

    stat("group", overshoot_of_mean, "overshoot", unit="%")
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from uuv.experiment.columns import ResultColumn, known_column, with_unit
from uuv.sim.evaluation.intervals import share_interval
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array

Record = Mapping[str, Any]  # a row in which columns of tables are replaced by plain values
Kind = Literal[
    "value",
    "mean",
    "median",
    "p10",
    "p90",
    "p95",
    "largest",
    "least",
    "rms",
    "sem",
    "total",
    "count",
    "spread",
    "share",
    "group",
]
_NUMBERS: dict[str, Callable[[Array], float]] = {
    "mean": lambda values: float(values.mean()),
    "median": lambda values: float(np.median(values)),
    "p10": lambda values: float(np.quantile(values, 0.1)),
    "p90": lambda values: float(np.quantile(values, 0.9)),
    "p95": lambda values: float(np.quantile(values, 0.95)),
    "largest": lambda values: float(values.max()),
    "least": lambda values: float(values.min()),
    "rms": lambda values: float(np.sqrt(np.mean(values**2))),
    "sem": lambda values: float(values.std(ddof=1) / np.sqrt(len(values))),
    "total": lambda values: float(values.sum()),
}
_SHARE_DIGITS = 1  # number of decimals of a share in %
_SPREAD = ("median", "p95", "largest")
_WORDS = {
    "p10": "10 %",
    "p90": "90 %",
    "p95": "95 %",
    "sem": "standard error",
    "spread": "median, 95 %, largest",
    "value": "",
    "share": "",
    "count": "",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistic:
    """A statistic of one quantity over a group of records."""

    kind: Kind
    # column, or function of a record; for the kind "group" a function of all records
    of: str | Callable[[Any], Any]
    label: str
    column: ResultColumn  # unit and format
    none: float | None = None  # value that replaces a missing value, which is left out by default
    among: str = ""  # column with the number of trials, for a share of counts

    @property
    def heading(self) -> str:
        """Name of the statistic in tables."""
        unit = "%" if self.kind == "share" else "" if self.kind == "count" else self.column.unit
        return with_unit(self.label, unit)

    def bound_to(self, columns: Mapping[str, ResultColumn], what: str) -> "Statistic":
        """The statistic with label, unit and format of its column.

        Raises:
            ConfigurationError: There is no such column, or a function has no label; the message
                begins with `what`.
        """
        if self.among:
            known_column(columns, self.among, what)

        if callable(self.of):
            if not self.label:
                raise ConfigurationError(f"{what}: a statistic of a function must have a label")
            return self

        # properties of the column, unless the statistic has its own
        column = known_column(columns, self.of, what)
        words = _WORDS.get(self.kind, self.kind)
        plain = column.label or column.name.replace("_", " ")
        return replace(
            self,
            label=self.label or (f"{plain}, {words}" if words else plain),
            column=replace(
                column,
                unit=self.column.unit or column.unit,
                digits=column.digits if self.column.digits is None else self.column.digits,
            ),
        )

    def values(self, records: Sequence[Record]) -> list[Any]:
        """Values of the quantity, with lists flattened, and None left out or replaced."""
        if self.kind == "group":
            items = [self.of(records) if callable(self.of) else None]
        else:
            items = [inner for record in records for inner in flattened(self._item(record))]

        return [self.none if item is None else item for item in items if not self._left_out(item)]

    def _item(self, record: Record) -> Any:
        """The quantity in a record."""
        return self.of(record) if callable(self.of) else record[self.of]

    def _left_out(self, entry: Any) -> bool:
        return entry is None and self.none is None

    def missing(self, records: Sequence[Record]) -> int:
        """Number of records that have no value and are left out."""
        if self.kind == "group":
            return 0
        return sum(self._left_out(self._item(row)) for row in records)

    def numbers(self, records: Sequence[Record]) -> dict[str, Any]:
        """The statistic as numbers by name, in the units of the rows; empty if there is no
        value.
        """
        values = self.values(records)

        if self.kind == "count":
            return {"count": sum(map(bool, values))}
        if not values or (self.kind == "sem" and len(values) < 2):
            return {}
        if self.kind in ("value", "group"):
            return {"value": values[0] if len(values) == 1 else values}

        if self.kind == "share":
            trials = [1] * len(values)
            if self.among:
                # Statistic over the records that have a value.
                trials = [row[self.among] for row in records if not self._left_out(self._item(row))]

            good = round(sum(values))
            of = round(sum(trials))
            low, high = share_interval(good, of)
            return {"share": good / of, "low": low, "high": high, "good": good, "of": of}

        array = np.array(values, dtype=float)
        names = _SPREAD if self.kind == "spread" else (self.kind,)
        return {name: _NUMBERS[name](array) for name in names}

    def amount(self, value: float) -> str:
        """One number of `numbers`, with its unit."""
        if self.kind == "share":
            return f"{100.0 * value:.4g} %"
        return f"{self.column.factor * value:.4g} {self.column.unit}".rstrip()

    def cell(self, records: Sequence[Record]) -> str:
        """The statistic as text; "-" if there is no value."""
        numbers = self.numbers(records)
        if not numbers:
            return "-"

        if self.kind == "share":
            digits = self.column.digits if self.column.digits is not None else _SHARE_DIGITS
            return (
                f"{100 * numbers['share']:.{digits}f} ({100 * numbers['low']:.{digits}f} to "
                f"{100 * numbers['high']:.{digits}f}) of {numbers['of']}"
            )
        if self.kind in ("value", "group", "count"):
            return self.column.cell(next(iter(numbers.values())))

        # a sum of whole numbers is a whole number
        whole = self.kind == "total" and self.column.digits is None and self.column.factor == 1.0
        if whole and all(isinstance(entry, int) for entry in self.values(records)):
            return f"{numbers['total']:.0f}"
        return ", ".join(self.column.number(self.column.factor * n) for n in numbers.values())


def stat(
    kind: Kind,
    of: str | Callable[[Any], Any],
    label: str = "",
    *,
    unit: str = "",
    digits: int | None = None,
    factor: float = 1.0,
    none: float | None = None,
    among: str = "",
) -> Statistic:
    """Statistic of a column, or of a function of a row.

    Args:
        kind: value (of a single row), mean, median, largest, least, rms, total, or one of these.
            p10, p90, p95: a quantile.
            sem: the standard error of the mean.
            count: number of true values.
            share: share of true values among all values, with its 95 % interval.
            spread: median, 95th percentile and largest.
            group: result of a function of all rows of a group; None means no value.
        of: Name of a column, or a function of a row.
        label: Name in tables; default: the label of the column and the kind.
        unit: Unit of a function's value; default: that of the column.
        digits: Decimals; default: those of the column.
        factor: Factor from a function's value to its unit.
        none: Value that replaces a missing value; default: it is left out.
        among: For a share: column with the number of trials, if `of` is the number of successes.

    Raises:
        ConfigurationError: There is no such kind, or `of` is not a function for the kind "group".
    """
    if kind not in get_args(Kind):
        known = ", ".join(get_args(Kind))
        raise ConfigurationError(
            f"statistic: must be one of {known}, got {kind!r}{did_you_mean(kind, get_args(Kind))}"
        )
    if kind == "group" and not callable(of):
        raise ConfigurationError(f"statistic group: must have a function of the rows, got {of!r}")
    column = ResultColumn(name=label, unit=unit, digits=digits, factor=factor)
    return Statistic(kind=kind, of=of, label=label, column=column, none=none, among=among)


def statistic_of(
    entry: "str | Statistic", columns: Mapping[str, ResultColumn], what: str
) -> Statistic:
    """A statistic as an entry of a table's columns, or the values of the column with that name.

    Raises:
        ConfigurationError: As for `Statistic.bound_to`.
    """
    return (stat("value", entry) if isinstance(entry, str) else entry).bound_to(columns, what)


def flattened(nested: Any) -> list[Any]:
    """Entries of nested lists, in their order; a single value gives itself."""
    if not isinstance(nested, list | tuple):
        return [nested]
    return [inner for entry in nested for inner in flattened(entry)]

"""Page of an experiment: shares, tables, histograms and bounds, each declared in one line.

    looks_needed.page = (
        Page()
        .share("first", "the first view sufficed")
        .table("Views until accepted", by="order", columns=[stat("mean", "looks")])
        .histogram("looks", by="order")
    )

The same page is printed, written to report.html, and part of docs/results.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from uuv.experiment.columns import ResultColumn, known_column, records_by
from uuv.experiment.harness import Summary, Table
from uuv.experiment.row_table import Row
from uuv.experiment.statistic import Record, Statistic, flattened, stat, statistic_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Where = Callable[[Record], Any]  # function that decides whether a record counts
Columns = Mapping[str, ResultColumn]
ALL = "all"  # label of the last line of a table, over all records
_MOST_WHOLE = 20  # largest number of distinct whole numbers for which a histogram has one bar each
_BINS = 10  # number of bins of a histogram of other numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class PagePart:
    """Result of one element of a page for some rows."""

    metrics: Mapping[str, Any] = field(default_factory=dict)
    tables: Sequence[Table] = ()
    lines: Sequence[str] = ()
    pictures: Iterable[tuple[str, str, "Figure"]] = ()
    failed: Sequence[str] | None = None  # missed bounds; None if the element has no bounds


class Element(Protocol):
    """Element of a page."""

    def check(self, columns: Columns) -> None:
        """Refuse names that are not columns."""
        ...

    def part(self, rows: Sequence[Row], columns: Columns) -> PagePart:
        """The element for some rows."""
        ...


class Page:
    """Elements of a page in their order; each method adds one and returns the page."""

    def __init__(self) -> None:
        self._elements: list[Element] = []

    def share(
        self, of: str | Callable[[Record], Any], label: str = "", *, where: Where | None = None
    ) -> Self:
        """Add a line with the share of rows for which `of` is true, and its 95 % confidence
        interval.

        Args:
            of: Name of a column, or function of a row; rows for which it is None are left out.
            label: Text before the figure; default: the label of the column.
            where: Rows that count; default: all.
        """
        return self._with(_Share(stat("share", of, label), where))

    def table(
        self,
        title: str,
        *,
        columns: Sequence[str | Statistic],
        by: str | Sequence[str] = (),
        across: str = "",
        where: Where | None = None,
        total: bool = False,
    ) -> Self:
        """Add a table of statistics, with a line for each group of rows.

        Args:
            title: Title.
            columns: Statistics, or names of columns whose value is the same in a group.
            by: Columns whose values define the groups, or meanings of the keys of columns.
            across: The same for groups that are side by side.
            where: Rows that count; default: all.
            total: Label of a further line over all rows.
        """
        groups = (by,) if isinstance(by, str) else tuple(by)
        return self._with(_Table(title, tuple(columns), groups, across, where, total))

    def histogram(
        self,
        of: str,
        title: str = "",
        *,
        by: str = "",
        where: Where | None = None,
        none: str = "none",
    ) -> Self:
        """Add a histogram of a column.

        Args:
            of: ResultColumn of numbers.
            title: Title; default: the label of the column.
            by: Column, or meaning of the keys of columns, whose values have separate bars.
            where: Rows that count; default: all.
            none: Label of the bar of missing values.
        """
        return self._with(_Histogram(of, title, by, where, none))

    def accept(
        self,
        of: Statistic,
        *,
        most: float = np.inf,
        least: float = -np.inf,
        by: str | Sequence[str] = (),
        where: Where | None = None,
    ) -> Self:
        """Add a bound. The exit code is 0, and the page says "accepted", only if the statistic is
        within the bound.

        Args:
            of: Statistic; a share is compared without its interval.
            most: Upper bound in the unit of the row.
            least: Lower bound.
            by: As for a table; each group must be within the bound. Default: all rows together.
            where: Rows that count; default: all.
        """
        groups = (by,) if isinstance(by, str) else tuple(by)
        return self._with(_Bound(of, most, least, groups, where))

    def add(self, function: Callable[[list[Row]], Any]) -> Self:
        """Add the result of a function of all rows; nothing is added if there are no rows.

        The result is a `Table`, a line of text, a mapping of figures for metrics.json, a picture as
        (title, caption, figure), or a list of these. A figure may be a function that draws it,
        which is called when a report is written.
        """
        return self._with(_Special(function))

    def _with(self, element: Element) -> Self:
        self._elements.append(element)
        return self

    def check(self, columns: Columns) -> None:
        """Refuse an element that names an unknown column.

        Raises:
            ConfigurationError: The message names the element and the column.
        """
        for element in self._elements:
            element.check(columns)

    def summary(self, rows: list[Row], columns: Columns, caption: str = "") -> Summary:
        """The page for some rows.

        Args:
            rows: Rows of the experiment, in the order of its cases.
            columns: Columns of the rows, by name.
            caption: Text below the title.
        """
        parts = [element.part(rows, columns) for element in self._elements]
        bounds = [part.failed for part in parts if part.failed is not None]

        return Summary(
            metrics={"runs": len(rows)} | {k: v for part in parts for k, v in part.metrics.items()},
            tables=[table for part in parts for table in part.tables],
            lines=[line for part in parts for line in part.lines],
            pictures=(picture for part in parts for picture in part.pictures),
            caption=caption,
            failed=[line for failed in bounds for line in failed] if bounds else None,
        )


@dataclass(frozen=True, slots=True)
class _Share:
    """A share of all rows, as a line."""

    of: Statistic
    where: Where | None

    def check(self, columns: Columns) -> None:
        self.of.bound_to(columns, "a share of the page")

    def part(self, rows: Sequence[Row], columns: Columns) -> PagePart:
        share = self.of.bound_to(columns, "a share of the page")
        records = _counting(rows, self.where)

        cell = share.cell(records)
        text = "no row" if cell == "-" else f"{cell.replace(' (', ' % (', 1)}"
        return PagePart(
            metrics={share.label: share.numbers(records)}, lines=[f"{share.label}: {text}"]
        )


@dataclass(frozen=True, slots=True)
class _Table:
    """A table of statistics by group."""

    title: str
    columns: tuple[str | Statistic, ...]
    by: tuple[str, ...]
    across: str
    where: Where | None
    total: bool

    def check(self, columns: Columns) -> None:
        for key in self._keys:
            _check_key(columns, key, self._what)
        self._statistics(columns)

    @property
    def _what(self) -> str:
        return f"table {self.title!r} of the page"

    @property
    def _keys(self) -> tuple[str, ...]:
        return (*self.by, self.across) if self.across else self.by

    def _statistics(self, columns: Columns) -> list[Statistic]:
        return [statistic_of(entry, columns, self._what) for entry in self.columns]

    def part(self, rows: Sequence[Row], columns: Columns) -> PagePart:
        statistics = self._statistics(columns)
        records = _counting(records_by(columns, rows, self._keys), self.where)
        if not records:
            return PagePart()

        sides = list(dict.fromkeys(record[self.across] for record in records if self.across))
        groups = _grouped(records, self.by)

        lines = [
            [*map(str, names), *self._cells(group, statistics, sides)]
            for names, group in groups.items()
        ]
        if self.total:
            blank = [""] * (len(self.by) - 1)
            lines.append([ALL, *blank, *self._cells(records, statistics, sides)])

        labels = [columns[key].heading if key in columns else key for key in self.by]
        table = Table(
            title=self.title,
            columns=(*labels, *self._headings(statistics, sides)),
            rows=lines,
            caption=_left_out(statistics, records),
            labels=len(self.by),
        )

        figures = {
            " ".join(map(str, names)) or ALL: self._numbers(group, statistics, sides)
            for names, group in groups.items()
        }
        return PagePart(metrics={self.title: figures}, tables=[table])

    def _numbers(
        self, records: Sequence[Record], statistics: Sequence[Statistic], sides: Sequence[Any]
    ) -> dict[str, Any]:
        """Figures of a group by statistic; of groups that are side by side, by their names."""
        if not self.across:
            return {statistic.label: statistic.numbers(records) for statistic in statistics}
        return {
            str(side): {
                statistic.label: statistic.numbers(
                    [record for record in records if record[self.across] == side]
                )
                for statistic in statistics
            }
            for side in sides
        }

    def _headings(self, statistics: Sequence[Statistic], sides: Sequence[Any]) -> list[str]:
        if not self.across:
            return [statistic.heading for statistic in statistics]
        if len(statistics) == 1:
            return [str(side) for side in sides]
        return [f"{side}: {entry.heading}" for side, entry in product(sides, statistics)]

    def _cells(
        self, records: Sequence[Record], statistics: Sequence[Statistic], sides: Sequence[Any]
    ) -> list[str]:
        if not self.across:
            return [statistic.cell(records) for statistic in statistics]
        return [
            statistic.cell([record for record in records if record[self.across] == side])
            for side, statistic in product(sides, statistics)
        ]


@dataclass(frozen=True, slots=True)
class _Histogram:
    """Numbers of rows by the value of a column, as a table and a picture."""

    of: str
    title: str
    by: str
    where: Where | None
    none: str

    def check(self, columns: Columns) -> None:
        known_column(columns, self.of, "a histogram of the page")
        if self.by:
            _check_key(columns, self.by, "a histogram of the page")

    def part(self, rows: Sequence[Row], columns: Columns) -> PagePart:
        column = columns[self.of]
        keys = (self.by,) if self.by else ()
        records = _counting(records_by(columns, rows, keys), self.where)
        title = self.title or column.heading
        groups = {
            " ".join(map(str, names)) or "rows": flattened([record[self.of] for record in group])
            for names, group in _grouped(records, keys).items()
        }
        if not groups:
            return PagePart()

        bars, counts = _bars(groups, column, self.none)
        table = Table(
            title=f"{title}, rows",
            columns=(self.by or "", *bars),
            rows=[(label, *map(str, numbers)) for label, numbers in counts.items()],
        )
        return PagePart(tables=[table], pictures=_drawn(title, column.heading, bars, counts))


@dataclass(frozen=True, slots=True)
class _Bound:
    """A bound on a statistic of all rows, or of each group of them."""

    of: Statistic
    most: float
    least: float
    by: tuple[str, ...]
    where: Where | None

    def check(self, columns: Columns) -> None:
        for key in self.by:
            _check_key(columns, key, "a bound of the page")
        self.of.bound_to(columns, "a bound of the page")

    def part(self, rows: Sequence[Row], columns: Columns) -> PagePart:
        statistic = self.of.bound_to(columns, "a bound of the page")
        records = _counting(records_by(columns, rows, self.by), self.where)
        failed = []
        for values, group in (_grouped(records, self.by) or {(): []}).items():
            names = [
                f"{columns[key].heading} {columns[key].cell(value)}" if key in columns else value
                for key, value in zip(self.by, values, strict=bool(group))
            ]
            if line := self._missed(statistic, group):
                failed.append(f"{', '.join([*names, statistic.label])}: {line}")
        return PagePart(failed=failed)

    def _missed(self, statistic: Statistic, records: Sequence[Record]) -> str:
        """How a group misses the bound; empty if the group is within it."""
        numbers = statistic.numbers(records)
        if not numbers:
            return "no value" if records else "no row"

        value = next(iter(numbers.values()))
        if self.least <= value <= self.most:
            return ""
        word = "at most" if value > self.most else "at least"
        bound = self.most if value > self.most else self.least
        return f"{statistic.amount(value)}, {word} {statistic.amount(bound)} is allowed"


@dataclass(frozen=True, slots=True)
class _Special:
    """Element made from the result of a function of the rows."""

    function: Callable[[list[Row]], Any]

    def check(self, columns: Columns) -> None:
        del columns

    def part(self, rows: Sequence[Row], columns: Columns) -> PagePart:
        del columns
        if not rows:
            return PagePart()

        parts = self.function(list(rows))
        parts = parts if isinstance(parts, list) else [parts]

        return PagePart(
            metrics={k: v for part in parts if isinstance(part, Mapping) for k, v in part.items()},
            tables=[part for part in parts if isinstance(part, Table)],
            lines=[part for part in parts if isinstance(part, str)],
            pictures=_pictures([part for part in parts if isinstance(part, tuple)]),
        )


def _pictures(items: Sequence[Any]) -> "Iterator[tuple[str, str, Figure]]":
    """Pictures, each drawn when it is requested."""
    for title, caption, figure in items:
        drawn: Any = figure() if callable(figure) else figure
        yield title, caption, drawn


def _check_key(columns: Columns, key: str, what: str) -> None:
    """Refuse a key of groups that is neither a column nor a meaning of the keys of columns."""
    if key not in {column.by for column in columns.values() if column.by}:
        known_column(columns, key, what)


def _counting(records: Sequence[Record], where: Where | None) -> list[Record]:
    return [record for record in records if where is None or where(record)]


def _grouped(records: Sequence[Record], by: Sequence[str]) -> dict[tuple[Any, ...], list[Record]]:
    groups: dict[tuple[Any, ...], list[Record]] = {}
    for record in records:
        groups.setdefault(tuple(_hashable(record[key]) for key in by), []).append(record)
    return groups or {(): []} if not by else groups


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


def _left_out(statistics: Sequence[Statistic], records: Sequence[Record]) -> str:
    """Sentence about values that are missing; empty if there are none."""
    missing = [
        f"{statistic.label}: {count} of {len(records)} rows have no value"
        for statistic in statistics
        if statistic.kind != "count" and (count := statistic.missing(records))
    ]
    return "; ".join(missing)


def _bars(
    groups: Mapping[str, Sequence[Any]], column: ResultColumn, none: str
) -> tuple[list[str], dict[str, list[int]]]:
    """Labels of the bars, and their heights by group: one bar for each whole number, bins for
    others.
    """
    # whole numbers have one bar each, other numbers one for each bin
    known = [value for values in groups.values() for value in values if value is not None]
    whole = all(isinstance(value, int) for value in known) and column.factor == 1.0
    if whole and (not known or max(known) - min(known) < _MOST_WHOLE):
        bars = range(min(known), max(known) + 1) if known else range(0)
        labels = list(map(str, bars))
        counts = {
            name: [sum(value == bar for value in values) for bar in bars]
            for name, values in groups.items()
        }
    else:
        edges = np.histogram_bin_edges(np.array(known, dtype=float) * column.factor, _BINS)
        labels = [column.number(float(low)) for low in edges[:-1]]
        counts = {
            name: np.histogram(
                [column.factor * value for value in values if value is not None], edges
            )[0].tolist()
            for name, values in groups.items()
        }

    if any(value is None for values in groups.values() for value in values):
        labels.append(none)
        for name, values in groups.items():
            counts[name].append(sum(value is None for value in values))
    return labels, counts


def _drawn(
    title: str, heading: str, bars: Sequence[str], counts: Mapping[str, Sequence[int]]
) -> Iterator[tuple[str, str, "Figure"]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(bars))
    width = 0.8 / max(1, len(counts))

    for i, (name, numbers) in enumerate(counts.items()):
        axes.bar(places + width * (i - 0.5 * (len(counts) - 1)), numbers, width=width, label=name)

    axes.set_xticks(places, bars, rotation=90 if len(bars) > 10 else 0)
    axes.set_xlabel(heading)
    axes.set_ylabel("rows")
    if len(counts) > 1:
        axes.legend()

    yield title, "", figure

"""Study harness: runs the cases of an experiment in worker processes, resumes them, and summarises
the rows.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table as RichTable

from uuv.experiment.engines import Engine, engine_for
from uuv.experiment.loaded_code import digests, loaded_files, new_digests
from uuv.experiment.local_processes import NO_LIMITS
from uuv.experiment.options import PoolOptions
from uuv.experiment.row_log import METRICS, PAGE, TIMING, RowLog, Timing, by_case, without_log
from uuv.experiment.row_table import Row, read_rows
from uuv.experiment.worker import Limits, TimeLimitError, within_time
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.files import folder_given, folder_name
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.run_folder import RUNS, works_in
from uuv.sim.runs.saving import write_json, write_whole
from uuv.sim.runs.terminal import console as console_of
from uuv.sim.runs.terminal import verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Case = TypeVar("Case")
NOT_ACCEPTED = 1  # exit code
DIED = "its process died"
_WIDTH = 160  # [characters] width of a line if the output is not a terminal


@dataclass(frozen=True, slots=True)
class Table:
    """Table of text cells, for the terminal and the report."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    labels: int = 1  # number of leading columns that are text, aligned left

    def printed(self) -> RichTable:
        """The table for the terminal."""
        table = RichTable(
            title=self.title or None, caption=self.caption or None, title_justify="left"
        )

        for i, column in enumerate(self.columns):
            table.add_column(column, justify="left" if i < self.labels else "right", no_wrap=i == 0)
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        """The table as markdown."""
        lines = [
            self.columns,
            ["---" if i < self.labels else "---:" for i in range(len(self.columns))],
            *self.rows,
        ]
        return f"**{self.title}**\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Summary of all rows of a study."""

    metrics: Mapping[str, Any]  # figures for metrics.json
    tables: Sequence[Table] = ()
    lines: Sequence[str] = ()  # lines printed below the tables
    # title, caption and figure of each picture, for the report
    pictures: Iterable[tuple[str, str, "Figure"]] = ()
    caption: str = ""  # text below the title of the report
    failed: Sequence[str] | None = None  # missed bounds; None if the study has no bounds

    @property
    def accepted(self) -> bool:
        """True if no bound was missed."""
        return not self.failed

    @property
    def verdict(self) -> dict[str, Any]:
        """Entries "accepted" and "failed" of metrics.json; empty for a study without bounds."""
        return (
            {} if self.failed is None else {"accepted": self.accepted, "failed": list(self.failed)}
        )

    def print_to(self, console: Console) -> None:
        """Print tables, lines and verdict."""
        for table in self.tables:
            console.print(table.printed())
        for line in self.lines:
            console.print(line, highlight=False, markup=False)
        if self.failed is not None:
            console.print(verdict("; ".join(self.failed)))

    def write_page(self, file: Path, title: str, made_by: Mapping[str, Any], pace: str) -> None:
        """Write report.html.

        Args:
            file: HTML file.
            title: Title of the page.
            made_by: Options of the study.
            pace: Sentence about the computing time.

        Raises:
            ConfigurationError: The file cannot be written.
        """
        from uuv.sim.interfaces import page
        from uuv.sim.runs.provenance import provenance_rows

        accepted = None if self.failed is None else self.accepted
        about = " ".join(filter(None, (self.caption, pace)))
        parts = [
            page.heading(title, accepted, reasons=self.failed or (), about=about),
            *(
                page.section(
                    table.title,
                    page.table(table.columns, table.rows, texts=range(table.labels)),
                    page.caption(table.caption),
                )
                for table in self.tables
            ),
            *(page.paragraph(line) for line in self.lines),
            *(page.figure(*picture) for picture in self.pictures),
            page.provenance(provenance_rows(made_by)),
        ]
        write_whole(file, page.page(title, parts))


@dataclass(frozen=True, slots=True)
class _Done:
    """Result of one case, which a worker sends back."""

    row: Row | None  # row; None if the case failed
    error: str
    wall_s: float | None
    cpu_s: float | None
    # digests of the files that its process has loaded since its last result
    code: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Study(Generic[Case]):
    """Experiment over many cases: `run_one` returns the row of a case, and `summarise` the summary
    of all rows.

    A case contains everything, except the code, that its row depends on. It is picklable: a number,
    a tuple, or a frozen dataclass. `run_one` must be importable by a fresh Python under its
    module's name.
    """

    cases: Sequence[Case]
    run_one: Callable[[Case], Mapping[str, Any]]
    summarise: Callable[[list[Row]], Summary]  # cases; the rows are in their order
    # function for the row of a case that failed; None: a failure ends the study
    failed: Callable[[Case, str], Mapping[str, Any]] | None = None
    # function for the line printed for a new row; empty: nothing is printed
    line: Callable[[Row], str] = lambda _: ""
    # digests of files that no process of the study may load
    code: Mapping[str, str] = field(default_factory=dict)
    # options that all rows of its folder share, by name
    of: Mapping[str, Any] = field(default_factory=dict)

    def carry_out(
        self, name: str, options: PoolOptions, title: str, limits: Limits = NO_LIMITS
    ) -> int:
        """Run the cases that the study's folder lacks, then print and write the results of all
        cases.

        The folder gets rows/ with the rows as Parquet, study.json with the options, versions and
        code that they depend on, metrics.json and report.html.

        Args:
            name: Name of the study, and of its folder in runs/.
            options: Options of the command.
            title: Title of the report.
            limits: Time and memory of each run.

        Returns:
            The exit code.

        Raises:
            UuvError: A case failed and the study does not allow failures, or the folder cannot be
                used.
        """
        console = _console()
        folder = (
            folder_given(options.out, "--out") if options.out else RUNS / folder_name(name, "name")
        )
        keyed = {key_of(case): case for case in self.cases}
        began = time.perf_counter()
        made_by = provenance(name, options)
        with RowLog.open(folder, anew=options.anew, of=self.of) as log:
            # Cases that have no row yet.
            left = {key: case for key, case in keyed.items() if not log.has(key)}
            if len(left) < len(keyed):
                console.print(
                    f"{len(keyed) - len(left)} of {len(keyed)} runs are already done",
                    highlight=False,
                )

            log.made_with(made_by["options"])
            engine = engine_for(options.engine, options.workers, len(left), limits)
            if left:
                self._fill(log, left, engine, limits, console)

            # Results of all cases, old and new.
            rows = [log.rows[key_of(case)] for case in self.cases]
            pace = _pace(rows, len(left), engine.place, time.perf_counter() - began)
            if lost := sum(not log.has(key) for key in keyed):
                pace += f" {lost} runs: {DIED}; the same command does them again."
            return self._conclude(folder, rows, title, made_by, pace, console)

    def sum_up(self, name: str, options: PoolOptions, title: str) -> int:
        """Print and write the results of the existing rows, without any run, whatever code made
        them.

        Args:
            name: Name of the study, and of its folder in runs/.
            options: Options of the command.
            title: Title of the report.

        Returns:
            The exit code.

        Raises:
            ConfigurationError: There is no row of these cases.
        """
        folder = (
            folder_given(options.out, "--out") if options.out else RUNS / folder_name(name, "name")
        )

        rows_by_key = by_case(read_rows(folder), folder)
        rows = [rows_by_key[key] for case in self.cases if (key := key_of(case)) in rows_by_key]
        if not rows:
            raise ConfigurationError(f"{folder}: has no row of this experiment")

        pace = f"{len(rows)} of {len(self.cases)} runs; {_pace(rows, 0, '', 0.0)}"
        return self._conclude(folder, rows, title, provenance(name, options), pace, _console())

    def _conclude(
        self,
        folder: Path,
        rows: list[Row],
        title: str,
        made_by: Mapping[str, Any],
        pace: str,
        console: Console,
    ) -> int:
        """Print and write the summary of `rows`, and return the exit code."""
        summary = self.summarise([without_log(row) for row in rows])
        works_in(folder)
        write_json(
            folder / METRICS, as_json({**summary.metrics, **summary.verdict, "provenance": made_by})
        )

        summary.print_to(console)
        console.print(pace, highlight=False)
        summary.write_page(folder / PAGE, title, made_by["options"], pace)
        console.print(f"written to {folder}/", highlight=False)
        return 0 if summary.accepted else NOT_ACCEPTED

    def _fill(
        self,
        log: RowLog,
        left: Mapping[str, Case],
        engine: Engine,
        limits: Limits,
        console: Console,
    ) -> None:
        """Run the cases in `left`, by key, and add their rows to the log."""
        progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )

        log.depends_on({**digests(loaded_files()), **self.code})
        run = partial(_timed, self.run_one, limits.time_s)
        with progress:
            bar = progress.add_task("runs", total=len(left))

            # Messages of results are handled one by one; the rows of a message are on disk before
            # the next one.
            for outcomes in engine.results(list(left.values()), run, _died):
                rows, error = self._rows_of(outcomes)
                for _, done in outcomes:
                    log.depends_on(done.code)
                log.add([(key_of(case), row, timing) for case, row, timing in rows])

                if error:
                    raise ConfigurationError(error)

                progress.advance(bar, len(rows))
                for _, row, _ in rows:
                    if line := self.line(row):
                        console.print(line, highlight=False, markup=False)

    def _rows_of(
        self, outcomes: Sequence[tuple[Case, _Done]]
    ) -> tuple[list[tuple[Case, Row, Timing]], str]:
        """Rows and times of the cases that have a row, and the first error of the other cases, or
        "".
        """
        rows: list[tuple[Case, Row, Timing]] = []
        error = ""

        for case, done in outcomes:
            row = done.row
            if row is None and self.failed is None:
                error = error or (f"{case}: {DIED}" if done.error == DIED else done.error)
                continue

            # The row of a failed case is defined by the study.
            row = (
                as_json(self.failed(case, done.error))
                if row is None and self.failed is not None
                else row
            )
            assert row is not None

            rows.append((case, row, {"wall_s": done.wall_s, "cpu_s": done.cpu_s}))
        return rows, error


def _console() -> Console:
    return console_of(_WIDTH)


def key_of(case: Any) -> str:
    """Digest of a case's content, under which its row is stored."""
    content = json.dumps(_plain(case), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def as_json(value: Any) -> Any:
    """`value` in JSON types, as it is read back from a file; numbers that are not finite become
    None.
    """
    return _finite(json.loads(json.dumps(_plain(value))))


def _timed(
    run_one: Callable[[Case], Mapping[str, Any]], limit_s: float | None, case: Case
) -> _Done:
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        with within_time(limit_s):
            row, error = as_json(run_one(case)), ""
    except UuvError as failure:
        row, error = None, str(failure)
    except TimeLimitError:
        row, error = None, f"not finished within {limit_s:g} s"
    except MemoryError:
        row, error = None, "out of memory"
    return _Done(row, error, time.perf_counter() - wall, time.process_time() - cpu, new_digests())


def _died(_: Any) -> _Done:
    return _Done(None, DIED, None, None, {})


def _pace(rows: Sequence[Row], done: int, machine: str, wall_s: float) -> str:
    """Sentence about the computing time of all rows, and of the rows made in this session."""
    cpu = sum(row[TIMING]["cpu_s"] or 0.0 for row in rows)
    done_now = f"; {done} of them now, in {wall_s:.0f} s on {machine}" if done else ""
    return f"{len(rows)} runs in {cpu:.0f} s of one core{done_now}."


def _plain(value: Any) -> Any:
    """`value` in types that `json` writes, which keep infinite and NaN floats distinct."""
    if is_dataclass(value) and not isinstance(value, type):
        return {entry.name: _plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, (set, frozenset)):
        return sorted(_plain(entry) for entry in value)
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    return str(value) if isinstance(value, Path) else value


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value

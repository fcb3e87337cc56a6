"""Study harness: runs the cases of an experiment in worker processes, resumes, sums up and reports them."""

import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from scenarios.study.loaded_code import loaded_files
from scenarios.study.options import PoolOptions
from scenarios.study.pool import run_all
from scenarios.study.row_log import KEY, METRICS, PAGE, TIMING, RowLog
from scenarios.study.summary import Row, Summary
from sim.interfaces.errors import ConfigurationError, UuvError
from sim.runs.provenance import provenance
from sim.runs.run_folder import RUNS
from sim.runs.saving import write_json

Case = TypeVar("Case")
NOT_ACCEPTED = 1  # exit code
DIED = "its process died"


@dataclass(frozen=True, slots=True)
class _Done:
    """What a worker sends back for one case."""

    row: Row | None  # None: it failed
    error: str
    wall_s: float | None
    cpu_s: float | None
    files: frozenset[str]  # that the worker has loaded


@dataclass(frozen=True, kw_only=True)
class Study(Generic[Case]):
    """Experiment over many cases: `run_one` gives the row of a case, `summarise` the summary of all rows.

    A case holds everything that its row depends on besides the code, and is picklable: a number, a tuple, or a frozen
    dataclass. `run_one` must be importable by a fresh Python under its module's name.
    """

    cases: Sequence[Case]
    run_one: Callable[[Case], Mapping[str, Any]]
    summarise: Callable[[list[Row]], Summary]  # the rows are in the order of the cases
    failed: Callable[[Case, str], Mapping[str, Any]] | None = None  # row of a case that failed; None: the study ends
    line: Callable[[Row], str] = lambda _: ""  # printed when a row is there; empty: nothing

    def carry_out(self, name: str, options: PoolOptions, title: str) -> int:
        """Runs the cases that are missing in the study's folder, then prints and writes the results of all.

        The folder gets results.jsonl with the rows, study.json with what they depend on, metrics.json and report.html.

        Args:
            name: Name of the study, and of its folder in runs/.
            options: Options of the command.
            title: Title of the report.

        Returns:
            The exit code.

        Raises:
            UuvError: A case failed and the study does not allow for that, or the folder is of no use.
        """
        console = Console(width=None if sys.stdout.isatty() else 160)
        folder = options.out or RUNS / name
        workers = options.workers or os.cpu_count() or 1
        keyed = {key_of(case): case for case in self.cases}
        began = time.perf_counter()
        with RowLog.open(folder, anew=options.anew) as log:
            left = {key: case for key, case in keyed.items() if key not in log.rows}
            if len(left) < len(keyed):
                console.print(f"{len(keyed) - len(left)} of {len(keyed)} runs are there already", highlight=False)
            self._fill(log, left, workers, console)
            rows = [log.rows[key_of(case)] for case in self.cases]
            pace = _pace(rows, len(left), workers, time.perf_counter() - began)
            summary = self.summarise([_without_log(row) for row in rows])
            made_by = provenance(name, options)
            write_json(folder / METRICS, as_json({**summary.metrics, **summary.verdict, "provenance": made_by}))
            summary.print_to(console)
            console.print(pace, highlight=False)
            summary.write_page(folder / PAGE, title, made_by["options"], pace)
            console.print(f"written to {folder}/", highlight=False)
        return 0 if summary.accepted else NOT_ACCEPTED

    def _fill(self, log: RowLog, left: Mapping[str, Case], workers: int, console: Console) -> None:
        """Runs the cases in `left`, by key, and adds their rows to the log."""
        progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        if left:
            log.depends_on(loaded_files())
        with progress:
            bar = progress.add_task("runs", total=len(left))
            for case, done in self._results(list(left.values()), workers):
                row = done.row
                if row is None and self.failed is not None:
                    row = as_json(self.failed(case, done.error))
                elif row is None:
                    raise ConfigurationError(f"{case}: {DIED}" if done.error == DIED else done.error)
                log.depends_on(done.files)
                log.add(key_of(case), row, {"wall_s": done.wall_s, "cpu_s": done.cpu_s})
                progress.advance(bar)
                if said := self.line(row):
                    console.print(said, highlight=False, markup=False)

    def _results(self, cases: Sequence[Case], workers: int) -> Iterator[tuple[Case, _Done]]:
        """Each case with its result; a single worker is this process."""
        if workers == 1:
            return ((case, _timed(self.run_one, case)) for case in cases)
        return run_all(cases, min(workers, max(1, len(cases))), partial(_timed, self.run_one), _died)


def key_of(case: Any) -> str:
    """Digest of a case's content, by which its row is found again."""
    content = json.dumps(_plain(case), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def as_json(value: Any) -> Any:
    """`value` in JSON types, as they are read back from a file: numbers that are not finite become None."""
    return _finite(json.loads(json.dumps(_plain(value))))


def _timed(run_one: Callable[[Case], Mapping[str, Any]], case: Case) -> _Done:
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        row, error = as_json(run_one(case)), ""
    except UuvError as failure:
        row, error = None, str(failure)
    return _Done(row, error, time.perf_counter() - wall, time.process_time() - cpu, loaded_files())


def _died(_: Any) -> _Done:
    return _Done(None, DIED, None, None, frozenset())


def _pace(rows: Sequence[Row], done: int, workers: int, wall_s: float) -> str:
    """Sentence about the computing time of all rows, and of those that were done now."""
    cpu = sum(row[TIMING]["cpu_s"] or 0.0 for row in rows)
    now = f"; {done} of them now, in {wall_s:.0f} s on {workers} workers" if done else ""
    return f"{len(rows)} runs in {cpu:.0f} s of one core{now}."


def _without_log(row: Row) -> Row:
    return {name: value for name, value in row.items() if name not in (KEY, TIMING)}


def _plain(value: Any) -> Any:
    """`value` in types that `json` writes; tells floats apart that are not finite."""
    if is_dataclass(value) and not isinstance(value, type):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if isinstance(value, (set, frozenset)):
        return sorted(_plain(each) for each in value)
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    return str(value) if isinstance(value, Path) else value


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value

"""Study: contact work under combined model errors of sea, vehicle, sensors and surface; each run is drawn anew.

    ./uvw run scripts/studies/contact.py --runs 500            # resumes an interrupted study.
    ./uvw run scripts/studies/contact.py --runs 500 --ablate   # adds the same runs without each method.
    ./uvw run scripts/studies/contact.py --only 17             # that run alone, with log and report.

The draw of a run depends on --seed and its number only. Exit code 0: at least 99 % of the runs keep contact and stay
within 3 mm and 8 N after transients, and none damages or diverges.
"""

from scenarios.start import parse, run_scenario  # isort: skip

import os
import sys
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from scenarios.campaigns.contact_study import KEPT, PATHS, Ranges, RunTask, StudyBounds, draw, one_run
from scenarios.campaigns.pool import run_all
from scenarios.campaigns.row_log import StudyLog, died, in_order
from scenarios.campaigns.study_figures import METHODS, summary
from scenarios.campaigns.study_report import rich_tables, write_report
from scenarios.command import NOT_ACCEPTED, command
from sim import hydrodynamics
from sim.interfaces.errors import ConfigurationError
from sim.runs.command_line import RunOptions
from sim.runs.provenance import provenance
from sim.runs.saving import write_json

RUNS, QUICK_RUNS = 500, 4  # number of runs by default, and with --quick


@dataclass(kw_only=True)
class Options:
    """Contact work under random conditions: distributions, failures, and ablation of each method."""

    runs: int | None = None
    """Number of runs; default 500, or 4 with --quick."""
    seed: int = 0
    """Seed of the study."""
    workers: int = 0
    """Number of processes; 0: one for each core. Results do not depend on it."""
    paths: tuple[Literal["longitudinal", "transverse"], ...] = PATHS
    """Paths that the runs take in turn."""
    ranges: Ranges = field(default_factory=Ranges)
    """Ranges of the random draw."""
    ablate: tuple[str, ...] | None = None
    """Also run without each method, or without those named."""
    ablate_runs: int = 100
    """Number of runs that are repeated without each method."""
    only: int | None = None
    """Do only the run of this number, with all its logs, in a folder of its own."""
    without: str = ""
    """With --only: method to leave out."""
    out: Path = Path("runs/study_contact")
    """Folder for results.jsonl, metrics.json and report.html; it holds one study, which is resumed."""
    anew: bool = False
    """Delete the runs in that folder."""
    quick: bool = False
    """Few and shorter jobs, for a first impression."""


def main() -> int:
    """Runs or resumes the study, or does a single run; returns the exit code."""
    options = parse(Options)
    _check(options)
    if options.only is not None:
        return _one(options)
    console = Console(width=None if sys.stdout.isatty() else 160)
    runs = options.runs if options.runs is not None else (QUICK_RUNS if options.quick else RUNS)
    settings = {
        "seed": options.seed,
        "paths": list(options.paths),
        "quick": options.quick,
        "ranges": asdict(options.ranges),
    }
    with StudyLog.open(options.out, settings, anew=options.anew) as log:
        return _study(options, runs, settings, log, console)


def _study(options: Options, runs: int, settings: dict[str, Any], log: StudyLog, console: Console) -> int:
    """Does the missing runs, then prints and writes the results of all; returns the exit code."""
    bounds = StudyBounds()
    methods = () if options.ablate is None else options.ablate or tuple(METHODS)
    tasks = [_task(options, run) for run in range(runs)]
    tasks += [replace(task, without=method) for method in methods for task in tasks[: options.ablate_runs]]
    done = {(row["run"], row["without"]) for row in log.rows}
    left = [task for task in tasks if task.key not in done]
    workers = options.workers or os.cpu_count() or 1
    if len(left) < len(tasks):
        console.print(f"{len(tasks) - len(left)} of {len(tasks)} runs are there already", highlight=False)
    hydrodynamics.install()  # compiled once here, else by every worker
    began = time.perf_counter()
    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    )
    with progress:
        bar = progress.add_task("runs", total=len(left))
        for task, row in run_all(left, workers, one_run, died):
            log.add(row)
            progress.advance(bar)
            if row["class"] != KEPT and not task.without:
                console.print(f"run {task.run:4d}  {row['class']}: {row['kind']}", highlight=False)
    wanted = {task.key for task in tasks}
    rows = in_order(row for row in log.rows if (row["run"], row["without"]) in wanted)
    metrics = summary(rows, bounds, {**settings, "runs": runs})
    write_json(options.out / "metrics.json", {**metrics, "provenance": provenance("study_contact", options)})
    for table in rich_tables(metrics):
        console.print(table)
    cpu = sum(row["timing"]["cpu_s"] or 0.0 for row in log.rows)
    simulated = sum(row["figures"].get("simulated_s") or 0.0 for row in log.rows)
    pace = f"{simulated:.0f} s simulated in {cpu:.0f} s of one core."
    if left:
        pace += f" {len(left)} runs took {time.perf_counter() - began:.0f} s on {workers} workers."
    console.print(pace, highlight=False)
    title = f"Contact work in {runs} seas, seed {options.seed}"
    write_report(options.out / "report.html", rows, metrics, bounds, title=title, pace=pace)
    verdict = (
        "[green]accepted[/green]" if metrics["accepted"] else "[red]not accepted[/red]: " + "; ".join(metrics["failed"])
    )
    console.print(verdict, highlight=False)
    console.print(f"written to {options.out}/", highlight=False)
    return 0 if metrics["accepted"] else NOT_ACCEPTED


def _task(options: Options, run: int) -> RunTask:
    path = options.paths[run % len(options.paths)]
    return RunTask(
        study=options.seed, run=run, path=path, without=options.without, ranges=options.ranges, quick=options.quick
    )


def _one(options: Options) -> int:
    """Repeats a single run as a scenario with all its output."""
    assert options.only is not None
    scenario = draw(_task(options, options.only))
    name = f"run_{options.only:04d}" + (f"_without_{options.without}" if options.without else "")
    own = None if options.out == Options.out else options.out / name
    scenario = replace(scenario, name=f"study_contact/{name}")
    return command(scenario, RunOptions(out=own), time.perf_counter(), f", run {options.only} of study {options.seed}")


def _check(options: Options) -> None:
    least_of = {"runs": 1, "workers": 0, "ablate_runs": 1, "only": 0, "seed": 0}
    for name, least in least_of.items():
        value = getattr(options, name)
        if value is not None and value < least:
            raise ConfigurationError(f"--{name.replace('_', '-')}: must be at least {least}, got {value}")
    if not options.paths:
        raise ConfigurationError("--paths: at least one is needed")
    for method in (*(options.ablate or ()), *((options.without,) if options.without else ())):
        if method not in METHODS:
            raise ConfigurationError(f"method {method!r}: allowed {', '.join(METHODS)}")
    if options.without and options.only is None:
        raise ConfigurationError("--without goes with --only; --ablate leaves methods out of many runs")


if __name__ == "__main__":
    run_scenario(main)

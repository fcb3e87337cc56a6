"""Trials of one job over many seeds on all cores: metrics, table of their spread, and verdict."""

import os
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.table import Table

from scenarios.campaigns.pool import run_all
from scenarios.command import NOT_ACCEPTED, progress
from sim.interfaces.errors import ConfigurationError, UuvError
from sim.runs.saving import write_json

WANTED = 0.95  # share of the trials that must be accepted
Metrics = dict[str, Any]
# Row of the table: label, key of the summary, unit, scale from SI, and which end is the worst.
Row = tuple[str, str, str, float, Literal["min", "max"]]


def run_trials(
    one: Callable[[int], Metrics],
    crashed: Callable[[int, str], Metrics],
    seeds: Iterable[int],
    workers: int,
    console: Console,
) -> list[Metrics]:
    """Metrics of each seed, in the order of `seeds`.

    A trial that fails with an error does not end the others. `one` and `crashed` must be importable by a fresh Python
    under their module's name.

    Args:
        one: Metrics of one seed.
        crashed: Metrics of a seed whose trial failed, with the message.
        seeds: Seeds of the trials.
        workers: Number of processes; 0: one for each core.
        console: Terminal.
    """
    found: dict[int, Metrics] = {}
    seeds = list(seeds)
    with progress(console) as shown:
        bar = shown.add_task("trials", total=len(seeds), note="")
        done = run_all(seeds, workers or os.cpu_count() or 1, partial(_trial, one, crashed), partial(_died, crashed))
        for seed, metrics in done:
            found[seed] = metrics
            if not metrics["accepted"]:
                shown.console.print(f"seed {seed}: {'; '.join(metrics['failed'])}", highlight=False)
            good = sum(bool(each["accepted"]) for each in found.values())
            shown.update(bar, advance=1, note=f"{good} of {len(found)} accepted")
    return [found[seed] for seed in seeds]


def _trial(one: Callable[[int], Metrics], crashed: Callable[[int, str], Metrics], seed: int) -> Metrics:
    try:
        return one(seed)
    except UuvError as error:
        return crashed(seed, str(error))


def _died(crashed: Callable[[int, str], Metrics], seed: int) -> Metrics:
    return crashed(seed, "its process died")


def check_trials(trials: int, workers: int) -> None:
    """Checks the options --trials and --workers.

    Raises:
        ConfigurationError: One of them is negative.
    """
    if trials < 0 or workers < 0:
        raise ConfigurationError(f"--trials and --workers: must be >= 0, got {trials} and {workers}")


def report_trials(
    trials: Sequence[Metrics],
    figures: Metrics,
    rows: Iterable[Row],
    folder: Path,
    made_by: Metrics,
    console: Console,
    said: str = "",
) -> int:
    """Writes trials.json and prints the summary.

    Args:
        trials: Metrics of each trial.
        figures: Summary of the trials.
        rows: Rows of the table.
        folder: Folder of trials.json.
        made_by: Provenance for the file.
        console: Terminal.
        said: Text appended to the line of the success rate.

    Returns:
        The exit code.
    """
    write_json(folder / "trials.json", {"summary": figures, "trials": list(trials), "provenance": made_by})
    console.print(trials_table(figures, rows))
    console.print(
        f"{figures['accepted']} of {figures['trials']} accepted: {figures['share']:.1%}, 95 % interval "
        f"{figures['share_low']:.1%} to {figures['share_high']:.1%}{said}",
        highlight=False,
    )
    if figures["failures"]:
        kinds = ", ".join(f"{kind} {count}" for kind, count in figures["failures"].items())
        console.print(f"failures: {kinds} (seeds {figures['failed_seeds']})", highlight=False)
    console.print(f"written to {folder}/trials.json", highlight=False)
    return 0 if figures["share"] >= WANTED else NOT_ACCEPTED


def trials_table(figures: Metrics, rows: Iterable[Row]) -> Table:
    """Table of the spread of each figure over the trials; rows without figures are left out."""
    table = Table()
    for name in ("figure", "median", "95 %", "worst", "unit"):
        table.add_column(name, justify="left" if name in ("figure", "unit") else "right")
    for label, key, unit, scale, worst in rows:
        values = figures[key]
        if values is not None:
            table.add_row(label, *(f"{values[name] * scale:.2f}" for name in ("median", "p95", worst)), unit)
    return table

"""Figures of several runs side by side: `uuv compare RUN RUN...`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from scenarios.cli.past_runs import run_folder
from scenarios.command import SCENARIO_FILE, flat
from scenarios.scenario_file import as_dict, read_scenario
from sim.reporting.series_tables import PastRun

_LEFT_OUT = ("provenance", "timings", "schema")
_ALL = "--all"
_SAME = 0.02  # share by which figures may differ and still count as alike
_USAGE = f"""usage: uuv compare RUN RUN [RUN ...] [{_ALL}]

Options in which the runs differ, and figures that differ by more than {_SAME:.0%} ({_ALL}: all figures).
RUN: folder of a run, or the name of a job for its latest."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the tables; returns the exit code."""
    del verb
    names = [arg for arg in args if arg != _ALL]
    if len(names) < 2 or any(name.startswith("-") for name in names):
        print(_USAGE)
        return 0 if {"-h", "--help"} & set(args) else 2
    folders = [run_folder(name) for name in names]
    console = Console(width=None if Console().is_terminal else 140)
    asked = [flat(as_dict(read_scenario(folder / SCENARIO_FILE))) for folder in folders]
    console.print(table("options that differ", names, _differing(asked)))
    found = [dict(numbers(PastRun.of(folder).metrics)) for folder in folders]
    every = _ALL in args
    rows = [(key, values) for key, values in _rows(found) if every or not alike(values)]
    console.print(table("figures" if every else "figures that differ", names, rows))
    return 0


def numbers(nested: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted name and value of each number, verdict and word of a run's metrics."""
    for key, value in nested.items():
        if isinstance(value, Mapping):
            if key not in _LEFT_OUT:
                yield from numbers(value, f"{before}{key}.")
        elif value is None or isinstance(value, bool | int | float) or key in ("state", "abort"):
            yield before + key, value


def alike(values: Sequence[Any]) -> bool:
    """True if all values are equal, or numbers within _SAME of each other."""
    if all(value == values[0] for value in values):
        return True
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
        return False
    return max(values) - min(values) <= _SAME * max(map(abs, values))


def table(title: str, names: Sequence[str], rows: Sequence[tuple[str, Sequence[Any]]]) -> Table:
    """A column for each run."""
    made = Table(title=title, title_justify="left")
    made.add_column("")
    for name in names:
        made.add_column(Path(name).name, justify="right", overflow="fold")
    for key, values in rows:
        made.add_row(key, *map(_said, values))
    return made


def _differing(several: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[Any]]]:
    return [(key, values) for key, values in _rows(several) if any(value != values[0] for value in values)]


def _rows(several: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[Any]]]:
    keys = dict.fromkeys(key for one in several for key in one)
    return [(key, [one.get(key) for one in several]) for key in keys]


def _said(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return str(value)
    return "nan" if math.isnan(value) else f"{value:.4g}"

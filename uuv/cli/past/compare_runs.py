"""Figures of several runs side by side: `uuv compare RUN RUN...`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuv.cli.past_runs import TRUST_HELP, run_folder, scenario_of
from uuv.kinds import TRUST
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.extras import LOG, absent, to_install
from uuv.sim.runs.saving import write_whole

if TYPE_CHECKING:
    from rich.table import Table

    from uuv.sim.reporting.series_tables import PastRun

_LEFT_OUT = ("provenance", "timings", "start", "schema")
_ASKED = ("scenario", "options.", "model_sha256")  # what was asked for, and the model that follows from it
_ALL = "--all"
_SAME = 0.02  # share by which figures may differ and still count as alike
_USAGE = f"""usage: uuv compare RUN RUN [RUN ...] [{_ALL}] [{TRUST}]

Options and versions in which the runs differ, and figures that differ by more than {_SAME:.0%} ({_ALL}: all figures).
The same and the time series of the first two, laid over each other, are left as compare_NAME.html in the first folder.
RUN: folder of a run, or the name of a job for its latest.
{TRUST_HELP}"""
Rows = list[tuple[str, list[Any]]]


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the tables, and writes the page; returns the exit code."""
    del verb
    names = [arg for arg in args if arg not in (_ALL, TRUST)]
    if len(names) < 2 or any(name.startswith("-") for name in names):
        print(_USAGE)
        return 0 if {"-h", "--help"} & set(args) else 2
    folders = [run_folder(name) for name in names]
    from uuv.sim.reporting.series_tables import PastRun

    runs = [PastRun.of(folder) for folder in folders]
    found = tables(runs, every=_ALL in args, trust=TRUST in args)
    from uuv.sim.runs.terminal import console as console_of

    console = console_of()
    for title, rows in found.items():
        console.print(table(title, [str(run.folder) for run in runs], rows) if rows else f"{title}: none")
    if absent(LOG):
        console.print(f"no page of the time series: {to_install(LOG)}", markup=False, highlight=False)
    elif without := [str(run.folder) for run in runs[:2] if not run.rates]:
        console.print(f"no page of the time series: {', '.join(without)} was run with --no-record", highlight=False)
    else:
        try:
            console.print(f"written to {write_page(runs, found)}", highlight=False, soft_wrap=True)
        except ConfigurationError as error:
            console.print(f"no page of the time series: {error}", highlight=False, soft_wrap=True)
    return 0


def tables(runs: "Sequence[PastRun]", *, every: bool, trust: bool = False) -> dict[str, Rows]:
    """Rows of options and of versions that differ, and of figures: all, or those that differ."""
    from uuv.scenario_file import as_dict, flat

    asked = [flat(as_dict(scenario_of(run.folder, trust=trust))) for run in runs]
    made = [flat(run.metrics.get("provenance", {})) for run in runs]
    made = [{key: value for key, value in one.items() if not key.startswith(_ASKED)} for one in made]
    figures = [dict(numbers(run.metrics)) for run in runs]
    shown = [(key, values) for key, values in _rows(figures) if every or not alike(values)]
    versions = _differing(made)
    return {
        "options that differ": _differing(asked),
        **({"versions that differ": versions} if versions else {}),
        "figures" if every else "figures that differ": shown,
    }


def write_page(runs: "Sequence[PastRun]", found: Mapping[str, Rows]) -> Path:
    """Page with the tables, and the time series of the first two runs; written to the folder of the first."""
    from uuv.sim.evaluation.metrics import Bounds
    from uuv.sim.reporting import report_page
    from uuv.sim.reporting.timelines import timelines

    names = _short([run.folder for run in runs])
    both = runs[:2]
    bounds = Bounds() if all("tool" in run.metrics for run in both) else None
    drawn = timelines({name: run.recorded for name, run in zip(names, both, strict=False)}, bounds)
    listed = "".join(
        f"<section><h2>{report_page.text(title)}</h2>"
        f"{report_page.table(('', *names), [(key, *map(_said, values)) for key, values in rows])}</section>"
        for title, rows in found.items()
        if rows
    )
    title = " against ".join(names)
    body = f"<header><h1>{report_page.text(title)}</h1></header>{listed}<section><h2>Time series</h2>{drawn}</section>"
    file = runs[0].folder / f"compare_{names[1].replace('/', '_')}.html"
    write_whole(file, report_page.page(title, body))
    return file


def _short(folders: Sequence[Path]) -> list[str]:
    """Names of folders: the last part, or more of them where they would be alike."""
    whole = [folder.resolve().parts for folder in folders]
    for parts in range(1, max(map(len, whole))):
        names = ["/".join(one[-parts:]) for one in whole]
        if len(set(names)) == len(names):
            return names
    return list(map(str, folders))


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
    apart = max(values) - min(values)
    return math.isfinite(apart) and apart <= _SAME * max(map(abs, values))


def table(title: str, names: Sequence[str], rows: Sequence[tuple[str, Sequence[Any]]]) -> "Table":
    """A column for each run."""
    from rich.table import Table

    made = Table(title=title, title_justify="left")
    made.add_column("")
    for name in names:
        made.add_column(Path(name).name, justify="right", overflow="fold")
    for key, values in rows:
        made.add_row(key, *map(_said, values))
    return made


def _differing(several: Sequence[Mapping[str, Any]]) -> Rows:
    return [(key, values) for key, values in _rows(several) if any(value != values[0] for value in values)]


def _rows(several: Sequence[Mapping[str, Any]]) -> Rows:
    keys = dict.fromkeys(key for one in several for key in one)
    return [(key, [one.get(key) for one in several]) for key in keys]


def _said(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return one_line(str(value))
    return "nan" if math.isnan(value) else f"{value:.4g}"

"""Figures of several runs side by side: `uuv compare RUN RUN...`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from uuv.cli.json_output import print_json
from uuv.cli.past.past_runs import Run, Trust, run_folder, scenario_of
from uuv.sim.interfaces.errors import ConfigurationError, UuvError, one_line
from uuv.sim.interfaces.extras import LOG, absent, to_install
from uuv.sim.runs.command_line import parse
from uuv.sim.runs.run_folder import FORMAT_KEY
from uuv.sim.runs.saving import write_whole

if TYPE_CHECKING:
    from rich.table import Table

    from uuv.sim.evaluation.bounds import Bounds
    from uuv.sim.reporting.series_tables import PastRun

_LEFT_OUT = (FORMAT_KEY, "provenance", "timings", "start", "schema")
# requested values, and the model that follows from them
_ASKED = ("scenario", "options.", "model_sha256")
_SAME = 0.02  # relative difference up to which figures count as equal
Rows = list[tuple[str, list[Any]]]


@dataclass(kw_only=True)
class CompareOptions:
    """Compare runs: options and versions that differ, and figures that differ by more than 2 %.

    The tables, and the time series of the first two runs laid over each other, are written to
    compare_NAME.html in the first folder.
    """

    a: Run
    b: Run
    more: Annotated[
        Positional[tuple[str, ...]], arg(metavar="[RUN ...]", help="Further runs.")
    ] = ()
    all: bool = False
    """Print all figures."""
    trust: Trust = False
    json: bool = False
    """Print the tables as JSON, and write no page."""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the tables, and writes the page; returns the exit code."""
    del verb
    options = parse(CompareOptions, args)
    folders = [run_folder(name) for name in (options.a, options.b, *options.more)]
    from uuv.sim.reporting.series_tables import PastRun

    runs = [PastRun.of(folder) for folder in folders]
    rows_by_title = tables(runs, every=options.all, trust=options.trust)
    if options.json:
        print_json(
            {"runs": folders, **{title: dict(rows) for title, rows in rows_by_title.items()}}
        )
        return 0

    from uuv.sim.runs.terminal import console as console_of

    console = console_of()
    for title, rows in rows_by_title.items():
        console.print(
            table(title, [str(run.folder) for run in runs], rows) if rows else f"{title}: none"
        )

    if absent(LOG):
        console.print(
            f"no page of the time series: {to_install(LOG)}", markup=False, highlight=False
        )
    elif without := [str(run.folder) for run in runs[:2] if not run.rates]:
        console.print(
            f"no page of the time series: {', '.join(without)} was run with --no-record",
            highlight=False,
        )
    else:
        try:
            console.print(
                f"written to {write_page(runs, rows_by_title, trust=options.trust)}",
                highlight=False,
                soft_wrap=True,
            )
        except ConfigurationError as error:
            console.print(f"no page of the time series: {error}", highlight=False, soft_wrap=True)
    return 0


def tables(runs: "Sequence[PastRun]", *, every: bool, trust: bool = False) -> dict[str, Rows]:
    """Rows of options and of versions that differ, and of figures: all, or those that differ."""
    from uuv.scenario_file import as_dict, flat

    options = [flat(as_dict(scenario_of(run.folder, trust=trust))) for run in runs]
    versions_of = [flat(run.metrics.get("provenance", {})) for run in runs]
    versions_of = [
        {key: value for key, value in provenance.items() if not key.startswith(_ASKED)}
        for provenance in versions_of
    ]

    figures = [dict(numbers(run.metrics)) for run in runs]
    shown = [(key, values) for key, values in _rows(figures) if every or not alike(values)]
    versions = _differing(versions_of)
    return {
        "options that differ": _differing(options),
        **({"versions that differ": versions} if versions else {}),
        "figures" if every else "figures that differ": shown,
    }


def _bounds(runs: "Sequence[PastRun]", *, trust: bool) -> "Bounds | None":
    """Bounds by which all runs were judged; None if they differ, or if the vehicle or the object of
    a run is not here.
    """
    from uuv import first_start
    from uuv.assembly import assemble

    first_start.build()
    try:
        placed = [assemble(scenario_of(run.folder, trust=trust)).placed for run in runs]
    except UuvError:
        return None
    bounds = placed[0].bounds
    return bounds if all(other.bounds == bounds for other in placed) else None


def write_page(
    runs: "Sequence[PastRun]", rows_by_title: Mapping[str, Rows], *, trust: bool = False
) -> Path:
    """Page with the tables and the series of the first two runs, in the folder of the first."""
    from uuv.sim.interfaces import page
    from uuv.sim.reporting.timelines import timelines

    names = _short([run.folder for run in runs])
    both = runs[:2]
    worked = all("tool" in run.metrics for run in both)
    bounds = _bounds(both, trust=trust) if worked else None
    drawn = timelines({name: run.recorded for name, run in zip(names, both, strict=False)}, bounds)
    title = " against ".join(names)

    columns = ("", *names)
    parts = [page.heading(title)]
    for head, rows in rows_by_title.items():
        if rows:
            cells = [(key, *map(_cell, values)) for key, values in rows]
            parts.append(page.section(head, page.table(columns, cells)))
    parts.append(page.section("Time series", page.Html(drawn)))

    file = runs[0].folder / f"compare_{names[1].replace('/', '_')}.html"
    write_whole(file, page.page(title, parts))
    return file


def _short(folders: Sequence[Path]) -> list[str]:
    """Names of folders: as many last parts of their paths as distinguish them."""
    whole = [folder.resolve().parts for folder in folders]
    for parts in range(1, max(map(len, whole))):
        names = ["/".join(parts_of[-parts:]) for parts_of in whole]
        if len(set(names)) == len(names):
            return names
    return list(map(str, folders))


def numbers(nested: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted name and value of each number, boolean, state and abort code of a run's metrics."""
    for key, value in nested.items():
        if key in _LEFT_OUT:
            continue
        if isinstance(value, Mapping):
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

    page_table = Table(title=title, title_justify="left")
    page_table.add_column("")
    for name in names:
        page_table.add_column(Path(name).name, justify="right", overflow="fold")

    for key, values in rows:
        page_table.add_row(key, *map(_cell, values))
    return page_table


def _differing(several: Sequence[Mapping[str, Any]]) -> Rows:
    return [
        (key, values)
        for key, values in _rows(several)
        if any(value != values[0] for value in values)
    ]


def _rows(several: Sequence[Mapping[str, Any]]) -> Rows:
    keys = dict.fromkeys(key for figures in several for key in figures)
    return [(key, [figures.get(key) for figures in several]) for key in keys]


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return one_line(str(value))
    return "nan" if math.isnan(value) else f"{value:.4g}"

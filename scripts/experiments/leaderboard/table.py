"""Leaderboard of the benchmark: one page in Markdown from result files over the same cases."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from uuv.benchmark.score import by_family, totals
from uuv.experiment import Table
from uuv.experiment.row_log import METRICS
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.tables import TableReader

_BOTH = "score both with the same --cases and the same seed"
_SAME = {  # that all results of one table share: its name, and what to do
    "version": ("benchmark version", "score both with one"),
    "seed": ("cases of seed", _BOTH),
    "cases": ("number of cases", _BOTH),
    "cases_digest": ("cases with digest", "their code differs; score both with one"),
}
_COLUMNS = (
    "entry",
    "kept [%]",
    "damage [%]",
    "force RMS [N]",
    "force peak [N]",
    "path [mm]",
    "excursion [mm]",
    "energy [kJ]",
    "step [us]",
    "entry's file",
    "project",
)


def read_result(file: Path) -> dict[str, Any]:
    """A result file of uuv benchmark.

    Raises:
        ConfigurationError: It cannot be read, or is none.
    """
    path = file / METRICS if file.is_dir() else file
    content = json_of(path, "result")
    try:
        record = TableReader(path.name, passes_unknown=True).made(_Result, content)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: is no result file of uuv benchmark: {error}") from error

    for row in content["rows"]:
        if "class" not in row:  # no name of a field
            raise ConfigurationError(
                f"{path}: is no result file of uuv benchmark: a row has no class"
            )

    if len(record.rows) != record.benchmark.cases:
        raise ConfigurationError(
            f"{path}: expected {record.benchmark.cases} rows, got {len(record.rows)}"
        )

    return content


@dataclass(frozen=True, slots=True, kw_only=True)
class _Benchmark:
    """What was scored, and by what code."""

    version: int
    seed: int
    public: bool
    cases: int = field(metadata={"schema": {"minimum": 1}})
    cases_digest: str
    entry: str
    source: str
    code: str
    in_process: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Door:
    """Answers of an entry: their number, and wall times [s]."""

    steps: int
    waited_s: float
    longest_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """Entries of a row that the page is made of; figures are None where a run gave none."""

    family: str
    force_rms_n: float | None
    force_peak_n: float | None
    path_max_m: float | None
    excursion_max_m: float | None
    energy_j: float | None
    door: _Door | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Result:
    """A result file."""

    benchmark: _Benchmark
    rows: list[_Row]


def page(results: Sequence[Mapping[str, Any]]) -> str:
    """The page, the best share kept first.

    Raises:
        ConfigurationError: There are no results, or they are of different cases.
    """
    if not results:
        raise ConfigurationError("leaderboard: expected at least one result file, got none")

    # Only results of the same cases can be compared.
    first = results[0]["benchmark"]
    for record in results:
        about = record["benchmark"]
        for name, (phrase, cure) in _SAME.items():
            if about[name] != first[name]:
                raise ConfigurationError(
                    f"leaderboard: {first['entry']!r} has {phrase} {first[name]}, "
                    f"{about['entry']!r} has {about[name]}: "
                    f"{cure}"
                )

    scored = [
        (entry["benchmark"], totals(entry["rows"]), by_family(entry["rows"])) for entry in results
    ]
    scored.sort(key=lambda row: (-row[1]["kept"]["value"], row[0]["entry"]))

    families = list(dict.fromkeys(name for _, _, counts in scored for name in counts))
    kinds = "public cases" if first["public"] else f"cases of seed {first['seed']}"

    tables = (
        Table(
            title="Scores by the truth",
            columns=_COLUMNS,
            rows=[_cells(about, total) for about, total, _ in scored],
        ),
        Table(
            title="Kept, by family",
            columns=("entry", *families),
            rows=[
                (
                    about["entry"],
                    *(f"{counts[name]['kept']} of {counts[name]['runs']}" for name in families),
                )
                for about, _, counts in scored
            ],
        ),
    )

    return "\n\n".join(
        (
            f"# UUV contact, version {first['version']}: {first['cases']} {kinds}",
            "Shares with exact binomial intervals of 95 %; medians with bootstrap intervals of "
            "95 %, over the runs that gave the figure. Force and path are of surface work, "
            "without the insertions. Step is the mean wall time of one answer through the door, "
            "the entry's computing included; a dash: the controller ran in the simulation's "
            "process. Entry's file is the digest of the file with its class, and of the one with "
            "its estimator; a dash: the entry is a setting of the project's own controller. "
            "Project is the digest of the project's code, without the entry's. See "
            "docs/benchmark.md.",
            *(table.markdown() for table in tables),
            f"Digest of the cases: {first['cases_digest']}.\n",
        )
    )


def _cells(about: Mapping[str, Any], total: Mapping[str, Any]) -> tuple[str, ...]:
    step = total["step_wall_s"]
    return (
        about["entry"],
        _interval(total["kept"], 100.0, 0),
        _interval(total["damaged"], 100.0, 0),
        _interval(total["force_rms_n"], 1.0, 2),
        _interval(total["force_peak_n"], 1.0, 1),
        _interval(total["path_max_m"], 1e3, 2),
        _interval(total["excursion_max_m"], 1e3, 1),
        _interval(total["energy_j"], 1e-3, 2),
        "–" if step is None else f"{1e6 * step:.0f}",
        " ".join(about["source"][at : at + 6] for at in range(0, len(about["source"]), 16)) or "–",
        about["code"],
    )


def _interval(figure: Mapping[str, float] | None, scale: float, digits: int) -> str:
    """A value and its interval in brackets, where it has one."""
    if figure is None:
        return "–"
    figure_text = f"{scale * figure['value']:.{digits}f}"
    if "low" not in figure:
        return figure_text
    return (
        f"{figure_text} ({scale * figure['low']:.{digits}f} to {scale * figure['high']:.{digits}f})"
    )

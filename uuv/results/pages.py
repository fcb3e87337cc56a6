"""Pages of results: one table for each experiment in docs/results.md, and a page with the rest."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import Any

from uuv.catalogue import CHECKOUT, EXPERIMENTS
from uuv.experiment.declaration import Experiment, experiments_in
from uuv.experiment.harness import Summary, Table
from uuv.results.kept_rows import KeptRows, kept_rows
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.saving import write_whole

DOCS = CHECKOUT / "docs"
OVERVIEW = "results.md"
PAGES = "results"  # folder
MOST_LINES = 500  # of the overview
# largest number of lines of a table in the overview; a longer one is only on the experiment's page
MOST_ROWS = 10
STATUS = "Status: "  # begins the line about the last check
_DECLARES = "@experiment("
_HEAD = """\
# Results

An entry for each experiment, printed by `./uvw run uuv results`: a table where the rows of a run
are kept, with the commit and date of that run, else the command that makes them. The status:

- verified: the code that the rows depend on is that of their run, or of the last check, in which a
  subset gave the same values.
- *unverified*: that code has changed since.
- *changed*: the subset gave other values.
- *no rows kept*: nothing is stated, and `--check` leaves it out.
- *no data here*: the experiment needs a folder of measured data, which was not given; what follows
  is of the last check.

Intervals of shares are of 95 % [Wilson 1927]. The page of an experiment has its command,
conditions and other tables. Tables that are not yet printed so are on
[earlier results](results_earlier.md), checks of the physics on [physics](results/physics.md), pool
trials on [their page](pool.md).
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultsOfOne:
    """An experiment of the checkout with its kept rows."""

    experiment: Experiment[Any, Any]
    kept: KeptRows | None
    has_data: bool = False  # True if the folder of measured data that it needs exists

    @property
    def subject(self) -> str:
        """Folder of the experiment below scripts/experiments, in words."""
        return self.experiment.__module__.split(".")[1].replace("_", " ")

    @property
    def status(self) -> str:
        """Validity of the table."""
        if self.kept is None:
            return "*no rows kept*"
        no_data = self.experiment.needs_data and not self.has_data
        return f"*no data here*; {self.kept.status}" if no_data else self.kept.status

    @property
    def command(self) -> str:
        """The command that makes its rows."""
        if self.kept is not None:
            return self.kept.command
        file = Path(*self.experiment.__module__.split(".")).with_suffix(".py")
        return f"./uvw run scripts/{file.as_posix()}"


def all_experiments() -> list[Experiment[Any, Any]]:
    """Experiments of the checkout, by subject and file.

    Raises:
        ConfigurationError: There is no checkout, or two experiments have the same name.
    """
    if not EXPERIMENTS.is_dir():
        raise ConfigurationError(
            "results: needs a checkout of the project, which contains the experiments in scripts/"
        )

    experiments: dict[str, Experiment[Any, Any]] = {}
    for file in sorted(EXPERIMENTS.rglob("[!_]*.py")):
        if _DECLARES not in file.read_text(encoding="utf-8"):
            continue

        module = ".".join(file.relative_to(EXPERIMENTS.parent).with_suffix("").parts)
        for experiment in experiments_in(import_module(module)):
            if experiment.name in experiments:
                other = experiments[experiment.name].__module__
                raise ConfigurationError(
                    f"{experiment.name}: names of experiments must differ, got {other} and {module}"
                )
            experiments[experiment.name] = experiment
    return list(experiments.values())


def results(experiments: Sequence[Experiment[Any, Any]], *, data: bool) -> list[ResultsOfOne]:
    """Experiments with their kept rows; `data` says whether a folder of measured data exists."""
    return [
        ResultsOfOne(experiment=entry, kept=kept_rows(entry.name), has_data=data)
        for entry in experiments
    ]


def pages(entries: Sequence[ResultsOfOne]) -> dict[Path, str]:
    """Text of each page by its file in docs/.

    Raises:
        ConfigurationError: The overview would be too long, or rows have another version.
    """
    texts: dict[Path, str] = {}
    overview = [_HEAD]
    for subject, group in groupby(entries, key=lambda entry: entry.subject):
        overview.append(f"## {subject.capitalize()}\n")
        members = list(group)
        for entry in members:
            if entry.kept is None:
                continue

            summary = entry.experiment.summary(entry.kept.rows)
            overview += _section(entry, summary)
            texts[Path(PAGES) / f"{entry.experiment.name}.md"] = _page(entry, summary)
        overview += _without_rows([entry for entry in members if entry.kept is None])

    text = "\n".join(overview)
    if (lines := text.count("\n")) > MOST_LINES:
        raise ConfigurationError(
            f"{OVERVIEW}: must have at most {MOST_LINES} lines, got {lines}; shorten the first "
            "tables of experiments"
        )
    return {Path(OVERVIEW): text} | texts


def _section(entry: ResultsOfOne, summary: Summary) -> Iterator[str]:
    """An experiment in the overview: title, first short table, and links to the rest."""
    experiment = entry.experiment

    yield f"### {experiment.title}\n"
    short = [table for table in summary.tables if len(table.rows) <= MOST_ROWS]
    if short:
        yield f"{_markdown(short[0])}\n"
    else:
        yield "".join(f"{line}\n" for line in summary.lines[:1]) or "Its tables are long.\n"
    # links to the rest, and the validity of the table
    yield f"[All of it]({PAGES}/{experiment.name}.md). {_origin(entry)}\n"
    yield f"{STATUS}{entry.status}\n"


def _without_rows(entries: Sequence[ResultsOfOne]) -> Iterator[str]:
    """Experiments without kept rows, with a line each for title and command."""
    if entries:
        yield f"{STATUS}{entries[0].status}, of:\n"
        yield from (f"- {entry.experiment.title}: `{entry.command}`" for entry in entries)
        yield ""


def _page(entry: ResultsOfOne, summary: Summary) -> str:
    """The page of an experiment."""
    experiment = entry.experiment
    _, _, rest = experiment.about.partition("\n\n")
    parts = [f"# {experiment.title}\n", f"{rest}\n" if rest else ""]
    parts.append(f"```\n{entry.command}\n```\n")
    parts += [f"{_origin(entry)}\n", f"{STATUS}{entry.status}\n"]

    if summary.failed:
        parts.append(f"Not accepted: {'; '.join(summary.failed)}.\n")
    if summary.lines:
        parts.append("\n".join(f"- {line}" for line in summary.lines) + "\n")
    parts += [f"{_markdown(table)}\n" for table in summary.tables]

    return "\n".join(part for part in parts if part).rstrip() + "\n"


def _origin(entry: ResultsOfOne) -> str:
    """Sentence about the run that gave the rows."""
    record = entry.kept
    assert record is not None, "a page is of kept rows"
    seeds = f", {record.seeds}" if record.seeds else ""
    return f"{len(record.rows)} runs{seeds}, {record.date}, commit {record.commit}."


def _markdown(table: Table) -> str:
    """A table as markdown, with its caption below."""
    cells = Table(
        title=table.title,
        columns=[_escaped(cell) for cell in table.columns],
        rows=[[_escaped(cell) for cell in row] for row in table.rows],
        labels=table.labels,
    )
    return cells.markdown() + (f"\n\n{table.caption}." if table.caption else "")


def _escaped(cell: str) -> str:
    return cell.replace("|", "\\|")


def write_page(path: Path, text: str) -> None:
    """Write a page below docs/.

    Raises:
        ConfigurationError: The file cannot be written.
    """
    (DOCS / path).parent.mkdir(exist_ok=True)
    write_whole(DOCS / path, text)


def without_status(text: str) -> str:
    """A page without the parts that depend on the present code."""
    return "\n".join(line for line in text.splitlines() if not line.startswith(STATUS))


def stale(texts: Mapping[Path, str], docs: Path = DOCS) -> list[str]:
    """Pages that differ from the files in docs/ in more than their status."""
    return [
        path.as_posix()
        for path, text in texts.items()
        if not (docs / path).is_file()
        or without_status((docs / path).read_text(encoding="utf-8")) != without_status(text)
    ]

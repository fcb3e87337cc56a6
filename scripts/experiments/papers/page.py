"""Writes docs/papers.md: what the papers state in numbers, and what this project gives.

    ./uvw run scripts/experiments/papers/page.py

The statements stand in statements.toml beside this file. Their figures are of kept rows: those of
the jobs by stated_runs.py, those of experiments by their own. A statement without a figure there,
or whose rows were found changed by their last check, is refused by name: nothing is written, and
the exit code is 1.
"""

from uuv.start import parse, run_scenario  # isort: skip

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from experiments.papers.stated_runs import stated_runs
from experiments.papers.statements import PaperStatement, Statements, leaves, read
from uuv.results.pages import STATUS, ResultsOfOne, all_experiments, results, write_page

PAGE = Path("papers.md")


@dataclass
class Options:
    """Statements of the papers beside the figures of this project."""


@dataclass(frozen=True, kw_only=True)
class PaperFigures:
    """Kept figures: of jobs by command, of experiments by name."""

    sources: Mapping[str, ResultsOfOne]  # by name of the experiment
    figures: Mapping[str, Mapping[str, Any]]  # by command or name of the experiment

    @classmethod
    def kept(cls, statements: Statements) -> "PaperFigures":
        """Those of the experiments that statements name, and of the jobs."""
        named = {stated_runs.name, *(row.experiment for row in statements.rows)}
        chosen = [entry for entry in all_experiments() if entry.name in named]
        return cls.of(results(chosen, data=False))

    @classmethod
    def of(cls, entries: Sequence[ResultsOfOne]) -> "PaperFigures":
        """Those of some experiments; none of rows that their check found changed."""
        sources = {entry.experiment.name: entry for entry in entries}

        figures: dict[str, Mapping[str, Any]] = {}
        for name, entry in sources.items():
            if entry.kept is None or entry.kept.check.deviations:
                continue
            if name == stated_runs.name:
                figures |= {row["command"]: row["figures"] for row in entry.kept.rows}
            else:
                summary = entry.experiment.summary(entry.kept.rows)
                figures[name] = dict(leaves(dict(summary.metrics)))
        return cls(sources=sources, figures=figures)

    def text(self, row: PaperStatement) -> str | None:
        """What stands beside a statement; None: a figure is lacking."""
        source = row.command or row.experiment
        if not source:
            return row.ours
        try:
            return row.text(self.figures.get(source, {}))
        except KeyError:
            return None

    def refusal(self, row: PaperStatement) -> str:
        """Why there is no figure."""
        entry = self.sources.get(row.experiment or stated_runs.name)
        if entry is None:
            return f"{row.experiment or stated_runs.name}: no such experiment"
        if entry.kept is None or entry.kept.check.deviations:
            return f"{entry.experiment.name}: {entry.status}"
        lacking = [name for name in row.names if name not in self.figures.get(row.command, {})]
        return f"{row.command or row.experiment}: its rows have no {', '.join(lacking)}"


def main() -> int:
    """Writes the page; 1 if a figure is lacking."""
    parse(Options)
    statements = read()
    figures = PaperFigures.kept(statements)
    return write(PAGE, statements, figures, page_of(statements, figures))


def write(page: Path, statements: Statements, figures: PaperFigures, lines: Iterable[str]) -> int:
    """Writes a page of statements; 1, and a line for each, if figures are lacking.

    Args:
        page: File in docs/.
        statements: Its rows.
        figures: Theirs.
        lines: The page, not begun before all figures are there.
    """
    console = Console(highlight=False)

    lacking = [row for row in statements.rows if figures.text(row) is None]
    for row in lacking:
        console.print(f"{row.place}: {figures.refusal(row)}", style="red", markup=False)
    if lacking:
        console.print(f"no page: {len(lacking)} of {len(statements.rows)} statements lack a figure")
        return 1

    # All figures are there
    write_page(page, "\n".join(lines) + "\n")
    console.print(f"{len(statements.rows)} statements written to docs/{page}")
    return 0


def page_of(statements: Statements, figures: PaperFigures) -> Iterator[str]:
    """Lines of the page."""
    yield from ("# The papers, statement by statement", "", statements.intro.strip(), "")
    yield from ("```", "./uvw run scripts/experiments/papers/page.py", "```")
    yield from statuses(list(figures.sources.values()))

    for paper in statements.paper:
        yield from ("", f"## [{paper.source}] {paper.title}", "", paper.text.strip(), "")
        yield from ("| place | stated | here | command | difference |", "|---|---|---|---|---|")
        for row in paper.row:
            command = row.command
            if row.experiment:
                command = figures.sources[row.experiment].command.removeprefix("./uvw run scripts/")
            shown = f"`{command}`" if command else ""
            yield f"| {row.place} | {row.stated} | {figures.text(row)} | {shown} | {row.remark} |"


def statuses(entries: Sequence[ResultsOfOne]) -> Iterator[str]:
    """A line for each source of figures."""
    for entry in entries:
        yield from ("", f"{STATUS}`{entry.experiment.name}`: {entry.status}")


if __name__ == "__main__":
    run_scenario(main)

"""Writes docs/papers.md: what the papers state in numbers, and what this project gives.

    ./uvw run scripts/experiments/papers/page.py

The statements stand in stated/statements.toml. Their figures are of kept rows: those of
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

from experiments.papers.stated.statements import (
    PaperStatement,
    Statements,
    is_command,
    leaves,
    read,
)
from experiments.papers.stated_runs import stated_runs
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
        named = {_experiment(source) for row in statements.rows for source in row.sources}
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
                cases = conditions(entry.experiment.case_names, entry.kept.rows)
                figures[name] = dict(leaves(dict(summary.metrics))) | cases
        return cls(sources=sources, figures=figures)

    def texts(self, row: PaperStatement) -> tuple[str, str, str] | None:
        """What stands beside a statement: as published, by default, a remark; None: one lacks
        a figure.
        """
        try:
            return row.texts(self.figures)
        except KeyError:
            return None

    def refusal(self, row: PaperStatement) -> str:
        """Why there is no figure, of the first source that lacks one."""
        for source in row.sources:
            known = self.figures.get(source, {})
            lacking = [name for name in row.names(source) if name not in known]
            if not lacking:
                continue

            # No rows, or rows without it
            name = _experiment(source)
            entry = self.sources.get(name)
            if entry is None:
                return f"{name}: no such experiment"
            if entry.kept is None or entry.kept.check.deviations:
                return f"{name}: {entry.status}"
            return "; ".join(f"{source}: its rows have no {figure}" for figure in lacking)
        return ""


def _experiment(source: str) -> str:
    """Name of the experiment whose rows have the figures of a source."""
    return stated_runs.name if is_command(source) else source


def conditions(names: Iterable[str], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Conditions of rows by name of the case's field, as "case.seed": the value, or the least and
    the largest as "0 to 9"; and the number of values, as "case.seed.count".
    """
    figures: dict[str, Any] = {}
    for name in names:
        values: list[Any] = []
        for row in rows:
            if row[name] not in values:
                values.append(row[name])

        text = values[0]
        if len(values) > 1:
            numbers = all(
                isinstance(value, int | float) and not isinstance(value, bool) for value in values
            )
            text = f"{min(values):g} to {max(values):g}" if numbers else ", ".join(map(str, values))
        figures |= {f"case.{name}": text, f"case.{name}.count": len(values)}
    return figures


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

    lacking = [row for row in statements.rows if figures.texts(row) is None]
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
        yield "| place | stated | as published | by default | command | difference |"
        yield "|---|---|---|---|---|---|"
        for row in paper.row:
            published, ours, remark = figures.texts(row) or ("", "", "")
            source = "<br>".join(f"`{command}`" for command in _sources(row, figures))
            cells = (row.place, row.stated, published, ours, source, remark)
            yield f"| {' | '.join(cells)} |"


def _sources(row: PaperStatement, figures: PaperFigures) -> list[str]:
    """Commands that give the figures of a statement, after `./uvw run` and `scripts/`."""
    return [
        source
        if is_command(source)
        else figures.sources[source].command.removeprefix("./uvw run scripts/")
        for source in row.sources
    ]


def statuses(entries: Sequence[ResultsOfOne]) -> Iterator[str]:
    """A line for each source of figures."""
    for entry in entries:
        yield from ("", f"{STATUS}`{entry.experiment.name}`: {entry.status}")


if __name__ == "__main__":
    run_scenario(main)

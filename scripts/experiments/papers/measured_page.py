"""Writes docs/measured.md: the models beside the best public measurement of each.

    ./uvw run scripts/experiments/papers/measured_page.py

The comparisons stand in stated/measurements.toml. As with the papers, a figure is of kept
rows; one that is lacking, or whose rows their last check found changed, is refused by name.
"""

from uuv.start import parse, run_scenario  # isort: skip

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from experiments.papers.page import PaperFigures, statuses, write
from experiments.papers.stated.statements import FOLDER, Statements, read
from experiments.papers.stated_runs import stated_runs

FILE = FOLDER / "measurements.toml"
PAGE = Path("measured.md")
_RULE = "|---|---|---|---|---|"


@dataclass
class Options:
    """The models beside public measurements."""


def main() -> int:
    """Writes the page; 1 if a figure is lacking."""
    parse(Options)
    comparisons = read(FILE)
    figures = PaperFigures.kept(comparisons)
    return write(PAGE, comparisons, figures, page_of(comparisons, figures))


def page_of(comparisons: Statements, figures: PaperFigures) -> Iterator[str]:
    """Lines of the page."""
    yield from ("# Measured", "", comparisons.intro.strip(), "")
    yield from ("```", "./uvw run scripts/experiments/papers/measured_page.py", "```")

    for group in comparisons.paper:
        yield from ("", f"## {group.title}", "", group.text.strip())
        if group.row:
            yield from (
                "",
                "| model | measured | the miss | rows | not measured in public |",
                _RULE,
            )
        for row in group.row:
            source = row.experiment or (stated_runs.name if row.command else "")
            rows = f"[{source}](results/{source}.md)" if source else ""
            _, miss, remark = figures.texts(row) or ("", "", "")
            yield f"| {row.place} | {row.stated} | {miss} | {rows} | {remark} |"

    yield from statuses(list(figures.sources.values()))


if __name__ == "__main__":
    run_scenario(main)

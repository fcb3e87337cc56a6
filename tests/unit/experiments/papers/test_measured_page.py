"""The page of measurements: its figures are of kept rows, or stand on the page that it links
(test_typed_numbers.py).
"""

from pathlib import Path

from experiments.papers.measured_page import FILE, PAGE, page_of
from experiments.papers.page import PaperFigures
from experiments.papers.stated.statements import read
from experiments.papers.stated_runs import COMMANDS, STATEMENTS
from uuv.results.pages import without_status

COMPARISONS = read(FILE)


def test_the_page_in_docs_is_that_of_the_kept_rows(root: Path):
    text = "\n".join(page_of(COMPARISONS, PaperFigures.kept(COMPARISONS)))
    kept_page = (root / "docs" / PAGE).read_text(encoding="utf-8")
    assert without_status(kept_page) == without_status(text)


def test_the_jobs_of_the_comparisons_are_run_for_their_figures():
    """A row of a job has the figures of both files of statements."""
    assert any(row.commands for row in COMPARISONS.rows)
    assert set(COMPARISONS.rows) <= set(STATEMENTS)
    assert {command for row in COMPARISONS.rows for command in row.commands} <= set(COMMANDS)


def test_every_comparison_says_what_would_settle_it():
    assert len(COMPARISONS.rows) > 10
    assert [row.place for row in COMPARISONS.rows if not row.remark or not row.stated] == []
    assert [row.place for row in COMPARISONS.rows if row.experiment and not row.figures] == []

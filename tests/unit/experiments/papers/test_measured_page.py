"""The page of measurements: its figures are of kept rows, or stand on the page that it links."""

import re
from pathlib import Path

from experiments.papers.measured_page import FILE, PAGE, page_of
from experiments.papers.page import PaperFigures
from experiments.papers.stated.statements import read
from uuv.results.pages import without_status

COMPARISONS = read(FILE)


def test_the_page_in_docs_is_that_of_the_kept_rows(root: Path):
    text = "\n".join(page_of(COMPARISONS, PaperFigures.kept(COMPARISONS)))
    kept_page = (root / "docs" / PAGE).read_text(encoding="utf-8")
    assert without_status(kept_page) == without_status(text)


def test_a_figure_without_an_experiment_stands_on_the_page_that_it_links(root: Path):
    typed = [row for row in COMPARISONS.rows if not row.command and not row.experiment]
    compared = 0
    for row in typed:
        linked = re.findall(r"\]\((\w+\.md)", row.ours)
        text = "".join((root / "docs" / page).read_text(encoding="utf-8") for page in linked)
        for figure in re.findall(r"\d+\.\d+", row.ours) if linked else ():
            assert figure in text, f"{row.place}: {figure}"
            compared += 1
    assert compared > 8


def test_every_comparison_says_what_would_settle_it():
    assert len(COMPARISONS.rows) > 10
    assert [row.place for row in COMPARISONS.rows if not row.remark or not row.stated] == []
    assert [row.place for row in COMPARISONS.rows if row.experiment and not row.names("")] == []

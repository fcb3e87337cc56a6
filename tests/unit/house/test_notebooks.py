"""The notebooks run without Jupyter and without a screen, and are kept without outputs."""

import sys
from pathlib import Path
from typing import Any

import pytest

from notebook_cells import cells, run_cell
from source_tree import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
QUICK = ("own_urdf",)  # the others are whole jobs
_GUARD = "tests/unit/house/test_notebooks.py::test_a_notebook_runs[own_urdf]"


def books() -> list[Any]:
    """The notebooks; those that run whole jobs are too long for the suite."""
    long = pytest.mark.long(guarded_by=_GUARD)
    return [
        pytest.param(path, id=path.stem, marks=[] if path.stem in QUICK else [long])
        for path in NOTEBOOKS
    ]


def test_there_are_three():
    assert [path.stem for path in NOTEBOOKS] == ["force_law", "main_job", "own_urdf"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path):
    code = [cell for cell in cells(path) if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


@pytest.mark.parametrize("path", books())
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each cell; what a cell ends with shows itself as a card, a picture or a text."""
    folder = tmp_path / "notebooks"  # beside the examples, as in docs/
    folder.mkdir()
    (tmp_path / "examples").symlink_to(ROOT / "docs" / "examples")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path, ""])  # modules that a cell writes
    names: dict[str, Any] = {"__name__": "notebook"}

    shown = [run_cell(cell, names) for cell in cells(path) if cell["cell_type"] == "code"]
    pictures = [value._repr_png_() for value in shown if hasattr(value, "_repr_png_")]
    cards = [value._repr_html_() for value in shown if hasattr(value, "_repr_html_")]
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert [card for card in cards if card and not card.startswith("<div")] == []
    assert pictures or cards
    if "check" in names:
        assert names["check"].jobs
        assert all(job.promised for job in names["check"].jobs)

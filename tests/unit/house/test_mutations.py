"""The list of changes that the tests must see still fits the source."""

from pathlib import Path

import pytest


@pytest.fixture
def run(root: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(root / "tests" / "mutations"))
    import run

    return run


def test_every_change_of_the_list_applies_once_and_is_python(run):
    entries = run.listed()
    assert len(entries) >= 60
    for entry in entries:
        compile(entry["text"], entry["file"], "exec")
    assert len({(entry["file"], entry["old"], entry["new"]) for entry in entries}) == len(entries)

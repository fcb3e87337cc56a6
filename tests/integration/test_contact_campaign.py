"""The campaign of contact work as a user runs it: two short runs, then gone on with by another
number of workers, and from a file of its draws.
"""

import json
from pathlib import Path

import pytest

from uuv.experiment import read_rows

FILE = "scripts/campaigns/contact_quick.toml"


def rows(out: Path) -> dict[int, dict]:
    return {
        row["case"]: {key: entry for key, entry in row.items() if key not in ("timing", "case_id")}
        for row in read_rows(out)
    }


@pytest.mark.long(
    guarded_by="tests/unit/uuv/campaigns/test_campaign.py::"
    "test_cases_from_a_file_are_those_that_were_drawn_but_for_what_is_set"
)
def test_two_runs_are_the_same_whoever_does_them(verb, root, tmp_path, monkeypatch):
    monkeypatch.chdir(root)
    done = verb("campaign", FILE, "--cases", 2, "--out", tmp_path / "two", "--workers", 2)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    metrics = json.loads((tmp_path / "two" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["runs"] == 2
    assert done.returncode == (0 if metrics["accepted"] else 1)

    both = rows(tmp_path / "two")
    assert {row["values"]["task.path"] for row in both.values()} == {"longitudinal", "transverse"}
    for row in both.values():  # whatever became of them, they worked
        assert row["metrics"]["contact.force_error_rms_n"] is not None, row
        assert 1e4 <= row["values"]["perturbations.Pad.stiffness"] <= 2e4

    drawn = tmp_path / "drawn.json"
    assert verb("campaign", FILE, "--write-drawn", drawn).returncode == 0
    options = ("--drawn", drawn, "--cases", 1, "--out", tmp_path / "one", "--workers", 1)
    assert verb("campaign", FILE, *options).returncode in (0, 1)
    assert rows(tmp_path / "one") == {0: both[0]}
    again = verb("campaign", FILE, "--cases", 2, "--out", tmp_path / "two")
    assert "2 of 2 runs are already done" in again.stdout

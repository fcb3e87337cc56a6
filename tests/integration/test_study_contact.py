"""The contact study as a user runs it: two short runs, then gone on with by another number of
workers.
"""

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from uuv.experiment import read_rows

SOFT = ("--ranges.stiffness", "1e4", "2e4")  # keeps the physics at its longest step


def study(root: Path, out: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "scripts/experiments/contact/contact.py",
        "--quick",
        "--out",
        str(out),
        *SOFT,
        *options,
    ]
    return subprocess.run(
        command, cwd=root, capture_output=True, text=True, timeout=600, check=False
    )


def rows(out: Path) -> dict[int, dict]:
    return {
        row["run"]: {key: value for key, value in row.items() if key not in ("timing", "case_id")}
        for row in read_rows(out)
    }


@pytest.mark.long
def test_two_runs_are_the_same_whoever_does_them(root, tmp_path):
    done = study(root, tmp_path / "two", "--runs", "2", "--workers", "2")
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert done.stderr == ""
    metrics = json.loads((tmp_path / "two" / "metrics.json").read_text(encoding="utf-8"))
    schema = json.loads(
        (root / "sim/schemas/study_contact.schema.json").read_text(encoding="utf-8")
    )
    jsonschema.validate(metrics, schema)
    assert metrics["runs"] == 2
    assert done.returncode == (0 if metrics["accepted"] else 1)
    assert (tmp_path / "two" / "report.html").stat().st_size > 50_000
    both = rows(tmp_path / "two")
    assert sorted(both) == [0, 1]
    assert {row["path"] for row in both.values()} == {"longitudinal", "transverse"}
    for row in both.values():  # whatever became of them, they worked
        assert row["figures"]["force_rms_n"] is not None, row
        assert 1e4 <= row["varied"]["stiffness"] <= 2e4
    done = study(root, tmp_path / "one", "--runs", "1", "--workers", "1")
    assert rows(tmp_path / "one") == {0: both[0]}, done.stdout + done.stderr
    again = study(root, tmp_path / "two", "--runs", "2")
    assert "2 of 2 runs are there already" in again.stdout
    assert json.loads((tmp_path / "two" / "metrics.json").read_text(encoding="utf-8")) == metrics


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(["--runs", "0"], "--runs: must be at least 1", id="no runs"),
        pytest.param(["--ranges.friction", "0.6", "0.1"], "--ranges.friction", id="falling range"),
        pytest.param(["--ablate", "luck"], "'luck': allowed compensation", id="unknown method"),
    ],
)
def test_bad_input_is_one_line_and_code_2(script, tmp_path, options, said):
    done = script("experiments.contact.contact", "--out", tmp_path, *options)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr

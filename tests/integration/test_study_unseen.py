"""The study of unseen objects: what it sums up is what its rows say."""

import json
from pathlib import Path
from statistics import median

import pytest

from uuv.experiment import read_rows


def run_study(script, folder: Path, *options: object) -> tuple[list[dict], dict]:
    run = script("experiments.identification.unseen.unseen", "--out", folder, *options)
    assert run.returncode == 0, run.stderr
    assert "Verdicts" in (folder / "report.html").read_text()
    return read_rows(folder), json.loads((folder / "metrics.json").read_text())


def test_scenes_without_the_object(script, tmp_path: Path):
    rows, metrics = run_study(script, tmp_path, "--runs", 0, "--wrong", 1)
    assert [row["content"] for row in rows] == ["absent"]
    assert not any(row["found"] for row in rows)
    assert sum(sum(counts.values()) for counts in metrics["confusion"].values()) == 1
    assert metrics["false_accepts"] == sum(row["decision"] == "accept" for row in rows)


@pytest.mark.long
def test_all_kinds_of_scenes(script, tmp_path: Path):
    rows, metrics = run_study(
        script, tmp_path, "--runs", 4, "--wrong", 4, "--piles", 1, "--sonar", 1, "--start", "any"
    )
    assert len(rows) == 4 + 4 + 5 + 1
    present = [row for row in rows if row["content"] == "present" and row["sensor"] != "sonar"]
    assert metrics["present"]["all"]["scenes"] == len(present) == 4
    assert metrics["present"]["all"]["found"] == sum(row["found"] for row in present)
    assert metrics["present"]["all"]["identify_ms"] == pytest.approx(
        1e3 * median(row["identify_s"] for row in present)
    )
    for row in present:
        near = row["position_m"] < 0.005 + 0.003 * row["range_m"] and row["angle_deg"] < 3.0
        assert row["found"] == near
    assert metrics["piles"]["all"]["scenes"] == 5
    assert metrics["sonar"]["all"]["scenes"] == 1
    depth = [row for row in rows if row["sensor"] != "sonar"]
    wrong = [row for row in depth if row["decision"] == "accept" and not row["found"]]
    assert metrics["false_accepts"] == len(wrong)
    assert sum(sum(counts.values()) for counts in metrics["confusion"].values()) == len(depth)


def test_no_scenes_at_all_are_refused(script):
    run = script("experiments.identification.unseen.unseen", "--runs", 0, "--wrong", 0)
    assert run.returncode == 2
    assert "no scenes" in run.stderr

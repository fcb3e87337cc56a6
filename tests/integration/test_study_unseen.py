"""The study of unseen objects: what it sums up is what its rows say."""

import json
from pathlib import Path

import pytest

from scenarios.study import read_rows


def run_study(script, folder: Path, *options: object) -> tuple[list[dict], dict]:
    run = script("studies.unseen", "--out", folder, *options)
    assert run.returncode == 0, run.stderr
    assert (folder / "report.html").stat().st_size > 10_000
    return read_rows(folder), json.loads((folder / "metrics.json").read_text())


def test_a_scene_with_the_object_and_one_without(script, tmp_path: Path):
    rows, metrics = run_study(script, tmp_path, "--runs", 1, "--wrong", 1)
    assert [row["content"] for row in rows] == ["present", "absent"]
    assert metrics["present"]["all"]["found"] == int(rows[0]["found"])
    assert metrics["present"]["all"]["identify_ms"] == pytest.approx(1e3 * rows[0]["identify_s"])
    assert sum(sum(counts.values()) for counts in metrics["confusion"].values()) == 2
    assert rows[1]["found"] is False


@pytest.mark.long
def test_all_kinds_of_scenes(script, tmp_path: Path):
    rows, metrics = run_study(script, tmp_path, "--runs", 4, "--wrong", 4, "--piles", 1, "--sonar", 1, "--start", "any")
    assert len(rows) == 4 + 4 + 5 + 1
    assert metrics["present"]["all"]["scenes"] == 4
    assert metrics["piles"]["all"]["scenes"] == 5
    assert metrics["sonar"]["all"]["scenes"] == 1
    wrong = [row for row in rows if row["decision"] == "accept" and not row["found"]]
    assert metrics["false_accepts"] == len(wrong)
    assert sum(sum(counts.values()) for counts in metrics["confusion"].values()) == len(rows)


def test_no_scenes_at_all_are_refused(script):
    run = script("studies.unseen", "--runs", 0, "--wrong", 0)
    assert run.returncode == 2
    assert "no scenes" in run.stderr

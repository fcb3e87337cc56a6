"""The experiment on unseen objects: what it sums up is what its rows say."""

import json
from pathlib import Path
from statistics import median

import pytest

from uuv.experiment import read_rows


def run_experiment(script, folder: Path, *options: object) -> tuple[list[dict], dict]:
    run = script(
        "experiments.identification.unseen.unseen", "--workers", 1, "--out", folder, *options
    )
    assert run.returncode == 0, run.stderr
    assert "Verdicts" in (folder / "report.html").read_text()
    return read_rows(folder), json.loads((folder / "metrics.json").read_text())


def test_scenes_without_the_object(script, tmp_path: Path):
    rows, metrics = run_experiment(script, tmp_path, "--present", 0, "--wrong", 1)
    assert [row["content"] for row in rows] == ["absent"]
    assert not any(row["found"] for row in rows)
    assert sum(sum(counts.values()) for counts in metrics["Verdicts"].values()) == 1
    accepted = sum(row["decision"] == "accept" for row in rows)
    assert metrics["false accepts, by cameras"]["good"] == accepted


@pytest.mark.long
def test_all_kinds_of_scenes(script, tmp_path: Path):
    rows, metrics = run_experiment(
        script, tmp_path, "--present", 4, "--wrong", 4, "--piles", 1, "--sonar", 1, "--start", "any"
    )
    assert len(rows) == 4 + 4 + 5 + 1
    assert {row["known"] for row in rows} == {"any"}
    there = [row for row in rows if row["content"] == "present" and row["sensor"] != "sonar"]
    by_sensor = metrics["Object present, by sensor"]
    assert sum(figures["found"]["of"] for figures in by_sensor.values()) == len(there) == 4
    for sensor, figures in by_sensor.items():
        times = [row["identify_s"] for row in there if row["sensor"] == sensor]
        assert figures["time, median"]["median"] == pytest.approx(median(times))
    for row in there:
        near = row["position_m"] < 0.005 + 0.003 * row["range_m"] and row["angle_deg"] < 3.0
        assert row["found"] == near
    piles = metrics["Piles of five"].values()
    assert sum(figures["found"]["of"] for figures in piles) == 5
    depth = [row for row in rows if row["sensor"] != "sonar"]
    wrong = [row for row in depth if row["decision"] == "accept" and not row["found"]]
    assert metrics["false accepts, by cameras"]["good"] == len(wrong)
    assert sum(sum(counts.values()) for counts in metrics["Verdicts"].values()) == len(depth)


def test_no_scenes_at_all_are_refused(script):
    run = script("experiments.identification.unseen.unseen", "--present", 0, "--wrong", 0)
    assert run.returncode == 2
    assert "no scenes" in run.stderr

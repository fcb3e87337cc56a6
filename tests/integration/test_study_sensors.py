"""The experiment on sensors: what it writes, and the order that physics puts calibrations in."""

from pathlib import Path

import pytest

from uuv.experiment import read_rows


@pytest.mark.long
def test_one_scene(script, tmp_path: Path):
    run = script(
        "experiments.identification.sensors", "--runs", 1, "--workers", 1, "--out", tmp_path
    )
    assert run.returncode == 0, run.stderr
    (row,) = read_rows(tmp_path)
    wrong = "port, calibrated in air"
    assert row["depth"][wrong] > 0.2 * row["range"]
    assert not row["accepted"][wrong]
    assert row["depth"]["port, in water"] < 0.02
    assert (tmp_path / "report.html").stat().st_size > 10_000


def test_no_scenes_are_refused(script):
    run = script("experiments.identification.sensors", "--runs", 0)
    assert run.returncode == 2
    assert "--runs" in run.stderr

"""The experiment of identification: what it writes is what it measured."""

import json
from math import radians
from pathlib import Path

from uuv.experiment import read_rows


def test_one_scene_of_each_sensor(script, tmp_path: Path):
    run = script(
        "experiments.identification.identification",
        "--object",
        "starfish",
        "--runs",
        1,
        "--workers",
        1,
        "--out",
        tmp_path,
    )
    assert run.returncode == 0, run.stderr
    rows = read_rows(tmp_path)
    assert [row["sensor"] for row in rows] == ["stereo", "white", "sonar"]
    figures = json.loads((tmp_path / "metrics.json").read_text())["Poses by object and sensor"]
    for row in rows:
        median = figures[f"starfish {row['sensor']}"]["position, median"]["median"]
        assert median == row["position"]
        assert row["found"] == (
            row["position"] < 0.01 * row["range"] and row["angle"] < radians(5.0)
        )
    assert (tmp_path / "report.html").stat().st_size > 10_000


def test_unknown_object_is_refused(script):
    run = script("experiments.identification.identification", "--object", "teapot")
    assert run.returncode == 2
    assert "manifold" in run.stderr

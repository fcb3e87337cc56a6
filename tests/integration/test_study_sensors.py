"""The study of sensors: what it writes, and the order that physics puts calibrations in."""

import json
import subprocess
import sys
from pathlib import Path


def test_one_scene(root: Path, tmp_path: Path):
    run = subprocess.run(
        [sys.executable, "scripts/study_sensors.py", "--runs", "1", "--out", tmp_path],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    rows = {name: rows[0] for name, rows in json.loads((tmp_path / "sensors.json").read_text()).items()}
    wrong = rows["port, calibrated in air"]
    assert wrong["depth_error_m"] > 0.2 * wrong["range_m"]
    assert not wrong["accepted"]
    assert rows["port, in water"]["depth_error_m"] < 0.02
    assert (tmp_path / "sensors.png").stat().st_size > 10_000


def test_no_scenes_are_refused(root: Path):
    run = subprocess.run(
        [sys.executable, "scripts/study_sensors.py", "--runs", "0"],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 2
    assert "--runs" in run.stderr

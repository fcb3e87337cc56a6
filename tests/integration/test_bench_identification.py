"""Identification beside other libraries: every method runs on the same scene."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from uuv.experiment import read_rows


@pytest.mark.long
@pytest.mark.usefixtures("open3d")
def test_one_scene(root: Path, tmp_path: Path):
    run = subprocess.run(
        [
            sys.executable,
            "scripts/experiments/identification/peers.py",
            "--object",
            "manifold",
            "--runs",
            "1",
            "--out",
            tmp_path,
        ],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    (row,) = read_rows(tmp_path)
    assert len(row["position"]) >= 6
    assert all(map(np.isfinite, row["position"].values()))
    assert all(time > 0.0 for time in (*row["time"].values(), *row["fit_time"].values()))
    assert row["found"]["ours, whole"]
    assert row["found"]["ours, search and fit"]
    assert "ours, whole" in (tmp_path / "report.html").read_text()

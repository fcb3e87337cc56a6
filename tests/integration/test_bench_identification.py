"""The race of identification: every method runs on the same scene, and the figures are those of its
rows.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest


@pytest.mark.long
@pytest.mark.usefixtures("open3d")
def test_one_scene(root: Path, tmp_path: Path):
    run = subprocess.run(
        [
            sys.executable,
            "scripts/experiments/identification/peers.py",
            "--objects",
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
    figures = json.loads((tmp_path / "metrics.json").read_text())
    rows = {row["method"]: row for row in figures["rows"]}
    assert len(rows) >= 6
    assert all(np.isfinite(row["position_m"]) and row["process_s"] > 0.0 for row in rows.values())
    assert rows["ours, whole"]["found"]
    assert rows["ours, search and fit"]["found"]
    assert figures["fit_alone_s"]["ours"] > 0.0

"""Sampling the seabed as a user runs it: a core, and clouds and files over which the vehicle does not descend."""

import json
import subprocess
import sys

import jsonschema
import numpy as np
import pytest

from models import open3d_loader
from sim import hydrodynamics
from sim.seabed_metrics import SeabedBounds, schema

open3d_loader.load()  # without its system libraries there is no terrain: see tests/conftest.py
BOUNDS = SeabedBounds()


def sample_seabed(root, out, *options):
    command = [sys.executable, "scripts/sample_seabed.py", "--no-record", "--out", str(out), *map(str, options)]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """The notice of a first start is said here, before the runs whose words are tested."""
    hydrodynamics.install()


def test_a_core_is_taken(root, tmp_path):
    done = sample_seabed(root, tmp_path, "--seed", 3, "--quick")
    assert done.returncode == 0, done.stdout + done.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(metrics, schema())
    assert metrics["run"]["state"] == "done"
    assert metrics["core"]["push_error_share"] <= BOUNDS.push
    assert metrics["core"]["pull_max_n"] > 0.5  # it was in the soil, and came out
    assert metrics["hull"]["rise_max_m"] <= BOUNDS.rise
    assert metrics["hull"]["ground_gap_m"] > 0.3


def test_over_a_bad_cloud_it_does_not_descend(root, tmp_path):
    """Two layers 0.4 m apart, in hull axes."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1.5, 1.5, (4000, 2))
    np.savetxt(tmp_path / "layers.txt", np.column_stack([xy, -2.5 + 0.4 * (rng.random(4000) < 0.5)]))
    done = sample_seabed(root, tmp_path, "--cloud", tmp_path / "layers.txt")
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1
    assert "two surfaces one above the other" in done.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(metrics, schema())
    assert metrics["run"]["state"] == "abort"
    assert metrics["hull"]["ground_gap_m"] > 2.0  # it scans from 2.5 m, its underside 0.4 m lower


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(["--push", "100"], "at most half the limit", id="push"),
        pytest.param(["--depth", "-5"], "depth: must be > 0", id="depth"),
        pytest.param(["--cloud", "nowhere.txt"], "there is no such file", id="no cloud"),
        pytest.param(["--vehicle", "bluerov2_heavy"], "a geom named 'pad'", id="no tool"),
    ],
)
def test_bad_input_is_one_line_and_code_2(root, tmp_path, options, said):
    done = sample_seabed(root, tmp_path, *options)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr

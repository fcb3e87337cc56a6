"""The pile as a user runs it, with the arm on the vehicle's side: pressed, and cleaned without
contact.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.metrics import schema

BOUNDS = Bounds()
_DONE: dict[str, dict[str, Any]] = {}  # metrics by name
RUNS = {"ring": ("--path", "ring"), "contactless": ("--contactless", "0.03", "--sensor", "survey")}


@pytest.fixture
def run_of(script, tmp_path: Path) -> Callable[[str], dict[str, Any]]:
    """metrics.json of a run by its name; each is done once."""

    def run(name: str) -> dict[str, Any]:
        if name not in _DONE:
            out = tmp_path / name
            done = script("clean_pile", "--quick", "--no-record", "--out", out, *RUNS[name])
            assert done.returncode == 0, done.stdout + done.stderr
            _DONE[name] = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
        return _DONE[name]

    return run


@pytest.mark.parametrize("name", [pytest.param("ring", marks=pytest.mark.long), "contactless"])
def test_figures_keep_their_bounds(run_of, name):
    metrics = run_of(name)
    jsonschema.validate(metrics, schema())
    assert metrics["accepted"] is True
    assert metrics["run"]["state"] == "done"
    assert metrics["identification"]["position_error_m"] <= BOUNDS.position_error
    assert metrics["tool"]["path_deviation_max_m"] <= BOUNDS.path_deviation
    assert metrics["tool"]["tilt_max_rad"] <= BOUNDS.tilt
    assert metrics["hull"]["tilt_max_rad"] <= BOUNDS.tilt
    assert metrics["tool"]["speed_mean_m_s"] == pytest.approx(0.02, rel=0.2)


@pytest.mark.long
def test_it_pressed(run_of):
    contact = run_of("ring")["contact"]
    assert [segment["set_n"] for segment in contact["segments"]] == [60.0, 90.0]
    assert contact["force_error_rms_n"] <= BOUNDS.force_error_rms
    assert contact["force_error_max_n"] <= BOUNDS.force_error_max
    assert contact["lost_s"] == 0.0
    assert run_of("ring")["gap"] is None


def test_it_kept_its_distance(run_of):
    gap = run_of("contactless")["gap"]
    assert gap["set_m"] == 0.03
    assert 0.0 < gap["error_rms_m"] <= gap["error_max_m"] <= BOUNDS.gap_error
    assert gap["touched_s"] == 0.0
    assert run_of("contactless")["contact"]["segments"] == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(["--height", "0.25"], "clear of the flange", id="at the flange"),
        pytest.param(["--contactless", "0.2"], "at most the stand-off", id="too far"),
    ],
)
def test_bad_input_is_one_line_and_code_2(script, tmp_path, options, said):
    done = script("clean_pile", "--quick", "--no-record", "--out", tmp_path / "out", *options)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr

"""The insertion as a user runs it: one whole run that must feel its way in, its figures, and bad
inputs in one line.
"""

import json

import jsonschema
import pytest

from uuv.sim import hydrodynamics
from uuv.sim.evaluation.insertion_metrics import InsertionBounds, schema

BOUNDS = InsertionBounds()


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """The notice of a first start is said here, before the runs whose words are tested."""
    hydrodynamics.install()


@pytest.mark.long  # the baseline runs the same job
def test_a_sampler_goes_in_and_comes_out(script, tmp_path):
    """Aimed 5 mm beside the hole as found, more than the clearance: it cannot go in without
    touching and giving way.
    """
    done = script("insert_sampler", "--quick", "--no-record", "--out", tmp_path, "--error", 5, 0)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "accepted" in done.stdout
    metrics = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    jsonschema.validate(metrics, schema())
    insertion = metrics["insertion"]
    assert metrics["accepted"] is True
    assert metrics["run"]["state"] == "done"
    assert metrics["identification"]["aside_m"] < 5e-3
    assert insertion["clearance_m"] == pytest.approx(2e-3)
    assert insertion["depth_m"] > insertion["depth_asked_m"] - BOUNDS.short
    assert insertion["tip_at_end_m"] < 0.0
    # It touched, and was not pressed.
    assert 1.0 < insertion["side_force_max_n"] <= BOUNDS.side_force
    assert insertion["axial_force_max_n"] <= BOUNDS.axial_force


UNSEEN = pytest.mark.long(
    guarded_by="tests/integration/test_clean_barrel.py::test_bad_input_is_one_line_and_code_2"
)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(["--hole", "c"], "'c'", id="unknown hole"),
        pytest.param(
            ["--clearance", "0"],
            "--clearance (site.object.clearance) [m]: must be positive and finite, got 0",
            id="no clearance",
        ),
        pytest.param(["--error", "nan", "0"], "--error", id="error is no number"),
        pytest.param(["--clearance", "40"], "radius", id="hole too wide"),
        pytest.param(["--depth", "-5", "--no-quick"], "depth", id="negative depth"),
        pytest.param(
            ["--vehicle", "bluerov2_heavy"], "geom 'pad' (may be in contact)", id="no tool"
        ),
        pytest.param(["--range", "12"], "not identified", id="camera sees nothing", marks=UNSEEN),
    ],
)
def test_bad_input_is_one_line_and_code_2(script, tmp_path, options, said):
    done = script("insert_sampler", "--quick", "--no-record", "--out", tmp_path, *options)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert "Traceback" not in done.stdout + done.stderr

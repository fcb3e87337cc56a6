"""An inspection flight as a user runs it: once around, its figures, and what is refused in one
line.
"""

import json

import jsonschema
import pytest

from uuv.sim import hydrodynamics
from uuv.sim.evaluation.inspection_metrics import InspectionBounds, schema

BOUNDS = InspectionBounds()


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """The notice of a first start is said here, before the runs whose words are tested."""
    hydrodynamics.install()


@pytest.mark.long  # the baseline runs the same job
def test_it_flies_once_around(script, tmp_path):
    done = script(
        "inspect_object", "--no-record", "--out", tmp_path, "--object", "starfish", "--distance", 1
    )
    assert done.returncode == 0, done.stdout + done.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(metrics, schema())
    assert metrics["run"]["state"] == "done"
    assert metrics["inspection"]["distance_max_m"] <= BOUNDS.distance
    assert metrics["inspection"]["seen_share"] > 0.4  # of a flat thing, from above


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(
            ["--distance", "0.6"], "m of the object, 0.3 m of clearance are required", id="too near"
        ),
        pytest.param(["--distance", "-1"], "inspection distance: must be > 0", id="no distance"),
        pytest.param(["--object", "castle"], "unknown object 'castle'", id="unknown"),
    ],
)
def test_what_cannot_be_is_one_line_and_code_2(script, tmp_path, options, said):
    done = script("inspect_object", "--no-record", "--out", tmp_path, *options)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr

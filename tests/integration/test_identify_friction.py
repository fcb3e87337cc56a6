"""The friction identification as a user runs it: its figures, and what is refused in one line."""

import json

import jsonschema
import pytest

from uuv.sim import hydrodynamics
from uuv.sim.evaluation.friction_metrics import schema
from uuv.tasks.gear_identification import FrictionBounds

BOUNDS = FrictionBounds()


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """The notice of a first start is said here, before the runs whose words are tested."""
    hydrodynamics.install()


def test_gears_that_differ_from_belief_are_found(verb, tmp_path):
    run = verb("identify", "friction", "--quick", "--no-record", "--seed", 1, "--out", tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "Stribeck speed [rad/s]" in run.stdout
    metrics = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(metrics, schema())
    friction = metrics["friction"]
    assert friction["coulomb_error"] <= BOUNDS.coulomb
    assert friction["stiction_error"] <= BOUNDS.stiction
    gears = [joint["coulomb"] for joint in friction["joints"]]
    assert len(gears) == 6
    assert max(abs(gear["believed"] / gear["true"] - 1.0) for gear in gears) > 5.0 * BOUNDS.coulomb

    # `uuv.run`, by which it is repeated, takes the samples as well.
    replayed = verb("replay", tmp_path)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    assert replayed.stdout.startswith("the same to the bit")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(
            ["--seconds", "3"],
            "--seconds (task.seconds) [s]: must be finite, >= 10, <= 300, got 3",
            id="too short",
        ),
        pytest.param(
            ["--vehicle", "bluerov2_heavy"], "body 'arm_base' (carries the arm)", id="no arm"
        ),
    ],
)
def test_what_cannot_be_is_one_line_and_code_2(verb, tmp_path, options, said):
    run = verb("identify", "friction", "--out", tmp_path / "out", *options)
    assert run.returncode == 2, run.stdout + run.stderr
    assert run.stderr.startswith("error: ")
    assert run.stderr.count("\n") == 1
    assert said in run.stderr
    assert not (tmp_path / "out").exists()

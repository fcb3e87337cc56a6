"""What no script can do ends in one line and code 2 before any work is done."""

from pathlib import Path

import pytest

WITH_OUT = (
    "experiments.kinematics.ik",
    "experiments.runtime.physics",
    "clean_object",
    "experiments.papers.servo_arm",
    "experiments.contact.step_response",
    "experiments.identification.bung",
    "experiments.calibration.effects",
    "experiments.identification.decisions",
    "experiments.toolpath.deformation",
    "experiments.faults.faults",
    "experiments.identification.identification",
    "experiments.toolpath.paths",
    "experiments.seabed.seabed",
    "experiments.identification.sensors",
    "experiments.papers.track_singularity",
    "validate_physics",
)


def refused(run) -> str:
    """The one line that is said instead of the work."""
    assert run.returncode == 2, run.stdout + run.stderr
    assert run.stderr.startswith("error: ")
    assert run.stderr.count("\n") == 1
    return run.stderr


@pytest.mark.parametrize("name", WITH_OUT)
def test_results_cannot_go_into_a_file(script, tmp_path: Path, name: str):
    file = tmp_path / "file"
    file.touch()
    assert f"--out {file}: the folder cannot be created" in refused(script(name, "--out", file))


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("experiments.kinematics.ik", ("--targets", 0), "--targets: must be at least 1"),
        ("experiments.kinematics.ik_growth", ("--links", 0), "--links: must be at least 1"),
        ("experiments.toolpath.paths", ("--runs", 0), "--runs: must be at least 1"),
        ("experiments.toolpath.paths", ("--looks", 0), "--looks: must be at least 1"),
        (
            "experiments.identification.identification",
            ("--ranges", 2, 1),
            "ranges: must be 0 < near <= far",
        ),
        (
            "experiments.identification.identification",
            ("--start-error", -1, 5),
            "start error: must not be negative",
        ),
        ("experiments.identification.recognition", ("--among", "teapot", "manifold"), "teapot"),
        (
            "experiments.identification.cloud_models",
            ("--points", 0),
            "--points: must be at least 1, got 0",
        ),
        ("clean_object", ("--seed", -1), "--seed: must not be negative, got -1"),
        ("experiments.identification.bung", ("--seed", -1), "--seed: must not be negative, got -1"),
        (
            "experiments.calibration.wild_touches",
            ("--runs", 0),
            "--runs: must be at least 1, got 0",
        ),
        (
            "experiments.calibration.real_arms",
            ("--data", "nowhere"),
            "--data nowhere: must be a folder",
        ),
        (
            "experiments.identification.decisions",
            ("--workers", -1),
            "--workers: must be at least 0, got -1",
        ),
        (
            "experiments.vehicles.hover",
            ("--directions", 0),
            "--directions: must be at least 1, got 0",
        ),
        ("experiments.faults.faults", ("--only", "storm"), "--only storm: there is no such case"),
    ],
)
def test_numbers_out_of_range(script, tmp_path: Path, name: str, options: tuple, said: str):
    assert said in refused(script(name, *options, "--out", tmp_path))

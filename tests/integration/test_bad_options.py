"""What no script can do ends in one line and code 2 before any work is done."""

from pathlib import Path

import pytest

WITH_OUT = (
    "benchmarks.ik",
    "benchmarks.physics",
    "clean_object",
    "papers.servo_arm",
    "studies.step_response",
    "studies.bung",
    "studies.calibration",
    "studies.contact",
    "studies.decisions",
    "studies.deformation",
    "studies.faults",
    "studies.identification",
    "studies.paths",
    "studies.seabed",
    "studies.sensors",
    "papers.track_singularity",
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
    assert f"--out {file}: cannot be made a folder" in refused(script(name, "--out", file))


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("benchmarks.ik", ("--targets", 0), "--targets: must be at least 1"),
        ("benchmarks.ik", ("--links", 0), "--links"),
        ("studies.paths", ("--runs", 0), "--runs: must be at least 1"),
        ("studies.paths", ("--looks", 0), "--looks: must be at least 1"),
        ("studies.identification", ("--ranges", 2, 1), "ranges: must be 0 < near <= far"),
        ("studies.identification", ("--start-error", -1, 5), "start error: must not be negative"),
        ("clean_object", ("--seed", -1), "--seed: must not be negative, got -1"),
        ("studies.bung", ("--seed", -1), "--seed: must not be negative, got -1"),
        ("studies.calibration", ("--wild-runs", 0), "--wild-runs: must be at least 1, got 0"),
        ("studies.calibration", ("--real", "nowhere"), "--real nowhere: at least two folders"),
        ("studies.decisions", ("--workers", -1), "--workers: must be at least 0, got -1"),
        ("studies.hover", ("--directions", 0), "--directions: must be at least 1, got 0"),
        ("studies.faults", ("--only", "storm"), "--only storm: there is no such case"),
    ],
)
def test_numbers_out_of_range(script, tmp_path: Path, name: str, options: tuple, said: str):
    assert said in refused(script(name, *options, "--out", tmp_path))

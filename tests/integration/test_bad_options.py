"""What no script can do ends in one line and code 2 before any work is done."""

from pathlib import Path

import pytest

WITH_OUT = (
    "bench_ik",
    "bench_physics",
    "clean_object",
    "servo_arm",
    "step_response",
    "study_bung",
    "study_contact",
    "study_decisions",
    "study_deformation",
    "study_faults",
    "study_identification",
    "study_paths",
    "study_seabed",
    "study_sensors",
    "track_singularity",
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
        ("bench_ik", ("--targets", 0), "--targets: must be at least 1"),
        ("bench_ik", ("--links", 0), "--links"),
        ("study_paths", ("--trials", 0), "--trials: must be at least 1"),
        ("study_paths", ("--looks", 0), "--looks: must be at least 1"),
        ("study_identification", ("--ranges", 2, 1), "ranges: must be 0 < near <= far"),
        ("study_identification", ("--start-error", -1, 5), "start error: must not be negative"),
        ("clean_object", ("--seed", -1), "--seed: must not be negative, got -1"),
        ("study_bung", ("--first-seed", -1), "--first-seed: must not be negative, got -1"),
    ],
)
def test_numbers_out_of_range(script, tmp_path: Path, name: str, options: tuple, said: str):
    assert said in refused(script(name, *options, "--out", tmp_path))

"""The scripts around inverse kinematics as a user runs them: short ones, their figures and
files.
"""

import json
from pathlib import Path

import pytest

from uuv.experiment import read_rows


def test_the_gimbal_lock_is_passed_within_the_speed_limit(script, tmp_path: Path) -> None:
    done = script(
        "experiments.papers.track_singularity",
        "--quick",
        "--speed-limit",
        "0.12",
        "--out",
        tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    runs = json.loads((tmp_path / "metrics.json").read_text())["runs"]
    assert runs["without"]["largest_joint_speed"] > 3.0 * 0.12  # measured 3.0
    assert runs["without"]["checked_position_error_m"] < 1e-5
    assert runs["with"]["largest_joint_speed"] <= 0.12 * (1.0 + 1e-9)
    # what the passing costs: measured 2.5 s, 1.4 mm and 0.6 deg
    assert runs["with"]["off_the_path_s"] > 0.0
    assert runs["with"]["checked_position_error_m"] < 0.02
    assert runs["with"]["checked_orientation_error_rad"] < 0.1
    assert runs["with"]["position_error_at_the_end_m"] < 1e-5
    assert {"run.rrd", "track_singularity.png"} <= {file.name for file in tmp_path.iterdir()}


@pytest.mark.long
def test_the_servo_arm_does_all_three_experiments(script, tmp_path: Path) -> None:
    done = script("experiments.papers.servo_arm", "--quick", "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    for crossing in metrics["single"].values():
        x, y, z, course, trim, roll = crossing["row"]
        assert (x - 100.0) ** 2 + (y + 400.0) ** 2 + z**2 <= 1.0  # [mm]
        assert abs(trim + 50.0) <= 0.6  # [deg]
        assert abs(course - 5.0) + abs(roll) < 2.0
    assert all(methods["hybrid"]["reached"] == 1.0 for methods in metrics["motions"].values())
    assert {"single_solution.png", "motions.png"} <= {file.name for file in tmp_path.iterdir()}


def test_the_bench_has_its_tables_and_pictures(script, tmp_path: Path) -> None:
    options = ("--arm", "puma560", "ur5", "--targets", 10, "--rates", 50, "--limits", 180)
    done = script(
        "experiments.kinematics.ik",
        *options,
        *("--repeats", 1, "--no-peers", "--workers", 1, "--out", tmp_path),
    )
    # 1: too few targets for the rate of jacobian_free
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert done.stderr == ""

    rows = read_rows(tmp_path)
    assert len(rows) == 2 * 2 * 2
    assert all(row["reached"]["hybrid"] == 50 for row in rows)
    assert set(rows[0]["median"]) >= {"hybrid", "jacobian_free", "plain", "compiled DLS"}
    assert [row["kernel"] is None for row in rows] == [False, True] * 4
    report = (tmp_path / "report.html").read_text()
    for title in ("Targets solved by our methods", "Kernels, bar A", "Time of a Python call over"):
        assert title in report


@pytest.mark.parametrize(
    ("name", "options", "culprit"),
    [
        ("experiments.kinematics.ik", ("--arm", "puma"), "'puma'"),
        ("experiments.papers.track_singularity", ("--speed", "0"), "--speed"),
    ],
)
def test_bad_input_ends_in_one_line(
    script, name: str, options: tuple[str, ...], culprit: str
) -> None:
    done = script(name, *options)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert culprit in done.stderr

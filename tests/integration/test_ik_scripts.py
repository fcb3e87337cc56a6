"""The scripts around inverse kinematics as a user runs them: short ones, their figures and
files.
"""

from pathlib import Path

import pytest

from uuv.experiment import read_rows


def test_the_gimbal_lock_is_passed_within_the_speed_limit(script, tmp_path: Path) -> None:
    recipes = ("--recipe", "without", "limit", "default", "--method", "hybrid")
    short = ("--reach", 0.5, "--period", 0.1, "--speed-limit", 0.12, *recipes)
    done = script("experiments.papers.track_singularity", *short, "--workers", 1, "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    runs = {row["recipe"]: row for row in read_rows(tmp_path)}
    assert runs["without"]["joint_speed"] > 3.0 * 0.12  # measured 3.0
    assert runs["without"]["position_error"] < 1e-5
    assert runs["limit"]["joint_speed"] <= 0.12 * (1.0 + 1e-9)
    # what the passing costs: measured 2.5 s, 1.4 mm and 0.6 deg
    assert runs["limit"]["share_off"] > 0.0
    assert runs["limit"]["position_error"] < 0.02
    assert runs["limit"]["orientation_error"] < 0.1
    assert runs["limit"]["end_error"] < 1e-5
    # the seventh joint saves all of it
    assert runs["default"]["joint_speed"] <= 0.06
    assert runs["default"]["share_off"] == 0.0
    assert "Wrist along y0 through the gimbal lock" in (tmp_path / "report.html").read_text()


def test_the_way_through_the_gimbal_lock_is_recorded(script, tmp_path: Path) -> None:
    done = script("experiments.papers.view_singularity", "--reach", 0.2, "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "run.rrd").stat().st_size > 0


@pytest.mark.long
def test_the_servo_arm_does_all_three_experiments(script, tmp_path: Path) -> None:
    done = script("experiments.papers.servo_arm", "--poses", 12, "--workers", 1, "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    rows = {row["method"]: row for row in read_rows(tmp_path)}
    for row in rows.values():
        x, y, z, course, trim, roll = row["solved"]
        assert (x - 100.0) ** 2 + (y + 400.0) ** 2 + z**2 <= 1.0  # [mm]
        assert abs(trim + 50.0) <= 0.6  # [deg]
        assert abs(course - 5.0) + abs(roll) < 2.0
    assert set(rows["hybrid"]["reached"].values()) == {1.0}
    report = (tmp_path / "report.html").read_text()
    assert "Experiment 1: a single solution" in report
    assert "Experiments 2 and 3" in report


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
        ("experiments.papers.track_singularity", ("--recipe", "none"), "--recipe"),
    ],
)
def test_bad_input_ends_in_one_line(
    script, name: str, options: tuple[str, ...], culprit: str
) -> None:
    done = script(name, *options)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert culprit in done.stderr

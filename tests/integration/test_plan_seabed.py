"""Seabed work as a user has it: files in, a path out, and bad files in one line."""

import numpy as np
import pytest

from uuv.experiment import read_rows
from uuv.models.site.seabed import seabed


@pytest.fixture
def files(tmp_path):
    rng = np.random.default_rng(0)
    ground = seabed("ripples", rng, half=1.0)
    xy = rng.uniform(-1.0, 1.0, (4000, 2))
    np.savetxt(tmp_path / "cloud.txt", np.column_stack([xy, ground.height(xy)]))
    (tmp_path / "targets.txt").write_text("z 0 0 1\n-0.4 0 1\n0.4 0.1 1\n0.2 0.5 1\n", "utf-8")
    return tmp_path, ground


def test_a_path_from_files(verb, files, within):
    folder, ground = files
    clouds = ("--cloud", folder / "cloud.txt", "--targets", folder / "targets.txt")
    done = verb("plan-seabed", *clouds, "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    T = np.loadtxt(folder / "out" / "profile.csv", delimiter=",", skiprows=1)
    path = np.loadtxt(folder / "out" / "path.csv", delimiter=",", skiprows=1)
    within("profile [m]", T[:, 2] - ground.height(T), 0.03)
    within("path [m]", path[:, 5] - ground.height(path[:, 3:5]), 0.03)
    assert np.all(np.diff(path[:, 0]) > 0.0)
    assert (folder / "out" / "plan.png").stat().st_size > 20_000


def test_bad_files_end_in_one_line(verb, files):
    folder, _ = files
    (folder / "empty.txt").touch()
    done = verb("plan-seabed", "--cloud", folder / "empty.txt", "--targets", folder / "targets.txt")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "the file is empty" in done.stderr


def test_study_of_terrains(script, tmp_path):
    done = script(
        "experiments.seabed.seabed", "--runs", 2, "--workers", 1, "--beam", 2, "--out", tmp_path
    )
    assert done.returncode == 0, done.stderr
    runs = read_rows(tmp_path)
    assert [run["kind"] for run in runs] == ["flat", "ripples"]
    for run in runs:
        assert run["refused"] or run["hull_gap"] > 0.25

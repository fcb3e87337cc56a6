"""A run's folder is new and its own, and its results are there whole or not at all."""

import errno
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from uuv.cli.past.past_runs import run_folder
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.run_folder import alone_in, give_back, new_folder, point_to
from uuv.sim.runs.saving import write_json, write_whole


def test_each_run_has_a_folder_of_its_own_and_latest_leads_to_the_last(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = [new_folder("clean_barrel", seed=7) for _ in range(3)]  # within one second, or two
    assert len(set(folders)) == 3
    for folder in folders:
        assert folder.parent == Path("runs/clean_barrel")
        assert "-7" in folder.name
        assert json.loads((folder / "run.json").read_text())["scenario"] == "clean_barrel"
    assert (tmp_path / "runs/clean_barrel/latest").resolve() == folders[-1].resolve()


def test_a_run_that_is_refused_at_the_door_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = new_folder("x", seed=0)
    (first / "metrics.json").write_text("{}")
    second = new_folder("x", seed=0)
    out = new_folder("x", tmp_path / "out")
    give_back()
    assert not second.exists()
    assert not out.exists()
    assert sorted(path.name for path in first.iterdir()) == ["metrics.json", "run.json"]
    assert (tmp_path / "runs/x/latest").resolve() == first.resolve()


def test_a_folder_of_the_users_own_is_left_as_it_was(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "latest").symlink_to("elsewhere")
    new_folder("x", tmp_path / "out")
    give_back()
    assert list((tmp_path / "out").iterdir()) == []
    assert os.readlink(tmp_path / "latest") == "elsewhere"


def test_latest_is_a_file_where_there_are_no_links(tmp_path, monkeypatch):
    def none(*_: object, **__: object) -> None:
        raise OSError("no links here")

    monkeypatch.setattr(Path, "symlink_to", none)
    point_to(tmp_path / "latest", "20260101-120000-3")
    assert (tmp_path / "latest").read_text() == "20260101-120000-3\n"

    # A verb finds the run by it.
    home = tmp_path / "runs" / "open_water"
    folder = home / "20260101-120000-3"
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text("{}")
    point_to(home / "latest", folder.name)
    monkeypatch.chdir(tmp_path)
    assert run_folder("open-water").resolve() == folder
    (home / "latest").write_text("../../elsewhere\n")
    with pytest.raises(ConfigurationError, match="latest"):
        run_folder("open-water")


@pytest.mark.parametrize("name", ["new", "new/er", "Prüfstand 3 – Süd"])
def test_out_is_made_where_it_is_not(name, tmp_path):
    assert new_folder("x", tmp_path / name) == tmp_path / name
    with pytest.raises(ConfigurationError, match="already in use"):
        new_folder("x", tmp_path / name)


def test_out_with_anything_in_it_is_refused_and_left_alone(tmp_path):
    (tmp_path / "report.html").write_text("old")
    with pytest.raises(ConfigurationError, match="already in use"):
        new_folder("x", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_out_that_cannot_be_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="the folder cannot be created"):
        new_folder("x", tmp_path / "file")


def test_of_many_runs_at_once_one_has_the_folder(tmp_path):
    def asked(_: int) -> bool:
        try:
            new_folder("x", tmp_path / "out")
        except ConfigurationError:
            return False
        return True

    with ThreadPoolExecutor(16) as pool:
        assert sum(pool.map(asked, range(64))) == 1


def test_what_cannot_be_written_leaves_the_old_file(tmp_path):
    file = tmp_path / "metrics.json"
    write_json(file, {"a": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(file, {"a": float("nan")})
    assert json.loads(file.read_text()) == {"a": 1}
    with pytest.raises(ConfigurationError, match="cannot be written"):
        write_whole(tmp_path / "nowhere" / "metrics.json", "")
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "with_name", lambda *_: Path("/dev/full"))
    monkeypatch.setattr(Path, "unlink", lambda *_, **__: None)
    with pytest.raises(ConfigurationError, match="No space left on device"):
        write_whole(tmp_path / "metrics.json", "x" * 100)


def test_a_file_system_without_locks_is_one_line(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    with (
        pytest.raises(ConfigurationError, match=r"does not support locks \(No locks available\)"),
        alone_in(tmp_path),
    ):
        pass


def test_a_lock_goes_with_its_process(tmp_path, root):
    held = """
import os, sys, pathlib
import uuv.sim.runs.run_folder as run_folder
with run_folder.alone_in(pathlib.Path(sys.argv[1])):
    os.abort()
"""
    killed = subprocess.run([sys.executable, "-c", held, str(tmp_path)], cwd=root, check=False)
    assert killed.returncode < 0
    with alone_in(tmp_path):
        assert (tmp_path / ".lock").read_text() == f"{os.getpid()}\n"
        with (
            pytest.raises(ConfigurationError, match=f"in use by the process {os.getpid()}"),
            alone_in(tmp_path),
        ):
            pass

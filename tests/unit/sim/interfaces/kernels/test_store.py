"""The store gives back what was kept with a stamp, or nothing: never what is cut, foreign, or of
another stamp.
"""

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest

from uuv.sim.interfaces.kernels import store

STAMP = "what it depends on"
CODE = b"machine code" * 20
NOBODY = 65534  # a user other than the one of the tests


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A new store, set up by its variable."""
    folder_of = tmp_path / "caches" / "store"
    monkeypatch.setenv(store.FOLDER, str(folder_of))
    monkeypatch.delenv(store.LIMIT, raising=False)
    store._place_for.cache_clear()
    assert store.folder() == folder_of
    return folder_of


def set_age(file: Path, age: float) -> None:
    """Make a file as if it were last used `age` [s] ago."""
    moment = time.time() - age
    os.utime(file, (moment, moment))


def the_file(folder: Path) -> Path:
    """The only file of a store."""
    (file,) = folder.iterdir()
    return file


def test_what_is_kept_comes_back_in_a_folder_of_the_users_own(folder):
    assert store.load(STAMP) is None
    assert not store.holds(STAMP)
    assert store.save(STAMP, CODE)
    assert store.holds(STAMP)
    assert store.load(STAMP) == CODE
    assert store.load(STAMP + ".") is None
    assert folder.stat().st_mode & 0o777 == 0o700
    assert the_file(folder).stat().st_mode & 0o777 == 0o600


def test_every_cut_and_every_changed_byte_is_seen_and_taken_away(folder):
    store.save(STAMP, CODE)
    file = the_file(folder)
    whole = file.read_bytes()
    damaged = [whole[:end] for end in range(len(whole))]
    damaged += [whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :] for at in range(len(whole))]
    for content in (*damaged, whole + b"."):
        file.write_bytes(content)
        assert store.load(STAMP) is None
        assert not file.exists()
    store.save(STAMP, CODE)
    assert store.load(STAMP) == CODE


def test_nothing_is_unpickled_before_stamp_and_content_are_compared(folder, tmp_path):
    """A kernel's cache meets a file of another stamp under its own name, with a pickle that would
    make a folder.
    """

    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "made"),)

    store.save(STAMP, pickle.dumps(Evil()))
    the_file(folder).rename(store._file("another stamp") or folder)
    assert store.load("another stamp") is None
    assert not (tmp_path / "made").exists()


def test_a_file_that_others_may_write_is_not_read(folder):
    store.save(STAMP, CODE)
    the_file(folder).chmod(0o622)
    assert store.load(STAMP) is None


def test_a_link_and_a_pipe_are_not_read(folder, tmp_path):
    store.save(STAMP, CODE)
    file = the_file(folder)
    file.rename(tmp_path / "elsewhere")
    file.symlink_to(tmp_path / "elsewhere")
    assert store.load(STAMP) is None
    file.unlink()
    os.mkfifo(file)  # to wait for whoever writes into it would be forever
    assert store.load(STAMP) is None


@pytest.mark.skipif(os.getuid() != 0, reason="gives files to another user, which root alone may")
def test_files_and_folders_of_another_user_are_not_taken(folder, capsys):
    store.save(STAMP, CODE)
    os.chown(the_file(folder), NOBODY, NOBODY)
    assert store.load(STAMP) is None
    os.chown(folder, NOBODY, NOBODY)
    store._place_for.cache_clear()
    assert store.folder() is None
    assert store.load(STAMP) is None
    assert not store.save(STAMP, CODE)
    assert f"{folder} belongs to another user" in capsys.readouterr().err


def test_a_folder_that_others_could_enter_is_closed(folder):
    store.save(STAMP, CODE)
    folder.chmod(0o777)
    store._place_for.cache_clear()
    assert store.load(STAMP) == CODE
    assert folder.stat().st_mode & 0o777 == 0o700


def test_without_a_place_nothing_is_kept_and_one_line_says_so(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(store.FOLDER, str(tmp_path / "file"))
    assert store.folder() is None
    assert not store.save(STAMP, CODE)
    assert store.load(STAMP) is None
    assert not store.holds(STAMP)
    store.trim()
    assert store.empty() == 0
    assert capsys.readouterr().err.count("\n") == 1
    monkeypatch.setenv(store.FOLDER, store.OFF)
    assert store.folder() is None
    assert capsys.readouterr().err == ""
    assert store.content().why == "UUV_KERNEL_STORE=off"


def test_a_home_that_cannot_be_used_is_left_for_the_temporary_folder(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("")
    monkeypatch.delenv(store.FOLDER, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(store.tempfile, "gettempdir", lambda: str(tmp_path))
    folder = store.folder()
    assert folder == tmp_path / f"uuv-arm-kernels-{os.getuid()}"
    assert store.save(STAMP, CODE)
    assert f"compiled kernels are kept in {folder}" in capsys.readouterr().err


FULL = """
import resource, sys
from uuv.sim.interfaces.kernels import store
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))  # a write past it fails as on a full disk
print(store.save("what it depends on", b"machine code" * 20), store.load("what it depends on"))
"""


def test_a_full_disk_leaves_nothing_behind(folder):
    done = subprocess.run([sys.executable, "-c", FULL], capture_output=True, text=True, check=True)
    assert done.stdout == "False None\n"
    assert list(folder.iterdir()) == []


@pytest.mark.usefixtures("folder")
def test_the_least_recently_used_leave_first(monkeypatch):
    for age, name in ((3e5, "old"), (2e5, "older, but used again"), (1e5, "young")):
        store.save(name, bytes(400_000))
        file = store._file(name)
        assert file is not None
        set_age(file, age)
    store.load("older, but used again")
    monkeypatch.setenv(store.LIMIT, "1")
    store.trim()
    assert store.load("old") is None
    assert store.holds("older, but used again")
    assert store.holds("young")
    monkeypatch.setenv(store.LIMIT, "0.5")
    store.trim()
    assert store.load("young") is None
    assert store.holds("older, but used again")


@pytest.mark.parametrize("limit", ["many", "-1", "nan", "inf", ""])
def test_a_limit_that_is_none_is_the_usual_one(limit, monkeypatch):
    monkeypatch.setenv(store.LIMIT, limit)
    assert store.limit() == 512e6


def test_what_a_killed_process_left_is_taken_away_once_it_is_old(folder):
    for name, age in (("dead", 7200.0), ("writing", 5.0)):
        (folder / f"{name}.part").write_bytes(b"half")
        set_age(folder / f"{name}.part", age)
    store.trim()
    assert [file.name for file in folder.iterdir()] == ["writing.part"]


def test_it_is_emptied_and_told(folder):
    for name in "ab":
        store.save(name, CODE)
    store.note_start(loaded=3, compiled=2)
    content, start = store.content(), store.last_start()
    assert (content.files, content.folder) == (2, folder)
    assert content.bytes > 2 * len(CODE)
    assert time.time() - content.oldest < 60.0
    assert start is not None
    assert (start.loaded, start.compiled) == (3, 2)
    assert store.empty() == 2
    assert store.content().files == 0
    (folder / "last_start.json").write_text("[]")
    assert store.last_start() is None

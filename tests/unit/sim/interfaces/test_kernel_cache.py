"""Compiled loops are kept where they can be, and cut files of them do not end a run."""

import os
import pickle
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import pytest

from sim.interfaces import kernel_cache
from sim.interfaces.kernels import keyed_by_imports

LOOP = """
import numba

@numba.njit(cache=True)
def doubled(x):
    return 2.0 * x
"""


def twice_two(file: Path) -> tuple[float, int]:
    """The loop of `file`, as a process of its own would load it: what it gives, and how often it was found compiled."""
    spec = spec_from_file_location("loop", file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.doubled(2.0), sum(module.doubled.stats.cache_hits.values())


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_cut_files_are_taken_away_and_made_anew(kind, tmp_path, capsys):
    home = tmp_path / "ein Prüfstand"
    home.mkdir()
    source, kept = home / "loop.py", home / "__pycache__"
    source.write_text(LOOP)
    assert [twice_two(source), twice_two(source)] == [(4.0, 0), (4.0, 1)]
    kernel_cache.mend(kept)
    assert twice_two(source) == (4.0, 1)
    (file,) = kept.glob(f"*.{kind}")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises((EOFError, pickle.UnpicklingError)):
        twice_two(source)
    assert capsys.readouterr().err == ""
    kernel_cache.mend(kept)
    assert capsys.readouterr().err == f"{kept}: 1 cut files of compiled code taken away, made anew when needed\n"
    assert [twice_two(source), twice_two(source)] == [(4.0, 0), (4.0, 1)]


def test_every_cut_of_an_index_is_seen(tmp_path):
    file = tmp_path / "loop.f-1.py311.nbi"
    whole = pickle.dumps("0.61") + pickle.dumps((b"stamp", {("f", Path("x")): "loop.f-1.py311.1.nbc"}))
    for end in range(len(whole)):
        file.write_bytes(whole[:end])
        kernel_cache.mend(tmp_path)
        assert not file.exists(), end
    for content in (whole, bytes(len(whole)), whole + b"."):
        file.write_bytes(content)
        kernel_cache.mend(tmp_path)
        assert file.exists() == (content == whole)


def test_nothing_of_a_file_that_is_looked_through_is_run(tmp_path):
    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "made"),)

    (tmp_path / "loop.f-1.py311.1.nbc").write_bytes(pickle.dumps(Evil()))
    kernel_cache.mend(tmp_path)
    assert not (tmp_path / "made").exists()
    assert (tmp_path / "loop.f-1.py311.1.nbc").exists()


@pytest.mark.parametrize("home", [True, False], ids=["home", "no home"])
def test_a_checkout_that_cannot_be_written(home, tmp_path, monkeypatch, capsys):
    """In the user's cache without a word; where there is none in a folder of the user's own, and said."""
    monkeypatch.delenv(kernel_cache.VARIABLE, raising=False)
    monkeypatch.setitem(sys.modules, "numba", type(sys)("numba"))
    sys.modules["numba"].config = type(sys)("config")  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(kernel_cache, "HOME", tmp_path / "checkout")  # where there is nothing, nothing can be written
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache" if home else tmp_path / "file"))
    monkeypatch.setattr(kernel_cache.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(kernel_cache.shutil, "disk_usage", lambda _: type("Usage", (), {"free": 1 << 40}))
    kernel_cache.prepare()
    place = Path(os.environ[kernel_cache.VARIABLE])
    monkeypatch.delenv(kernel_cache.VARIABLE)  # and not after this test
    assert place.is_relative_to(tmp_path / "cache") == home
    assert place.is_dir()
    assert str(place) == sys.modules["numba"].config.CACHE_DIR
    said = capsys.readouterr().err
    assert said == "" if home else said.startswith(f"compiled code is kept in {place}: neither")
    if not home:
        assert place.stat().st_mode & 0o077 == 0


def test_a_disk_that_does_not_tell_its_room_cannot_be_written(tmp_path, monkeypatch):
    def untold(_: Path) -> None:
        raise OSError("not supported")

    monkeypatch.setattr(kernel_cache.shutil, "disk_usage", untold)
    assert not kernel_cache._writable(tmp_path)


def test_a_kernel_is_kept_while_its_sources_are_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "folders", lambda: [tmp_path])

    @keyed_by_imports
    def loop(x):
        return x

    kernel = SimpleNamespace(py_func=loop)
    name = f"{loop.__module__.rpartition('.')[2]}.{loop.__qualname__}"
    assert not kernel_cache.is_kept(kernel)
    (tmp_path / f"{name}x-3.py311.nbi").touch()  # of an older source
    assert not kernel_cache.is_kept(kernel)
    (tmp_path / f"{name}-3.py311.nbi").touch()
    assert kernel_cache.is_kept(kernel)

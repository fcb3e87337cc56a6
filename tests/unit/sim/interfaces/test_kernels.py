"""Machine code that is kept between runs goes with the sources that it was compiled from, in whichever file."""

import ast
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numba.core.caching import IndexDataCacheFile

from sim.interfaces.kernels import imports_stamp, name_files_by_key
from sim.runs.command_line import ROOMS
from untyped import untyped

ROOT = Path(__file__).resolve().parents[4]

BOTTOM = """
import numba

@numba.njit
def grown(x):
    return 3.0 * x
"""
MIDDLE = """
import numba
from bottom import grown

@numba.njit
def raised(x):
    return grown(x) + 1.0
"""
TOP = """
import numba
from middle import raised
from sim.interfaces.kernels import keyed_by_imports

@numba.njit(cache=True)
@keyed_by_imports
def entry(x):
    return _inner(x)

@numba.njit(cache=True)
@keyed_by_imports
def _inner(x):
    return raised(x)

print(entry(2.0), sum(entry.stats.cache_hits.values()))
"""


def test_a_change_in_another_file_reaches_the_caller(tmp_path):
    """Machine code is kept while nothing changes, and made anew for a file two imports away."""
    for name, text in (("bottom", BOTTOM), ("middle", MIDDLE), ("top", TOP)):
        (tmp_path / f"{name}.py").write_text(text)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")} | {"PYTHONPATH": str(ROOT)}

    def run() -> str:
        told = subprocess.run(
            [sys.executable, "top.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        return told.stdout.strip()

    assert [run(), run()] == ["7.0 0", "7.0 1"]
    (tmp_path / "bottom.py").write_text(BOTTOM.replace("3.0", "40.0"))
    assert run() == "81.0 0"


def kept(module: ModuleType) -> dict[str, Any]:
    """Functions of `module` itself whose machine code numba keeps."""
    found = {name: value for name, value in vars(module).items() if hasattr(value, "py_func")}
    return {
        name: value
        for name, value in found.items()
        if value.__module__ == module.__name__ and value._cache.cache_path is not None
    }


def taken(tree: ast.Module, module: ModuleType) -> set[str]:
    """Names that compiled code of `module` could take from another file of ours: compiled functions and numbers."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ROOMS:
            names |= {alias.asname or alias.name for alias in node.names}
    values = {name: vars(module).get(name) for name in names}
    return {n for n, value in values.items() if hasattr(value, "__wrapped__") or isinstance(value, (int, float))}


FILES = [
    path
    for room in ROOMS
    for path in sorted((ROOT / room).rglob("*.py"))
    if re.search(r"^(@|\w+ = ).*njit\(cache=True", path.read_text(), flags=re.MULTILINE)
]


def test_the_files_with_kept_loops_are_found():
    assert {"joint_servo", "thrusters", "allocation", "load_observer", "thruster_curves"} <= {
        path.stem for path in FILES
    }


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_kept_loop_is_keyed_by_what_its_file_takes_from_others(path):
    module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    tree, loops = ast.parse(path.read_text()), kept(module)
    used = {name for loop in loops.values() for name in loop.py_func.__code__.co_names}
    ours = {n for n in used if getattr(vars(module).get(n), "__name__", "").partition(".")[0] in ROOMS}
    assert not {n for n in ours if isinstance(vars(module)[n], ModuleType)}, "import the function, not its module"
    if used & taken(tree, module):
        unkeyed = [name for name, loop in loops.items() if "." not in loop.py_func.__qualname__]
        assert unkeyed == []


def test_the_stamp_sees_numbers_and_no_order():
    assert imports_stamp({"A": 1.0, "B": 2}) == imports_stamp({"B": 2, "A": 1.0})
    assert imports_stamp({"A": 1.0}) != imports_stamp({"A": 1.5})


def test_code_of_another_signature_is_never_loaded(tmp_path):
    """Two processes compile two signatures at once; the slower has read the index before the faster one wrote it."""
    name_files_by_key()
    slow, fast, reader = (IndexDataCacheFile(str(tmp_path), "f", "stamp") for _ in range(3))
    seen, write_index, write_code = [], slow._save_index, slow._save_data

    def index_late(overloads: dict[str, str]) -> None:
        fast.save("float", "code for float")
        write_index(overloads)

    def code_after_a_look(name: str, data: str) -> None:
        seen.append(reader.load("int"))
        write_code(name, data)

    untyped(slow)._save_index, untyped(slow)._save_data = index_late, code_after_a_look
    slow.save("int", "code for int")
    assert seen == [None]
    assert reader.load("int") == "code for int"
    assert reader.load("float") in (None, "code for float")  # an entry may be lost


def test_stale_code_is_not_loaded_after_the_source_has_changed(tmp_path):
    name_files_by_key()
    old, new = (IndexDataCacheFile(str(tmp_path), "f", stamp) for stamp in ("yesterday", "today"))
    old.save("int", "old code")
    assert new.load("int") is None
    new.save("float", "new code for float")
    assert new.load("int") is None
    new.save("int", "new code")
    assert new.load("int") == "new code"

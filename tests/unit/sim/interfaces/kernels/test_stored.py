"""Machine code goes with the code that it was compiled from, in whichever file, process or
folder.
"""

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import FunctionType, ModuleType

import pytest

from uuv.sim.interfaces.kernels import stamps, store, stored
from uuv.sim.runs.command_line import ROOMS

ROOT = Path(__file__).resolve().parents[5]
NUMBAS_CACHE = re.compile(r"\bn?jit\([^)]*cache=|\bcfunc\(")  # beside the store, which sees more

BOTTOM = """
from uuv.sim.interfaces.kernels import kernel

@kernel
def grown(x):
    return 3.0 * x
"""
TOP = """
import sys
from bottom import grown
from uuv.sim.interfaces.kernels import c_function, kernel, stored
from numba import types

@kernel(error_model="numpy")
def entry(x):
    return grown(x) + 1.0

@kernel(signature=types.float64(types.float64))
def fixed(x):
    return entry(x)

assert not fixed.signatures  # an import compiles nothing

@c_function(types.float64(types.float64))
def address(x):
    return 2.0 * fixed(x)

assert address.ctypes(2.0) == 2.0 * fixed(2) == 2.0 * fixed(2.0)  # called by another kernel first
try:
    fixed("two")
except TypeError:
    assert len(fixed.signatures) == 1
else:
    raise AssertionError("of another type than the signature's")

counts = stored.counts
print(entry(2.0), fixed(2), address.ctypes(2.0), counts.loaded, counts.compiled, counts.unkept)
"""


@pytest.fixture
def run(tmp_path):
    """Runs TOP in a process of its own, from a folder with these two files and a store beside
    it.
    """

    def run(folder: str = "one", **environment: str) -> str:
        done = subprocess.run(
            [sys.executable, "top.py"],
            cwd=tmp_path / folder,
            env={
                **os.environ,
                "PYTHONPATH": str(ROOT),
                store.FOLDER: str(tmp_path / "store"),
                **environment,
            },
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()

    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "bottom.py").write_text(BOTTOM)
        (tmp_path / folder / "top.py").write_text(TOP)
    return run


def test_another_folder_starts_warm_and_an_edit_two_files_away_is_seen(run, tmp_path):
    assert run() == "7.0 7.0 14.0 0 4 0"
    assert run("two") == "7.0 7.0 14.0 3 0 0"  # what they call is within them
    (tmp_path / "two" / "bottom.py").write_text(BOTTOM.replace("3.0", "40.0"))
    assert run("two") == "81.0 81.0 162.0 0 4 0"
    assert run() == "7.0 7.0 14.0 3 0 0"  # both are kept side by side
    assert run(NUMBA_BOUNDSCHECK="1") == "7.0 7.0 14.0 0 4 0"


def test_without_a_store_and_with_a_damaged_one_the_figures_are_the_same(run, tmp_path):
    assert run(**{store.FOLDER: store.OFF}) == "7.0 7.0 14.0 0 4 4"
    assert not (tmp_path / "store").exists()
    run()
    for file in (tmp_path / "store").glob("*.kernel"):
        file.write_bytes(file.read_bytes()[:-1])
    assert run() == "7.0 7.0 14.0 0 4 0"


def modules() -> list[ModuleType]:
    """All modules of the project whose source has a kernel."""
    files = [file for room in (*ROOMS, "uuv") for file in sorted((ROOT / room).rglob("*.py"))]
    names = [
        "uuv." + ".".join(file.relative_to(ROOT).with_suffix("").parts).removeprefix("uuv.")
        for file in files
        if re.search(r"^@kernel|= kernel\(", file.read_text(), flags=re.MULTILINE)
    ]
    return [importlib.import_module(name) for name in names]


def test_every_kernel_of_the_project_can_be_kept():
    kernels = {
        f"{module.__name__}.{name}": kernel
        for module in modules()
        for name, kernel in vars(module).items()
        if isinstance(getattr(kernel, "_cache", None), stored.StoredKernel)
    }
    assert len(kernels) > 150
    for kernel in kernels.values():
        function = kernel.py_func
        assert isinstance(function, FunctionType)
        assert re.fullmatch("[0-9a-f]{64}", stamps.stamp(function))


def test_numbas_own_cache_is_used_nowhere():
    files = [
        file for room in (*ROOMS, "uuv", "scripts") for file in sorted((ROOT / room).rglob("*.py"))
    ]
    using = [
        str(file)
        for file in files
        if NUMBAS_CACHE.search(file.read_text()) and file.parent.name != "kernels"
    ]
    assert using == []


def test_versions_and_settings_are_part_of_the_key():
    text = json.dumps(stored.toolchain())
    assert all(
        word in text
        for word in (importlib.import_module("numba").__version__, "BOUNDSCHECK=", "OPT=")
    )

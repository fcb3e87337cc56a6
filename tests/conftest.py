"""Set up for every test: our rooms and no others, tolerances that scale together, scripts as a user runs them."""

import os
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import sim
from models import open3d_loader
from sim.interfaces.errors import MissingLibraryError
from sim.startup import run_scenario

ROOT = Path(__file__).resolve().parents[1]
SCALE = float(os.environ.get("UUV_TOLERANCE_SCALE", "1"))

if Path(sim.__file__ or "").resolve().parent != ROOT / "sim":
    pytest.exit(f"{sim.__file__} hides the room {ROOT / 'sim'}; rename it or take it off PYTHONPATH", returncode=2)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A process for each core, up to four (half a GB each), for all tests; those named are sooner done in this one.

    What tests print is lost in other processes, so residuals are asked of one.
    """
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    return min(os.cpu_count() or 1, 4) if whole and SCALE != 0.0 else 0


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup():
    return (yield from skipping())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    return (yield from skipping())


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector):
    report = yield
    if report.failed and MissingLibraryError.__name__ in str(report.longrepr) and not os.environ.get("CI"):
        report.outcome, report.longrepr = "skipped", (str(collector.path), 0, "Skipped: a library is missing")
    return report


def skipping():
    """Run what is wrapped; where it lacks a library, skip with the line that names it."""
    try:
        return (yield)
    except MissingLibraryError as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))


@pytest.fixture
def open3d() -> Any:
    """Open3D, to compare with; skips where it is not installed, as by default: uvw run --extra open3d pytest ..."""
    if not find_spec("open3d"):
        pytest.skip("Open3D is not installed")
    return open3d_loader.load()


@pytest.fixture
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(params=[1, 2, "fresh"])
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Two fixed seeds and one that is new in every run; pytest shows it when the test fails."""
    seed = int.from_bytes(os.urandom(4), "big") if request.param == "fresh" else request.param
    print(f"seed {seed}")
    return np.random.default_rng(seed)


@pytest.fixture
def within(capfd: pytest.CaptureFixture[str]):
    """`within(name, residual, tolerance)`: the largest |residual| must not exceed the tolerance.

    UUV_TOLERANCE_SCALE multiplies every tolerance; 0 prints the residuals beside them and fails none.
    """

    def check(name: str, residual: object, tolerance: float) -> None:
        largest = float(np.max(np.abs(np.asarray(residual, dtype=np.float64))))
        if SCALE == 0.0:
            with capfd.disabled():
                print(f"\n{name}: {largest:.3g} (tolerance {tolerance:.3g})", end="")
            return
        limit = tolerance * SCALE
        assert largest <= limit, f"{name}: {largest:.3g}, tolerance {limit:.3g}"

    return check


class Run(NamedTuple):
    """What came of a script, named as in subprocess.CompletedProcess."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]):
    """`script(name, *arguments)`: what scripts/name.py does, in this process, since starting one takes seconds."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "200")

    def run(name: str, *arguments: object) -> Run:
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *map(str, arguments)])
        module = import_module(name)
        capfd.readouterr()
        with pytest.raises(SystemExit) as stop:
            run_scenario(module.main)
        said = capfd.readouterr()
        return Run(int(stop.value.code or 0), said.out, said.err)

    return run

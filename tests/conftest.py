"""Set up for every test: our rooms and no others, tolerances that scale together, scripts as a user
runs them.
"""

import gc
import os
import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

# Before NumPy reads it, as uuv/__init__.py does for jobs: on matrices of this size further threads
# only spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import numpy as np
import pytest
from hypothesis.internal.conjecture import providers

import uuv
from uuv.models.meshes import open3d_loader
from uuv.sim.interfaces.errors import MissingLibraryError
from uuv.sim.runs.command_line import run_scenario

pytest_plugins = ["skip_ceiling"]  # --most-skipped

ROOT = Path(__file__).resolve().parents[1]
FIXED_SEEDS = (1, 2)  # of `rng`; the second one with -m long
SCALE = float(os.environ.get("UUV_TOLERANCE_SCALE", "1"))

# Imports and syntax trees make millions of objects, none of them garbage: the collector looks at
# them seldom, and not at all before the tests (`pytest_collection_finish`).
gc.set_threshold(2_000, 10, 100)
gc.disable()

# Byte code is written whatever the environment says: each process that a test starts would else
# translate all packages anew, for 3 s.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

if Path(uuv.__file__ or "").resolve().parent != ROOT / "uuv":
    pytest.exit(
        f"{uuv.__file__} hides {ROOT / 'uuv'}; rename it or take it off PYTHONPATH", returncode=2
    )


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("seeds")
    group.addoption(
        "--fresh",
        type=int,
        default=0,
        metavar="N",
        help="draw from N new seeds instead of the fixed ones",
    )
    group.addoption(
        "--seed",
        type=int,
        action="append",
        default=[],
        metavar="K",
        dest="seeds",
        help="draw from this seed, as shown",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Settle the seeds, once for all processes, before Hypothesis reads its options."""
    config.addinivalue_line(
        "markers",
        "seeds(*numbers): of the parameter `seed`, where --fresh and --seed ask for no other",
    )
    option = config.option
    if hasattr(config, "workerinput"):
        option.seeds = getattr(config, "workerinput")["seeds"]  # noqa: B009  an attribute of xdist's workers alone
    else:
        option.seeds = [
            *option.seeds,
            *(int.from_bytes(os.urandom(4), "big") for _ in range(option.fresh)),
        ]
    hypothesis.settings.register_profile(
        "suite", derandomize=not option.seeds, database=None, deadline=None
    )
    hypothesis.settings.load_profile("suite")
    if not option.seeds and hasattr(providers, "_get_local_constants"):
        # Hypothesis would draw from constants of all modules that are imported by then, after
        # parsing them: other examples in another order of tests.
        providers._get_local_constants = lambda: providers._local_constants
    if option.seeds and option.hypothesis_seed is None:
        option.hypothesis_seed = str(option.seeds[0])


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Hand the seeds to a process that xdist starts: it reads the command line anew, and would draw
    its own.
    """
    node.workerinput["seeds"] = node.config.option.seeds


def pytest_report_header(config: pytest.Config) -> str | None:
    return f"seeds: {', '.join(map(str, config.option.seeds))}" if config.option.seeds else None


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """`rng` on the fixed seeds; `seed` on those of the test's own mark `seeds`, which are as
    fixed.
    """
    asked = metafunc.config.option.seeds
    if "rng" in metafunc.fixturenames:
        metafunc.parametrize("rng", asked or first_in_the_suite(FIXED_SEEDS), indirect=True)
    for mark in metafunc.definition.iter_markers("seeds"):
        metafunc.parametrize("seed", asked or first_in_the_suite(mark.args))


def first_in_the_suite(seeds: Sequence[int]) -> list[Any]:
    """Parameters of a test: the first seed, and the others with -m long, which it guards."""
    first, *others = seeds
    return [first, *(pytest.param(seed, marks=pytest.mark.long) for seed in others)]


def pytest_collection_finish() -> None:
    """What is imported and collected by now stays to the end: the garbage collector need not walk
    it each time.
    """
    gc.freeze()
    gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None):
    """What a file's tests leave behind (caches, modules that they import) is not walked again by
    those of the next.
    """
    result = yield
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
        gc.freeze()
    return result


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A process for each core, up to four (half a GB each), for all tests; those named are sooner
    done in this one.

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
    reasons = (
        re.findall(rf"{MissingLibraryError.__name__}: (.+)", str(report.longrepr))
        if report.failed
        else []
    )
    if reasons and not os.environ.get("CI"):
        report.outcome, report.longrepr = (
            "skipped",
            (str(collector.path), 0, f"Skipped: {reasons[-1]}"),
        )
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
    """Open3D, to compare with; skips where it is not installed, as by default: uvw run --extra
    open3d pytest ...
    """
    if not find_spec("open3d"):
        pytest.skip("Open3D is not installed")
    return open3d_loader.load()


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """On a fixed seed, so that a commit is red or green whoever runs it; on a second one with
    -m long, on others with --fresh and --seed.
    """
    print(f"repeat with --seed {request.param}")  # pytest shows it when the test fails
    return np.random.default_rng(request.param)


@pytest.fixture
def fresh_seeds(request: pytest.FixtureRequest) -> list[int]:
    """Seeds of --fresh and --seed, for a test that has its own way of using them; none in the plain
    suite.
    """
    return list(request.config.option.seeds)


@pytest.fixture
def within(capfd: pytest.CaptureFixture[str]):
    """`within(name, residual, tolerance)`: the largest |residual| must not exceed the tolerance.

    UUV_TOLERANCE_SCALE multiplies every tolerance; 0 prints the residuals beside them and fails
    none.
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
def ended(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]):
    """`ended(command, *words)`: how a command ends in this process, with these words as its command
    line.
    """
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "200")
    renderer = os.environ.get("MUJOCO_GL")
    monkeypatch.setenv("MUJOCO_GL", renderer or "")  # has it restored: `uuv picture` sets it
    if renderer is None:
        monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(sys, "path", list(sys.path))

    def run(command: Callable[[], Any], *words: object) -> Run:
        monkeypatch.setattr(sys, "argv", [*map(str, words)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as stop:
            command()
        said = capfd.readouterr()
        return Run(int(stop.value.code or 0), said.out, said.err)

    return run


@pytest.fixture
def script(ended):
    """`script("experiments.faults.faults", *arguments)`: what scripts/experiments/faults/faults.py
    does, in this process.
    """

    from uuv.experiment.declaration import experiments_in  # pyarrow, which few tests need

    def run(name: str, *arguments: object) -> Run:
        module = import_module(name)
        declared = experiments_in(module)
        main = declared[0].main if declared else module.main
        return ended(lambda: run_scenario(main), f"{name}.py", *arguments)

    return run


@pytest.fixture
def verb(ended):
    """`verb("identify", "water", *arguments)`: what `uuv identify water ARGUMENTS` does, in this
    process.
    """
    from uuv.cli.main import main

    return partial(ended, main, "uuv")

"""The scenario layer as others import it: under one name, from any folder, from the installed
wheel.
"""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

TWICE = """
import os
import sys
from uuv import assemble, jobs, read_scenario, run, show
from uuv.scenario_file import from_dict, as_dict
assert from_dict(as_dict(jobs.clean_barrel(seed=1))) == jobs.clean_barrel(seed=1)
names = {}
for name, module in list(sys.modules.items()):
    if getattr(module, "__file__", None):
        names.setdefault(os.path.realpath(module.__file__), []).append(name)
ours = {
    file: modules for file, modules in names.items()
    if any(name.partition(".")[0] == "uuv" for name in modules)
}
assert len(ours) > 100, len(ours)
print({file: modules for file, modules in ours.items() if len(modules) > 1})
"""
MAIN_JOB = """
from uuv import jobs, run, show
r = run(jobs.clean_barrel(seed=0, quick=True))
show(r, "my_run")
print(r.assessment.accepted, r.assessment.failed)
"""
TABLES = {"events", "series_loop", "series_poses", "series_slow", "series_slow_late"}
LEFT = {"metrics.json", "report.html", "scenario.toml", *(f"{name}.parquet" for name in TABLES)}
FALL = """
import mujoco
from uuv import models
from uuv.sim import hydrodynamics
hydrodynamics.install()
model = hydrodynamics.compile(models.load("uuv_puma"))
data = mujoco.MjData(model)
mujoco.mj_step(model, data, nstep=500)
print(abs(data.qvel[2]) < 0.1)
"""


def python(program: str | Path, code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [program, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )


ROOMS = ("models", "sim", "controllers", "perception", "calib", "scenarios")
OWN = """
import models, sim, controllers, perception, calib, scenarios
assert all(room.MINE for room in (models, sim, controllers, perception, calib, scenarios))
import uuv.models, uuv.sim
print(uuv.models.load("uuv_puma").modelname != "", not hasattr(uuv.sim, "MINE"))
"""


@pytest.fixture
def own_folder(tmp_path: Path) -> Path:
    """A folder, with a blank and an umlaut in its name, of a user who calls his own packages as our
    rooms.
    """
    folder = tmp_path / "Tiefsee Gerät"
    for name in ROOMS:
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text("MINE = True\n")
    return folder


def test_no_module_is_loaded_under_two_names(own_folder: Path):
    ran = python(sys.executable, TWICE, own_folder)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == "{}"


def test_folders_of_ones_own_are_ones_own_and_hide_nothing(own_folder: Path):
    ran = python(sys.executable, OWN, own_folder)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == "True True"


@pytest.mark.parametrize("room", ROOMS[:-1])
def test_a_room_has_no_other_name(room: str, tmp_path: Path):
    """In a checkout its folder lies on the path."""
    ran = python(sys.executable, f"import {room}", tmp_path)
    assert ran.returncode == 1
    assert ran.stderr.splitlines()[-1] == (
        f"ImportError: {room!r} is not a package of the project: import uuv.{room}"
    )


def test_a_copy_without_links_finds_its_rooms(root: Path, tmp_path: Path):
    """As some archives and file systems leave it: a link is a small file with the path."""
    names = shutil.ignore_patterns("__pycache__")
    for name in ("models", "sim"):
        shutil.copytree(root / name, tmp_path / name, ignore=names)
    (tmp_path / "uuv").mkdir()
    for file in (root / "uuv").glob("__init__.py*"):
        shutil.copy(file, tmp_path / "uuv")
    (tmp_path / "uuv" / "models").write_text("../models")
    code = "import uuv.models; print(uuv.models.load('remus100').modelname, uuv.models.__file__)"
    ran = python(sys.executable, code, tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.endswith(f"{tmp_path / 'models' / '__init__.py'}\n")


def test_the_command_is_a_module_too(root: Path):
    ran = subprocess.run(
        [sys.executable, "-m", "uuv", "--version"],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("uuv-arm ")


def call_uv(root: Path, *words: object) -> None:
    """Calls uv. Needs the network, or uv's cache."""
    uv = shutil.which("uv") or str(root / ".uv" / "bin" / "uv")
    ran = subprocess.run([uv, *map(str, words)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


@pytest.fixture(scope="module")
def wheel(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project as others install it."""
    folder = tmp_path_factory.mktemp("wheel")
    call_uv(root, "build", "--wheel", "--out-dir", folder, root)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def environment(root: Path, wheel: Path) -> Path:
    """Python of an environment with the wheel, its extras for a job, and a notebook kernel."""
    python = wheel.parent / "environment" / "bin" / "python"
    call_uv(root, "venv", "--python", sys.executable, python.parents[1])
    call_uv(
        root,
        "pip",
        "install",
        "--python",
        python,
        f"{wheel}[perception,log]",
        "nbclient",
        "ipykernel",
    )
    return python


@pytest.mark.long
def test_what_is_installed_works_and_what_is_missing_is_named(
    root: Path, wheel: Path, tmp_path: Path
):
    minimal_python = wheel.parent / "minimal" / "bin" / "python"

    def uuv(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [minimal_python.with_name("uuv"), *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    call_uv(root, "venv", "--python", sys.executable, minimal_python.parents[1])
    call_uv(root, "pip", "install", "--python", minimal_python, wheel)
    assert (
        sum(file.stat().st_size for file in minimal_python.parents[1].rglob("*") if file.is_file())
        < 0.5e9
    )
    assert python(minimal_python, FALL, tmp_path).stdout.strip() == "True"
    ran = uuv("run", "clean-barrel", "--quick")
    assert ran.returncode == 2
    assert ran.stderr == (
        "error: cameras and sonars need the package embreex: pip install 'uuv-arm[perception]'\n"
    )
    call_uv(root, "pip", "install", "--python", minimal_python, f"{wheel}[perception]")
    ran = uuv("run", "clean-barrel", "--quick", "--out", "plain")
    assert ran.returncode == 0, ran.stderr
    assert "no run.rrd and report.html, series as .npz: pip install 'uuv-arm[log]'" in ran.stdout
    assert {file.stem for file in (tmp_path / "plain").glob("*.npz")} == TABLES
    for verb, lacks in (
        ("report", "report: needs matplotlib"),
        ("picture", "this needs the package PIL"),
    ):
        ran = uuv(verb, "plain")
        assert ran.returncode == 2
        assert ran.stderr.startswith(f"error: {lacks}")
        assert "'uuv-arm[log]'" in ran.stderr


@pytest.mark.long
def test_the_wheel_runs_the_main_job_from_any_folder(environment: Path, tmp_path: Path):
    ran = python(environment, MAIN_JOB, tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines()[-1] == "True ()"
    assert {file.name for file in (tmp_path / "my_run").iterdir()} == LEFT


@pytest.mark.long(
    guarded_by="tests/unit/uuv/cli/test_installed.py::test_folders_of_ones_own_are_ones_own_and_hide_nothing"
)
def test_the_wheel_adds_one_name_and_hides_nothing_of_the_users(
    environment: Path, wheel: Path, own_folder: Path
):
    with zipfile.ZipFile(wheel) as archive:
        names = {name.partition("/")[0] for name in archive.namelist()}
        experiments = [name for name in archive.namelist() if "experiments" in name]
    assert {name for name in names if not name.endswith(".dist-info")} == {"uuv"}
    assert experiments == []
    for code, words in ((TWICE, "{}"), (OWN, "True True")):
        ran = python(environment, code, own_folder)
        assert ran.returncode == 0, ran.stderr
        assert ran.stdout.strip() == words


NOTEBOOK = """
import nbclient, nbformat
cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
notebook = nbformat.v4.new_notebook(cells=cells)
nbclient.NotebookClient(notebook, timeout=500).execute()
outputs = [output for cell in notebook.cells for output in cell.outputs]
print([output.get("text", "") for output in outputs if output.get("name") == "stdout"][-1])
"""
LOGGED = """
from uuv.sim.reporting.rerun_log import RerunLog
from uuv import assemble
made = assemble(jobs.clean_barrel(seed=0, quick=True), full=True)
with RerunLog("run.rrd", made.plant.model, timestep=made.plant.timestep) as log:
    r = run(made, observers=[log], longest=1.0)
print(r.assessment.accepted)
"""


@pytest.mark.long
def test_a_notebook_runs_the_main_job_and_leaves_a_visual_log(environment: Path, tmp_path: Path):
    ran = python(environment, NOTEBOOK.replace("CELLS", repr([MAIN_JOB, LOGGED])), tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines()[0] == "False"  # of the second run, that was cut short
    assert {file.name for file in (tmp_path / "my_run").iterdir()} == LEFT
    assert (tmp_path / "run.rrd").stat().st_size > 10_000

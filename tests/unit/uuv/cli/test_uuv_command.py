"""The command `uuv`, from the shell, and the parts of one's own that it makes."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from uuv import catalogue
from uuv.cli import skeletons
from uuv.cli.compare_runs import alike
from uuv.cli.main import main
from uuv.cli.picture import CLIP, STILL
from uuv.cli.run_scene import FRAMES, HEIGHT, WIDTH
from uuv.jobs import barrel
from uuv.scenario_file import write_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.reporting.series_tables import PastRun


@pytest.fixture
def uuv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """The command in a folder of its own; gives what it printed to stdout, or to stderr if it fails."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("MUJOCO_GL", "")  # has it restored: the verb `picture` sets it
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setenv("PYTHONSAFEPATH", "")  # likewise: every verb sets it

    def call(*args: str, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["uuv", *args])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        assert (ended.value.code or 0) == code, said.err + said.out
        return said.err if code == 2 else said.out

    return call


def test_list_names_everything_that_the_registries_do_without_importing_them(uuv):
    from uuv import models
    from uuv.components.contact_parts import CONTROLLERS, SENSORS
    from uuv.models.arms.published_arms import ARMS
    from uuv.models.objects.targets import OBJECTS
    from uuv.models.site.soil import SOILS
    from uuv.models.tools.tools import TOOLS
    from uuv.perturbations.perturbation import registry
    from uuv.tasks import registry as tasks

    listed = {shelf.kind: [name for name, _ in catalogue.things(shelf.kind)] for shelf in catalogue.SHELVES}
    for kind, known in (("arm", ARMS), ("object", OBJECTS), ("soil", SOILS), ("tool", TOOLS)):
        assert sorted(listed[kind]) == list(known.names())
    for kind, known in (
        ("controller", CONTROLLERS),
        ("sensor", SENSORS),
        ("perturbation", registry()),
        ("task", tasks.registry()),
    ):
        assert sorted(listed[kind]) == list(known.names())
    assert {*listed["vehicle"]} <= {*models.available()}
    assert len(listed["vehicle"]) == 10
    assert all(said for kind in ("job", "study", "vehicle", "perturbation") for _, said in catalogue.things(kind))
    said = uuv("list", "objects")
    assert said.startswith("objects  (uuv run clean-object --object NAME)")
    assert "  barrel  " in said
    heavy = "import sys; from uuv.catalogue import main; main('list', []); print('mujoco' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "False"


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["rnu"], "no verb 'rnu'; there are list, run, .* (did you mean run?)"),
        (["list", "boats"], "no kind 'boats'; there are job"),
        (["run", "clean-barel"], "(did you mean clean-barrel?)"),
        (["run", "clean-object", "--object", "baril"], "(did you mean barrel?)"),
        (["run", "nothing.toml"], "nothing.toml"),
        (["run", "clean-barrel", "--blend", "0.1"], "--blend 0.1: a round tool does not turn"),
        (
            ["run", "clean-barrel", "--turn", "0", "--dwell", "--blend", "0.1"],
            "--dwell (task.turn.dwell) and --blend (task.turn.blend) 0.1",
        ),
        (["run", "clean-barrel", "--target-pose", "known", "--sensor", "sonar"], "nothing looks for the object"),
        (["run", "clean-barrel", "--speeed", "0.03"], "--speeed, 0.03 .* (did you mean --speed?)"),
        (
            ["run", "clean-object", "--line", "0.1", "0.1", "0.1", "0.1"],
            "--line (site.object.line): must be at least 0.05 m long",
        ),
        (["run", "clean-object", "--line", "5", "5", "6", "6"], "rays miss it"),
        (["run", "clean-object", "--line", "0", "0", "1", "1", "--path", "top"], "--path and --line: one of the two"),
        (["replay", "elsewhere"], "elsewhere: no run, a folder with metrics.json"),
        (["check", "no_module:hull"], "vehicle 'no_module:hull': cannot be imported"),
        (["new", "boat", "mine"], "no skeleton of a 'boat'; there are controller"),
        (["new", "object", "My-Thing"], "a module's name in lower case"),
    ],
)
def test_a_mistake_is_one_line(args: list[str], said: str, uuv, tmp_path: Path):
    told = uuv(*args, code=2).strip().splitlines()
    error = told[-1]
    assert all(line.startswith(("first start:", "compiling ")) for line in told[:-1])  # on a new machine
    for part in said.split(" .* "):
        assert part in error
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_help_of_every_verb(uuv):
    assert "uuv run clean-barrel --seed 3" in uuv()
    for verb in (
        "list",
        "run",
        "compare",
        "replay",
        "report",
        "view",
        "picture",
        "check",
        "wet",
        "identify-water",
        "doctor",
        "new",
        "completion",
    ):
        assert uuv(verb, "--help").startswith(f"usage: uuv {verb}")
    assert "--corner" in uuv("run", "clean-barrel", "--help")


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["uuv", "re"], {"replay", "report"}),
        (["uuv", "run", "clean-b"], {"clean-barrel"}),
        (["uuv", "run", "clean-barrel", "--az"], {"--azimuth"}),
        (["uuv", "run", "clean-barrel", "--no-r"], {"--no-record"}),
        (["uuv", "new", "ta"], {"task"}),
        (["uuv", "replay", "sample"], {"sample-seabed"}),
    ],
)
def test_words_are_completed(words: list[str], wanted: set[str], uuv, tmp_path: Path):
    typed = " ".join(f"'{word}'" for word in words)
    asked = f"COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _uuv; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    program = uuv("completion", "bash") + asked
    said = subprocess.run(["bash", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert set(said.stdout.split()) == wanted


def test_pictures_ask_for_egl_only_where_it_is(uuv, monkeypatch: pytest.MonkeyPatch):
    """Without the library, MuJoCo could not even be imported."""
    monkeypatch.delenv("DISPLAY", raising=False)
    for found, wanted in ((None, None), ("libEGL.so.1", "egl")):
        monkeypatch.setattr("ctypes.util.find_library", lambda _, found=found: found)
        monkeypatch.delenv("MUJOCO_GL", raising=False)
        uuv("picture", "--help")
        assert os.environ.get("MUJOCO_GL") == wanted


def test_a_run_is_repeated_compared_and_read_back(uuv, tmp_path: Path):
    job = barrel(seed=1, quick=True, target_pose="known")
    write_scenario(job, tmp_path / "mine.toml")
    made = json.loads(uuv("run", "mine.toml", "--json", "--out", "first", "--set", "task.speed=0.04"))
    assert made["accepted"]
    assert "the same to the bit" in uuv("replay", "first")
    other = tmp_path / "second"
    other.mkdir()
    write_scenario(job, other / "scenario.toml")
    (other / "metrics.json").write_text(json.dumps({**made, "tool": {**made["tool"], "speed_mean_m_s": 0.02}}))
    table = uuv("compare", "first", "second")
    assert "task.speed" in table
    assert "tool.speed_mean_m_s" in table
    assert made["contact"]["force_error_rms_n"] > 0.0
    assert "contact.force_error_rms_n" not in table
    assert "no page of the time series: second was run with --no-record" in table
    shutil.copytree(tmp_path / "first", tmp_path / "third")
    assert "written to first/compare_third.html" in uuv("compare", "first", "third")
    assert "solid: first; dotted: third" in (tmp_path / "first" / "compare_third.html").read_text(encoding="utf-8")
    assert uuv("report", "first").strip() == str((tmp_path / "first" / "report.html").resolve())
    page = Path(__file__).resolve().parents[4] / "docs" / "runs.md"
    (read_back,) = re.findall(r"```python\n([^`]*PastRun[^`]*)```", page.read_text(encoding="utf-8"))
    exec(compile(read_back.replace("runs/clean_barrel/latest", "first"), "runs.md", "exec"), names := {})
    past = PastRun.of(tmp_path / "first")
    assert np.array_equal(names["force"], past.column("contact_normal"))
    assert past.rates[0] == "loop"
    time, force = past.column("time"), past.column("contact_normal")
    assert np.diff(time) == pytest.approx(0.002)
    assert force.max() == pytest.approx(90.0, abs=5.0)
    assert past.units()["contact_normal"] == "N"
    assert past.units("slow")["q.joint1"] == "rad"
    assert past.table("events").to_pylist()[-1]["state"] == "done"
    assert past._repr_html_().count("<tr>") == 6
    with pytest.raises(ConfigurationError, match="no column 'force'; there are time"):
        past.column("force")
    with pytest.raises(ConfigurationError, match=r"no series 'fast'; there are loop"):
        past.table("fast")


@pytest.mark.long
def test_still_and_clip_of_a_run(uuv, tmp_path: Path):
    folder = tmp_path / "first"
    assert uuv("run", "clean-barrel", "--quick", "--quiet", "--out", str(folder)).startswith("accepted")
    program = "import sys; from uuv.cli.main import main; sys.argv = ['uuv', 'picture', 'first']; main()"
    made = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert made.stdout.split() == [str(folder.resolve() / name) for name in (STILL, CLIP)]
    still, clip = Image.open(folder / STILL), Image.open(folder / CLIP)
    assert still.size == (WIDTH, HEIGHT)
    assert np.asarray(still).std() > 20.0
    assert getattr(clip, "n_frames", 1) == FRAMES


def test_check_says_what_a_vehicle_has_and_lacks(uuv):
    said = uuv("check", "uuv_puma", "--jobs", "hover", "seabed-core")
    assert "351.3 kg, +0.0 N" in said
    assert said.count("  promised") == 2
    lacking = uuv("check", "bluerov2_heavy_alpha5", "--jobs", "tap", code=1)
    assert "refused: parts" in lacking
    assert "lacks geom 'pad' (may touch)" in lacking
    assert "-129 to 129 N" in lacking


@pytest.mark.parametrize(
    "kind",
    ["vehicle", "object", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("sensor", "controller", "task"))],
)
def test_a_skeleton_passes_its_own_test(kind: str, uuv, tmp_path: Path):
    uuv("new", kind, "mine")
    assert "is there already" in uuv("new", kind, "mine", code=2)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_mine.py"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout
    named = {"task": "mine:Circle"}.get(kind, "mine:mine")
    assert named in skeletons.SKELETONS[kind].use.replace("NAME", "mine").split()


def test_a_task_of_ones_own_is_run_and_replayed(uuv, tmp_path: Path):
    uuv("new", "task", "draw")
    (tmp_path / "other.py").write_text("def Thing():\n    return 1\n")
    asked = ("--set", "site.object.kind=OpenWater", "task.radius=0.05")
    made = json.loads(uuv("run", "clean-barrel", "--json", "--no-record", "--task", "draw:Circle", *asked))
    assert made["accepted"], made["failed"]
    assert made["provenance"]["options"]["task"] == {"kind": "draw:Circle", "radius": 0.05}
    refused = uuv("replay", "draw", code=2)
    assert "scenario.toml': names code, 'draw:Circle', which is not run unless you say --trust" in refused
    assert "the same to the bit" in uuv("replay", "draw", "--trust")
    for task, said in (
        ("draw:Round", "error: --task: task 'draw:Round': cannot be imported"),
        ("other:Thing", "error: --task: [task]: task 'other:Thing' must be a dataclass that inherits Task"),
    ):
        assert uuv("run", "clean-barrel", "--task", task, code=2).startswith(said)
    assert "MODULE:CLASS is missing" in uuv("run", "clean-barrel", "--task", code=2)


def test_figures_that_differ():
    assert alike([1.0, 1.01])
    assert not alike([1.0, 1.1])
    assert not alike([None, 1.0])
    assert not alike([True, False])
    assert alike(["done", "done"])

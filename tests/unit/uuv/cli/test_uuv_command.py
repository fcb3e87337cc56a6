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
from uuv.cli.completion import words_of
from uuv.cli.main import USAGE, VERBS
from uuv.cli.past.compare_runs import alike
from uuv.cli.past.picture import CLIP, STILL
from uuv.jobs import clean_object
from uuv.scenario_file import write_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.reporting.series_tables import PastRun


@pytest.fixture
def uuv(verb, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The command in a folder of its own; gives what it printed to stdout, or to stderr if it
    fails.
    """
    monkeypatch.chdir(tmp_path)

    def call(*args: str, code: int = 0) -> str:
        ran = verb(*args)
        assert ran.returncode == code, ran.stderr + ran.stdout
        return ran.stderr if code == 2 else ran.stdout

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

    listed = {
        shelf.kind: [name for name, _ in catalogue.things(shelf.kind)]
        for shelf in catalogue.SHELVES
    }
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
    assert len(listed["vehicle"]) == 14
    assert all(
        listing
        for kind in ("job", "experiment", "vehicle", "perturbation")
        for _, listing in catalogue.things(kind)
    )
    listing = uuv("list", "objects")
    assert listing.startswith("objects  (uuv run clean-object --object NAME)")
    assert "  barrel  " in listing
    heavy = (
        "import sys; from uuv.cli.listing import main; main('list', []); print('mujoco' in "
        "sys.modules)"
    )
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
        (
            ["run", "clean-barrel", "--blend", "0.1"],
            "--blend (task.turn.blend) 0.1: needs --turn (task.turn.angle) too",
        ),
        (
            ["run", "clean-barrel", "--turn", "0", "--dwell", "--blend", "0.1"],
            "--dwell (task.turn.dwell) and --blend (task.turn.blend) 0.1",
        ),
        (
            ["run", "clean-barrel", "--target-pose", "known"],
            "--target-pose: no longer an option; use --sensor survey",
        ),
        (
            ["run", "clean-barrel", "--sensor", "survey", "--looks", "3"],
            "the object is not identified",
        ),
        (["run", "clean-barrel", "--set"], "--set: KEY=VALUE is missing"),
        (["run", "clean-barrel", "--set", "task.sped=1"], "--set: "),
        (["run"], "NAME: missing"),
        (["run", "--seed", "3"], "--seed: the name of a job comes first: uuv run NAME [OPTIONS]"),
        (["compare", "here"], "RUN: missing"),
        (["run", "clean-barrel", "--speeed", "0.03"], "--speeed, 0.03 .* (did you mean --speed?)"),
        (
            ["run", "clean-object", "--line", "0.1", "0.1", "0.1", "0.1"],
            "--line (site.object.line): must be at least 0.05 m long",
        ),
        (["run", "clean-object", "--line", "5", "5", "6", "6"], "rays miss the mesh"),
        (
            ["run", "clean-object", "--line", "0", "0", "1", "1", "--path", "top"],
            "--path (task.path) 'top' and --line (site.object.line): give only one of the two",
        ),
        (["replay", "elsewhere"], "elsewhere: must be a run, a folder with metrics.json"),
        (["check", "no_module:hull"], "vehicle 'no_module:hull': cannot be imported"),
        (["new", "boat", "mine"], "KIND: must be one of "),
        (["new", "object", "My-Thing"], "a module's name in lower case"),
        (["new", "job", "statistics"], "NAME: must not be that of an installed module"),
        (["new", "job", "numpy"], "NAME: must not be that of an installed module"),
        (
            ["logs", "dive.BIN", "--picture", "x.foo"],
            "--picture: must be a file *.png, got 'x.foo'",
        ),
        (
            ["replay", "--log", "dive.BIN", "--trust"],
            "replay: --trust is of a RUN; a log names no code",
        ),
        (["replay", "clean-barrel", "--picture", "x.png"], "replay: --picture needs --log"),
        (["drive", "clean-barrel", "--pace", "0"], "pace: must be 0.01 to 100.0 times real time"),
    ],
)
def test_a_mistake_is_one_line(args: list[str], said: str, uuv, tmp_path: Path):
    lines = uuv(*args, code=2).strip().splitlines()
    error = lines[-1]
    # on a new machine
    assert all(line.startswith(("first start:", "compiling ")) for line in lines[:-1])
    for part in said.split(" .* "):
        assert part in error
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


WITHOUT_FIGURES = (
    "new",
    "completion",
    "report",
    "view",
    "picture",
    "gallery",
)  # they leave, or name, files
LIGHT = """
import contextlib, io, json, sys, time
from uuv.cli.main import VERBS, main
from uuv.jobs import JOBS
told = {}
for words in (*(name.split() for name in VERBS), *(["run", job] for job in JOBS.names())):
    sys.argv, begun, said = ["uuv", *words, "--help"], time.process_time(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main()
    heavy = sorted({"mujoco", "numba", "scipy"} & sys.modules.keys())
    told[" ".join(words)] = (time.process_time() - begun, heavy, said.getvalue())
print(json.dumps(told))
"""


def test_help_of_every_verb_is_light_and_tells_its_use(uuv):
    """CPU time of one process that helps with all of them: the first imports what they share."""
    usage = uuv()
    ran = subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True, check=True)
    table = json.loads(ran.stdout)
    (shared, _, _), *_ = table.values()
    for words, (seconds, heavy, text) in table.items():
        assert heavy == [], words
        assert shared + seconds < 1.0, words  # [s] measured 0.3
        if words in VERBS:
            assert f"uuv {words} {VERBS[words].words}".rstrip() in usage
            assert " ".join(text.split()).startswith(f"usage: uuv {words} [-h]")
    assert "--corner" in table["run clean-barrel"][2]


def test_the_page_of_the_command_has_all_verbs(root: Path):
    page = (root / "docs" / "uuv.md").read_text(encoding="utf-8")
    assert f"```text\n{USAGE}\n```" in page, "the table of verbs, as `uuv --help` prints it"
    rows = re.findall(r"^\| `([^`]+)` \|", page, flags=re.MULTILINE)
    assert rows == list(VERBS)


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_is_completed_and_prints_its_figures_as_json(name: str):
    has = {"--json", "--help"} if name not in WITHOUT_FIGURES else {"--help"}
    assert has <= set(words_of(name, VERBS[name]))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify-water"], "identify-water: this command is now `uuv identify water`"),
        (
            ["identify-object", "--object", "valve"],
            "identify-object: this command is now `uuv identify object`",
        ),
        (["identify_friction"], "identify_friction: this command is now `uuv identify friction`"),
        (["calibrate-arm"], "calibrate-arm: this command is now `uuv calibrate`"),
        (["run_campaign.py", "x.toml"], "run_campaign.py: this command is now `uuv campaign`"),
        (["run-scenario"], "run-scenario: this command is now `uuv run`"),
        (["show_models"], "show_models: this command is now `uuv models`"),
        (["validate-physics"], "validate-physics: this command is now `uuv validate`"),
        (["contact-score"], "contact-score: this command is now `uuv benchmark`"),
        (["run", "campaign"], "campaign is not a job but a verb: `uuv campaign`"),
        (["identify"], "identify: needs one of object, friction, water, got none"),
        (
            ["identify", "watr"],
            "identify: needs one of object, friction, water, got watr (did you mean water?)",
        ),
        (["identify", "--help"], "identify: needs one of object, friction, water, got --help"),
    ],
)
def test_an_earlier_spelling_and_a_missing_object_are_told(words: list[str], said: str, uuv):
    assert uuv(*words, code=2) == f"error: {said}\n"


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["uuv", "re"], {"replay", "report", "results"}),
        (["uuv", "run", "clean-b"], {"clean-barrel"}),
        (["uuv", "run", "clean-barrel", "--az"], {"--azimuth"}),
        (["uuv", "run", "clean-barrel", "--no-r"], {"--no-record"}),
        (["uuv", "run", "clean-barrel", *(7 * ["--quick"]), "--az"], {"--azimuth"}),  # the tenth
        (["uuv", "new", "ta"], {"task"}),
        (["uuv", "identify", "wa"], {"water"}),
        (["uuv", "identify", "water", "--wi"], {"--window"}),
        (["uuv", "identify", "object", "--mesh"], {"--mesh-scale"}),
        (["uuv", "campaign", "--rep"], {"--replay"}),
        (["uuv", "run", "my.toml", "--tr"], {"--trust"}),
        (["uuv", "compare-campaigns", "--js"], {"--json"}),
        (["uuv", "completion", "z"], {"zsh"}),
        (["uuv", "replay", "sample"], {"sample-seabed"}),
        (["uuv", "check", "rem"], {"remus100"}),
        (["uuv", "models", "phoe"], {"phoenix_smart3s"}),
        (
            ["uuv", "run", "clean-barrel", "--vehicle", "uuv_puma_"],
            {"uuv_puma_side", "uuv_puma_two_sway"},
        ),
        (["uuv", "run", "my.toml", "--vehicle", "rexrov2_"], {"rexrov2_arm7"}),
    ],
)
def test_words_are_completed(words: list[str], wanted: set[str], uuv, tmp_path: Path):
    typed = " ".join(f"'{word}'" for word in words)
    arguments = (
        f"COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _uuv; printf '%s\\n' "
        f'"${{COMPREPLY[@]}}"'
    )
    program = uuv("completion", "bash") + arguments
    ran = subprocess.run(
        ["bash", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert set(ran.stdout.split()) == wanted


def test_pictures_ask_for_egl_only_where_it_is(uuv, monkeypatch: pytest.MonkeyPatch):
    """Without the library, MuJoCo could not even be imported."""
    monkeypatch.delenv("DISPLAY", raising=False)
    for found, wanted in ((None, None), ("libEGL.so.1", "egl")):
        monkeypatch.setattr("ctypes.util.find_library", lambda _, found=found: found)
        monkeypatch.delenv("MUJOCO_GL", raising=False)
        uuv("picture", "--help")
        assert os.environ.get("MUJOCO_GL") == wanted


def test_a_run_is_compared_and_read_back(uuv, tmp_path: Path):
    job = clean_object(seed=1, quick=True, sensor="survey")
    write_scenario(job, tmp_path / "mine.toml")
    printed = json.loads(
        uuv("run", "mine.toml", "--json", "--out", "first", "--set", "task.speed=0.04")
    )
    assert printed["accepted"]
    other = tmp_path / "second"
    other.mkdir()
    write_scenario(job, other / "scenario.toml")
    (other / "metrics.json").write_text(
        json.dumps({**printed, "tool": {**printed["tool"], "speed_mean_m_s": 0.02}})
    )
    table = uuv("compare", "first", "second")
    assert "task.speed" in table
    assert "tool.speed_mean_m_s" in table
    assert printed["contact"]["force_error_rms_n"] > 0.0
    assert "contact.force_error_rms_n" not in table
    assert "no page of the time series: second was run with --no-record" in table
    shutil.copytree(tmp_path / "first", tmp_path / "third")
    assert "written to first/compare_third.html" in uuv("compare", "first", "third")
    assert "solid: first; dotted: third" in (tmp_path / "first" / "compare_third.html").read_text(
        encoding="utf-8"
    )

    # Of a vehicle that is not here the bounds are not known; the series are drawn all the same.
    kept = tmp_path / "third" / "scenario.toml"
    text = kept.read_text(encoding="utf-8")
    assert 'vehicle = "uuv_puma"' in text
    kept.write_text(text.replace('vehicle = "uuv_puma"', 'vehicle = "gone.xml"'), encoding="utf-8")
    assert "written to first/compare_third.html" in uuv("compare", "first", "third")

    assert uuv("report", "first").strip() == str((tmp_path / "first" / "report.html").resolve())
    page = Path(__file__).resolve().parents[4] / "docs" / "runs.md"
    (read_back,) = re.findall(
        r"```python\n([^`]*PastRun[^`]*)```", page.read_text(encoding="utf-8")
    )
    exec(
        compile(read_back.replace("runs/clean_barrel/latest", "first"), "runs.md", "exec"),
        names := {},
    )
    past = PastRun.of(tmp_path / "first")
    assert np.array_equal(names["force"], past.column("contact_normal"))
    assert past.rates[0] == "loop"
    time, force = past.column("time"), past.column("contact_normal")
    assert np.diff(time) == pytest.approx(0.002)
    assert force.max() == pytest.approx(60.0, abs=5.0)
    assert past.units()["contact_normal"] == "N"
    assert past.units("slow")["q.joint1"] == "rad"
    assert past.table("events").to_pylist()[-1]["state"] == "done"
    assert past._repr_html_().count("<tr>") == 6
    assert past.states[int(past.column("state")[-1])] == "done"
    with pytest.raises(
        ConfigurationError, match=r"'force' in .*'loop' \(did you mean set_force\?\)"
    ):
        past.column("force")
    with pytest.raises(ConfigurationError, match=r"the table 'slow' has it: column\('q.joint1', "):
        past.column("q.joint1")
    with pytest.raises(ConfigurationError, match=r"no series 'fast'; there are loop"):
        past.table("fast")


def test_a_missing_report_is_written_alone_and_of_the_same_trajectory_only(uuv, tmp_path: Path):
    folder = tmp_path / "a"
    uuv("run", "open-water", "--quick", "--no-record", "--out", "a")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    uuv("report", "a")
    after = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert after.pop("report.html")
    assert after == before

    # A record of other code.
    (folder / "report.html").unlink()
    metrics = json.loads(before["metrics.json"])
    metrics["run"]["trajectory_sha256"] = "0" * 64
    (folder / "metrics.json").write_text(json.dumps(metrics))
    altered = {file.name: file.read_bytes() for file in folder.iterdir()}
    said = uuv("report", "a", code=2)
    assert "a has no report.html, and different trajectory: " in said
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == altered


@pytest.mark.long
def test_still_and_clip_of_a_run(uuv, tmp_path: Path):
    folder = tmp_path / "first"
    assert uuv("run", "clean-barrel", "--quick", "--quiet", "--out", str(folder)).startswith(
        "accepted"
    )
    program = (
        "import sys; from uuv.cli.main import main; sys.argv = ['uuv', 'picture', 'first', "
        "'--size', '320x180', '--frames', '20']; main()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert ran.stdout.split() == [str(folder.resolve() / name) for name in (STILL, CLIP)]
    still, clip = Image.open(folder / STILL), Image.open(folder / CLIP)
    assert still.size == (320, 180)
    assert np.asarray(still).std() > 20.0
    assert getattr(clip, "n_frames", 1) == 20


def test_check_says_what_a_vehicle_has_and_lacks(uuv):
    listing = uuv("check", "uuv_puma", "--jobs", "hover", "seabed-core")
    assert "351.3 kg, +0.0 N" in listing
    assert listing.count("  feasible") == 2
    lacking = uuv("check", "bluerov2_heavy_alpha5", "--jobs", "tap", code=1)
    assert "refused: parts" in lacking
    assert "lacks geom 'pad' (may be in contact)" in lacking
    assert "-129 to 129 N" in lacking


def test_a_folder_that_cannot_be_written_is_one_line(uuv, monkeypatch: pytest.MonkeyPatch):
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("uuv.sim.runs.saving._not_through_a_link", refused)
    assert "my_part.py: cannot be written" in uuv("new", "job", "my_part", code=2)


SKELETON = pytest.mark.long(
    guarded_by="tests/unit/uuv/cli/test_uuv_command.py::test_a_skeleton_passes_its_own_test"
)


@pytest.mark.parametrize(
    "kinds",
    [
        ("vehicle", "tool", "perturbation"),
        pytest.param(("object", "sensor", "controller", "task", "job"), marks=SKELETON),
    ],
    ids=" ".join,
)
def test_a_skeleton_passes_its_own_test(kinds: tuple[str, ...], uuv, tmp_path: Path):
    """Those of several kinds in one process, which imports what all of them need."""
    for kind in kinds:
        name = f"my_{kind}"
        uuv("new", kind, name)
        assert "exists already" in uuv("new", kind, name, code=2)
        used = {"task": f"{name}:Circle", "perturbation": f"perturbations.{name}:Worn.factor=2.0"}
        use = skeletons.SKELETONS[kind].use.replace("NAME", name).split()
        assert used.get(kind, f"{name}:{name}") in use

    tests = [f"test_my_{kind}.py" for kind in kinds]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout


def test_a_task_of_ones_own_is_run_and_replayed(uuv, tmp_path: Path):
    uuv("new", "task", "draw")
    (tmp_path / "other.py").write_text("def Thing():\n    return 1\n")
    arguments = ("--set", "site.object.kind=OpenWater", "task.radius=0.05")
    table = json.loads(
        uuv("run", "clean-barrel", "--json", "--no-record", "--task", "draw:Circle", *arguments)
    )
    assert table["accepted"], table["failed"]
    assert table["provenance"]["options"]["task"] == {"kind": "draw:Circle", "radius": 0.05}
    refused = uuv("replay", "draw", code=2)
    assert "scenario.toml': names code, 'draw:Circle', which is only run with --trust" in refused
    assert "the same to the bit" in uuv("replay", "draw", "--trust")
    for task, line in (
        ("draw:Round", "error: --task: task 'draw:Round': cannot be imported"),
        (
            "other:Thing",
            "error: --task: [task]: task 'other:Thing' must be a dataclass that inherits Task",
        ),
    ):
        assert uuv("run", "clean-barrel", "--task", task, code=2).startswith(line)
    assert "Missing value for argument '--task'" in uuv("run", "clean-barrel", "--task", code=2)


def test_figures_that_differ():
    assert alike([1.0, 1.01])
    assert not alike([1.0, 1.1])
    assert not alike([None, 1.0])
    assert not alike([True, False])
    assert alike(["done", "done"])

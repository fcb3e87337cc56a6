"""Folders and files of strangers: every verb refuses what is damaged or hostile in one line, and
runs none of it.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from run_records import every_run
from uuv.campaigns.campaign import read_campaign
from uuv.campaigns.distributions import Distribution
from uuv.cli.main import main
from uuv.cli.past import compare_runs
from uuv.experiment.row_log import RowLog
from uuv.jobs import clean_barrel
from uuv.scenario_file import read_scenario, to_toml
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.logged_columns import WIDTHS
from uuv.sim.loop.recording import STATES
from uuv.sim.reporting.series_files import Column, write_table
from uuv.sim.runs.run_folder import alone_in
from uuv.sim.runs.saving import write_whole

SCENARIO = to_toml(clean_barrel(seed=4, quick=True))
CODE = SCENARIO.replace('kind = "SurfaceWork"', 'kind = "stranger:Task"')


def run_in(folder: Path) -> Path:
    """Folder of a run of half a second, in a turned pose."""
    folder.mkdir()
    (folder / "scenario.toml").write_text(SCENARIO)
    (folder / "metrics.json").write_text(json.dumps(every_run(simulated_s=0.5)))
    (folder / "run.rrd").write_bytes(b"RRF2")
    n = 250
    columns = [Column("time", 0.002 * np.arange(n), "s")]
    for name, width in WIDTHS.items():
        table = np.tile(0.3 + 0.1 * np.arange(width), (n, 1))
        if name == "state":
            table[:] = STATES.index(WorkState.WORK)
        columns += [
            Column(f"{name}.{i}" if width > 1 else name, table[:, i], "", name)
            for i in range(width)
        ]
    write_table(folder / "series_loop", columns)
    texts = {"state": ["settle", "work"], "note": ["", ""], "abort": ["", ""]}
    events = [Column(name, np.array(words)) for name, words in texts.items()]
    write_table(folder / "events", [Column("time", np.array([0.0, 0.1]), "s"), *events])
    return folder


@pytest.fixture
def uuv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """The command in a folder of its own, with the runs `good` and `bad`; gives code and all that
    it printed.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    run_in(tmp_path / "good")
    run_in(tmp_path / "bad")

    def call(*args: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["uuv", *args])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return int(ended.value.code or 0), output.out + output.err

    return call


def with_run(**changes: Any) -> str:
    return json.dumps(every_run(**changes))


METRICS: dict[str, tuple[str, str]] = {
    "list": ("[]", r"metrics\.json: must be a table, got \[\]"),
    "number": ("5", r"must be a table, got 5"),
    "empty table": ("{}", r"run, accepted, failed, timings are missing"),
    "no run": ('{"run": null}', r"accepted, failed, timings are missing"),
    "deep": ("[" * 10_000, r"tables deep"),
    "cut": (with_run()[:-40], r"cannot be read"),
    "state": (with_run(state="flying"), r"run.state: allowed .*, got 'flying'"),
    "digest": (with_run(trajectory_sha256=5), r"run.trajectory_sha256: must be text, got 5"),
    "escape": (with_run(note="\x1b[2J"), r"run.note: a control character"),
}


@pytest.mark.parametrize(("text", "said"), METRICS.values(), ids=METRICS)
@pytest.mark.parametrize(
    "verb", [("compare", "good", "bad"), ("compare", "bad", "good"), ("replay", "bad")]
)
def test_damaged_metrics_are_one_line(
    verb: tuple[str, ...], text: str, said: str, uuv, tmp_path: Path
):
    (tmp_path / "bad" / "metrics.json").write_text(text)
    code, output = uuv(*verb)
    assert code == 2
    assert output.startswith("error: metrics 'bad/metrics.json': ")
    assert output.count("\n") == 1
    with pytest.raises(ConfigurationError, match=said):
        compare_runs.tables([_past(tmp_path / "bad")] * 2, every=True)


def _past(folder: Path) -> Any:
    from uuv.sim.reporting.series_tables import PastRun

    return PastRun.of(folder)


def _replaced(name: str, columns: list[Column]) -> Callable[[Path], None]:
    return lambda folder: write_table(folder / name, columns)


def _cut(name: str) -> Callable[[Path], None]:
    def cut(folder: Path) -> None:
        (folder / name).write_bytes((folder / name).read_bytes()[:900])

    return cut


def _with_state(state: float) -> Callable[[Path], None]:
    times = Column("time", np.zeros(3), "s")
    return _replaced("series_loop", [times, Column("state", np.full(3, state), "", "state")])


WORDS = [
    Column("time", np.array([0.0]), "s"),
    Column("note", np.array([""])),
    Column("abort", np.array([""])),
]
SERIES: dict[str, tuple[Callable[[Path], None], str]] = {
    "cut": (_cut("series_loop.parquet"), "is not a complete Parquet file"),
    "no times": (_replaced("series_loop", [Column("a", np.zeros(3))]), "no column 'time'"),
    "no state": (
        _replaced("series_loop", [Column("time", np.zeros(3))]),
        "without the series 'state'",
    ),
    "words": (
        _replaced("series_loop", [Column("time", np.array(["x"]))]),
        "'time' of 'loop' is not numeric",
    ),
    "falling": (
        _replaced("series_loop", [Column("time", np.array([1.0, 0.0]))]),
        "the times of its series 'loop'",
    ),
    "events": (
        _replaced("events", [*WORDS, Column("state", np.array(["flying"]))]),
        "state of an event: allowed",
    ),
    "foreign state": (_with_state(99.0), r"the series 'state' must be whole numbers .* got 99"),
    "state not a number": (_with_state(np.nan), r"the series 'state' must be .* got nan"),
    "no events": (_replaced("events", WORDS), "'events' has no column 'state' of texts"),
}


@pytest.mark.parametrize(("damage", "said"), SERIES.values(), ids=SERIES)
def test_damaged_series_are_one_line(
    damage: Callable[[Path], None], said: str, uuv, tmp_path: Path
):
    damage(tmp_path / "bad")
    code, output = uuv("compare", "bad", "good")
    assert code == 0
    assert "no page of the time series: " in output
    with pytest.raises(ConfigurationError, match=said):
        _ = _past(tmp_path / "bad").recorded


def test_whole_runs_are_compared(uuv):
    """What the damages above are damages of."""
    code, output = uuv("compare", "bad", "good")
    assert code == 0
    assert "written to bad/compare_good.html" in output


def test_markup_of_a_figure_is_text(uuv, tmp_path: Path):
    (tmp_path / "bad" / "metrics.json").write_text(
        json.dumps({**every_run(simulated_s=0.5), "[/red]<b>k": 1.0})
    )
    code, output = uuv("compare", "bad", "good")
    assert code == 0
    assert "[/red]<b>k" in output
    assert "[/red]&lt;b&gt;k" in (tmp_path / "bad" / "compare_good.html").read_text(
        encoding="utf-8"
    )


def test_what_is_no_log_is_not_shown(uuv, tmp_path: Path):
    (tmp_path / "bad" / "run.rrd").unlink()
    (tmp_path / "bad" / "run.rrd").symlink_to("/dev/zero")
    assert uuv("view", "bad") == (2, "error: log 'bad/run.rrd': it is no regular file\n")
    (tmp_path / "good" / "run.rrd").write_bytes(b"hello")
    assert uuv("view", "good") == (2, "error: log 'good/run.rrd': is no log of Rerun\n")


@pytest.mark.parametrize("name", ["../../out", "/tmp/out", "x\\u001b]0;p\\u0007", "[/bold]"])
def test_a_name_that_leads_elsewhere_is_refused(name: str, uuv, tmp_path: Path):
    (tmp_path / "s.toml").write_text(SCENARIO.replace('name = "clean_barrel"', f'name = "{name}"'))
    code, output = uuv("run", "s.toml", "--no-record")
    assert code == 2
    assert "control character" in output or "name: must be letters, digits, - and _" in output
    assert output[:-1].isprintable()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad", "good", "s.toml"]


def test_no_link_is_followed_to_write(tmp_path: Path):
    outside = tmp_path / "outside"
    outside.write_text("mine")
    for name in ("page.html", f".page.html.{os.getpid()}"):
        (tmp_path / name).symlink_to(outside)
    write_whole(tmp_path / "page.html", "theirs")
    (tmp_path / ".lock").symlink_to(outside)
    with pytest.raises(ConfigurationError), alone_in(tmp_path):
        pass
    assert outside.read_text() == "mine"
    assert (tmp_path / "page.html").read_text() == "theirs"


# -- code ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "verb",
    [
        ("run", "bad/scenario.toml"),
        ("replay", "bad"),
        ("report", "bad"),
        ("compare", "good", "bad"),
    ],
)
def test_code_that_a_file_names_is_not_imported(verb: tuple[str, ...], uuv, tmp_path: Path):
    (tmp_path / "stranger.py").write_text("open('imported', 'w').close()\n")
    (tmp_path / "bad" / "scenario.toml").write_text(CODE)
    message = (
        "error: scenario 'bad/scenario.toml': names code, 'stranger:Task', which is only run "
        "with --trust\n"
    )
    assert uuv(*verb) == (2, message)
    assert not (tmp_path / "imported").exists()
    code, output = uuv(*verb, "--trust")
    assert code == 2
    assert "stranger:Task" in output
    assert (tmp_path / "imported").exists()
    del sys.modules["stranger"]


@pytest.mark.parametrize(
    "change",
    [
        ('controller = "work"', 'controller = "stranger:C"'),
        ('sensor = "camera"', 'sensor = "stranger:s"'),
        ('vehicle = "uuv_puma"', 'vehicle = "stranger:v"'),
        (
            "perturbation_seed = 0",
            'perturbation_seed = 0\n[[perturbations]]\nkind = " stranger:P"\n#',
        ),
    ],
)
def test_every_place_of_a_scenario_is_looked_at(change: tuple[str, str], tmp_path: Path):
    assert change[0] in SCENARIO
    (tmp_path / "s.toml").write_text(SCENARIO.replace(*change))
    with pytest.raises(
        ConfigurationError,
        match=r"names code, ' ?stranger:\w', which is only run with "
        r"--trust",
    ):
        read_scenario(tmp_path / "s.toml")


def test_a_campaign_names_no_code_either(tmp_path: Path):
    head = 'base = "clean-barrel"\nquick = true\ncases = 1\n'
    (tmp_path / "own.toml").write_text(head + '[set]\n"control.controller" = "stranger:C"\n')
    (tmp_path / "base.toml").write_text(CODE)
    (tmp_path / "of_base.toml").write_text('base = "base.toml"\ncases = 1\n')
    drawn = '[distributions]\n"control.controller" = { categorical = ["work", "stranger:C"] }\n'
    (tmp_path / "drawn.toml").write_text(head + drawn)
    for name in ("own", "of_base", "drawn"):
        with pytest.raises(ConfigurationError, match="names code, 'stranger:"):
            read_campaign(tmp_path / f"{name}.toml")
    typed = ["control.controller=stranger:C"]
    assert (
        read_campaign(tmp_path / "own.toml", typed, trust=True).base.control.controller
        == "stranger:C"
    )
    (tmp_path / "plain.toml").write_text(head)
    assert read_campaign(tmp_path / "plain.toml", typed).base.control.controller == "stranger:C"


HIDING = (
    "csv.py",
    "json.py",
    "numpy.py",
    "yaml.py",
    "rich.py",
    "tyro.py",
    "models/__init__.py",
    "uuv/__init__.py",
)


def test_the_working_folder_is_last_on_the_path(tmp_path: Path):
    """Also in a process that the command starts, before its first line."""
    for name in HIDING:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(
            f"open('executed', 'a').write({name!r})\nraise SystemExit(9)\n"
        )
    (tmp_path / "mine.py").write_text("def Circle():\n    pass\n")
    (tmp_path / "s.toml").write_text(SCENARIO.replace("speed = 0.02", 'speed = "x"'))
    program = """
import subprocess, sys
from uuv.cli.main import main
from uuv.sim.runs.command_line import run_scenario
def call(*args):
    sys.argv = ["uuv", *args]
    try:
        main()
    except SystemExit as ended:
        return ended.code or 0
print(
    call("list", "job"), call("completion", "bash"),
    call("run", "s.toml"), call("compare", "x", "y"),
)
def work():
    import csv, mine
    print(csv.__file__, subprocess.run([sys.executable, "-m", "csv"]).returncode)
    print(subprocess.run([sys.executable, "-c", "import csv"]).returncode)
run_scenario(work)
"""
    uuv = Path(sys.executable).with_name("uuv")
    for command in (
        [sys.executable, "-P", "-c", program],
        [str(uuv), "list", "job"],
        [str(uuv), "run", "s.toml"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert "Traceback" not in done.stderr, done.stderr
        assert not (tmp_path / "executed").exists(), command
        if command[1] == "-P":
            assert done.stdout.splitlines()[-3].endswith("0 0 2 2")
            assert done.stdout.splitlines()[-2].endswith("csv.py 0")
            assert done.stdout.splitlines()[-1] == "0"


# -- studies ---------------------------------------------------------------------------------------


def study_in(folder: Path) -> Path:
    with RowLog.open(folder) as log:
        log.add([("a", {"x": 1.5}, {"wall_s": 0.1, "cpu_s": 0.1})])
    return folder


@pytest.mark.parametrize(
    ("about", "said"),
    [
        ("[]", r"study\.json: must be a table, got \[\] .*discard the rows by --anew"),
        ('{"code": ["a"]}', r"code: must be a table"),
        ('{"versions": {"numpy": 2}}', r"versions.numpy: must be text, got 2"),
        ("{", r"cannot be read"),
    ],
)
def test_a_damaged_study_is_one_line(about: str, said: str, tmp_path: Path):
    study_in(tmp_path)
    (tmp_path / "study.json").write_text(about)
    with pytest.raises(ConfigurationError, match=said), RowLog.open(tmp_path):
        pass


@pytest.mark.parametrize("others", [(), ("metrics.json", "report.html")])
def test_rows_without_what_they_depend_on(others: tuple[str, ...], tmp_path: Path):
    study_in(tmp_path)
    (tmp_path / "study.json").unlink()
    for name in others:
        (tmp_path / name).touch()
    with (
        pytest.raises(ConfigurationError, match=r"has rows, but study\.json is missing"),
        RowLog.open(tmp_path),
    ):
        pass
    with RowLog.open(tmp_path, anew=True) as log:
        assert not log.rows


def test_digests_are_not_taken_of_devices(tmp_path: Path):
    study_in(tmp_path)
    about = json.loads((tmp_path / "study.json").read_text())
    (tmp_path / "study.json").write_text(json.dumps({**about, "code": {"/dev/zero": "ab"}}))
    with (
        pytest.raises(ConfigurationError, match=r"runs of other code \(changed: /dev/zero"),
        RowLog.open(tmp_path),
    ):
        pass


def test_rows_do_not_go_where_a_link_leads(tmp_path: Path):
    study_in(tmp_path / "study")
    shutil.move(tmp_path / "study" / "rows", tmp_path / "outside")
    (tmp_path / "study" / "rows").symlink_to(tmp_path / "outside")
    before = (tmp_path / "outside" / "000000.parquet").read_bytes()
    with pytest.raises(ConfigurationError, match="got a link"):
        study_more(tmp_path / "study")
    assert (tmp_path / "outside" / "000000.parquet").read_bytes() == before


def study_more(folder: Path) -> None:
    with RowLog.open(folder) as log:
        log.add([("b", {"x": 2.5}, {"wall_s": 0.1, "cpu_s": 0.1})])


@pytest.mark.parametrize(("step", "fits"), [(5e-324, False), (1e-18, False), (1e-3, True)])
def test_a_step_that_no_value_is_a_multiple_of(step: float, fits: bool):
    distribution = {"uniform": [0.01, 0.05], "step": step}
    if fits:
        assert Distribution.of(distribution).at(np.array([0.3])) == pytest.approx(0.022)
        return
    with pytest.raises(
        ConfigurationError, match=r"step: must be larger than 1/9.*e\+15 of the largest value"
    ):
        Distribution.of(distribution)

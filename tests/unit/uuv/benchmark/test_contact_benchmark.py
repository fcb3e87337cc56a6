"""The contact benchmark: pinned cases, a door that no entry can break, scores that do not depend on
the door.
"""

import io
import json
import os
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bad_entries
from experiments.leaderboard.table import page, read_result
from untyped import untyped
from uuv.assembly import assemble
from uuv.benchmark import door
from uuv.benchmark.cases import CASES, FAMILIES, BenchmarkCase, cases, digest
from uuv.benchmark.door import EntryProcess
from uuv.benchmark.entries import ENTRIES, Entry
from uuv.benchmark.score import (
    DISC,
    ENTRY_SEED,
    KEPT,
    ScoredCase,
    ThrusterEnergy,
    behind_door,
    median,
    score,
    share,
)
from uuv.benchmark.wire import Briefing, CommandCodec, EntryError, EstimateCodec
from uuv.experiment import read_rows
from uuv.models.hydrodynamics import SEA_WATER
from uuv.runner import run
from uuv.scenario import Control
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ContactEstimate,
    GroundPlane,
    HullLoad,
    StateEstimate,
)
from uuv.sim.interfaces.spatial import exp_so3, pose

GROUND = GroundPlane(time=1.0, p_W=np.ones(3), normal_W=np.ones(3), scatter=0.0, beams=3, silent=())
DIGEST = "d090bbf90ede"  # of the 100 public cases


def run_behind_door(control, longest, *, estimator="", **limits):
    """A run of case 0 of so many simulated seconds [s] with an entry behind the door."""
    built = assemble(BenchmarkCase(index=0).scenario(Control()))
    model = built.own.model
    briefing = Briefing(
        model=model, water_error=0.0, control=control, estimator=estimator, task="barrel", seed=0
    )
    with EntryProcess(briefing, **limits) as process:
        return run(behind_door(built, process), longest=longest)


def test_the_public_cases_are_pinned():
    public = cases()
    assert len(public) == CASES
    assert digest(public) == DIGEST
    assert {case.family for case in public} == set(FAMILIES)
    assert digest(cases(5, seed=1)) != digest(cases(5))
    assert digest(cases(5)) == digest(public[:5])


@pytest.mark.parametrize(
    ("name", "said"),
    [
        pytest.param(
            "Dies",
            "ended with code 7: last words",
            marks=pytest.mark.long(
                guarded_by="tests/unit/uuv/benchmark/test_contact_benchmark.py::"
                "test_rows_of_a_changed_entry_are_refused_and_none_is_doubled"
            ),
        ),
        pytest.param("Hangs", "no reply of the entry for 0.5 s", marks=pytest.mark.long),
        pytest.param("Raises", "raised RuntimeError: out of ideas", marks=pytest.mark.long),
        pytest.param("WrongType", "must return a Command, got dict", marks=pytest.mark.long),
        pytest.param("WrongShape", "thrusters: expected shape", marks=pytest.mark.long),
        pytest.param("WrongTime", "command must be for the time", marks=pytest.mark.long),
    ],
)
def test_a_failure_of_the_entry_is_one_line(name, said):
    with pytest.raises(EntryError, match=said) as caught:
        run_behind_door(Control(controller=f"bad_entries:{name}"), 0.1, step_limit=0.5)
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_commands_that_are_no_numbers_stop_the_vehicle():
    ran = run_behind_door(Control(controller="bad_entries:NotANumber"), 1.0)
    assert ran.recording.final.abort is AbortCode.CONTROLLER


@pytest.mark.long
def test_an_unknown_entry_is_a_failed_case():
    with pytest.raises(ConfigurationError, match="no module 'nowhere'"):
        Entry.of("nowhere:Controller")
    entry = replace(Entry.of("default"), control=Control(controller="bad_entries:Nobody"))
    row = score(ScoredCase(case=BenchmarkCase(index=0), entry=entry))
    assert row["class"] == "entry failed"
    assert "Nobody" in row["detail"]


def test_every_first_entry_can_be_made():
    for name, control in ENTRIES.items():
        assert Entry.of(name).control == control


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="reads its memory by /proc")
@pytest.mark.parametrize("estimator", ["", "good_estimators:given"])
def test_the_truth_is_not_in_the_memory_of_the_entry(monkeypatch, tmp_path, rng, estimator):
    """The bytes of the object's true place are not found, nor random ones; those of limits that it
    was told are.
    """
    built = assemble(BenchmarkCase(index=0).scenario(Control()))
    limits = np.array(built.own.vehicle.torque_limits[:3], dtype=np.float64)
    true = np.array(untyped(built.placed).truth.X_WT[:3, 3], dtype=np.float64)
    sought = (true, rng.normal(size=3), limits)
    masked = np.stack(
        [np.frombuffer(array.tobytes(), dtype=np.uint8) ^ bad_entries.MASK for array in sought]
    )
    np.save(tmp_path / "patterns.npy", masked)
    monkeypatch.setattr(door, "_KEPT_GROUPS", (*door._KEPT_GROUPS, "BENCHMARK_TEST_"))
    monkeypatch.setenv(bad_entries.PATTERNS, str(tmp_path / "patterns.npy"))
    monkeypatch.setenv(bad_entries.FOUND, str(tmp_path / "found"))
    run_behind_door(Control(controller="bad_entries:SearchesItself"), 0.02, estimator=estimator)
    of_truth, of_nothing, of_told = map(int, (tmp_path / "found").read_text().split())
    assert of_nothing == 0
    assert of_truth == 0
    assert of_told > 0


@pytest.mark.long
def test_a_step_through_the_door_changes_no_bit():
    control = ENTRIES["default"]
    here = run(assemble(BenchmarkCase(index=0).scenario(control)), longest=1.0).recording
    behind = run_behind_door(control, 1.0).recording
    assert here.digest() == behind.digest()
    assert np.ptp(here["p_WB"].value, axis=0).max() > 1e-3  # the hull moves


@pytest.mark.long
def test_an_estimator_behind_the_door_changes_no_bit():
    control = ENTRIES["default"]
    here = run(assemble(BenchmarkCase(index=0).scenario(control)), longest=1.0).recording
    behind = run_behind_door(control, 1.0, estimator="good_estimators:given").recording
    other = run_behind_door(control, 1.0, estimator="good_estimators:RawEstimator").recording
    assert here.digest() == behind.digest()
    assert here.digest() != other.digest()  # the entry's estimates are those that are used


@pytest.mark.parametrize(
    ("name", "said"),
    [
        pytest.param(
            "EstimatesNothing", "must return a StateEstimate, got NoneType", marks=pytest.mark.long
        ),
        pytest.param("EstimatesOtherShape", "v_WB_B: expected shape", marks=pytest.mark.long),
        pytest.param(
            "EstimatesNoPose",
            "X_WB of the entry's estimate: expected a pose",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_failure_of_the_estimator_is_one_line(name, said):
    with pytest.raises(EntryError, match=said) as caught:
        run_behind_door(ENTRIES["default"], 0.1, estimator=f"bad_entries:{name}")
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_estimates_that_are_no_numbers_stop_the_vehicle():
    ran = run_behind_door(ENTRIES["default"], 1.0, estimator="bad_entries:EstimatesNotANumber")
    assert ran.recording.final.abort is AbortCode.ESTIMATE


def test_estimates_of_an_entry_cross_the_door_unchanged(rng):
    arrays = {name: rng.normal(size=3) for name in ("v_WB_B", "w_WB_B", "a_WB_B", "position_sigma")}
    arrays |= {name: rng.normal(size=6) for name in ("q", "qd", "tau")}
    sent = StateEstimate(
        time=rng.random(), X_WB=pose(exp_so3(rng.normal(size=3)), rng.normal(size=3)), **arrays
    )
    near, far = EstimateCodec(6), EstimateCodec(6)
    got = far.decode_reply(near.encode_reply(sent))
    for field in fields(StateEstimate):
        np.testing.assert_array_equal(getattr(sent, field.name), getattr(got, field.name))
    for reply in (near.encode(sent, None), b"", b"S", near.encode_reply(sent)[:-1]):
        with pytest.raises(EntryError, match="not an estimate"):
            far.decode_reply(reply)


def test_an_entry_with_an_estimator_is_another_entry():
    alone = Entry.of("default")
    both = Entry.of("default", "bad_entries:EstimatesNothing")
    assert both.name == "default with bad_entries:EstimatesNothing"
    assert both.control == alone.control
    assert both.source != alone.source
    with pytest.raises(ConfigurationError, match="--estimator: there is no module 'nowhere'"):
        Entry.of("default", "nowhere:Filter")
    with pytest.raises(ConfigurationError, match="expected MODULE:CLASS, got 'nowhere'"):
        Entry.of("default", "nowhere")


ENTRY = (
    "import {helper}\n\n\nclass Failing:\n    def __init__(self, model, *, water_error):\n    "
    "    {helper}.fail()\n"
)
HELPER = "def fail():\n    raise RuntimeError('out of {word}')\n"
DYING = "import os\n\n\ndef fail():\n    print('last words', flush=True)\n    os._exit(7)\n"


def test_rows_of_a_changed_entry_are_refused_and_none_is_doubled(verb, monkeypatch, tmp_path):
    """By the command: the file of its class changes, then one that this imports, then other options
    are given.
    """
    monkeypatch.syspath_prepend(str(tmp_path))
    entry, helper, out = (
        tmp_path / "failing_entry.py",
        tmp_path / "help_of_entry.py",
        tmp_path / "out",
    )
    entry.write_text(ENTRY.format(helper=helper.stem))
    helper.write_text(HELPER.format(word="ideas"))

    def scored(*more):
        words = (
            "--entry",
            f"{entry.stem}:Failing",
            "--cases",
            1,
            "--workers",
            1,
            "--out",
            out,
            *more,
        )
        return verb("benchmark", *words)

    output = scored().stdout
    assert "case   0, barrel: entry failed: the entry raised" in output
    assert "out of ideas" in " ".join(output.split())
    assert "1 of 1 runs are already done" in scored().stdout
    for changed, text in ((entry, "# mended\n"), (helper, "# mended\n")):
        before = changed.read_text()
        changed.write_text(before + text)
        refused = scored()
        assert refused.returncode == 2
        assert (
            f"(changed: {changed}); discard them by --anew, or give another --out" in refused.stderr
        )
        assert len(refused.stderr.splitlines()) == 1
        changed.write_text(before)
    monkeypatch.setattr(sys, "stdin", io.StringIO("7\n"))
    other = {
        f"--entry {entry.stem}:Failing": ("--entry", "default"),
        "cases of digest": ("--fresh",),
    }
    for held_kind, arguments in other.items():
        refused = scored(*arguments)
        assert refused.returncode == 2
        assert f"has runs of {held_kind}" in refused.stderr
        assert f", but runs of {held_kind.split(' ')[0]}" in refused.stderr
    helper.write_text(DYING)
    assert "ended with code 7: last words" in scored("--anew").stdout
    (row,) = read_rows(out)
    assert row["class"] == "entry failed"
    assert "ended with code 7: last words" in row["detail"]


SNOOPING = """
import os
from pathlib import Path


def read(path):
    try:
        return path.read_bytes()
    except OSError:
        return b""


class Snoops:
    period = 0.002

    def __init__(self, model, *, water_error):
        self.seen, self.parents = [], 0

    def init(self, estimate):
        return None

    def step(self, state, estimate, reference):
        return state, None

    def brief(self, briefing):
        parts = briefing.seed, briefing.task, briefing.control, briefing.estimator
        self.seen += [repr(parts).encode()]
        self.seen += [read(Path("/proc/self/cmdline")), repr(os.listdir(".")).encode()]
        self.seen += [b"own environment " + repr(dict(os.environ)).encode()]
        process, places = os.getpid(), [Path.cwd(), Path({out!r})]
        # Itself and the benchmark: what is above them is the tests' own.
        while process > 1 and self.parents < 2:
            home = Path("/proc", str(process))
            self.seen += [read(home / name) for name in ("cmdline", "environ", "comm")]
            opened = [file for file in home.glob("fd/*") if file.is_file() and not file.is_fifo()]
            self.seen += [read(file) for file in opened]
            process = int(read(home / "stat").rpartition(b")")[2].split()[1])
            self.parents += 1
        for place in places:
            self.seen += [read(file) for file in place.rglob("*") if file.is_file()]
        with open({log!r}, "ab") as log:
            log.write(b"%d parents, seed %d\\n" % (self.parents, briefing.seed))
            log.write(b"\\n".join(self.seen))
        raise RuntimeError("seen enough")
"""


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks into /proc")
def test_an_entry_finds_its_case_nowhere(root: Path, tmp_path: Path):
    """By the command, with a fresh case: arguments, environment, files and parents tell the seed to
    nobody.
    """
    seed = 8_414_709_848_078_965_066
    out = tmp_path / "out"
    log = tmp_path / "log"
    (tmp_path / "snooping_entry.py").write_text(SNOOPING.format(out=str(out), log=str(log)))
    command = [
        "-m",
        "uuv",
        "benchmark",
        "--fresh",
        "--entry",
        "snooping_entry:Snoops",
        "--cases",
        "1",
    ]
    paths = os.pathsep.join([str(tmp_path), str(root), str(root / "scripts")])
    done = subprocess.run(
        [sys.executable, *command, "--workers", "1", "--out", str(out)],
        input=f"{seed}\n",
        cwd=root,
        env={name: os.environ[name] for name in ("PATH", "HOME")}
        | {"PYTHONPATH": paths, "MARK_OF_THE_PARENT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "the entry raised RuntimeError: seen enough" in done.stdout, done.stdout + done.stderr
    logged = log.read_bytes()
    ((parents, briefed),) = re.findall(rb"(\d+) parents, seed (\d+)", logged)
    assert int(parents) == 2
    assert int(briefed) == ENTRY_SEED
    (environment,) = re.findall(rb"own environment (.*)", logged)
    assert b"MARK_OF_THE_PARENT" not in environment
    assert b'"versions"' in logged  # it did read the benchmark's files
    for secret in (str(seed).encode(), seed.to_bytes(8, "little"), f"{seed:x}".encode()):
        assert secret not in logged
    assert json.loads((out / "metrics.json").read_text())["benchmark"]["seed"] == seed


@pytest.mark.parametrize("text", ["x", "-3", "1.5", "9" * 30])
def test_a_seed_that_is_none_is_refused(text: str, verb, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    refused = verb("benchmark", "--fresh")
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: --fresh: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("[]", r"must be a table, got \[\]"),
        ('{"benchmark": 5, "rows": []}', r"benchmark: must be a table, got 5"),
        (
            '{"benchmark": {"version": 1}, "rows": []}',
            r"\[benchmark\]: seed, public, .* are "
            r"missing",
        ),
        ("[" * 9000 + "]" * 9000, "tables deep"),
    ],
)
def test_a_damaged_result_is_one_line(change: str, said: str, tmp_path: Path):
    (tmp_path / "metrics.json").write_text(change)
    with pytest.raises(ConfigurationError, match=said):
        read_result(tmp_path)


@pytest.mark.long
def test_one_case_again_gives_the_same_figures(verb, tmp_path):
    """With log and report; its figures are those of the row."""
    row = score(ScoredCase(case=BenchmarkCase(index=0), entry=Entry.of("joint PD")))
    done = verb("benchmark", "--entry", "joint PD", "--only", 0, "--out", tmp_path / "one")
    assert done.returncode == (0 if row["class"] == KEPT else 1)
    assert {"metrics.json", "report.html", "run.rrd"} <= {
        path.name for path in (tmp_path / "one").iterdir()
    }
    contact = json.loads((tmp_path / "one" / "metrics.json").read_text())["contact"]
    assert contact["force_error_rms_n"] == row["force_rms_n"]
    assert contact["force_error_max_n"] == row["force_peak_n"]


@pytest.mark.long
def test_scores_are_the_same_through_the_door():
    entry = Entry.of("default")
    here = score(ScoredCase(case=BenchmarkCase(index=0), entry=entry, in_process=True))
    rows = [score(ScoredCase(case=BenchmarkCase(index=0), entry=entry)) for _ in range(2)]
    assert here["class"] == KEPT
    for row in rows:
        assert {**row, "door": None} == here


def test_commands_cross_the_door_unchanged(rng):
    near, far = CommandCodec(6, 8), CommandCodec(6, 8)
    load = HullLoad(arm_wrench_B=rng.normal(size=6), current_W=rng.normal(size=3))
    loads = []
    for load_sent in (load, load, None, replace(load)):
        command = Command(
            time=rng.random(),
            joint_torque=rng.normal(size=6),
            thrusters=rng.normal(size=8),
            scan=True,
            contact=ContactEstimate(force_W=rng.normal(size=3), normal=np.nan),
            hull_load=load_sent,
        )
        got = far.decode(near.encode(command), command.time)
        np.testing.assert_array_equal(got.joint_torque, command.joint_torque)
        np.testing.assert_array_equal(got.thrusters, command.thrusters)
        np.testing.assert_array_equal(got.contact.force_W, command.contact.force_W)
        assert not got.contact.known
        loads.append(got.hull_load)
    assert loads[0] is loads[1]  # fault detection tells a new load by the object
    assert loads[2] is None
    assert loads[3] is not loads[0]
    np.testing.assert_array_equal(loads[0].arm_wrench_B, load.arm_wrench_B)


@pytest.mark.parametrize("rare", [{}, {"tau_doubt": np.ones(6)}, {"ground": GROUND}])
def test_estimates_cross_the_door_unchanged(rng, rare):
    arrays = {name: rng.normal(size=3) for name in ("v_WB_B", "w_WB_B", "a_WB_B", "position_sigma")}
    arrays |= {name: rng.normal(size=6) for name in ("q", "qd", "tau")} | {
        "X_WB": rng.normal(size=(4, 4))
    }
    sent = StateEstimate(
        time=rng.random(), vision_age=np.nan, dvl_age=np.inf, imu_age=rng.random(), **arrays, **rare
    )
    near, far = EstimateCodec(6), EstimateCodec(6)
    for reference_sent in (None, "set points", None):
        got, reference = far.decode(near.encode(sent, untyped(reference_sent)))
        assert reference == reference_sent
        for field in fields(StateEstimate):
            first, other = getattr(sent, field.name), getattr(got, field.name)
            if field.name == "ground":
                assert (first is None) == (other is None)
            else:
                np.testing.assert_array_equal(first, other)


@pytest.mark.parametrize("reply", [b"", b"C", b"C" + bytes(7), b"X" + bytes(8 * 33)])
def test_other_bytes_are_no_command(reply):
    with pytest.raises(EntryError, match="not a command"):
        CommandCodec(6, 8).decode(reply, 0.0)


def test_intervals():
    interval = share(10, 10)
    # closed form of Clopper and Pearson for all of n
    assert interval["low"] == pytest.approx(0.025**0.1)
    assert interval["high"] == 1.0
    assert median([]) is None
    median_interval = median([1.0, 2.0, 3.0, 4.0, 10.0])
    assert median_interval is not None
    assert median_interval["low"] <= median_interval["value"] == 3.0 <= median_interval["high"]


def test_results_of_other_cases_make_no_table():
    row = {"case": 0, "family": "barrel", "class": KEPT, "door": None}
    row |= dict.fromkeys(
        ("force_rms_n", "force_peak_n", "path_max_m", "excursion_max_m", "energy_j"), 1.0
    )
    about = {
        "version": 1,
        "seed": 1,
        "public": False,
        "cases": 1,
        "cases_digest": "a",
        "entry": "mine",
        "code": "c",
    }
    about["source"] = "0123456789abcdef" + "fedcba9876543210"  # of a controller and an estimator
    result_file = {"benchmark": about, "rows": [row]}
    assert "| mine | 100 (3 to 100) |" in page([result_file])  # by hand: the least share is 0.025
    assert "| 012345 fedcba | c |" in page([result_file])
    other = {**about, "entry": "other"}
    with pytest.raises(
        ConfigurationError,
        match="'mine' has cases of seed 1, 'other' has 2: score both with the same",
    ):
        page([result_file, {"benchmark": {**other, "seed": 2}, "rows": [row]}])
    with pytest.raises(
        ConfigurationError,
        match="number of cases 1, 'other' has 10: score both with the same --cases",
    ):
        page(
            [result_file, {"benchmark": {**other, "cases": 10, "cases_digest": "b"}, "rows": [row]}]
        )
    with pytest.raises(ConfigurationError, match="at least one"):
        page([])


def test_energy_of_thrusters_is_that_of_each_disc():
    """4 N ahead and 9 N astern for two samples: sum of |T|^1.5 is 8 + 27, over sqrt(2 rho A)."""
    counted = ThrusterEnergy(0.002)
    timestep = 0.002
    for tick in range(20):
        truth = SimpleNamespace(thrust=np.array([4.0, -9.0]))
        counted.observe(untyped(SimpleNamespace(tick=tick, truth=truth)))
    area = np.pi * DISC**2 / 4.0
    assert counted.energy == pytest.approx(35.0 / np.sqrt(2.0 * SEA_WATER * area) * 20 * timestep)

"""The contact study's own parts: what it draws, how it names what came of a run, and that no run
depends on another.
"""

import json
import signal
from dataclasses import replace
from functools import cache
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, ClassVar

import jsonschema
import numpy as np
import pytest

from uuv import assemble, jobs, models
from uuv import run as run_of
from uuv.models.vehicle import Vehicle
from uuv.perturbations.pad import Pad
from uuv.perturbations.sensing import WanderingVision
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.loop.recording import STATES, Event, Recording, Series
from uuv.sim.runs.command_line import Interrupted, RunOptions
from uuv.sim.runs.terminal import PlainConsole

DT = 0.002
SCHEMA = json.loads(
    (Path(__file__).resolve().parents[4] / "sim/schemas/study_contact.schema.json").read_text()
)


@pytest.fixture
def study() -> Any:
    return import_module("uuv.campaigns.contact_study")


@pytest.fixture
def told() -> Any:
    return import_module("experiments.contact.study_report")


# -- drawing ---------------------------------------------------------------------------------------


def task(study: Any, run: int, seed: int = 3, **other: Any) -> Any:
    return study.RunTask(
        **{"study": seed, "run": run, "path": "longitudinal", "ranges": study.Ranges(), **other}
    )


def test_a_run_depends_on_its_number_and_the_seed_alone(study):
    scenario, again = study.draw(task(study, 5)), study.draw(task(study, 5, without="fusion"))
    assert again.control.without == ("fusion",)
    assert replace(again, control=scenario.control) == scenario
    for other in (task(study, 6), task(study, 5, seed=4)):
        assert study.draw(other).perturbations != scenario.perturbations


def test_vision_wanders_only_where_it_is_asked_to_and_changes_no_other_draw(study):
    plain = study.draw(task(study, 3))
    wandering = study.draw(task(study, 3, ranges=study.Ranges(vision_wander=0.01)))
    assert wandering.perturbations == (*plain.perturbations, WanderingVision(sigma=0.01))
    assert replace(wandering, perturbations=plain.perturbations) == plain


def test_draws_fill_their_ranges_and_no_more(study):
    ranges = study.Ranges(elevation=(-10.0, 30.0), surface=0.02)
    drawn = [study.draw(task(study, run, ranges=ranges)) for run in range(300)]
    speed = np.array([np.linalg.norm(scenario.site.current) for scenario in drawn])
    rise = np.degrees(
        np.arcsin([one.site.current[2] / s for one, s in zip(drawn, speed, strict=True)])
    )
    varied = [study.varied(scenario) for scenario in drawn]
    columns = {
        "speed": (speed, ranges.current),
        "rise": (rise, ranges.elevation),
        "gust": (np.array([v["gust"] for v in varied]), ranges.gust),
        "delay": (np.array([v["vision_delay"] for v in varied]), ranges.vision_delay),
        "rate": (np.array([1.0 / v["vision_period"] for v in varied]), ranges.vision_rate),
        "noise": (np.array([v["vision_noise"] for v in varied]), ranges.vision_noise),
        "friction": (np.array([v["friction"] for v in varied]), ranges.friction),
        "stiffness": (np.log([v["stiffness"] for v in varied]), tuple(np.log(ranges.stiffness))),
        "surface": (np.array([v["surface_offset"] for v in varied]), (-0.02, 0.02)),
    }
    for name, (found, (low, high)) in columns.items():
        slack = 0.05 * (high - low)  # of periods, which are whole ticks
        assert low - slack <= found.min() < low + slack, name
        assert high - slack < found.max() <= high + slack, name
    for one in drawn:
        for time in (one.sensing.vision_period, one.sensing.vision_delay):
            assert abs(time / DT - round(time / DT)) < 1e-9


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"current": (0.4, 0.0)}, "rise"),
        ({"friction": (0.0, 0.5)}, "friction"),
        ({"gust": (0.0, float("nan"))}, "finite"),
        ({"water": -0.1}, "water"),
    ],
)
def test_ranges_that_cannot_be_are_refused(study, given, said):
    with pytest.raises(ConfigurationError, match=said):
        study.Ranges(**given)


def test_a_stiff_surface_costs_substeps_of_the_plant_and_no_steps_of_the_loop():
    scenario = replace(jobs.clean_barrel(quick=True), perturbations=(Pad(stiffness=3e5),))
    built = assemble(scenario)
    assert built.plant.timestep == pytest.approx(DT, rel=1e-12)
    assert built.plant.substeps > 4
    recording = run_of(built, longest=0.01).recording
    assert len(recording["contact_most"].time) == 5
    assert recording.timestep == built.plant.timestep
    assert recording.substeps == built.plant.substeps


# -- classes ---------------------------------------------------------------------------------------

GOOD = {
    "force_rms_n": 0.5,
    "force_peak_n": 3.0,
    "lost_s": 0.0,
    "cross_max_m": 0.001,
    "along_max_m": 0.002,
    "force_over_set": 1.1,
    "collision_s": 0.0,
    "simulated_s": 60.0,
}


def recording(
    states: list[WorkState],
    set_force: Any = 60.0,
    true: Any = 60.0,
    note: str = "",
    abort: AbortCode | None = None,
    **more: Any,
) -> Recording:
    """A run through `states`, a second in each; `more` are other series (N, k), or other values of
    these.
    """
    each = round(1.0 / DT)
    time = np.array(np.arange(len(states) * each) * DT, dtype=np.float64)
    columns = {
        "state": np.repeat([STATES.index(state) for state in states], each).astype(float),
        "set_force": np.broadcast_to(set_force, time.shape),
        "contact_normal": np.broadcast_to(true, time.shape),
        "contact_most": np.broadcast_to(true, time.shape),
        **more,
    }
    return Recording(
        timestep=DT,
        duration=len(time) * DT,
        vehicle=vehicle(),
        series=MappingProxyType(
            {
                name: Series(
                    time=time, value=np.array(v).reshape(len(time), -1), unit="", labels=()
                )
                for name, v in columns.items()
            }
        ),
        events=tuple(
            Event(time=float(i), state=state, note=note, abort=abort)
            for i, state in enumerate(states)
        ),
        targets=(),
        clouds=MappingProxyType({}),
    )


@cache
def vehicle() -> Vehicle:
    return Vehicle.of(models.load("uuv_puma").compile())


WORKED = [
    WorkState.CLOSE_IN,
    WorkState.APPROACH,
    WorkState.PRESS,
    WorkState.WORK,
    WorkState.RETREAT,
]


ABORTED = [*WORKED, WorkState.ABORT]
SCANNED = [WorkState.SCAN, WorkState.ABORT]


@pytest.mark.parametrize(
    ("states", "abort", "figures", "expected"),
    [
        ([*WORKED, WorkState.DONE], None, {}, ("kept", "")),
        ([*WORKED, WorkState.DONE], None, {"force_peak_n": 8.1}, ("missed", "force_peak_n")),
        ([*WORKED, WorkState.DONE], None, {"force_peak_n": 8.0}, ("kept", "")),
        (
            [*WORKED, WorkState.DONE],
            None,
            {"lost_s": 0.002, "along_max_m": None},
            ("missed", "along_max_m, lost_s"),
        ),
        (
            [*WORKED, WorkState.DONE],
            None,
            {"force_over_set": 1.6},
            ("damage", "force above 1.5 times the set one"),
        ),
        (
            [*WORKED, WorkState.DONE],
            None,
            {"collision_s": 0.01},
            ("damage", "the vehicle touched what it should not"),
        ),
        (
            [*WORKED, WorkState.DONE],
            None,
            {"force_rms_n": np.inf},
            ("diverged", "a figure is not finite"),
        ),
        (ABORTED, AbortCode.CONTACT_LOST, {}, ("broken off", "contact lost")),
        (ABORTED, AbortCode.FORCE_LIMIT, {}, ("broken off", "force limit")),
        (
            ABORTED,
            AbortCode.THRUSTER,
            {"force_over_set": 2.5},
            ("damage", "force above 1.5 times the set one"),
        ),
        ([*WORKED], None, {}, ("broken off", "not done in time")),
        ([*WORKED], AbortCode.VISION, {}, ("broken off", "vision lost")),
        (
            [WorkState.SETTLE, WorkState.ABORT],
            AbortCode.HULL_NOT_AT_REST,
            {},
            ("refused", "hull not at rest"),
        ),
        (SCANNED, AbortCode.OUT_OF_REACH, {}, ("refused", "out of reach")),
        (SCANNED, AbortCode.NOT_IDENTIFIED, {}, ("refused", "not identified")),
    ],
)
def test_what_came_of_a_run_has_a_class_and_a_kind(study, states, abort, figures, expected):
    """The kind is the code; words of the sentence beside it tell nothing."""
    note = "contact lost: out of reach, not identified"
    outcome = SimpleNamespace(recording=recording(states, note=note, abort=abort))
    found = study.classify(outcome, {**GOOD, **figures}, study.StudyBounds())
    assert (found["class"], found["kind"]) == expected
    assert found["class"] in study.CLASSES
    assert found["detail"] == note


def test_force_is_measured_against_what_is_set_then(study):
    """Before the work against the first set force, however little is asked for yet; at work against
    the present one.
    """
    states = [WorkState.APPROACH, WorkState.PRESS, WorkState.WORK, WorkState.WORK]
    wanted = np.repeat([0.0, 20.0, 60.0, 30.0], round(1.0 / DT))
    over = study.force_over_set(
        recording(states, wanted, np.repeat([30.0, 66.0, 63.0, 45.0], round(1.0 / DT))), 60.0
    )
    assert over == pytest.approx(1.5)
    over = study.force_over_set(
        recording(states, wanted, np.repeat([30.0, 96.0, 63.0, 45.0], round(1.0 / DT))), 60.0
    )
    assert over == pytest.approx(1.6)


def test_damage_is_of_the_largest_force_of_a_substep(study):
    most = np.repeat([30.0, 60.0, 60.0], round(1.0 / DT))
    most[700] = 84.0
    over = study.force_over_set(
        recording([WorkState.APPROACH, WorkState.PRESS, WorkState.WORK], contact_most=most), 60.0
    )
    assert over == pytest.approx(1.4)


def test_a_run_that_never_worked_misses_no_bound(study):
    for states, missed in ((SCANNED, []), (ABORTED, ["force_peak_n", "lost_s"])):
        outcome = SimpleNamespace(recording=recording(states, abort=AbortCode.NOT_IDENTIFIED))
        found = study.classify(
            outcome, {**GOOD, "force_peak_n": None, "lost_s": 0.1}, study.StudyBounds()
        )
        assert found["missed"] == missed


def test_the_hull_is_off_its_place_where_that_stands_still(study):
    """It travels for a second, 0.2 m behind; then it is 5 cm off while the arm unfolds, 0.3 m
    before and after.
    """
    each = round(1.0 / DT)
    reference = np.zeros((4 * each, 3))
    reference[: each + 1] = np.linspace([-1.0, 2.0, 0.0], [0.0, 0.0, 0.0], each + 1)
    off = np.repeat(
        [[0.0, 0.12, 0.16], [0.03, 0.0, -0.04], [0.0, 0.03, 0.04], [0.3, 0.0, 0.0]], each, axis=0
    )
    states = [WorkState.CLOSE_IN, WorkState.CLOSE_IN, WorkState.TARE, WorkState.WORK]
    run = recording(states, p_WB_reference=reference, p_WB=reference + off)
    assert study._unfolding(run) == pytest.approx(0.05)


# -- signals ---------------------------------------------------------------------------------------


def test_a_signal_ends_a_run_after_a_whole_step_and_a_second_one_at_once():
    stop = import_module("uuv.runner").SignalStop()
    stop.observe("first")
    assert stop.last is None
    stop.ask(signal.SIGTERM)
    with pytest.raises(Interrupted) as ended:
        stop.observe("second")
    assert (stop.last, ended.value.code) == ("second", 143)
    with pytest.raises(Interrupted) as at_once:
        stop.ask(signal.SIGINT)
    assert at_once.value.code == 130


def test_a_signal_after_the_run_costs_nothing_of_it(tmp_path, monkeypatch):
    """It comes while the run is judged: the figures are written all the same, and the exit code
    says so.
    """
    whole_run = import_module("uuv.command")

    class Judged:
        accepted, failed = True, ()
        metrics: ClassVar = {
            "run": {"simulated_s": 1.0},
            "timings": {"wall_s": 1.0, "real_time_factor": 1.0},
        }

        def made_by(self, _made_by: Any) -> Any:
            return self

        def started(self, _start: Any) -> Any:
            return self

        def write(self, file: Path) -> None:
            file.write_text("{}")

    def assessed(*_: Any) -> Judged:
        signal.raise_signal(signal.SIGTERM)
        return Judged()

    for name in ("rehearse", "run_through"):  # the run itself is not what this is about
        monkeypatch.setattr(
            whole_run, name, lambda *_, **__: SimpleNamespace(part_by_part="", slow_parts=())
        )
    monkeypatch.setattr(whole_run, "assessed", assessed)
    monkeypatch.setattr(whole_run, "results_table", lambda _: "")
    said = StringIO()
    monkeypatch.setattr(whole_run, "PlainConsole", lambda: PlainConsole(file=said))
    with pytest.raises(Interrupted) as ended:
        whole_run.command(
            jobs.clean_barrel(quick=True), RunOptions(record=False, out=tmp_path / "out"), 0.0
        )
    assert ended.value.code == 143
    assert {"metrics.json", "scenario.toml"} <= {file.name for file in (tmp_path / "out").iterdir()}
    assert "written to" in said.getvalue()


# -- figures ---------------------------------------------------------------------------------------


def row(run: int, without: str = "", **figures: Any) -> dict[str, Any]:
    return {
        "run": run,
        "without": without,
        "path": "longitudinal",
        "class": "kept",
        "kind": "",
        "missed": [],
        "varied": {"friction": 0.1 + 0.01 * run, "stiffness": 1e4},
        "figures": {**GOOD, **figures},
    }


def test_a_kept_run_is_also_judged_by_the_true_object(told, study):
    off = [0.0, 0.003, 0.0031, None]
    rows = [
        {**row(k), "figures": {**GOOD, "object_deviation_max_m": at}} for k, at in enumerate(off)
    ]
    rows.append({**row(4, object_deviation_max_m=0.0), "class": "missed"})
    metrics = told.summary(rows, study.StudyBounds(), {})
    assert (metrics["kept"], metrics["kept_on_object"]) == (4, 2)
    assert metrics["by_path"] == {"longitudinal": {"runs": 5, "kept": 4, "kept_on_object": 2}}


def test_distributions_count_a_run_without_a_figure_as_not_within(told, study):
    rows = [row(i, force_peak_n=float(i)) for i in range(10)]
    rows.append(row(10, force_peak_n=None))
    found = told.distributions(rows, study.StudyBounds())["force_peak_n"]
    assert (found["count"], found["median"], found["max"], found["bound"]) == (10, 4.5, 9.0, 8.0)
    assert found["share_within"] == pytest.approx(9 / 11)


def test_quantiles_of_a_figure(told, study):
    """101 runs of 0 to 10 N: quantiles fall on runs."""
    found = told.distributions(
        [row(i, force_peak_n=0.1 * i) for i in range(101)], study.StudyBounds()
    )["force_peak_n"]
    assert [found[name] for name in ("median", "p95", "p99", "max")] == pytest.approx(
        [5.0, 9.5, 9.9, 10.0]
    )
    assert found["share_within"] == pytest.approx(81 / 101)


def test_a_run_is_in_one_bin_of_its_promised_chance(told):
    """On a bound it is in the upper one, and a chance of 1 in the last."""
    rows = [
        row(i, promised_chance=chance) for i, chance in enumerate((0.95, 0.96, 0.98, 1.0, None))
    ]
    rows[1]["class"] = "missed"
    assert told.reliability(rows) == [
        {"least": 0.95, "most": 0.98, "runs": 2, "mean": pytest.approx(0.955), "kept": 1},
        {"least": 0.98, "most": 0.99, "runs": 1, "mean": 0.98, "kept": 1},
        {"least": 0.99, "most": 1.0, "runs": 1, "mean": 1.0, "kept": 1},
    ]


def test_factor_of_a_method_is_the_median_of_ratios_of_the_same_runs(told):
    rows = [row(i, force_rms_n=1.0 + i) for i in range(3)]
    rows += [
        row(i, "fusion", force_rms_n=factor * (1.0 + i))
        for i, factor in enumerate((2.0, 3.0, 10.0))
    ]
    rows.append(row(7, "fusion", force_rms_n=99.0))  # of no run with the method
    rows[3]["class"] = "broken off"
    (found,) = told.ablations(rows)
    assert (found["method"], found["figure"], found["pairs"]) == ("fusion", "force_rms_n", 3)
    assert found["factor"] == pytest.approx(3.0)
    assert found["kept_with"] == 3
    assert found["kept_without"] == 2


def test_drivers_are_found_where_there_are_some(told):
    rng = np.random.default_rng(1)
    rows = [row(i, force_rms_n=0.1 * i, force_peak_n=rng.uniform()) for i in range(40)]
    found = told.drivers(rows)
    assert found["force_rms_n"] == {"friction": pytest.approx(1.0)}
    assert abs(found["force_peak_n"]["friction"]) < 0.6


def test_metrics_keep_their_schema_and_the_report_is_one_page(study, tmp_path):
    rows = [row(i, force_rms_n=0.5 + 0.01 * i) for i in range(12)]
    rows[4] |= {"class": "broken off", "kind": "contact lost"}
    rows[5] |= {"class": "refused", "kind": "out of reach", "figures": {}}
    rows.append(row(0, "fusion", force_rms_n=3.0))
    found = import_module("experiments.contact.study_report").summarise(
        rows, study.StudyBounds(), {"seed": 0}
    )
    metrics = found.metrics
    jsonschema.validate(metrics, SCHEMA)
    assert metrics["kept"] == 10
    assert not metrics["accepted"]
    assert [group["class"] for group in metrics["outcomes"]] == ["kept", "broken off", "refused"]
    file = tmp_path / "report.html"
    found.write_page(file, "T & T", {}, "")
    page = file.read_text()
    assert page.count("<img") == 7
    assert metrics["sensitivity"]["responses"]["missed"]["parameters"][0]["name"] == "friction"
    assert "T &amp; T" in page
    assert 'src="http' not in page


def test_no_runs_that_worked_give_a_page_without_pictures(study, tmp_path):
    rows = [{**row(i), "class": "refused", "kind": "out of reach", "figures": {}} for i in range(3)]
    found = import_module("experiments.contact.study_report").summarise(
        rows, study.StudyBounds(), {}
    )
    jsonschema.validate(found.metrics, SCHEMA)
    file = tmp_path / "report.html"
    found.write_page(file, "T", {}, "")
    assert "<img" not in file.read_text()


# -- step response ---------------------------------------------------------------------------------


def test_step_figures_of_a_second_order_answer(within):
    """Overshoot exp(-pi z / sqrt(1 - z^2)); a first-order answer rises in T ln 9 and settles in T
    ln 20.
    """
    steps = import_module("experiments.contact.force_steps")
    t = np.maximum(steps.times(), 0.0)
    z, w = 0.5, 12.0
    damped = w * np.sqrt(1.0 - z * z)
    second = 1.0 - np.exp(-z * w * t) * (np.cos(damped * t) + z * w / damped * np.sin(damped * t))
    found = steps.figures(60.0 + 30.0 * second, 60.0, 90.0)
    within("overshoot", found["overshoot"] - np.exp(-np.pi * z / np.sqrt(1.0 - z * z)), 1e-3)
    first = steps.figures(60.0 + 30.0 * (1.0 - np.exp(-t / 0.1)), 60.0, 90.0)
    within("rise [s]", first["rise_s"] - 0.1 * np.log(9.0), 2.0 * steps.SAMPLE)
    within("settling [s]", first["settling_s"] - 0.1 * np.log(20.0), 2.0 * steps.SAMPLE)
    assert first["overshoot"] == 0.0


def test_steps_up_are_cut_out_of_a_run():
    steps = import_module("experiments.contact.force_steps")
    each = round(1.0 / DT)
    level = np.repeat([60.0, 60.0, 90.0, 90.0, 90.0, 60.0, 60.0, 60.0, 90.0, 90.0], each)
    ramp = np.clip(np.interp(np.arange(len(level)), np.arange(len(level)), level), 60.0, 90.0)
    run = recording([WorkState.WORK] * 10, ramp, ramp + 1.0)
    found = steps.steps_up(run, 60.0, 90.0)
    assert found["set"].shape == (1, len(steps.times()))  # the last is not seen to its end
    assert found["true"][0, 0] == 61.0
    assert found["true"][0, -1] == 91.0


def test_a_sea_refused_for_its_current_is_run_once_more_where_that_is_asked(study, monkeypatch):
    refused = {
        "class": study.REFUSED,
        "kind": AbortCode.CURRENT.value,
        "detail": "",
        "missed": [],
        "figures": {},
    }
    kept = {**refused, "class": study.KEPT, "kind": ""}

    def tried(scenario: Any, bounds: Any, drawn: Any) -> dict[str, Any]:
        del bounds, drawn
        return kept if np.isinf(scenario.task.promise.most_thrust) else refused

    monkeypatch.setattr(study, "_tried", tried)
    rows = [study.one_run(task(study, 1, anyway=anyway)) for anyway in (False, True)]
    assert [row["anyway"] for row in rows] == ["", study.KEPT]
    # it counts as refused all the same
    assert [row["class"] for row in rows] == [study.REFUSED] * 2

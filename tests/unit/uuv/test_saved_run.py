"""A saved run goes on with the bits of the run that never stopped, however often, and with failures
to come.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from uuv import SavedRun, Scenario, assemble, jobs, run, saved
from uuv.jobs import clean_object, clean_pile, insert_sampler, inspect_object, sample_seabed
from uuv.perturbations.loop import Failure, SensorFailure, ThrusterFailure
from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.perturbations.sensing import DriftingTorque
from uuv.perturbations.target import PushedObject
from uuv.runner import run_through
from uuv.scenario import Control
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import Recorder, Recording

EARLY = 6.0  # [s] of a short run, which begins to scan at 5.05 s
PAGE = Path(__file__).resolve().parents[4] / "docs" / "runs.md"


def bits(recording: Recording) -> str:
    """Digest of all series."""
    return recording.digest(recording.series)


def early(scenario: Scenario | SavedRun) -> Recording:
    """Recording of the first seconds."""
    if isinstance(scenario, SavedRun):
        return run(scenario, longest=EARLY).recording
    return run_through(assemble(scenario), longest=EARLY).recording


GUSTY = jobs.clean_barrel(quick=True, gust=0.05, sensor="survey")


@pytest.fixture(scope="module")
def looking() -> SavedRun:
    """The barrel, at the first step of the scan."""
    return saved(GUSTY, "scan", full=False)


@pytest.fixture(scope="module")
def sound(looking: SavedRun) -> str:
    """Bits of its first seconds, to which nothing happens."""
    return bits(early(looking))


@pytest.fixture(scope="module")
def as_documented() -> dict[str, Any]:
    """What the example of the page leaves."""
    (block,) = re.findall(r"```python\n([^`]*\bsaved\([^`]*)```", PAGE.read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    exec(block, names)
    return names


@pytest.mark.long(guarded_by="tests/unit/uuv/test_saved_run.py::test_what_has_begun_goes_on")
def test_the_example_goes_on_to_the_bits_of_the_whole_run(as_documented):
    """From the approach, and from the press that is saved on the way from there."""
    scenario, at_press = as_documented["scenario"], as_documented["at_press"]
    whole = run(scenario)
    for again in (as_documented["sound"], run(at_press)):
        assert bits(again.recording) == bits(whole.recording)
        assert again.recording.events == whole.recording.events
        assert again.assessment.metrics["run"] == whole.assessment.metrics["run"]
    assert as_documented["sound"].recording.final.state is WorkState.DONE
    assert as_documented["lost"].recording.final.state is WorkState.ABORT


ANOTHER_SENSOR = pytest.mark.long(
    guarded_by="tests/unit/uuv/test_saved_run.py::test_a_failure_to_come_acts_as_in_a_scenario_that_always_had_it"
)


@pytest.mark.parametrize(
    "failure",
    [
        ThrusterFailure(thruster="heave_front", stuck=True, state="scan"),
        pytest.param(
            SensorFailure(sensor="encoders", effect="frozen", field="q", index=1, state="scan"),
            marks=ANOTHER_SENSOR,
        ),
        SensorFailure(sensor="dvl", effect="frozen", field="v_WB_B", state="settle", after=5.2),
        pytest.param(
            SensorFailure(sensor="vision", effect="lost", at=5.3, duration=0.4),
            marks=ANOTHER_SENSOR,
        ),
    ],
    ids=["thruster", "encoders", "dvl", "vision"],
)
def test_a_failure_to_come_acts_as_in_a_scenario_that_always_had_it(
    looking: SavedRun, sound: str, failure: Failure
):
    """A thruster that sticks keeps a command, a frozen sensor a message, from before the run was
    saved.
    """
    whole = early(replace(GUSTY, perturbations=(failure,)))
    assert bits(early(looking.with_failures(failure))) == bits(whole)
    assert sound != bits(whole)


@pytest.mark.parametrize(
    "scenario",
    [
        replace(GUSTY, control=Control(without=("force-control",))),
        replace(
            GUSTY,
            perturbations=(
                DriftingTorque(),
                ThrusterFailure(thruster="sway", share=0.5, at=2.0),
                SensorFailure(
                    sensor="torque",
                    effect="offset",
                    field="tau",
                    value=3.0,
                    state="settle",
                    after=5.5,
                ),
                PushedObject(by=(0.1, 0.0, 0.0), state="scan", after=0.2),
            ),
        ),
    ],
    ids=["around a controller", "perturbed"],
)
def test_what_has_begun_goes_on(scenario: Scenario):
    assert bits(early(saved(scenario, "scan", full=False))) == bits(early(scenario))


def test_branches_do_not_see_each_other(looking: SavedRun, sound: str):
    lost = looking.with_failures(ThrusterFailure(thruster="sway", at=5.5))
    assert bits(early(lost)) != sound
    assert bits(early(looking)) == sound
    assert looking.scenario.perturbations == ()


@pytest.mark.parametrize(
    ("failure", "line"),
    [
        (
            ThrusterFailure(thruster="sway", at=1.0),
            r"ThrusterFailure would have begun at 1\.000 s, before scan was saved at",
        ),
        (
            ThrusterFailure(thruster="sway", state="settle", after=1.0),
            r"would have begun at 1\.000 s",
        ),
        (
            PushedObject(by=(0.1, 0.0, 0.0), at=50.0),
            "got PushedObject, which changes a run from its start",
        ),
        (DriftingTorque(), "got DriftingTorque, which changes a run from its start"),
    ],
)
def test_what_would_have_acted_is_refused(looking: SavedRun, failure: Any, line: str):
    with pytest.raises(ConfigurationError, match=line):
        looking.with_failures(failure)


@pytest.mark.parametrize(
    ("phase", "line"),
    [
        (
            "aproach",
            r"phase: must be one of settle, scan, .* of a run, got 'aproach' "
            r"\(did you mean approach\?\)",
        ),
        ("done", "phase: must be one of settle, .* of a run, got 'done'"),
        ("insert", "must be one of settle, scan, close-in, .* of this task, got 'insert'"),
    ],
)
def test_a_phase_that_there_is_not_is_refused(phase: str, line: str):
    with pytest.raises(ConfigurationError, match=line):
        saved(GUSTY, phase)


def test_a_phase_that_is_not_reached_is_an_error_that_says_where_the_run_ended():
    lost = SensorFailure(sensor="imu", effect="lost", at=0.5)
    with pytest.raises(
        ConfigurationError,
        match=r"phase: scan was not reached; the run ended at "
        r"\d+\.\d s in abort: ",
    ):
        saved(replace(GUSTY, perturbations=(lost,)), "scan")


def test_a_saved_run_goes_forward_only(looking: SavedRun):
    with pytest.raises(ConfigurationError, match=r"phase: must be later than scan, .*, got settle"):
        saved(looking, "settle")
    with pytest.raises(
        ConfigurationError,
        match=r"longest \[s\]: must be later than the saved run, which is at \d\.\d+ s, got 1",
    ):
        run(looking, longest=1.0)
    plant = assemble(GUSTY).plant
    with pytest.raises(ConfigurationError, match="`recorder` must be left out"):
        run(looking, recorder=Recorder(plant.model, timestep=plant.timestep))


class Counting:
    """Observer that keeps a number, and says so to nobody."""

    slow_ticks = ()

    def __init__(self) -> None:
        self.calls = 0

    def observe(self, moment: Any) -> None:
        self.calls += 1


class Counted(Perturbation):
    def on_loop(self, loop: Loop) -> Loop:
        return replace(loop, observers=(*loop.observers, Counting()))


def test_an_observer_that_cannot_be_saved_is_refused():
    with pytest.raises(
        ConfigurationError, match=r"observer Counting has a state, so it must have `save\(\)`"
    ):
        saved(replace(GUSTY, perturbations=(Counted(),)), "scan")


@pytest.mark.long(guarded_by="tests/unit/uuv/test_saved_run.py::test_what_has_begun_goes_on")
@pytest.mark.parametrize(
    ("scenario", "phase"),
    [
        (jobs.clean_barrel(quick=True, gust=0.05, seed=3), "approach"),
        (jobs.clean_barrel(quick=True, gust=0.05, seed=3), "work"),
        (clean_pile(quick=True), "close-in"),
        (clean_object(), "press"),
        (insert_sampler(), "insert"),
        (inspect_object(), "work"),
        (sample_seabed(work="core"), "withdraw"),
    ],
    ids=["barrel", "barrel at work", "pile", "object", "insertion", "inspection", "core"],
)
def test_every_job_goes_on_to_the_bits_of_the_whole_run(scenario: Scenario, phase: str):
    whole = run(scenario)
    start = saved(scenario, phase)
    for _ in range(2):
        again = run(start)
        assert bits(again.recording) == bits(whole.recording)
        assert again.assessment.accepted == whole.assessment.accepted


@pytest.mark.long(guarded_by="tests/unit/uuv/test_saved_run.py::test_what_has_begun_goes_on")
def test_a_thruster_lost_at_work_is_that_of_the_whole_run():
    lost = ThrusterFailure(thruster="heave_front", state="work", after=1.0)
    scenario = jobs.clean_barrel(quick=True, sensor="survey")
    whole = run(replace(scenario, perturbations=(lost,)))
    assert whole.recording.final.state is WorkState.ABORT
    start = saved(scenario, "press").with_failures(lost)
    assert bits(run(start).recording) == bits(whole.recording)

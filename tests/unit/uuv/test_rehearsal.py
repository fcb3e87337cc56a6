"""A rehearsal before a run: on an assembly that is thrown away, so that parts of one's own may hold
state.
"""

import json
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from untyped import untyped
from uuv.assembly import Assembly, assemble
from uuv.command import command
from uuv.jobs import clean_barrel
from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.runner import REHEARSAL, assessed, rehearse, run, run_through, to_rehearse
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions
from uuv.sim.sensors.proprioception import JointTorqueSensors
from uuv.site import Barrel, OpenWater

SECONDS = 0.4  # simulated


class WearingPlant:
    """Plant whose thrusters lose a little at every step: it counts them itself."""

    def __init__(self, plant: Any) -> None:
        self.plant = plant
        self.timestep = plant.timestep
        self.steps = 0

    def observe(self) -> Any:
        return self.plant.observe()

    def step(self, command: Any) -> None:
        self.steps += 1
        worn = np.exp(-0.01 * self.steps) * np.asarray(command.thrusters)
        self.plant.step(replace(command, thrusters=worn))


class DriftingSensor:
    """Sensor of joint torques with a drift that is its own, not in its state."""

    def __init__(self, sensor: JointTorqueSensors) -> None:
        self.sensor = sensor
        self.period = sensor.period
        self.delay = sensor.delay
        self.off = 0.0

    def init(self, rng: np.random.Generator) -> Any:
        return self.sensor.init(rng)

    def step(self, state: Any, truth: Any) -> Any:
        self.off += 0.01
        state, measured = self.sensor.step(state, truth)
        assert measured is not None
        return state, replace(measured, tau=measured.tau + self.off)


class Counting:
    """Observer that counts."""

    def __init__(self) -> None:
        self.seen = 0

    def observe(self, moment: Any) -> None:
        del moment
        self.seen += 1


@dataclass(frozen=True, kw_only=True)
class Worn(Perturbation):
    """Parts that hold state; `loops` are all that were made."""

    loops: ClassVar[list[Loop]] = []

    def on_loop(self, loop: Loop) -> Loop:
        sensors = [
            untyped(DriftingSensor(sensor)) if isinstance(sensor, JointTorqueSensors) else sensor
            for sensor in loop.parts.sensors
        ]
        worn = Loop(
            plant=WearingPlant(loop.plant),
            parts=replace(loop.parts, sensors=sensors),
            observers=(Counting(),),
        )
        self.loops.append(worn)
        return worn


@pytest.fixture
def worn(monkeypatch: pytest.MonkeyPatch) -> Scenario:
    monkeypatch.setattr(Worn, "loops", [])
    return replace(clean_barrel(quick=True), perturbations=(Worn(),))


def digest(scenario: Scenario) -> str:
    """Of the trajectory of a run without a rehearsal."""
    assembly = assemble(scenario)
    ran = run_through(assembly, longest=SECONDS)
    return assessed(assembly, ran).metrics["run"]["trajectory_sha256"]


def test_a_command_runs_as_without_its_rehearsal(worn: Scenario, tmp_path):
    """By the door of the command line: what holds state was stepped in the rehearsal, and is new
    for the run.
    """
    expected = digest(worn)
    assert digest(replace(worn, perturbations=())) != expected  # the state tells in the trajectory
    Worn.loops.clear()
    with pytest.raises(ConfigurationError, match="the work could not start"):
        command(worn, RunOptions(record=False, out=tmp_path / "out", longest=SECONDS), 0.0)
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["run"]["trajectory_sha256"] == expected

    rehearsed, ran = Worn.loops
    ticks = round(SECONDS / ran.plant.timestep)
    assert untyped(rehearsed.plant).steps == round(REHEARSAL / ran.plant.timestep)
    assert untyped(ran.plant).steps == untyped(ran.observers[0]).seen == ticks
    assert untyped(rehearsed.observers[0]).seen == 0


def test_what_a_door_adds_is_for_the_run_alone(worn: Scenario, tmp_path):
    changed: list[Assembly] = []
    counting = Counting()

    def noted(assembly: Assembly) -> Assembly:
        changed.append(replace(assembly))
        return changed[-1]

    def counted(assembly: Assembly) -> list[Counting]:
        assert assembly is changed[-1]
        return [counting]

    options = RunOptions(record=False, out=tmp_path / "out", longest=SECONDS)
    with pytest.raises(ConfigurationError, match="the work could not start"):
        command(worn, options, 0.0, changed=noted, observers_of=counted)
    assert len(changed) == 1
    ran = Worn.loops[-1]
    assert changed[0].loop.plant is ran.plant
    assert counting.seen == round(SECONDS / ran.plant.timestep)


def test_a_run_from_python_is_the_same(worn: Scenario):
    expected = digest(worn)
    rehearse(assemble(to_rehearse(worn)))
    done = run(assemble(worn), longest=SECONDS)
    assert done.assessment.metrics["run"]["trajectory_sha256"] == expected


def test_an_assembly_runs_once():
    assembly = assemble(clean_barrel(quick=True))
    run_through(assembly, longest=SECONDS)
    with pytest.raises(
        ConfigurationError,
        match=r"run: an assembly can be run only once, and this one is at 0.39\d s; assemble",
    ):
        run_through(assembly, longest=SECONDS)


def test_a_part_that_cannot_run_fails_in_the_rehearsal():
    class Broken(WearingPlant):
        def step(self, command: Any) -> None:
            raise ConfigurationError("broken")

    class Breaks(Perturbation):
        def on_loop(self, loop: Loop) -> Loop:
            return replace(loop, plant=Broken(loop.plant))

    with pytest.raises(ConfigurationError, match="broken"):
        rehearse(assemble(replace(clean_barrel(quick=True), perturbations=(Breaks(),))))


def test_growth_and_dents_are_not_drawn_for_a_rehearsal():
    scenario = clean_barrel(quick=True)
    fouled = replace(
        scenario, site=replace(scenario.site, object=Barrel(length=0.2, fouled=0.03, dented=0.01))
    )
    assert to_rehearse(fouled).site.object == Barrel(length=0.2)
    assert to_rehearse(fouled) == replace(
        fouled, site=replace(fouled.site, object=Barrel(length=0.2))
    )
    alone = replace(scenario, site=replace(scenario.site, object=OpenWater()))
    assert to_rehearse(alone) == alone

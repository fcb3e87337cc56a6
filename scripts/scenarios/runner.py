"""Runner: an assembled scenario to its end without any output, and its assessment."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenarios import first_start
from scenarios.assembly import Assembly, assemble
from scenarios.inputs import check_inputs
from scenarios.scenario import Scenario
from scenarios.tasks.task import RunResult
from scenarios.ticks.compiled_ticks import reason
from scenarios.ticks.ticks_around import ticks_for
from sim.evaluation.metrics import Assessment
from sim.loop.recording import Recorder, Recording
from sim.loop.rollout import Moment, Observer, rollout
from sim.runs.command_line import Interrupted
from sim.water.current import Current

REHEARSAL = 0.1  # [s] simulated; loads all compiled code


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """A run that has ended, and its assessment against the truth."""

    assembly: Assembly
    result: RunResult
    assessment: Assessment

    @property
    def scenario(self) -> Scenario:
        """Description of the run."""
        return self.assembly.scenario

    @property
    def recording(self) -> Recording:
        """Time series of the run."""
        return self.result.recording

    def _repr_html_(self) -> str:
        """Card for a notebook."""
        from sim.reporting.series_tables import card_of

        return card_of(self.assembly.placed.title, self.assessment)


def run(
    scenario: Scenario | Assembly,
    *,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    longest: float | None = None,
) -> Run:
    """Runs a scenario to its end without any output.

    Args:
        scenario: A description, recorded with all that a report needs; or what `assemble` made of one.
        recorder: Recorder of the run; None: a new one.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time; None: that of the task.

    Returns:
        Recording and assessment.

    Raises:
        UuvError: The scenario cannot be assembled, or the motion diverges.
    """
    if isinstance(scenario, Scenario):
        check_inputs(scenario)
    first_start.build()
    assembly = assemble(scenario, full=True) if isinstance(scenario, Scenario) else scenario
    result = run_through(assembly, recorder, observers, longest)
    return Run(assembly=assembly, result=result, assessment=assessed(assembly, result))


def assessed(assembly: Assembly, result: RunResult) -> Assessment:
    """Assessment of a run against the truth about its site."""
    return assembly.placed.assess(result, assembly.scenario.seed)


def rehearse(assembly: Assembly) -> None:
    """Runs the loop for REHEARSAL, to load all compiled code and let an invalid plug-in fail at once.

    The state of the parts is explicit, so only the plant is changed; `Assembly.restart` resets it.
    """
    plant, parts, rng = assembly.plant, assembly.parts, np.random.default_rng(assembly.scenario.seed)
    rollout(plant, parts, duration=REHEARSAL, rng=rng)
    if not reason(assembly.loop.plant, parts, ()):
        compiled = ticks_for(plant, parts, Recorder(plant.model, timestep=plant.timestep, full=False)).bind
        plant.reset(current=Current(assembly.scenario.site.current), X_WB=assembly.X_WB)  # no gust is drawn
        rollout(plant, parts, duration=REHEARSAL, rng=rng, compiled=compiled)


def run_through(
    assembly: Assembly,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    longest: float | None = None,
    stop: "SignalStop | None" = None,
    *,
    part_by_part: bool = False,
) -> RunResult:
    """Runs from the start without any output.

    Args:
        assembly: The assembled scenario.
        recorder: Recorder of the run; None: a new one.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time; None: that of the task.
        stop: Observer that ends the run on a signal; None: one that no signal reaches.
        part_by_part: Take every tick part by part, also where ticks can be compiled; slower, and the same to the bit.

    Returns:
        Recording, last moment and wall time.

    Raises:
        UuvError: The motion diverges, or the parts are incompatible.
        Interrupted: A second signal ended the run within a step.
    """
    plant, loop = assembly.plant, assembly.loop
    recorder = recorder or Recorder(plant.model, timestep=plant.timestep, full=assembly.full)
    assembly.restart()
    stop = stop or SignalStop()
    seen = [*loop.observers, *observers, stop]
    why = "asked for" if part_by_part else reason(loop.plant, loop.parts, seen)
    began = time.perf_counter()
    try:
        last = rollout(
            loop.plant,
            loop.parts,
            duration=assembly.placed.longest if longest is None else longest,
            rng=assembly.noise,
            observers=[recorder, *seen],
            compiled=None if why else ticks_for(plant, loop.parts, recorder).bind,
        )
    except Interrupted:
        if stop.last is None:
            raise
        last = stop.last
    by = stop.asked if stop.last is not None else None
    return RunResult(
        recording=recorder.recording(interrupted=by.signal.name if by else ""),
        last=last,
        wall_s=time.perf_counter() - began,
        part_by_part=why,
    )


class SignalStop:
    """Last of the observers: ends a run after a whole step once a signal has asked for it."""

    slow_ticks = (250,)  # half a second: a signal is noticed after a tenth of that in wall time

    def __init__(self) -> None:
        self.asked: Interrupted | None = None
        self.last: Moment | None = None  # moment at which the run was ended

    def ask(self, number: int, _frame: Any = None) -> None:
        """Signal handler: the first signal ends the run after the present step, a second one at once."""
        if self.asked is not None:
            raise Interrupted(number)
        self.asked = Interrupted(number)

    def observe(self, moment: Moment) -> None:
        """Raises Interrupted once a signal has asked for the end."""
        if self.asked is not None:
            self.last = moment
            raise self.asked

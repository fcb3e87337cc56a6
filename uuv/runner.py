"""Runner: an assembled scenario to its end without any output, and its assessment."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv import first_start
from uuv.assembly import Assembly, assemble
from uuv.inputs import check_inputs
from uuv.outcome import RunResult
from uuv.saved_run import SavedRun, check_observers, checked_phase, snapshot_of
from uuv.scenario import Scenario
from uuv.sim.evaluation.metrics import Assessment
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import readonly
from uuv.sim.loop.recording import Recorder, Recording
from uuv.sim.loop.rollout import Moment, Observer, Rollout, Stage, Ticks, rollout, run_on
from uuv.sim.runs.command_line import Interrupted
from uuv.ticks.compiled_ticks import CompiledTicks, reason

if TYPE_CHECKING:  # a run is made without the extra log
    from uuv.sim.reporting.run_plot import RunFigure

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

    def plot(self, *, whole: bool = False) -> "RunFigure":
        """Figure of force, path error, hull and phase over time, by Matplotlib.

        Args:
            whole: From the start of the run; else from the approach on.

        Raises:
            ConfigurationError: The run ended before there was anything to draw.
            MissingLibraryError: The extra log is not installed.
        """
        with wanted():
            from uuv.sim.reporting.run_plot import plot_of

        return plot_of(self.recording, whole=whole)

    def _repr_html_(self) -> str:
        """Card for a notebook."""
        from uuv.sim.reporting.series_tables import card_of

        return card_of(self.assembly.placed.title, self.assessment)


def run(
    scenario: Scenario | SavedRun | Assembly,
    *,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    longest: float | None = None,
) -> Run:
    """Runs a scenario to its end without any output.

    Args:
        scenario: A description, recorded with all that a report needs; a saved run, which goes on;
            or what `assemble` made of a description.
        recorder: Recorder of the run; None: a new one. A saved run has its own.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time, from the start of the run; None: that of the task.

    Returns:
        Recording and assessment.

    Raises:
        UuvError: The scenario cannot be assembled, or the motion diverges.
    """
    if isinstance(scenario, Scenario):
        check_inputs(scenario, longest)

    first_start.build()
    start = scenario if isinstance(scenario, SavedRun) else None
    if start is not None and recorder is not None:
        raise ConfigurationError(
            "run: a saved run goes on with its own recorder; leave `recorder` out"
        )

    assembly = scenario if isinstance(scenario, Assembly) else _assembled(scenario, full=True)
    ran = run_through(assembly, recorder, observers, longest, start=start)
    return Run(assembly=assembly, result=ran, assessment=assessed(assembly, ran))


def saved(scenario: Scenario | SavedRun, phase: str = "approach", *, full: bool = True) -> SavedRun:
    """Runs a scenario up to the first step of a phase, from which `run` continues, repeatedly.

    Args:
        scenario: A description, or a run that was saved in an earlier phase.
        phase: Of the task, such as "approach", "press" or "work".
        full: Record what the report needs; a saved run goes on as it began.

    Returns:
        The run up to there.

    Raises:
        UuvError: There is no such phase, the run ended before it, or as `run` does.
    """
    checked_phase(phase)
    if isinstance(scenario, Scenario):
        check_inputs(scenario)
    first_start.build()

    start = scenario if isinstance(scenario, SavedRun) else None
    assembly = _assembled(scenario, full=full)
    state = checked_phase(phase, assembly.parts.planner)
    check_observers(assembly.loop.observers)
    if start is not None:
        start.check_before(state)

    begun = _begin(assembly, start=start)
    last = run_on(
        begun.rollout,
        assembly.placed.longest,
        pause=lambda moment: moment.reference.state is state,
        compiled=begun.compiled,
    )

    if begun.rollout.stage is not Stage.COMMANDED:
        reference = last.reference
        time = float(last.truth.time)
        note = f": {reference.note}" if reference.note else ""
        raise ConfigurationError(
            f"phase: {phase} was not reached; the run ended at {time:.1f} s in "
            f"{reference.state}{note}"
        )

    return SavedRun(
        scenario=assembly.scenario,
        phase=state,
        time=float(last.truth.time),
        full=assembly.full,
        snapshot=snapshot_of(begun.rollout, begun.recorder, assembly.loop.observers),
        past=tuple(begun.recorder.references()),
    )


def _assembled(scenario: Scenario | SavedRun, *, full: bool) -> Assembly:
    """A description assembled; that of a saved run is recorded as that began."""
    if isinstance(scenario, SavedRun):
        return assemble(scenario.scenario, full=scenario.full)
    return assemble(scenario, full=full)


def assessed(assembly: Assembly, ran: RunResult) -> Assessment:
    """Assessment of a run against the truth about its site."""
    return assembly.placed.assess(ran, assembly.scenario.seed)


def to_rehearse(scenario: Scenario) -> Scenario:
    """The scenario for the rehearsal: its object is clean, for nothing touches it so soon."""
    site = scenario.site
    return replace(scenario, site=replace(site, object=site.object.clean()))


def rehearse(assembly: Assembly) -> None:
    """Runs the loop for REHEARSAL: loads all compiled code, and lets an invalid plug-in fail early.

    Args:
        assembly: Made of `to_rehearse` for this alone, and thrown away: its parts may hold state.
    """
    rng = np.random.default_rng(assembly.scenario.seed)
    plant, loop = assembly.plant, assembly.loop

    # Part by part, and compiled where that can be.
    rollout(loop.plant, loop.parts, duration=REHEARSAL, rng=rng)
    if not reason(loop.plant, loop.parts):
        recorder = Recorder(plant.model, timestep=plant.timestep, full=False)
        compiled = CompiledTicks(plant, recorder).bind
        plant.reset(current=assembly.current(), X_WB=assembly.X_WB)
        rollout(plant, loop.parts, duration=REHEARSAL, rng=rng, compiled=compiled)


def run_through(
    assembly: Assembly,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    longest: float | None = None,
    stop: "SignalStop | None" = None,
    *,
    part_by_part: bool = False,
    start: SavedRun | None = None,
) -> RunResult:
    """Runs without any output.

    Args:
        assembly: The assembled scenario.
        recorder: Recorder of the run; None: a new one.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time; None: that of the task.
        stop: Observer that ends the run on a signal; None: one that no signal reaches.
        part_by_part: Take every tick part by part, also where ticks can be compiled; slower, and
            the same to the bit.
        start: Saved run of the scenario, to go on from; None: from the start.

    Returns:
        Recording, last moment and wall time.

    Raises:
        UuvError: The motion diverges, or the parts are incompatible.
        Interrupted: A second signal ended the run within a step.
    """
    longest = assembly.placed.longest if longest is None else longest
    if start is not None and longest <= start.time:
        raise ConfigurationError(
            f"longest [s]: the saved run is at {start.time:.3f} s already, got {longest:g}"
        )

    stop = stop or SignalStop()
    began = time.perf_counter()
    begun = _begin(assembly, recorder, [*observers, stop], part_by_part=part_by_part, start=start)
    try:
        last = run_on(begun.rollout, longest, compiled=begun.compiled)
    except Interrupted:
        if stop.last is None:
            raise
        last = stop.last

    by = stop.asked if stop.last is not None else None
    recording = begun.recorder.recording(interrupted=by.signal.name if by else "")
    return RunResult(
        recording=replace(recording, supply=readonly(assembly.plant.supply.state)),
        last=last,
        wall_s=time.perf_counter() - began,
        part_by_part=begun.part_by_part,
        slow_parts=() if begun.ticks is None else begun.ticks.slow_parts,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Begun:
    """A run that is ready to go, or to go on."""

    rollout: Rollout
    recorder: Recorder
    ticks: CompiledTicks | None  # its compiled ticks
    part_by_part: str  # why it has none

    @property
    def compiled(self) -> Callable[[Rollout], Ticks] | None:
        """What binds the compiled ticks to the run."""
        return None if self.ticks is None else self.ticks.bind


def _begin(
    assembly: Assembly,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    *,
    part_by_part: bool = False,
    start: SavedRun | None = None,
) -> _Begun:
    """A run at its start, or where `start` stands; the arguments are those of `run_through`."""
    plant, loop = assembly.plant, assembly.loop
    recorder = recorder or Recorder(plant.model, timestep=plant.timestep, full=assembly.full)
    watching = [*loop.observers, *observers]
    why = "asked for" if part_by_part else reason(loop.plant, loop.parts)

    assembly.check_start()
    rollout = Rollout(loop.plant, loop.parts, assembly.noise, [recorder, *watching])
    if start is not None:
        start.resume(rollout, recorder, loop.observers)

    ticks = None if why else CompiledTicks(plant, recorder)
    return _Begun(rollout=rollout, recorder=recorder, ticks=ticks, part_by_part=why)


class SignalStop:
    """Last of the observers: ends a run after a whole step once a signal has asked for it."""

    slow_ticks = (250,)  # half a second: a signal is noticed after a tenth of that in wall time

    def __init__(self) -> None:
        self.asked: Interrupted | None = None
        self.last: Moment | None = None  # moment at which the run was ended

    def ask(self, number: int, _frame: Any = None) -> None:
        """Signal handler: the first signal ends the run after the step, a second one at once."""
        if self.asked is not None:
            raise Interrupted(number)
        self.asked = Interrupted(number)

    def observe(self, moment: Moment) -> None:
        """Raises Interrupted once a signal has asked for the end."""
        if self.asked is not None:
            self.last = moment
            raise self.asked

"""Runner: runs an assembled scenario to its end without any output, and assesses it."""

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
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import readonly
from uuv.sim.loop.recording import Recorder, Recording
from uuv.sim.loop.rollout import Moment, Observer, Rollout, Stage, Ticks, rollout, run_on
from uuv.sim.runs.command_line import Interrupted
from uuv.ticks.compiled_ticks import CompiledTicks, reason

if TYPE_CHECKING:  # a run is made without the extra log
    from uuv.sim.reporting.run_plot import RunFigure

REHEARSAL = 0.1  # [s] simulated time that loads all compiled code


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """A run that has ended, and its assessment by the true state."""

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
        """Summary for a notebook."""
        from uuv.sim.reporting.series_tables import card_of

        return card_of(self.assembly.placed.title, self.assessment)


def run(
    scenario: Scenario | SavedRun | Assembly,
    *,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    longest: float | None = None,
) -> Run:
    """Run a scenario to its end without any output.

    Args:
        scenario: A scenario, which is recorded with everything that a report needs; a saved run,
            which is continued; or a result of `assemble`.
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
            "run: `recorder` must be left out for a saved run, which has its own"
        )

    assembly = scenario if isinstance(scenario, Assembly) else _assembled(scenario, full=True)
    ran = run_through(assembly, recorder, observers, longest, start=start)
    return Run(assembly=assembly, result=ran, assessment=assessed(assembly, ran))


def saved(scenario: Scenario | SavedRun, phase: str = "approach", *, full: bool = True) -> SavedRun:
    """Run a scenario up to the first step of a phase, from which `run` can continue any number of
    times.

    Args:
        scenario: A scenario, or a run that was saved in an earlier phase.
        phase: Phase of the task, such as "approach", "press" or "work".
        full: Whether to record everything that the report needs; ignored for a saved run.

    Returns:
        The run up to that step.

    Raises:
        UuvError: There is no such phase, the run ended before it, or as for `run`.
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
    """The assembly of a scenario; a saved run is recorded in the same way as before."""
    if isinstance(scenario, SavedRun):
        return assemble(scenario.scenario, full=scenario.full)
    return assemble(scenario, full=full)


def assessed(assembly: Assembly, ran: RunResult) -> Assessment:
    """Assessment of a run by the truth about its site."""
    return assembly.placed.assess(ran, assembly.scenario.seed)


def to_rehearse(scenario: Scenario) -> Scenario:
    """The scenario for the rehearsal, with a clean object, since nothing touches it so early."""
    site = scenario.site
    return replace(scenario, site=replace(site, object=site.object.clean()))


def rehearse(assembly: Assembly) -> None:
    """Run the loop for REHEARSAL, which loads all compiled code and lets an invalid plug-in fail
    early.

    Args:
        assembly: Assembly of `to_rehearse`, not to be used afterwards, since its components may
            hold state.
    """
    rng = np.random.default_rng(assembly.scenario.seed)
    plant, loop = assembly.plant, assembly.loop

    # First in Python, then compiled if that is possible.
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
    """Run an assembly without any output.

    Args:
        assembly: The assembled scenario.
        recorder: Recorder of the run; None: a new one.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time; None: that of the task.
        stop: Observer that ends the run on a signal; None: signals do not end the run.
        part_by_part: Whether to run every tick in Python, even if ticks can be compiled; slower,
            with the same bits.
        start: Saved run of the scenario to continue from; None: from the start.

    Returns:
        Recording, last moment and wall time.

    Raises:
        UuvError: The motion diverges, or the components are incompatible.
        Interrupted: A second signal ended the run within a step.
    """
    longest = assembly.placed.longest if longest is None else longest
    if start is not None and longest <= start.time:
        raise ConfigurationError(
            f"longest [s]: must be later than the saved run, which is at {start.time:.3f} s, got "
            f"{longest:g}"
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
    """A run that is ready to start or to continue."""

    rollout: Rollout
    recorder: Recorder
    ticks: CompiledTicks | None  # the compiled ticks of the run
    part_by_part: str  # reason why there are none

    @property
    def compiled(self) -> Callable[[Rollout], Ticks] | None:
        """Function that binds the compiled ticks to the run."""
        return None if self.ticks is None else self.ticks.bind


def _begin(
    assembly: Assembly,
    recorder: Recorder | None = None,
    observers: Sequence[Observer] = (),
    *,
    part_by_part: bool = False,
    start: SavedRun | None = None,
) -> _Begun:
    """A run at its start or, if given, at `start`; the arguments are those of `run_through`."""
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
    """Last of the observers, which ends a run after a complete step once a signal has requested
    it.
    """

    slow_ticks = (250,)  # half a second: a signal is noticed after a tenth of this in wall time

    def __init__(self) -> None:
        self.asked: Interrupted | None = None
        self.last: Moment | None = None  # moment at which the run was ended

    def ask(self, number: int, _frame: Any = None) -> None:
        """Signal handler: the first signal ends the run after the step, a second one at once."""
        if self.asked is not None:
            raise Interrupted(number)
        self.asked = Interrupted(number)

    def observe(self, moment: Moment) -> None:
        """Raise Interrupted once a signal has requested the end."""
        if self.asked is not None:
            self.last = moment
            raise self.asked

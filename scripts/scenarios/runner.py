"""Run of an assembled scenario with its user output: rehearsal, visual log, progress, table, report."""

import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from controllers.tuning import table
from perception.target_finder import FinderState
from sim.evaluation.metrics import Assessment
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import WorkState
from sim.loop.recording import Recorder, Recording
from sim.loop.rollout import Moment, Observer, Parts, rollout
from sim.plant.plant import Plant
from sim.reporting.results_table import results_table
from sim.runs.command_line import Interrupted, ScenarioOptions, signals
from sim.runs.provenance import provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pictures = Iterable[tuple[str, str, "Figure"]]  # title, caption, figure
REHEARSAL = 0.1  # [s] simulated; loads all compiled code
REACTION_TICKS = 10  # loop steps between measurements of the arm's reaction wrench on the hull, for the report
LONGEST = 400.0  # [s] simulated, limit of a run
NOT_ACCEPTED = 1  # exit code


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedRun:
    """Plant and parts, to be run once: the random number generator is consumed."""

    seed: int
    plant: Plant
    parts: Parts
    loop: np.random.Generator  # draws the noise of the sensors
    restart: Callable[[], None]  # resets the plant to its start, gusts included


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """Recording, last moment and wall time of a run."""

    recording: Recording
    last: Moment
    wall_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """Evaluation of a run, and the figures of its report."""

    assess: Callable[[RunResult], Assessment]
    pictures: Callable[[RunResult], Pictures]  # figures of the report
    begun: tuple[WorkState, ...]  # the run must have been in one of these states, else it counts as refused


def rehearse(ready: PreparedRun) -> None:
    """Runs the loop for REHEARSAL, to load all compiled code and let an invalid plug-in fail at once.

    The state of the parts is explicit, so only the plant is changed; `PreparedRun.restart` resets it.
    """
    rollout(ready.plant, ready.parts, duration=REHEARSAL, rng=np.random.default_rng(ready.seed))


def run_through(
    ready: PreparedRun,
    recorder: Recorder,
    observers: Sequence[Observer] = (),
    longest: float = LONGEST,
    stop: "SignalStop | None" = None,
) -> RunResult:
    """Runs from the start without any output.

    Args:
        ready: Plant and parts.
        recorder: Recorder of the loop.
        observers: Further observers of the loop.
        longest: [s] limit of the simulated time.
        stop: Observer that ends the run on a signal; None: one that no signal reaches.

    Returns:
        Recording, last moment and wall time.

    Raises:
        UuvError: The motion diverges, or the parts are incompatible.
        Interrupted: A second signal ended the run within a step.
    """
    ready.restart()
    stop = stop or SignalStop()
    began = time.perf_counter()
    try:
        seen = [recorder, *observers, stop]
        last = rollout(ready.plant, ready.parts, duration=longest, rng=ready.loop, observers=seen)
    except Interrupted:
        if stop.last is None:
            raise
        last = stop.last
    by = stop.asked if stop.last is not None else None
    return RunResult(
        recording=recorder.recording(interrupted=by.signal.name if by else ""),
        last=last,
        wall_s=time.perf_counter() - began,
    )


def run_with_report(
    scenario: str,
    ready: PreparedRun,
    judging: Evaluation,
    title: str,
    options: ScenarioOptions,
    folder: Path,
    console: Console,
    started: float,
    story: Callable[[Recorder, Any], Observer] | None = None,
) -> int:
    """Runs with progress on screen, evaluates the run, and writes metrics, log and report to `folder`.

    Args:
        scenario: Name of the scenario.
        ready: Plant and parts.
        judging: Evaluation and figures.
        title: Title of log and report.
        options: Options of the scenario.
        folder: Folder of results.
        console: Terminal.
        started: [s] time.perf_counter() at the start of the command.
        story: Makes the observer that adds clouds to recording and log; None: `CloudRecorder`.

    Returns:
        The exit code.

    Raises:
        ConfigurationError: The work never began.
        Interrupted: A signal asked for the end; raised after all results are written. A second signal ends at once.
    """
    plant = ready.plant
    made_by = provenance(scenario, options, plant.model)  # before the run, which stores the current in the model
    recorder = Recorder(plant.model, timestep=plant.timestep, full=options.record)
    observers: list[Observer] = []
    rehearse(ready)
    log: Any = None
    try:
        if options.record or options.view:
            from sim.reporting.rerun_log import RerunLog

            log = RerunLog(folder / "run.rrd", plant.model, timestep=plant.timestep, title=title, view=options.view)
            observers.append(log)
        bar = progress(console)
        observers += [(story or CloudRecorder)(recorder, log), ProgressPrinter(bar, console)]
        console.print(f"[bold]{title}[/bold]  (ready in {time.perf_counter() - started:.1f} s)")
        stop = SignalStop()
        with signals(stop.ask):
            with bar:
                ran = run_through(ready, recorder, observers, stop=stop)
            assessment = judging.assess(ran).made_by(made_by)
            assessment.write(folder / "metrics.json")  # before the log, which is slow to close
            if log is not None:
                log.close()
            _say(assessment, console)
            if options.record:
                from sim.reporting.report import write_report

                write_report(
                    folder / "report.html",
                    ran.recording,
                    assessment,
                    title=title,
                    options=asdict(options),
                    pictures=judging.pictures(ran),
                    gains=table(*getattr(ready.parts.controller, "tunings", ())),
                )
            console.print(f"written to {folder}/", highlight=False)
    finally:
        if log is not None:
            log.close()
    if stop.asked is not None:
        raise stop.asked
    if not ran.recording.within(*judging.begun).any():
        raise ConfigurationError(
            f"the work could not begin: {ran.last.reference.note or f'not within {LONGEST:.0f} s'}"
        )
    return 0 if assessment.accepted else NOT_ACCEPTED


def _say(assessment: Assessment, console: Console) -> None:
    """Prints the table, the pace and the verdict."""
    console.print(results_table(assessment))
    simulated, timings = assessment.metrics["run"]["simulated_s"], assessment.metrics["timings"]
    console.print(
        f"{simulated:.0f} s simulated in {timings['wall_s']:.1f} s, {timings['real_time_factor']:.1f} times real time",
        highlight=False,
    )
    console.print(
        "[green]accepted[/green]" if assessment.accepted else "[red]not accepted[/red]: " + "; ".join(assessment.failed)
    )


def progress(console: Console) -> Progress:
    """Progress bar with the state of the work; disabled where the output is no terminal."""
    return Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        console=console,
        disable=not sys.stdout.isatty(),
    )


class SignalStop:
    """Last of the observers: ends a run after a whole step once a signal has asked for it."""

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


class CloudRecorder:
    """Observer that adds the clouds of each identification to recording and log."""

    def __init__(self, recorder: Recorder, log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        """Adds the clouds, in W, if the moment has an identification."""
        if moment.frame is None or not isinstance(moment.found, FinderState) or moment.found.last is None:
            return
        for name in ("cloud", "model_before", "model_after"):
            points_W = moment.found.in_world(getattr(moment.found.last, name))
            self._recorder.add_cloud(name, points_W)
            if self._log is not None:
                self._log.log_cloud(name, points_W, moment.truth.time)


class ProgressPrinter:
    """Observer that prints each state of the work and updates the progress bar."""

    def __init__(self, progress: Progress, console: Console) -> None:
        self._progress, self._console = progress, console
        self._bar = progress.add_task("", total=1.0, note="")
        self._state: WorkState | None = None

    def observe(self, moment: Moment) -> None:
        """Prints a new state; updates the bar every 250 steps."""
        reference, truth = moment.reference, moment.truth
        if reference.state is not self._state:
            self._state = reference.state
            note = f"  {reference.note}" if reference.note else ""
            self._console.print(f"{truth.time:7.1f} s  {reference.state}{note}", highlight=False)
        if moment.tick % 250 == 0:
            felt = moment.command.contact.normal
            said = f"{felt:5.1f} N felt" if reference.force and math.isfinite(felt) else ""
            self._progress.update(self._bar, description=str(reference.state), completed=reference.path_s, note=said)

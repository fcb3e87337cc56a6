"""A run with its user output: visual log, progress, table, report; results of an ended run."""

import math
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from uuv import first_start
from uuv.assembly import Assembly, assemble
from uuv.check.preflight import preflight
from uuv.controllers.tuning import table
from uuv.kinds import SURVEY, TRUST
from uuv.models.meshes import ray_casting
from uuv.outcome import RunResult
from uuv.pace import WallClock, check_pace
from uuv.runner import Run, SignalStop, assessed, rehearse, run_through, to_rehearse
from uuv.scenario import Scenario
from uuv.scenario_file import SCENARIO_FILE, as_dict, flat, names_of_code, write_scenario
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.extras import LOG, absent, to_install
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Moment, Observer
from uuv.sim.reporting.results_table import results_table
from uuv.sim.reporting.series_tables import write_series
from uuv.sim.runs.command_line import RunOptions, signals
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.run_folder import new_folder
from uuv.sim.runs.terminal import PlainConsole, verdict

if TYPE_CHECKING:
    from uuv.export.live_log import McapLog

NOT_ACCEPTED = 1  # exit code
_STILLS = 640, 360  # [px] width and height of the report's pictures of the scene


def command(
    scenario: Scenario,
    options: RunOptions,
    started: float,
    after: str = "",
    *,
    assembled: Callable[..., Assembly] = assemble,
    changed: Callable[[Assembly], Assembly] = lambda assembly: assembly,
    observers_of: Callable[[Assembly], Sequence[Observer]] = lambda _: (),
) -> int:
    """Runs a scenario with progress on screen, and writes its results to a new folder.

    Args:
        scenario: The description.
        options: Folder, recording and viewer.
        started: [s] time.perf_counter() at the start of the command.
        after: Appended to the title of log and report.
        assembled: Assembles the scenario, as `uuv.assembly.assemble` does: for the rehearsal, then
            for the run.
        changed: Returns the assembly to run instead of the usual one; not called for the rehearsal.
        observers_of: Returns more observers of the run; not called for the rehearsal.

    Returns:
        The exit code.

    Raises:
        UuvError: The work could not begin.
        Interrupted: A signal ended the run; raised after all results are written. A second signal
            ends the command at once.
    """
    check_pace(options.pace)
    console = PlainConsole()
    draws = _draws(options, console)

    sensing = scenario.sensing
    if scenario.task.looks and (sensing.sensor != SURVEY or sensing.arm_camera is not None):
        ray_casting.installed()  # a missing library is refused before anything is compiled

    compiled = first_start.build()
    # before the work: the folder may be unusable
    folder = new_folder(scenario.name, options.out, scenario.seed)

    refused = _rehearse(scenario, options, console, assembled)
    assembly = changed(assembled(scenario, full=options.record))
    plant, placed = assembly.plant, assembly.placed
    title, longest = placed.title + after, options.longest or placed.longest
    # Before the run, which stores the current in the model.
    made_by = provenance(scenario.name, as_dict(scenario), plant.model)

    recorder = Recorder(plant.model, timestep=plant.timestep, full=options.record)
    observers: list[Observer] = [*_paced(options), *observers_of(assembly)]
    start = first_start.noted(compiled)
    write_scenario(scenario, folder / SCENARIO_FILE)

    log: Any = None
    mcap = _mcap_log(options, folder, recorder, assembly)
    try:
        observers += mcap
        if draws or options.view:
            log = _rerun_log(options, folder / "run.rrd", assembly, title)
            observers.append(log)

        bar = progress(console)
        observers += [placed.story(recorder, log), ProgressPrinter(bar, console)]
        console.print(
            Text(title, style="bold"), f" (ready in {time.perf_counter() - started:.1f} s)"
        )

        # The run, and its results also after a first signal.
        stop = SignalStop()
        with signals(stop.ask):
            with bar:
                ran = run_through(assembly, recorder, observers, longest, stop=stop)

            _say_what_is_slow(ran, observers, console)
            assessment = assessed(assembly, ran).made_by(made_by).extended(start=asdict(start))
            if scenario.vehicle.unchecked:
                assessment = assessment.extended(unchecked=list(refused))
            assessment.write(folder / "metrics.json")  # before the log, which is slow to close
            if log is not None:
                log.close()
            for file in mcap:
                file.close(accepted=assessment.accepted)

            placed.write_files(folder)
            for summary_table in placed.tables():
                console.print(summary_table)
            _say(assessment, console)

            if options.record:
                write_series(ran.recording, folder)
            if draws:
                _report(Run(assembly=assembly, result=ran, assessment=assessment), folder, title)
            console.print(f"written to {folder}/", highlight=False)
    finally:
        for file in (*mcap, *([] if log is None else [log])):
            file.close()

    if stop.asked is not None:
        raise stop.asked

    _check_begun(ran, assembly, longest)
    return 0 if assessment.accepted else NOT_ACCEPTED


def _check_begun(ran: RunResult, assembly: Assembly, longest: float) -> None:
    """Refuse a run whose work did not begin within `longest` [s], and state the reason."""
    if ran.recording.within(*assembly.placed.begun).any():
        return

    why = ran.last.reference.note or f"it did not begin within {longest:.0f} s"
    met = f"; before that {ran.recording.collided}" if ran.recording.collided else ""
    vehicle = assembly.scenario.vehicle.vehicle
    raise ConfigurationError(f"the work could not start: {why}{met} (uuv check {vehicle})")


def _draws(options: RunOptions, console: Console) -> bool:
    """True if log and report are written; prints the libraries that are missing for them."""
    lacking = absent(LOG) if options.record else ()
    if lacking:
        series = ", series as .npz" if "pyarrow" in lacking else ""
        message = (
            f"no run.rrd and report.html{series}: {to_install(LOG)} ({', '.join(lacking)} missing)"
        )
        console.print(message, markup=False, highlight=False, soft_wrap=True)
    return options.record and not lacking


def _rehearse(
    scenario: Scenario, options: RunOptions, console: Console, assembled: Callable[..., Assembly]
) -> tuple[str, ...]:
    """Loads all compiled code by a separate assembly, since parts may hold state.

    Returns:
        Why the work would have been refused, of an unchecked run.
    """
    trial = assembled(to_rehearse(scenario), full=options.record)
    before = preflight(scenario, trial.own)
    start = (trial.refused,) if trial.refused else ()
    before = replace(before, refused=(*before.refused, *start))
    for line in filter(None, (trial.said, *before.lines)):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    rehearse(trial)
    return before.refused


def show(run: Run, folder: str | Path) -> None:
    """Prints the table of a run, and writes scenario, metrics, series and report to `folder`.

    The report is left out without a full recording, which `run(scenario)` makes, or without the
    extra LOG. The log run.rrd is not written, since it is made during a run.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_scenario(run.scenario, folder / SCENARIO_FILE)
    run.assessment.made_by(provenance(run.scenario.name, as_dict(run.scenario))).write(
        folder / "metrics.json"
    )

    _say(run.assessment, PlainConsole())
    write_series(run.recording, folder)
    if run.assembly.full and not absent(LOG):
        report_in(run, folder)


def report_in(run: Run, folder: Path) -> None:
    """Writes the report alone of a run in full to its folder; it needs the extra LOG."""
    _report(run, folder, run.assembly.placed.title)


def _report(run: Run, folder: Path, title: str) -> None:
    from uuv.sim.reporting.report import ReportedRun, write_report

    tables = as_dict(run.scenario)
    trust = f" {TRUST}" if any(names_of_code(tables)) else ""

    write_report(
        folder / "report.html",
        run.recording,
        run.assessment,
        run=ReportedRun(
            title=title,
            options=flat(tables),
            again=f"uuv replay {shlex.quote(str(folder))}{trust}",
            stills=_stills(run),
        ),
        pictures=run.assembly.placed.pictures(run.result),
        gains=table(*getattr(run.assembly.parts.controller, "tunings", ())),
        bounds=run.assembly.placed.bounds,
    )


def _stills(run: Run) -> list[tuple[str, bytes]]:
    """Scene of a run at four moments, by rays: captions and WebP files; none without the caster."""
    from uuv.sim.reporting.scene.clip import still
    from uuv.sim.reporting.scene.run_scene import PictureStyle, RunScene

    width, height = _STILLS
    style = PictureStyle(width=width, height=height, gl="off")
    style = style.judged_by(run.assembly.placed.bounds)
    try:
        with RunScene(run.assembly.plant.model, run.recording, style) as scene:
            return [
                (f"{scene.phase(time)}, {time:.1f} s", still(scene.picture(time), "webp"))
                for time in scene.moments()
            ]
    except MissingLibraryError:
        return []


def _rerun_log(options: RunOptions, file: Path, assembly: Assembly, title: str) -> Any:
    """The Rerun log, with its viewer if that was requested."""
    from uuv.sim.reporting.rerun_log import RerunLog

    return RerunLog(
        file,
        assembly.plant.model,
        timestep=assembly.plant.timestep,
        title=title,
        view=options.view,
        bounds=assembly.placed.bounds,
    )


def _mcap_log(
    options: RunOptions, folder: Path, recorder: Recorder, assembly: Assembly
) -> "list[McapLog]":
    """The MCAP log, if it was requested."""
    if options.log is None:
        return []
    from uuv.export.live_log import FILE, McapLog

    return [McapLog(folder / FILE, recorder, assembly.plant.model)]


def _paced(options: RunOptions) -> list[Observer]:
    """Observer that keeps the requested pace, if any."""
    return [] if options.pace is None else [WallClock(options.pace)]


def _say_what_is_slow(ran: RunResult, observers: Sequence[Observer], console: Console) -> None:
    """Print the lateness of a paced run, and the parts that ran in Python at every tick."""
    notes = [clock.summary() for clock in observers if isinstance(clock, WallClock)]
    if ran.part_by_part:
        notes.append(f"slower without compiled ticks: {ran.part_by_part}")
    if ran.slow_parts:
        parts = ", ".join(ran.slow_parts)
        notes.append(f"in Python at every tick (a compiled kernel is faster): {parts}")

    for note in notes:
        console.print(note, highlight=False)


def _say(assessment: Assessment, console: Console) -> None:
    """Prints the table, the pace and the verdict."""
    console.print(results_table(assessment))

    simulated = assessment.metrics["run"]["simulated_s"]
    timings = assessment.metrics["timings"]
    console.print(
        f"{simulated:.0f} s simulated in {timings['wall_s']:.1f} s, "
        f"{timings['real_time_factor']:.1f} times real time",
        highlight=False,
    )
    if refused := assessment.metrics.get("unchecked"):
        console.print(f"not checked; it would have been refused: {'; '.join(refused)}")
    console.print(verdict("; ".join(assessment.failed)))


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


class ProgressPrinter:
    """Observer that prints each state of the work and updates the progress bar."""

    slow_ticks = (250,)  # period of the progress bar in ticks

    def __init__(self, progress: Progress, console: Console) -> None:
        self._progress, self._console = progress, console
        self._bar = progress.add_task("", total=1.0, note="")
        self._state: WorkState | None = None
        self._note = ""

    def observe(self, moment: Moment) -> None:
        """Prints a new state; updates the bar every 250 steps."""
        reference = moment.reference
        truth = moment.truth
        if reference.state is not self._state:
            self._state = reference.state
            note = f"  {reference.note}" if reference.note not in ("", self._note) else ""
            self._note = reference.note
            self._console.print(
                f"{truth.time:7.1f} s  {reference.state}{note}", highlight=False, soft_wrap=True
            )

        if moment.tick % self.slow_ticks[0] == 0:
            felt = moment.command.contact.normal
            felt_text = (
                f"{felt:5.1f} N estimated" if reference.set_force and math.isfinite(felt) else ""
            )
            self._progress.update(
                self._bar,
                description=str(reference.state),
                completed=reference.path_s,
                note=felt_text,
            )

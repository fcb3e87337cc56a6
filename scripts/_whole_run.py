"""One run wired and ready, and all that a user sees of it: rehearsal, visual log, progress, table, report."""

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _job import LONGEST, NOT_ACCEPTED, REHEARSAL, Clouds, Teller
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from sim.metrics import Assessment
from sim.plant import Plant
from sim.recording import Recorder, Recording
from sim.results_table import results_table
from sim.rollout import Moment, Observer, Parts, rollout
from sim.startup import ScenarioOptions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ready:
    """Plant and parts, to be run once: the stream of random numbers runs on."""

    seed: int
    plant: Plant
    parts: Parts
    loop: np.random.Generator
    restart: Callable[[], None]  # the plant at its start again, the gusts undrawn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ran:
    """What was seen of a run."""

    recording: Recording
    last: Moment
    wall_s: float


def run(ready: Ready, recorder: Recorder, observers: Sequence[Observer] = ()) -> Ran:
    """Run to the end, without a word."""
    # A rehearsal loads all compiled code before the clock runs, and lets a bad plug-in fail at once.
    rollout(ready.plant, ready.parts, duration=REHEARSAL, rng=np.random.default_rng(ready.seed))
    ready.restart()
    began = time.perf_counter()
    last = rollout(ready.plant, ready.parts, duration=LONGEST, rng=ready.loop, observers=[recorder, *observers])
    return Ran(recording=recorder.recording(), last=last, wall_s=time.perf_counter() - began)


def run_shown(
    ready: Ready, title: str, options: ScenarioOptions, folder: Path, console: Console, started: float,
    story: Callable[[Recorder, Any], Observer] = Clouds,
) -> Ran:  # fmt: skip
    """Run to the end with a log in `folder`, if asked for, and progress on screen.

    `story` makes the observer that puts what was found into the recording and the log (None: there is none).
    """
    recorder = Recorder(ready.plant.model, full=options.record)
    observers: list[Observer] = []
    log: Any = None
    if options.record or options.view:
        from sim.rerun_log import RerunLog

        log = RerunLog(folder / "run.rrd", ready.plant.model, title=title, view=options.view)
        observers.append(log)
    bar = progress(console)
    observers += [story(recorder, log), Teller(bar, console)]
    console.print(f"[bold]{title}[/bold]  (ready in {time.perf_counter() - started:.1f} s)")
    try:
        with bar:
            return run(ready, recorder, observers)
    finally:
        if log is not None:
            log.close()


def write(
    assessment: Assessment, recording: Recording, title: str, options: ScenarioOptions, said: dict[str, Any],
    folder: Path, console: Console, pictures: Callable[[], Iterable[tuple[str, str, Figure]]],
) -> int:  # fmt: skip
    """metrics.json, the table, and the report with its `pictures`. Returns the exit code."""
    assessment.write(folder / "metrics.json")
    console.print(results_table(assessment))
    figures = assessment.metrics["run"]
    console.print(
        f"{figures['simulated_s']:.0f} s simulated in {figures['wall_s']:.1f} s, {figures['real_time_factor']:.1f} "
        "times real time",
        highlight=False,
    )
    console.print(
        "[green]accepted[/green]" if assessment.accepted else "[red]not accepted[/red]: " + "; ".join(assessment.failed)
    )
    if options.record:
        from sim.report import write_report

        write_report(
            folder / "report.html", recording, None, assessment, title=title, options=said, pictures=pictures()
        )
    console.print(f"written to {folder}/", highlight=False)
    return 0 if assessment.accepted else NOT_ACCEPTED


def progress(console: Console) -> Progress:
    """A bar with the state of the work, on a terminal."""
    return Progress(
        TextColumn("{task.description:<10}"), BarColumn(), TextColumn("{task.fields[note]}"), TimeElapsedColumn(),
        console=console, disable=not sys.stdout.isatty(),
    )  # fmt: skip

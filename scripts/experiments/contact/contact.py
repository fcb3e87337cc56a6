"""Study: contact work under model errors of sea, vehicle, sensors and surface, drawn for each run.

    # begins a study, or resumes an interrupted one
    ./uvw run scripts/experiments/contact/contact.py --runs 500

    # adds the same runs without each method
    ./uvw run scripts/experiments/contact/contact.py --runs 500 --ablate

    # that run alone, with log and report
    ./uvw run scripts/experiments/contact/contact.py --only 17

The draw of a run depends on --seed and its number only. Exit code 0: at least 99 % of the runs keep
contact and stay within 3 mm and 8 N after transients, and none damages or diverges.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time
from dataclasses import asdict, dataclass, field, replace
from functools import partial

from experiments.contact.study_report import METHODS, summarise
from uuv.campaigns.contact_study import (
    KEPT,
    PATHS,
    PathName,
    Ranges,
    RunTask,
    StudyBounds,
    crashed,
    draw,
    held_anyway,
    one_run,
)
from uuv.command import command
from uuv.controllers.planning.promise import StopLimits
from uuv.experiment import Row, Study, StudyOptions
from uuv.experiment.options import at_least
from uuv.sensors.arm_camera import ArmCameraSetup
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions

NAME = "study_contact"
RUNS, QUICK_RUNS = 500, 4  # number of runs by default, and with --quick


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Contact work under random conditions: distributions, failures, and ablation of each
    method.
    """

    runs: int | None = None
    """Number of runs; default 500, or 4 with --quick."""
    paths: tuple[PathName, ...] = PATHS
    """Paths that the runs take in turn."""
    ranges: Ranges = field(default_factory=Ranges)
    """Ranges of the random draw."""
    ablate: tuple[str, ...] | None = None
    """Also run without each method, or without those named."""
    ablate_runs: int = 100
    """Number of runs that are repeated without each method."""
    only: int | None = None
    """Do only the run of this number, with all its logs, in a folder of its own."""
    without: str = ""
    """With --only: method to leave out."""
    arm_camera: bool = False
    """A camera beside the tool tells navigation how the tool moves over the surface."""
    arm_camera_view: ArmCameraSetup = field(default_factory=ArmCameraSetup)
    """What that camera sees."""
    stop_every: float = 0.0
    """The pressed tool stops on its path after so many seconds of motion [s], for navigation; 0: it
    does not.
    """
    anyway: bool = False
    """Run a sea that is refused for its current once more without that refusal, and say what
    becomes of it; with --only: run it without that refusal.
    """
    quick: bool = False
    """Few and shorter jobs, for a first impression."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, ablate_runs=1, only=0)
        if not self.paths:
            raise ConfigurationError("--paths: at least one is needed")
        for method in (*(self.ablate or ()), *((self.without,) if self.without else ())):
            if method not in METHODS:
                raise ConfigurationError(f"method {method!r}: allowed {', '.join(METHODS)}")
        if self.without and self.only is None:
            raise ConfigurationError(
                "--without goes with --only; --ablate leaves methods out of many runs"
            )


def main() -> int:
    """Runs or resumes the study, or does a single run; returns the exit code."""
    options = parse(Options)
    if options.only is not None:
        return one_with_report(options, options.only)
    runs = options.runs if options.runs is not None else (QUICK_RUNS if options.quick else RUNS)
    methods = () if options.ablate is None else options.ablate or tuple(METHODS)
    tasks = [task_of(options, run) for run in range(runs)]
    tasks += [
        replace(task, without=method, anyway=False)
        for method in methods
        for task in tasks[: options.ablate_runs]
    ]
    settings = {
        "seed": options.seed,
        "paths": list(options.paths),
        "quick": options.quick,
        "ranges": asdict(options.ranges),
        "arm_camera": asdict(options.arm_camera_view) if options.arm_camera else None,
        "stop_every": options.stop_every,
        "anyway": options.anyway,
        "runs": runs,
    }
    study = Study(
        cases=tasks,
        run_one=one_run,
        summarise=partial(summarise, bounds=StudyBounds(), settings=settings),
        failed=crashed,
        line=line,
    )
    hydrodynamics.install()  # compiled once here, else by every worker
    return study.carry_out(NAME, options, f"Contact work in {runs} seas, seed {options.seed}")


def task_of(options: Options, run: int) -> RunTask:
    """The run of a number; the paths take turns."""
    path = options.paths[run % len(options.paths)]
    return RunTask(
        study=options.seed,
        run=run,
        path=path,
        without=options.without,
        ranges=options.ranges,
        quick=options.quick,
        arm_camera=options.arm_camera_view if options.arm_camera else None,
        stops=StopLimits(every=options.stop_every) if options.stop_every else None,
        anyway=options.anyway,
    )


def line(row: Row) -> str:
    """Line about a run that was not kept; empty for others and for ablations."""
    return (
        ""
        if row["class"] == KEPT or row["without"]
        else (f"run {row['run']:4d}  {row['class']}: {row['kind']}")
    )


def one_with_report(options: Options, run: int) -> int:
    """Repeats a single run as a scenario with all its output; returns the exit code."""
    task = task_of(options, run)
    scenario = held_anyway(draw(task)) if task.anyway else draw(task)
    name = f"run_{run:04d}" + (f"_without_{options.without}" if options.without else "")
    scenario, own = (
        replace(scenario, name=f"{NAME}/{name}"),
        RunOptions(out=options.out and options.out / name),
    )
    return command(scenario, own, time.perf_counter(), f", run {run} of study {options.seed}")


if __name__ == "__main__":
    run_scenario(main)

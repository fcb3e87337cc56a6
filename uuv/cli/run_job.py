"""Runs a job or a scenario file: `uuv run NAME`, `uuv run MODULE:FUNCTION`, `uuv run FILE.toml`."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from uuv import jobs
from uuv.cli.carry_out import Assignments, Output, run_printed, values_of
from uuv.cli.main import VERBS, present_spelling
from uuv.jobs.command_line import parsed
from uuv.kinds import SURVEY
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import RunOptions, as_base, parse

if TYPE_CHECKING:  # not needed for a help text
    from uuv.scenario import Scenario

TASK = "--task"
TARGET_POSE = "--target-pose"  # option of earlier versions


@dataclass(kw_only=True)
class EveryJob(Output):
    """Options of `uuv run` in addition to those of the job."""

    set: Assignments = ()
    """KEY=VALUE, repeatable: values by the keys of a scenario file, in its units, such as
    task.speed=0.03 or perturbations.MountedObject.stiffness=1e4."""
    task: str | None = None
    """MODULE:CLASS of your own task, with its defaults, in place of the job's task (`uuv new task
    NAME`)."""


@dataclass(kw_only=True)
class RunVerb(EveryJob):
    """Run a job or a scenario file; `uuv run NAME --help` lists the options of a job."""

    name: Annotated[
        Positional[str],
        arg(
            metavar="NAME",
            help=f"{', '.join(jobs.JOBS.names())}, a job of your own (MODULE:FUNCTION), or a "
            "scenario file (FILE.toml), such as scenario.toml in the folder of every run.",
        ),
    ]


@dataclass(kw_only=True)
class FileOptions(RunOptions):
    """Run a scenario from its file."""

    seed: int | None = None
    """Seed instead of that in the file."""
    trust: bool = False
    """Also run the code MODULE:ATTRIBUTE that the file names; code named on this command line
    needs no permission."""


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the job; returns the exit code."""
    del verb
    started = time.perf_counter()
    name, rest = (args[0], args[1:]) if args else ("", ())
    if name in ("", "-h", "--help"):
        parse(RunVerb, args)  # ends the command, with the help or an error
        return 0

    if name.endswith(".toml"):
        return _run_file(name, rest, started)
    if TARGET_POSE in args:
        raise ConfigurationError(f"{TARGET_POSE}: no longer an option; use --sensor {SURVEY}")

    if name.startswith("-"):
        raise ConfigurationError(f"{name}: the name of a job comes first: uuv run NAME [OPTIONS]")
    if name not in jobs.JOBS:
        raise ConfigurationError(_no_job(name))
    sys.argv[0] = f"uuv run {name}"  # shown in the help text
    return run(jobs.named(name), rest, started)


def run(job: jobs.Job, args: Sequence[str], started: float) -> int:
    """Runs a job with its options; returns the exit code.

    Args:
        job: The job.
        args: Its options, as typed.
        started: [s] time.perf_counter() at the start of the command.
    """
    # The typed options, and the scenario that they describe.
    task = _task_in(args)
    if task is None:
        values, options = parsed(job, args, EveryJob)
        scenario = job.scenario(values)
    else:  # fields of this task are options, instead of those of the job's task
        values, options = parsed(job, args, EveryJob, _with_task(job(), task))
        scenario = job.scenario(values, lambda base: _with_task(base, task))
    every = as_base(options, EveryJob)
    of_run = as_base(options, RunOptions)
    return run_printed(_with_set(scenario, every), of_run, every, started)


def _run_file(name: str, args: Sequence[str], started: float) -> int:
    """Runs a scenario from its file; returns the exit code."""
    from uuv.scenario_file import read_scenario

    options = parse(file_options(), args)
    of_file = as_base(options, FileOptions)
    every = as_base(options, EveryJob)
    scenario = read_scenario(name, trust=of_file.trust)
    scenario = scenario if of_file.seed is None else replace(scenario, seed=of_file.seed)
    scenario = scenario if every.task is None else _with_task(scenario, every.task)
    return run_printed(_with_set(scenario, every), of_file, every, started)


def file_options() -> type[Any]:
    """Class of all options of a scenario file."""
    names = " ".join(option.name for option in fields(EveryJob))
    about = {"__doc__": FileOptions.__doc__, "groups": {"run": names}}
    bases = (EveryJob, FileOptions)
    return make_dataclass("FileCommandLine", [], bases=bases, namespace=about, kw_only=True)


def _task_in(args: Sequence[str]) -> str | None:
    """Value of --task, which is needed before the other options are known."""
    for option, name in pairwise([*args, ""]):
        if option == TASK and not name.startswith("--"):
            return name or None
        if option.startswith(f"{TASK}="):
            return option.partition("=")[2]
    return None


def _with_task(scenario: "Scenario", task: str) -> "Scenario":
    """The scenario with the task MODULE:CLASS; it gets the name of the module."""
    from uuv.scenario_file import with_values

    module = task.partition(":")[0]
    name = module.rpartition(".")[2]
    return with_values(scenario, [f'task.kind="{task}"', f'name="{name}"'], TASK)


def _with_set(scenario: "Scenario", every: EveryJob) -> "Scenario":
    """The scenario with the values of --set."""
    if not every.set:
        return scenario
    from uuv.scenario_file import with_values

    return with_values(scenario, values_of(every.set), "--set")


def _no_job(name: str) -> str:
    """Message on an unknown job; it names the verb if the name is one, or was a command."""
    verb = name if name in VERBS else present_spelling(name)
    if verb and verb != "run":
        return f"{name} is not a job but a verb: `uuv {verb}`"
    known = jobs.JOBS.names()
    meant = did_you_mean(name, known)
    return f"no job {name!r}; there are {', '.join(known)}, or a scenario file (.toml){meant}"

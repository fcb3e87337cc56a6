"""A job or a scenario file: `uuv run NAME [OPTIONS]`, `uuv run FILE.toml [OPTIONS]`."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from tyro.conf import Positional, arg

from uuv import jobs
from uuv.catalogue import JOBS
from uuv.cli.carry_out import Assignments, Output, run_printed, values_of
from uuv.cli.main import VERBS, present_spelling
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import RunOptions, as_base, parse

if TYPE_CHECKING:  # a help text does without
    from uuv.scenario import Scenario

TASK = "--task"
Options = TypeVar("Options")


@dataclass(kw_only=True)
class EveryJob(Output):
    """Options of `uuv run` beside those of the job."""

    set: Assignments = ()
    """KEY=VALUE, repeatable: values by the keys of a scenario file, in its units, such as
    task.speed=0.03 or perturbations.MountedObject.stiffness=1e4."""
    task: str | None = None
    """MODULE:CLASS of a task of one's own, with its defaults, in place of the job's (`uuv new
    task NAME`)."""


@dataclass(kw_only=True)
class RunVerb(EveryJob):
    """Run a job or a scenario file; `uuv run NAME --help` lists the options of a job."""

    name: Annotated[
        Positional[str],
        arg(
            metavar="NAME",
            help=f"{', '.join(JOBS)}, or a scenario, FILE.toml, such as the scenario.toml in the folder of every run.",
        ),
    ]


@dataclass(kw_only=True)
class FileOptions(RunOptions):
    """Run a scenario from its file."""

    seed: int | None = None
    """Seed instead of that in the file."""
    trust: bool = False
    """Run the code, MODULE:ATTRIBUTE, that the file names too; what is typed here needs no
    leave."""


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the job; returns the exit code."""
    del verb
    started = time.perf_counter()
    name, rest = (args[0], args[1:]) if args else ("", ())
    if name in JOBS:
        options, of_run = parsed(job_options(name), rest)
        scenario = options.scenario()
    elif name.endswith(".toml"):
        options, of_run = parsed(FileOptions, rest)
        scenario = _of_file(name, options)
    elif name in ("", "-h", "--help"):
        parse(RunVerb, args)  # ends the command, by the help or the refusal
        return 0
    elif name.startswith("-"):
        raise ConfigurationError(f"{name}: the name of a job comes first: uuv run NAME [OPTIONS]")
    else:
        raise ConfigurationError(_no_job(name))

    changed = [(_of_task(of_run.task), TASK)] if of_run.task is not None else []
    changed += [(values_of(of_run.set), "--set")] if of_run.set else []
    if changed:
        from uuv.scenario_file import with_values

        for values, option in changed:
            scenario = with_values(scenario, values, option)
    return run_printed(scenario, options, of_run, started)


def job_options(job: str) -> type[Any]:
    """Class of the options of a job."""
    return getattr(jobs, JOBS[job])


def with_those_of_run(kind: type[Options]) -> type[Any]:
    """Class of the options of `kind` and those of every job, with the docstring of `kind`."""
    names = " ".join(option.name for option in fields(EveryJob))
    about = {"__doc__": kind.__doc__, "groups": {"run": names}}
    return make_dataclass(kind.__name__, [], bases=(EveryJob, kind), namespace=about, kw_only=True)


def parsed(kind: type[Options], args: Sequence[str]) -> tuple[Options, EveryJob]:
    """Options of `kind`, and those of every job beside them."""
    both = parse(with_those_of_run(kind), args)
    return as_base(both, kind), as_base(both, EveryJob)


def _of_file(name: str, options: FileOptions) -> "Scenario":
    from uuv.scenario_file import read_scenario

    scenario = read_scenario(name, trust=options.trust)
    return scenario if options.seed is None else replace(scenario, seed=options.seed)


def _of_task(task: str) -> list[str]:
    """Assignments that put in the task MODULE:CLASS; the scenario gets the name of the module."""
    module = task.partition(":")[0]
    return [f'task.kind="{task}"', f'name="{module.rpartition(".")[2]}"']


def _no_job(name: str) -> str:
    """Why there is no job of that name; one that is a verb, or was a command, is told as such."""
    verb = name if name in VERBS else present_spelling(name)
    if verb and verb != "run":
        return f"{name} is no job, but a verb of its own: `uuv {verb}`"
    return f"no job {name!r}; there are {', '.join(JOBS)}, or a scenario file (.toml){did_you_mean(name, JOBS)}"

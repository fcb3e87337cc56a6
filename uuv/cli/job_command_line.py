"""Command line of a job: its keyword arguments as options, beside those of every run."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, make_dataclass
from typing import TYPE_CHECKING, Any

from uuv.cli.carry_out import Assignments, Output, TrialOptions
from uuv.jobs.job import Job, JobOption
from uuv.sim.runs.command_line import RunOptions, parse

if TYPE_CHECKING:  # a help text does without
    from uuv.scenario import Scenario


@dataclass(kw_only=True)
class EveryJob(Output):
    """Options of `uuv run` beside those of the job."""

    set: Assignments = ()
    """KEY=VALUE, repeatable: values by the keys of a scenario file, in its units, such as
    task.speed=0.03 or perturbations.MountedObject.stiffness=1e4."""
    task: str | None = None
    """MODULE:CLASS of a task of one's own, with its defaults, in place of the job's (`uuv new
    task NAME`)."""


def run_options(job: Job) -> type[RunOptions]:
    """Class of the options of a run of the job that change no figure."""
    return TrialOptions if job.trials else RunOptions


def options_class(job: Job, beside: type[Any] = EveryJob, base: "Scenario | None" = None) -> type[Any]:
    """Dataclass of all options of a job, for `uuv.start.parse`.

    Args:
        job: The job.
        beside: Class of the command's options beside those of job and run.
        base: Its scenario, where a task of the user's own changes which options there are.
    """
    options = job.options(base)
    of_run = run_options(job)
    taken = {each for kind in (beside, of_run) for each in kind.__dataclass_fields__}
    listed = [each for word, each in options.items() if word not in taken]
    members = [(each.word, each.hint, field(default=each.default)) for each in listed]
    namespace = {
        "__doc__": job.description,
        "groups": _groups(listed) | {"run": " ".join(beside.__dataclass_fields__)},
        "keys": {each.word: each.key for each in listed if each.key},
        "abouts": {each.word: each.about for each in listed},
    }
    return make_dataclass("JobCommandLine", members, bases=(beside, of_run), namespace=namespace, kw_only=True)


def parsed(
    job: Job, args: Sequence[str], beside: type[Any] = EveryJob, base: "Scenario | None" = None
) -> tuple[dict[str, Any], Any]:
    """What a command line asks of a job; the arguments are those of `options_class`.

    Returns:
        Arguments of the job that were typed, by keyword; and all options, defaults included.
    """
    options = parse(options_class(job, beside, base), args)
    words = typed(args)
    return {word: getattr(options, word) for word in job.options(base) if word in words}, options


def typed(args: Iterable[str]) -> frozenset[str]:
    """Names of the options on a command line; what has a default is there only if it was typed."""
    names = {arg[2:].partition("=")[0].replace("-", "_") for arg in args if arg.startswith("--")}
    return frozenset(names | {name.removeprefix("no_") for name in names})


def _groups(options: Iterable[JobOption]) -> dict[str, str]:
    """Names of the options by the title of their group."""
    groups: dict[str, list[str]] = {}
    for each in options:
        groups.setdefault(each.group, []).append(each.word)
    return {title: " ".join(words) for title, words in groups.items()}

"""Command line of a job: its keyword arguments as options, in addition to those of every run."""

from collections.abc import Iterable, Sequence
from dataclasses import field, fields, make_dataclass
from typing import TYPE_CHECKING, Any

from uuv.jobs.job import Job, JobOption
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions, parse

if TYPE_CHECKING:  # not needed for a help text
    from uuv.scenario import Scenario


def options_class(
    job: Job,
    beside: type[Any] = RunOptions,  # options of the command
    base: "Scenario | None" = None,
) -> type[Any]:
    """Dataclass of all options of a job, for `uuv.start.parse`.

    Args:
        job: The job.
        beside: Class of the command's options in addition to those of job and run.
        base: Scenario of the job, if a user's task changes which options there are.

    Raises:
        ConfigurationError: An option of the job has the same name as one of every run.
    """
    bases = (RunOptions,) if issubclass(RunOptions, beside) else (beside, RunOptions)
    options = list(job.options(base).values())

    # A word with two meanings would be read as one of them.
    taken = {option.name for kind in bases for option in fields(kind)}
    for option in options:
        if option.word in taken:
            rule = "is also an option of every run; rename the job's option"
            raise ConfigurationError(f"job {job.name}: {option.key or option.word} {rule}")

    # Titles of groups, keys of a scenario file and texts, as `parse` reads them.
    titles = _groups(options)
    if beside is not RunOptions:
        titles["run"] = " ".join(option.name for option in fields(beside))
    namespace = {
        "__doc__": job.description,
        "groups": titles,
        "keys": {option.word: option.key for option in options if option.key},
        "abouts": {option.word: option.about for option in options},
    }
    members = [(option.word, option.hint, field(default=option.default)) for option in options]
    return make_dataclass("JobCommandLine", members, bases=bases, namespace=namespace, kw_only=True)


def parsed(
    job: Job, args: Sequence[str], beside: type[Any] = RunOptions, base: "Scenario | None" = None
) -> tuple[dict[str, Any], Any]:
    """Values that a command line gives to a job; the arguments are those of `options_class`.

    Returns:
        Arguments of the job that were typed, by keyword; and all options, defaults included.
    """
    options = parse(options_class(job, beside, base), args)

    words = typed(args)
    values = {word: getattr(options, word) for word in job.options(base) if word in words}
    return values, options


def typed(args: Iterable[str]) -> frozenset[str]:
    """Names of the options that were typed on a command line; all others have defaults."""
    words = {arg[2:].partition("=")[0] for arg in args if arg.startswith("--")}
    names = {word.replace("-", "_") for word in words}
    return frozenset(names | {name.removeprefix("no_") for name in names})


def _groups(options: Iterable[JobOption]) -> dict[str, str]:
    """Names of the options by the title of their group."""
    groups: dict[str, list[str]] = {}
    for option in options:
        groups.setdefault(option.group, []).append(option.word)
    return {title: " ".join(words) for title, words in groups.items()}

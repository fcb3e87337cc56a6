"""Job: a function with keyword arguments, in the user's units, that returns a scenario.

    @job
    def sweep_rock(*, width: float = 0.2) -> Scenario:
        "Sweep a rock from side to side."
        line = (0.0, -0.5 * width, 0.0, 0.5 * width)
        return replace(clean_object(object="rock", line=line), name="sweep_rock")

    sweep_rock(width=0.3, seed=4, forces=(40.0,))

A job is called with its own arguments and with the options of the scenario that it returns. Command
line, help, list, campaigns and notebooks read its signature:

    uuv run my_module:sweep_rock --width 0.3 --seed 4 --forces 40
"""

import inspect
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import shown
from uuv.sim.interfaces.tables import TableReader

if TYPE_CHECKING:  # not needed for a list of jobs
    from uuv.jobs.scenario_options import ScenarioOption
    from uuv.scenario import Scenario

    Change = Callable[[Scenario], Scenario]

QUICK = "quick"  # argument of a job that has a shorter form, for a first look within a minute
_ABOUT_QUICK = "A shorter job, for a first look within a minute; given options keep their values."
BY_NAME: "dict[str, Job]" = {}  # jobs that `job` has registered


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOption:
    """One keyword argument of a job."""

    word: str
    hint: Any  # its type
    default: Any
    about: str
    group: str = "job"
    key: str = ""  # key in a scenario file; empty: an argument of the job's function


class Job:
    """Job that returns its scenario when called."""

    def __init__(self, function: "Callable[..., Scenario]") -> None:
        """Take a function that returns the scenario, whose arguments are keywords with defaults.

        Raises:
            ConfigurationError: An argument has no default, or cannot be given by keyword.
        """
        self.function = function
        self.name = function.__name__.replace("_", "-")
        self.__doc__ = self._text = inspect.getdoc(function) or ""

        # As pydoc and editors know a function.
        self.__name__ = function.__name__
        self.__module__ = function.__module__

        for parameter in inspect.signature(function).parameters.values():
            by_keyword = parameter.kind in (parameter.KEYWORD_ONLY, parameter.POSITIONAL_OR_KEYWORD)
            if not by_keyword or parameter.default is parameter.empty:
                refused = f"{parameter.name} must be a keyword argument with a default"
                raise ConfigurationError(f"job {self.name}: {refused}")

    @property
    def about(self) -> str:
        """Description of the job in one line."""
        return " ".join(self._text.partition("\n\n")[0].split())

    @property
    def description(self) -> str:
        """Description of the job, without its arguments."""
        return self._text.partition("\nArgs:\n")[0].strip()

    @property
    def __signature__(self) -> inspect.Signature:
        """All keyword arguments, for help texts and editors."""
        keyword = inspect.Parameter.KEYWORD_ONLY
        listed = [
            inspect.Parameter(option.word, keyword, default=option.default, annotation=option.hint)
            for option in self.options().values()
        ]
        return inspect.Signature(listed, return_annotation="Scenario")

    @cached_property
    def arguments(self) -> Mapping[str, JobOption]:
        """Arguments of the function itself, by name."""
        hints = self._hints()
        abouts = {QUICK: _ABOUT_QUICK} | _arguments(self._text)
        return {
            word: JobOption(
                # An argument without an annotation takes anything.
                word=word,
                hint=hints.get(word, Any),
                default=parameter.default,
                about=abouts.get(word, ""),
            )
            for word, parameter in inspect.signature(self.function).parameters.items()
        }

    def options(self, base: "Scenario | None" = None) -> dict[str, JobOption]:
        """All keyword arguments: those of the function, then those of the scenario that it returns.

        Args:
            base: Scenario to use instead, for instance with a user's task.
        """
        listed = dict(self.arguments)
        if base is None:
            usual = self._scenario_options(self._base({}))
            short = self._scenario_options(self._base({QUICK: True})) if QUICK in listed else usual
        else:
            usual = short = self._scenario_options(base)

        for word, option in usual.items():
            about = option.declared.about
            if word in short and short[word].value != option.value:
                about += f" With --{QUICK} by default {_typed(short[word].value)}."

            listed[word] = JobOption(
                word=word,
                hint=option.hint,
                default=option.value,
                about=about,
                group=option.declared.group,
                key=option.key,
            )
        return listed

    def __call__(self, **values: Any) -> "Scenario":
        """The scenario, with `options` by keyword.

        Raises:
            ConfigurationError: There is no such option, or a value is of another type or range.
        """
        return self.scenario(values)

    def scenario(self, values: Mapping[str, Any], changed: "Change | None" = None) -> "Scenario":
        """The scenario for some values of options.

        Args:
            values: Values of options, by keyword.
            changed: Applied to the scenario that the function returns, before its options are set.

        Raises:
            ConfigurationError: There is no such option, or a value is of another type or range.
        """
        from uuv.jobs.scenario_options import with_options_set

        # The function's own arguments give the base.
        of_function = {
            word: _checked(self.arguments[word].hint, value, word)
            for word, value in values.items()
            if word in self.arguments
        }
        base = self._base(of_function)
        base = base if changed is None else changed(base)

        # The others are options of that base.
        options = self._scenario_options(base)
        known = (*self.arguments, *options)
        for word in values:
            if word not in known:
                meant = did_you_mean(word, known)
                unknown = f"job {self.name} has no {shown(word)}{meant}"
                raise ConfigurationError(f"{unknown}; it has {', '.join(known)}")
        of_scenario = {
            word: value if options[word].takes(value) else _checked(options[word].hint, value, word)
            for word, value in values.items()
            if word not in self.arguments
        }
        return with_options_set(base, options, of_scenario)

    def _base(self, values: Mapping[str, Any]) -> "Scenario":
        """The scenario that the function returns."""
        from uuv.scenario import Scenario

        scenario = self.function(**values)
        if not isinstance(scenario, Scenario):
            kind = type(scenario).__name__
            raise ConfigurationError(f"job {self.name}: must return a uuv.Scenario, got {kind}")
        return scenario

    def _scenario_options(self, base: "Scenario") -> "dict[str, ScenarioOption]":
        """Options of the scenario, except those with the name of an argument of the function."""
        from uuv.jobs.scenario_options import scenario_options

        options = scenario_options(base)
        return {word: options[word] for word in options if word not in self.arguments}

    def _hints(self) -> dict[str, Any]:
        """Types of the function's arguments; the type of its result may be unknown at run time."""
        annotations = dict(self.function.__annotations__)
        annotations.pop("return", None)
        holder = type(self.name, (), {"__annotations__": annotations})
        try:
            return get_type_hints(holder, self.function.__globals__)
        except NameError as error:
            raise ConfigurationError(f"job {self.name}: type of an argument: {error}") from error


def job(function: "Callable[..., Scenario]") -> Job:
    """Registers a function as a job, under its own name with dashes."""
    registered = Job(function)
    BY_NAME[registered.name] = registered
    return registered


def as_job(candidate: "Job | Callable[..., Any]", name: str) -> Job:
    """The job itself, or a job made of a plain function; `name` is the user's spelling.

    Raises:
        ConfigurationError: The candidate is neither a job nor a function.
    """
    if isinstance(candidate, Job):
        return candidate
    if not inspect.isfunction(candidate):
        form = "a function that returns a uuv.Scenario"
        raise ConfigurationError(f"job {shown(name)}: must be {form}")
    return Job(candidate)


def _checked(hint: Any, value: Any, word: str) -> Any:
    """The value, checked against an option's type; unchecked if the option has none."""
    return value if hint is Any else TableReader().value(hint, _plain(value), word)


def _plain(value: Any) -> Any:
    """A value in the types of a document: lists, texts and Python's own numbers."""
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # an array or number of numpy
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, tuple | list) else value


def _typed(value: Any) -> str:
    """A default as one types it on a command line."""
    several: Collection[Any] = value if isinstance(value, tuple) else (value,)
    return " ".join(f"{entry:g}" if isinstance(entry, float) else str(entry) for entry in several)


def _arguments(text: str) -> dict[str, str]:
    """Description of each argument in the section "Args:" of a docstring."""
    abouts: dict[str, str] = {}
    name = ""
    for line in text.partition("\nArgs:\n")[2].split("\n"):
        if line and not line.startswith(" "):
            break

        # An entry begins at four blanks; its further lines are indented more.
        if line.startswith("    ") and line[4:5].strip():
            name, _, about = line.strip().partition(": ")
            abouts[name] = about
        elif name and line.strip():
            abouts[name] += f" {line.strip()}"
    return abouts

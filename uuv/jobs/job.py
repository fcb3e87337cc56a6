"""Job: a function with keyword arguments, in the user's units, that returns a scenario.

    @job
    def sweep_rock(*, width: float = 0.2) -> Scenario:
        \"\"\"Sweep a rock from side to side.

Args:
            width: Of the sweep [m].
        \"\"\"
        line = (0.0, -0.5 * width, 0.0, 0.5 * width)
        return Scenario(name="sweep_rock", site=Site(object=KnownObject(line=line)), task=SurfaceWorkTask())

    sweep_rock(width=0.3, seed=4, forces=(40.0,))

It is called with its own arguments and with the options of the scenario that it returns. Command line, help, list,
campaigns and notebooks read its signature: `uuv run my_module:sweep_rock --width 0.3 --seed 4 --forces 40`.
"""

import inspect
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints, overload

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import shown
from uuv.sim.interfaces.tables import TableReader

if TYPE_CHECKING:  # a list of jobs does without what they are made of
    from uuv.jobs.scenario_options import ScenarioOption
    from uuv.scenario import Scenario

QUICK = "quick"  # argument of a job that has a shorter form, for a first look within a minute
_ABOUT_QUICK = "A shorter job, for a first look within a minute; options that are given keep their values."
BY_NAME: "dict[str, Job]" = {}  # jobs that `job` has registered


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOption:
    """One keyword argument of a job."""

    word: str
    hint: Any  # its type
    default: Any
    about: str
    group: str = "job"
    key: str = ""  # of a scenario file; empty: an argument of the job's function


class Job:
    """A job; called, it returns the scenario."""

    def __init__(self, function: "Callable[..., Scenario]", *, trials: bool = False, earlier: str = "") -> None:
        """Take a function whose arguments are keywords with defaults.

        Args:
            function: Returns the scenario.
            trials: Its task has figures that are summed up over many seeds (`uuv.campaigns.task_trials`).
            earlier: Its name in campaign files of earlier versions.

        Raises:
            ConfigurationError: An argument has no default, or cannot be given by keyword.
        """
        self.function, self.trials, self.earlier = function, trials, earlier
        self.name = function.__name__.replace("_", "-")
        self.__name__, self.__module__ = function.__name__, function.__module__
        self.__doc__ = self._text = inspect.getdoc(function) or ""
        for each in inspect.signature(function).parameters.values():
            if each.kind not in (each.KEYWORD_ONLY, each.POSITIONAL_OR_KEYWORD) or each.default is each.empty:
                raise ConfigurationError(f"job {self.name}: {each.name} must be a keyword argument with a default")

    @property
    def about(self) -> str:
        """What it is, in one line."""
        return self._text.partition("\n")[0]

    @property
    def description(self) -> str:
        """What it is, without its arguments."""
        return self._text.partition("\nArgs:\n")[0].strip()

    @property
    def __signature__(self) -> inspect.Signature:
        """All keyword arguments, for help texts and editors."""
        given = [
            inspect.Parameter(each.word, inspect.Parameter.KEYWORD_ONLY, default=each.default, annotation=each.hint)
            for each in self.options().values()
        ]
        return inspect.Signature(given, return_annotation="Scenario")

    @cached_property
    def own(self) -> Mapping[str, JobOption]:
        """Arguments of the function itself."""
        hints, abouts = self._hints(), _arguments(self._text)
        return {
            name: JobOption(
                word=name,
                hint=hints.get(name, Any),
                default=each.default,
                about=_ABOUT_QUICK if name == QUICK else abouts.get(name, ""),
            )
            for name, each in inspect.signature(self.function).parameters.items()
        }

    def _hints(self) -> dict[str, Any]:
        """Types of the function's arguments; that of what it returns may be a name for type checkers alone."""
        of_arguments = {name: hint for name, hint in self.function.__annotations__.items() if name != "return"}
        try:
            return get_type_hints(type(self.name, (), {"__annotations__": of_arguments}), self.function.__globals__)
        except NameError as error:
            raise ConfigurationError(f"job {self.name}: type of an argument: {error}") from error

    def options(self, base: "Scenario | None" = None) -> dict[str, JobOption]:
        """All keyword arguments: those of the function, then those of the scenario that it returns.

        Args:
            base: The scenario in place of that, for instance with a task of the user's own.
        """
        of_scenario = self._scenario_options(base if base is not None else self._made({}))
        short = self._scenario_options(self._made({QUICK: True})) if base is None and QUICK in self.own else {}
        listed = dict(self.own)
        for word, found in of_scenario.items():
            default, about = found.value, found.declared.about
            if word in short and short[word].value != default:
                about += f" With --{QUICK} by default {_words(short[word].value)}."
            listed[word] = JobOption(
                word=word, hint=found.hint, default=default, about=about, group=found.declared.group, key=found.key
            )
        return listed

    def __call__(self, **given: Any) -> "Scenario":
        """The scenario, with `options` by keyword.

        Raises:
            ConfigurationError: There is no such option, or a value is of another type or out of range.
        """
        return self.scenario(given)

    def scenario(self, given: Mapping[str, Any], change: "Callable[[Scenario], Scenario] | None" = None) -> "Scenario":
        """As a call; `change` is applied to what the function returns, before the scenario's own options."""
        from uuv.jobs.scenario_options import with_options_set

        own = {word: self._checked(self.own[word], value) for word, value in given.items() if word in self.own}
        base = self._made(own)
        base = base if change is None else change(base)
        options = self._scenario_options(base)
        self._refuse_unknown(given, options)

        values = {
            word: self._checked(JobOption(word=word, hint=options[word].hint, default=None, about=""), value)
            for word, value in given.items()
            if word not in self.own
        }
        return with_options_set(base, options, values)

    def _made(self, own: Mapping[str, Any]) -> "Scenario":
        """What the function returns."""
        from uuv.scenario import Scenario

        scenario = self.function(**own)
        if not isinstance(scenario, Scenario):
            raise ConfigurationError(f"job {self.name}: must return a uuv.Scenario, got {type(scenario).__name__}")
        return scenario

    def _scenario_options(self, base: "Scenario") -> "dict[str, ScenarioOption]":
        """Options of its scenario; an argument of the function hides one of the same name."""
        from uuv.jobs.scenario_options import scenario_options

        return {word: found for word, found in scenario_options(base).items() if word not in self.own}

    def _refuse_unknown(self, given: Mapping[str, Any], options: "Mapping[str, ScenarioOption]") -> None:
        known = (*self.own, *options)
        for word in given:
            if word not in known:
                meant = did_you_mean(word, known)
                raise ConfigurationError(f"job {self.name} has no {shown(word)}{meant}; it has {', '.join(known)}")

    def _checked(self, option: JobOption, value: Any) -> Any:
        """A value of the option's type."""
        if option.hint is Any:
            return value
        return TableReader().value(option.hint, _plain(value), option.word)


@overload
def job(function: "Callable[..., Scenario]") -> Job: ...


@overload
def job(*, trials: bool = False, earlier: str = "") -> "Callable[[Callable[..., Scenario]], Job]": ...


def job(
    function: "Callable[..., Scenario] | None" = None, *, trials: bool = False, earlier: str = ""
) -> "Job | Callable[[Callable[..., Scenario]], Job]":
    """Registers a function as a job, under its own name with dashes; the arguments are those of `Job`."""

    def registered(of: "Callable[..., Scenario]") -> Job:
        made = Job(of, trials=trials, earlier=earlier)
        BY_NAME[made.name] = made
        return made

    return registered if function is None else registered(function)


def as_job(thing: "Job | Callable[..., Any]", name: str) -> Job:
    """A job, or a plain function as one; `name` is how the user calls it.

    Raises:
        ConfigurationError: It is neither.
    """
    if isinstance(thing, Job):
        return thing
    if not inspect.isfunction(thing):
        raise ConfigurationError(f"job {shown(name)}: must be a function that returns a uuv.Scenario")
    return Job(thing)


def _plain(value: Any) -> Any:
    """A value as a document has it: lists, texts and Python's own numbers."""
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # of numpy
        return value.tolist()
    return [_plain(each) for each in value] if isinstance(value, tuple | list) else value


def _words(value: Any) -> str:
    """A default as it is typed."""
    several: Collection[Any] = value if isinstance(value, tuple) else (value,)
    return " ".join(f"{each:g}" if isinstance(each, float) else str(each) for each in several)


def _arguments(text: str) -> dict[str, str]:
    """What the section "Args:" of a docstring says of each argument."""
    told: dict[str, str] = {}
    _, _, section = text.partition("\nArgs:\n")
    name = ""
    for line in section.split("\n"):
        if line and not line.startswith(" "):
            break
        if line.startswith("    ") and line[4:5].strip():
            name, _, rest = line.strip().partition(": ")
            told[name] = rest
        elif name and line.strip():
            told[name] += f" {line.strip()}"
    return told

"""Options of an experiment: a class made from the fields of its case, and the cases that they
select.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, make_dataclass
from itertools import product
from pathlib import Path
from typing import Any, get_type_hints

from uuv.experiment.options import HarnessOptions, at_least
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.help_texts import help_texts

SEED = "seed"
RUNS = "runs"


@dataclass(kw_only=True)
class ExperimentOptions(HarnessOptions):
    """Options of every experiment, in addition to those of its cases."""

    run: bool = True
    """Run the cases that are missing (--no-run: the page of the rows that are there)."""
    drawn: Path | None = None
    """Run the cases in this file instead, which other options do not change."""


_NAMES_OF_OPTIONS = {entry.name for entry in fields(ExperimentOptions)} | {RUNS}


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseSpace:
    """Cases of an experiment, and the selection of cases by options."""

    base: type[Any]  # dataclass whose fields are the options
    seeds: int  # default number of seeds; 0: the base has no seed
    vary: Mapping[str, Sequence[Any]]  # values of fields; all their combinations are run
    # True: each seed with each combination; False: the seeds are spread over the combinations
    paired: bool
    # cases that one base gives; None: the base is the case
    expand: Callable[[Any], Iterable[Any]] | None

    def __post_init__(self) -> None:
        known = [entry.name for entry in fields(self.base)]
        for name in (*self.vary, *([SEED] if self.seeds else [])):
            if name not in known:
                raise ConfigurationError(
                    f"varied field of {self.base.__name__}: must be one of {', '.join(known)}, got "
                    f"{name!r}{did_you_mean(name, known)}"
                )

        for name in known:
            if name in _NAMES_OF_OPTIONS:
                raise ConfigurationError(
                    f"{self.base.__name__}.{name}: is an option of every experiment; take another "
                    "name"
                )

    def options(self, about: str) -> type[ExperimentOptions]:
        """Class of options: number of seeds and the first one, the fields of the base, and those of
        the harness; a field that is varied takes several values.

        Args:
            about: Help text of the command.
        """
        hints = get_type_hints(self.base)
        texts = dict(help_texts(self.base))
        members: list[tuple[str, Any, Any]] = []

        if self.seeds:
            members.append((RUNS, int, field(default=self.seeds)))
            texts[RUNS] = "Number of seeds, from --seed on."
            texts.setdefault(SEED, "Seed of the first run.")

        for entry in fields(self.base):
            hint = hints[entry.name]
            default = _default(entry)
            if entry.name in self.vary:
                hint = tuple[hint, ...]
                default = field(default=tuple(self.vary[entry.name]))
            elif entry.name == SEED and self.seeds and default.default is MISSING:
                default = field(default=0)
            members.append((entry.name, hint, default))

        names = [name for name, _, _ in members]
        harness = [entry.name for entry in fields(ExperimentOptions)]
        groups = {"cases": " ".join(names), "harness": " ".join(harness)}

        return make_dataclass(
            "Options",
            members,
            bases=(ExperimentOptions,),
            namespace={"abouts": texts, "groups": groups, "__doc__": about},
            kw_only=True,
        )

    def cases(self, options: Any) -> list[Any]:
        """Cases selected by options, in their order.

        Raises:
            ConfigurationError: A varied value is not among the known ones, or a case refuses its
                values.
        """
        for name, levels in self.vary.items():
            _check_words(name, getattr(options, name), levels)
        if isinstance(getattr(options, SEED, None), int):
            at_least(options, seed=0)

        if self.expand is None:
            return list(self._bases(options))
        return [case for base in self._bases(options) for case in self.expand(base)]

    def _bases(self, options: Any) -> Iterator[Any]:
        """The base for each combination of varied values and each seed."""
        fixed = {
            entry.name: getattr(options, entry.name)
            for entry in fields(self.base)
            if entry.name not in self.vary
        }

        combinations = [
            dict(zip(self.vary, values, strict=True))
            for values in product(*(getattr(options, name) for name in self.vary))
        ]
        if not self.seeds:
            yield from (self.base(**fixed, **varied) for varied in combinations)
            return

        first = fixed.pop(SEED)
        for i in range(options.runs):
            some = combinations if self.paired else [combinations[i % len(combinations)]]
            yield from (self.base(**fixed, **varied, seed=first + i) for varied in some)


def _check_words(name: str, values: Sequence[Any], known: Sequence[Any]) -> None:
    """Refuse words that are not among the known ones; a number may have any value."""
    option = f"--{name.replace('_', '-')}"
    if not values:
        raise ConfigurationError(f"{option}: must have at least one value, got none")

    for level in values:
        if isinstance(level, str) and level not in known:
            listed = ", ".join(map(str, known))
            raise ConfigurationError(
                f"{option}: must be one of {listed}, got {level!r}{did_you_mean(level, known)}"
            )


def _default(entry: Any) -> Any:
    """A new field with the default of another one."""
    if entry.default_factory is not MISSING:
        return field(default_factory=entry.default_factory)
    return field() if entry.default is MISSING else field(default=entry.default)

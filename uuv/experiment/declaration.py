"""Experiment: a case, what a run of it gives, and a page, declared in one file that is a command.

    @experiment("views", seeds=200, vary={"kind": KINDS, "object": NAMES})
    def looks_needed(case: ViewCase) -> ViewRow: ...

    looks_needed.page = Page().share("first", "the first view sufficed")

    if __name__ == "__main__":
        run_scenario(looks_needed.main)

The fields of the case are the options of the command, those of the row the columns of its table.
Workers, resume and engines are those of `uuv.experiment.harness.Study`.
"""

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar, get_type_hints

from uuv.catalogue import EXPERIMENTS
from uuv.experiment.case_options import CaseSpace, ExperimentOptions
from uuv.experiment.columns import ResultColumn, check_names, columns_of
from uuv.experiment.drawn_cases import made_cases
from uuv.experiment.harness import Study, Summary, key_of
from uuv.experiment.local_processes import NO_LIMITS
from uuv.experiment.page import Page
from uuv.experiment.row_log import without_log
from uuv.experiment.row_table import Row, read_rows
from uuv.experiment.worker import Limits
from uuv.sim.interfaces.errors import ConfigurationError, UuvError, did_you_mean
from uuv.sim.interfaces.files import folder_given, folder_name
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.run_folder import RUNS

Case = TypeVar("Case")
Outcome = TypeVar("Outcome")
DATA = "data"  # field of a case: folder of measured data, which not every machine has


class Experiment(Generic[Case, Outcome]):
    """An experiment: the function `run` over many cases, a command, and a page.

    It is called like the function. `page`, `line` (printed when a row is there) and `limits` (time
    and memory of a run) may be set.
    """

    def __init__(
        self,
        name: str,
        run: Callable[[Case], Outcome],
        space: CaseSpace,
        *,
        case: type[Any],
        columns: Mapping[str, ResultColumn],
        quick: Mapping[str, Any],
        failed: Callable[[Case, str], Outcome] | None,
    ) -> None:
        self.name = name
        self.run = run
        self.space = space
        self.case = case
        self.columns = columns
        self.quick = quick  # options of the quick subset
        self.limits: Limits = NO_LIMITS
        self.line: Callable[[Row], str] = lambda _: ""
        self._failed = failed
        self._page = Page()

        # as functools.wraps does: a worker imports it by these names
        self.__module__ = run.__module__
        self.__qualname__ = run.__qualname__
        self.__doc__ = run.__doc__

    def __call__(self, case: Case) -> Outcome:
        """What `run` gives for a case."""
        return self.run(case)

    def __reduce__(self) -> str:
        """A worker imports the experiment under the name of its function."""
        return self.__qualname__

    @property
    def page(self) -> Page:
        """The page; one that names what is no column is refused when it is set."""
        return self._page

    @page.setter
    def page(self, page: Page) -> None:
        """Sets the page.

        Raises:
            ConfigurationError: It names what is no column.
        """
        page.check(self.columns)
        self._page = page

    @property
    def about(self) -> str:
        """Description: docstring of the experiment's module, else of its function."""
        module = sys.modules.get(self.__module__)
        return inspect.cleandoc((module and module.__doc__) or self.__doc__ or self.name)

    @property
    def title(self) -> str:
        """First sentence of the description, in one line, without its full stop."""
        return " ".join(self.about.partition("\n\n")[0].split()).rstrip(".")

    @property
    def case_names(self) -> tuple[str, ...]:
        """Names of the columns that tell cases apart."""
        return tuple(entry.name for entry in fields(self.case))

    def case_key(self, case: Case) -> str:
        """Digest of a case by its columns, equal to `row_key` of its row."""
        return key_of(vars_of(case))

    def row_key(self, row: Row) -> str:
        """Digest of the case of a row."""
        return key_of({name: row[name] for name in self.case_names})

    @property
    def needs_data(self) -> bool:
        """Whether its cases are taken from a folder of measured data, option --data."""
        return any(entry.name == DATA for entry in fields(self.space.base))

    @cached_property
    def options(self) -> type[ExperimentOptions]:
        """Class of the options of the command."""
        return self.space.options(self.about)

    def options_with(self, values: Mapping[str, Any]) -> ExperimentOptions:
        """Options with some values, by name, and the others by default.

        Raises:
            ConfigurationError: There is no such option, or one without a default is left out.
        """
        self.check_options(values)
        lacking = [
            entry.name
            for entry in fields(self.options)
            if entry.name not in values
            and entry.default is MISSING
            and entry.default_factory is MISSING
        ]

        if lacking:
            raise ConfigurationError(f"experiment {self.name}: needs {', '.join(lacking)}")
        return self.options(**values)

    def check_options(self, names: Iterable[str]) -> None:
        """Refuses names that are no options.

        Raises:
            ConfigurationError: Which one, and those that there are.
        """
        known = [entry.name for entry in fields(self.options)]
        for name in names:
            if name not in known:
                raise ConfigurationError(
                    f"experiment {self.name}: no option {name!r}; there are "
                    f"{', '.join(known)}{did_you_mean(name, known)}"
                )

    def main(self) -> int:
        """Command of the experiment: parses the command line, runs or resumes; the exit code."""
        from uuv.start import parse

        if self.__module__ == "__main__":  # workers need its module by name
            return _imported(self).main()
        return self.carry_out(parse(self.options))

    def carry_out(self, options: ExperimentOptions) -> int:
        """Runs the cases that are missing, prints and writes the page; returns the exit code.

        Raises:
            UuvError: As `Study.carry_out`, or an option asks for no case.
        """
        study = self.study(options)
        if options.run:
            return study.carry_out(self.name, options, self.title, self.limits)

        folder = self.folder(options)
        for row in read_rows(folder):
            check_names(self.columns, without_log(row), str(folder))
        return study.sum_up(self.name, options, self.title)

    def folder(self, options: ExperimentOptions) -> Path:
        """Folder of the rows."""
        if options.out is not None:
            return folder_given(options.out, "--out")
        return RUNS / folder_name(self.name, "name")

    def study(self, options: ExperimentOptions) -> Study[Case]:
        """The cases that options ask for, as a study.

        Raises:
            ConfigurationError: They ask for none, a value is not allowed, or a file of drawn cases
                is of another experiment.
        """
        if options.drawn is None:
            cases = self.space.cases(options)
        else:
            cases = made_cases(options.drawn, self.name, self.case, self.space.vary)

        if not cases:
            raise ConfigurationError(f"experiment {self.name}: these options select no case")
        return Study(
            cases=cases,
            run_one=self.row,
            summarise=self.summary,
            failed=None if self._failed is None else self._failed_row,
            line=self.line,
        )

    def row(self, case: Case) -> Row:
        """Runs a case; its row has the fields of the case, then those of the outcome.

        Raises:
            ConfigurationError: The run refused its case; the message says which one.
        """
        try:
            return self._row(case, self.run(case))
        except UuvError as error:
            if self._failed is not None:  # the error has a column of its own
                raise

            listed = ", ".join(f"{key} {shown(value)}" for key, value in vars_of(case).items())
            raise ConfigurationError(f"experiment {self.name}, {listed}: {error}") from error

    def summary(self, rows: Sequence[Row]) -> Summary:
        """The page for some rows.

        Raises:
            ConfigurationError: They are of another version of the experiment.
        """
        for row in rows:
            check_names(self.columns, row, f"experiment {self.name}")
        return self.page.summary(list(rows), self.columns)

    def _failed_row(self, case: Case, error: str) -> Row:
        assert self._failed is not None
        return self._row(case, self._failed(case, error))

    def _row(self, case: Case, outcome: Outcome) -> Row:
        if not is_dataclass(outcome) or isinstance(outcome, type):
            kind = type(outcome).__name__
            raise ConfigurationError(
                f"experiment {self.name}: a run must give its row, a dataclass; got {kind}"
            )

        parts = (case, outcome)
        return {name: value for part in parts for name, value in vars_of(part).items()}


def experiment(
    name: str,
    *,
    seeds: int = 0,
    vary: Mapping[str, Sequence[Any]] | None = None,
    paired: bool = False,
    cases: Callable[[Any], Iterable[Any]] | None = None,
    quick: Mapping[str, Any] | None = None,
    failed: Callable[[Any, str], Any] | None = None,
) -> Callable[[Callable[[Case], Outcome]], Experiment[Case, Outcome]]:
    """Makes an experiment of a function that takes a case and returns a row, both frozen
    dataclasses; the fields of the case are options, and what stands below them is their help.

    Args:
        name: Of the experiment, its folder in runs/ and its page.
        seeds: Default number of seeds; the field `seed` of a case counts up from --seed. 0: none.
        vary: Values of fields of the case, whose combinations are run.
        paired: Each seed is run with every combination; else the seeds go round them.
        cases: Function from options, a dataclass by the annotation of its argument, to their cases;
            default: options are a case. `seeds` and `vary` are of the options then.
        quick: Options of a subset of the default cases, of at most a minute, by which
            `uuv results --check` checks the kept rows.
        failed: Row of a case whose run raised an error; default: that ends the experiment.

    Raises:
        ConfigurationError: The function has no such annotations, or a name is no field.
    """

    def decorated(run: Callable[[Case], Outcome]) -> Experiment[Case, Outcome]:
        case = _argument(run)
        row = get_type_hints(run).get("return")
        if not isinstance(row, type) or not is_dataclass(row):
            raise ConfigurationError(f"{run.__name__}: must return a dataclass, by annotation")

        base = case if cases is None else _argument(cases)
        space = CaseSpace(base=base, seeds=seeds, vary=vary or {}, paired=paired, expand=cases)
        columns = columns_of(case, row)
        declared = Experiment(
            name, run, space, case=case, columns=columns, quick=quick or {}, failed=failed
        )
        declared.check_options(declared.quick)
        return declared

    folder_name(name, "name of an experiment")
    return decorated


def experiments_in(module: ModuleType) -> list[Experiment[Any, Any]]:
    """Experiments that a module declares, in their order."""
    return [
        entry
        for entry in vars(module).values()
        if isinstance(entry, Experiment) and entry.__module__ == module.__name__
    ]


def vars_of(part: Any) -> dict[str, Any]:
    """Values of a dataclass's fields by name, as they are."""
    return {entry.name: getattr(part, entry.name) for entry in fields(part)}


def _argument(function: Callable[..., Any]) -> type[Any]:
    """Dataclass that annotates the first argument of a function.

    Raises:
        ConfigurationError: It is none.
    """
    hints = get_type_hints(function)
    hints.pop("return", None)
    kind = next(iter(hints.values()), None)
    if not isinstance(kind, type) or not is_dataclass(kind):
        raise ConfigurationError(
            f"{function.__name__}: its argument must be a dataclass, by annotation"
        )
    return kind


def _imported(declared: Experiment[Any, Any]) -> Experiment[Any, Any]:
    """An experiment of the main script, imported under the name of its module.

    Raises:
        ConfigurationError: Another module has that name.
    """
    main = sys.modules["__main__"]
    file = Path(str(main.__file__)).resolve()

    # by `python -m`; below scripts/; or anywhere, for Python searches the folder of a script first
    if main.__spec__ is not None:
        name = main.__spec__.name
    elif file.is_relative_to(EXPERIMENTS):
        name = ".".join(file.relative_to(EXPERIMENTS.parent).with_suffix("").parts)
    else:
        name = file.stem

    module = import_module(name)
    if Path(str(module.__file__)).resolve() != file:
        raise ConfigurationError(
            f"{file}: Python finds another module {name!r} first ({module.__file__}); rename it"
        )
    return getattr(module, declared.__qualname__)

"""Experiment: a case, the row of its run, and a page, declared in one file that is also a command.

    @experiment("views", seeds=200, vary={"kind": KINDS, "object": NAMES})
    def looks_needed(case: ViewCase) -> ViewRow: ...

    looks_needed.page = Page().share("first", "the first view sufficed")

    if __name__ == "__main__":
        run_scenario(looks_needed.main)

The fields of the case are the options of the command, and the fields of the row are the columns of
its table. `uuv.experiment.harness.Study` provides workers, resumption and engines.
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
DATA = "data"  # field of a case: folder of measured data, which is not available on every machine


class Experiment(Generic[Case, Outcome]):
    """An experiment: the function `run` over many cases, a command, and a page.

    An experiment is called like its function. `page`, `line` (printed for each new row) and
    `limits` (time and memory of a run) may be set.
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
        self.quick = quick  # options of the subset for a quick check
        self.limits: Limits = NO_LIMITS
        self.line: Callable[[Row], str] = lambda _: ""
        self._failed = failed
        self._page = Page()

        # like functools.wraps: a worker imports the experiment by these names
        self.__module__ = run.__module__
        self.__qualname__ = run.__qualname__
        self.__doc__ = run.__doc__

    def __call__(self, case: Case) -> Outcome:
        """Result of `run` for a case."""
        return self.run(case)

    def __reduce__(self) -> str:
        """Pickle as the name of the function, under which a worker imports the experiment."""
        return self.__qualname__

    @property
    def page(self) -> Page:
        """The page; a page that names an unknown column is refused when it is set."""
        return self._page

    @page.setter
    def page(self, page: Page) -> None:
        """Set the page.

        Raises:
            ConfigurationError: The page names an unknown column.
        """
        page.check(self.columns)
        self._page = page

    @property
    def about(self) -> str:
        """Description: docstring of the experiment's module or, without one, of its function."""
        module = sys.modules.get(self.__module__)
        return inspect.cleandoc((module and module.__doc__) or self.__doc__ or self.name)

    @property
    def title(self) -> str:
        """First sentence of the description, in one line, without its full stop."""
        return " ".join(self.about.partition("\n\n")[0].split()).rstrip(".")

    @property
    def case_names(self) -> tuple[str, ...]:
        """Names of the columns that identify a case."""
        return tuple(entry.name for entry in fields(self.case))

    def case_key(self, case: Case) -> str:
        """Digest of a case from its columns, equal to `row_key` of its row."""
        return key_of(vars_of(case))

    def row_key(self, row: Row) -> str:
        """Digest of the case of a row."""
        return key_of({name: row[name] for name in self.case_names})

    @property
    def needs_data(self) -> bool:
        """Whether the cases are taken from a folder of measured data, given by the option
        --data.
        """
        return any(entry.name == DATA for entry in fields(self.space.base))

    @cached_property
    def options(self) -> type[ExperimentOptions]:
        """Class of the options of the command."""
        return self.space.options(self.about)

    def options_with(self, values: Mapping[str, Any]) -> ExperimentOptions:
        """Options with the given values, by name, and defaults for the others.

        Raises:
            ConfigurationError: There is no such option, or an option without a default is left out.
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
        """Refuse names that are not options.

        Raises:
            ConfigurationError: The message names the unknown option and the known ones.
        """
        known = [entry.name for entry in fields(self.options)]
        for name in names:
            if name not in known:
                raise ConfigurationError(
                    f"experiment {self.name}: option must be one of {', '.join(known)}, got "
                    f"{name!r}{did_you_mean(name, known)}"
                )

    def main(self) -> int:
        """Command of the experiment: parses the command line, runs or resumes, and returns the exit
        code.
        """
        from uuv.start import parse

        if self.__module__ == "__main__":  # workers need its module under the module's name
            return _imported(self).main()
        return self.carry_out(parse(self.options))

    def carry_out(self, options: ExperimentOptions) -> int:
        """Run the missing cases, print and write the page, and return the exit code.

        Raises:
            UuvError: As for `Study.carry_out`, or the options select no case.
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
        """The cases that the options select, as a study.

        Raises:
            ConfigurationError: The options select no case, a value is not allowed, or a file of
                drawn cases belongs to another experiment.
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
        """Run a case; the row has the fields of the case, followed by those of the result.

        Raises:
            ConfigurationError: The run refused its case; the message names the case.
        """
        try:
            return self._row(case, self.run(case))
        except UuvError as error:
            if self._failed is not None:  # the error has its own column
                raise

            listed = ", ".join(f"{key} {shown(value)}" for key, value in vars_of(case).items())
            raise ConfigurationError(f"experiment {self.name}, {listed}: {error}") from error

    def summary(self, rows: Sequence[Row]) -> Summary:
        """The page for some rows.

        Raises:
            ConfigurationError: The rows are from another version of the experiment.
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
                f"experiment {self.name}: a run must return its row, a dataclass, got {kind}"
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
    """Make an experiment of a function that takes a case and returns a row, both frozen
    dataclasses. The fields of the case are options, and the string below a field is its help text.

    Args:
        name: Name of the experiment, of its folder in runs/ and of its page.
        seeds: Default number of seeds; the field `seed` of a case counts up from --seed. 0: the
            cases have no seed.
        vary: Values of fields of the case, whose combinations are run.
        paired: True: each seed is run with every combination. False: the seeds are distributed over
            the combinations in turn.
        cases: Function that returns the cases for options, whose dataclass is the annotation of its
            argument; `seeds` and `vary` then refer to the options. Default: the options are a case.
        quick: Options of a subset of the default cases, of at most a minute, with which `uuv
            results --check` checks the kept rows.
        failed: Function that returns the row of a case whose run raised an error; default: an error
            ends the experiment.

    Raises:
        ConfigurationError: The function has no such annotations, or a name is not a field.
    """

    def decorated(run: Callable[[Case], Outcome]) -> Experiment[Case, Outcome]:
        case = _argument(run)
        row = get_type_hints(run).get("return")
        if not isinstance(row, type) or not is_dataclass(row):
            raise ConfigurationError(
                f"{run.__name__}: the annotation of its result must be a dataclass"
            )

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
    """Experiments that a module declares, in the order of declaration."""
    return [
        entry
        for entry in vars(module).values()
        if isinstance(entry, Experiment) and entry.__module__ == module.__name__
    ]


def vars_of(part: Any) -> dict[str, Any]:
    """Values of a dataclass's fields by name, not copied."""
    return {entry.name: getattr(part, entry.name) for entry in fields(part)}


def _argument(function: Callable[..., Any]) -> type[Any]:
    """Dataclass that annotates the first argument of a function.

    Raises:
        ConfigurationError: The annotation is not a dataclass.
    """
    hints = get_type_hints(function)
    hints.pop("return", None)
    kind = next(iter(hints.values()), None)
    if not isinstance(kind, type) or not is_dataclass(kind):
        raise ConfigurationError(
            f"{function.__name__}: the annotation of its argument must be a dataclass"
        )
    return kind


def _imported(declared: Experiment[Any, Any]) -> Experiment[Any, Any]:
    """An experiment declared in the main script, imported under the name of its module."""
    main = sys.modules["__main__"]
    file = Path(str(main.__file__)).resolve()

    # by `python -m`, below scripts/, or anywhere, since Python searches the folder of a script
    # first
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

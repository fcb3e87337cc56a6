"""Campaign: a base scenario, distributions of its parameters, and the metrics of each run.

    name = "contact_quick"
    base = "clean-barrel"           # or a scenario file, relative to this one
    quick = true
    cases = 4

    [set]
    "belief.water_error" = 0.0

    [distributions]
    "site.current" = { direction = [0.0, 0.4] }
    "perturbations.Pad.stiffness" = { log_uniform = [1e4, 1e6] }

    [grid]
    "task.path" = ["longitudinal", "transverse"]

    [versions."without fusion"]
    "control.without" = ["fusion"]

    [metrics]
    names = ["contact.force_error_rms_n"]

docs/campaigns.md lists all keys.
"""

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from uuv import jobs
from uuv.campaigns.distributions import DESIGNS, Design, Distribution, drawn
from uuv.campaigns.run_outcome import figure_names
from uuv.experiment.drawn_cases import DrawnCase, read_cases
from uuv.experiment.worker import Limits
from uuv.scenario import Scenario
from uuv.scenario_file import as_dict, assigned, from_dict, put, read_scenario, refuse_code
from uuv.sim.evaluation import schema_files
from uuv.sim.interfaces.documents import inside, named, toml_of
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import folder_name
from uuv.sim.interfaces.spatial import finite_number, shown, whole_number
from uuv.sim.interfaces.streams import Streams
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.runs.run_folder import FORMAT_KEY

_MOST_CASES = 10_000_000  # largest number of runs of a campaign, which makes 10 GB of rows
EXPERIMENT = "campaign"  # name of the experiment in a file of drawn cases
_SEEDS = ("perturbation_seed", "seed")  # seeds that are drawn for every run


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """Many runs of one scenario with drawn parameters."""

    name: str
    base: Scenario
    # by dotted key of a scenario file, or perturbations.KIND.field
    distributions: Mapping[str, Distribution]
    metrics: tuple[str, ...]  # dotted names of metrics.json
    cases: int
    seed: int = 0
    design: Design = "random"
    # upper bounds of metrics; empty: the verdict of the run decides
    bounds: Mapping[str, float] = field(default_factory=dict)
    kept: float | None = None  # share of the runs that must keep the bounds; None: no verdict
    limits: Limits = field(default_factory=Limits)
    # values by dotted key that the cases take in turn; those of the first key change fastest
    grid: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    # the same draws again with other values by dotted key, for each named version
    versions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # number of first cases that are also run in the versions; None: all
    version_cases: int | None = None
    also: Mapping[str, float] = field(default_factory=dict)  # bounds that do not decide about a run
    never: tuple[str, ...] = ()  # classes or reasons of an end that are forbidden for every run

    def __post_init__(self) -> None:
        whole_number(self.cases, "cases", least=1, most=_MOST_CASES)
        whole_number(self.seed, "seed")
        if self.design not in DESIGNS:
            raise ConfigurationError(
                f"design: allowed {', '.join(DESIGNS)}, got {shown(self.design)}"
            )

        if self.kept is not None:
            finite_number(self.kept, "kept", least=0.0, most=1.0)
        if self.version_cases is not None:
            whole_number(self.version_cases, "version_cases", least=1)

        self._check_metrics()
        for name in self.distributions:
            _checked_key(self.base, name)
        self._check_grid()

        # Each version must give a valid scenario.
        for version in ("", *self.versions):
            try:
                self.runs_of(self.drawn(1), version)[0].scenario()
            except ConfigurationError as error:
                where = f"versions: {version}: " if version else ""
                raise ConfigurationError(f"{where}{error}") from error

    def _check_grid(self) -> None:
        """Refuse values of the grid that the cases cannot take in turn."""
        taken: set[str] = {*self.distributions}
        for names, levels in self.grid.items():
            if not levels:
                raise ConfigurationError(f"grid: {names}: must have at least one value, got none")
            keys = keys_of(names)
            for key in keys:
                _checked_key(self.base, key)
                if key in taken:
                    raise ConfigurationError(
                        f"grid: {key}: must not also be drawn, or be in the grid twice"
                    )
                taken.add(key)

            for level in levels:
                if keys[1:] and not (isinstance(level, list) and len(level) == len(keys)):
                    raise ConfigurationError(
                        f"grid: {names}: must be lists of {len(keys)} values, got {shown(level)}"
                    )

    def _check_metrics(self) -> None:
        """Refuse names of metrics that the base's task does not have, and bounds that are not
        numbers.
        """
        allowed = metric_names(self.base)
        for name in self.names:
            if name not in allowed:
                known = ", ".join(sorted(allowed)) + did_you_mean(name, sorted(allowed))
                raise ConfigurationError(f"no metric {shown(name)}; this task has {known}")
        for table, bounds in (("bounds", self.bounds), ("also", self.also)):
            for name, bound in bounds.items():
                finite_number(bound, f"{table}: {name}")

    @property
    def names(self) -> tuple[str, ...]:
        """Metrics that are kept in a row."""
        return tuple(dict.fromkeys((*self.metrics, *self.bounds, *self.also)))

    def drawn(self, cases: int | None = None) -> tuple[DrawnCase, ...]:
        """Drawn values for each run of the campaign, or for its first `cases`, by dotted key."""
        count = self.cases if self.design == "latin-hypercube" or cases is None else cases
        draws = drawn(self.distributions, count, self.seed, self.design)

        runs = []
        for case, parameters in enumerate(draws[:cases]):
            streams = Streams(self.seed, case)
            seeds = {name: int(streams[name].integers(2**31)) for name in _SEEDS}
            taken = self._of_grid(case)
            runs.append(DrawnCase(case=case, values={**seeds, **taken, **parameters}))
        return tuple(runs)

    def _of_grid(self, case: int) -> dict[str, Any]:
        """Values of the grid that a case takes."""
        taken: dict[str, Any] = {}
        for names, levels in self.grid.items():
            case, at = divmod(case, len(levels))
            keys = keys_of(names)
            together = levels[at] if keys[1:] else [levels[at]]
            taken |= zip(keys, together, strict=True)
        return taken

    def runs(self, cases: int | None = None) -> list["CampaignRun"]:
        """The runs of the campaign without its versions; `cases` limits them to the first cases."""
        return self.runs_of(self.drawn(cases))

    def runs_of(self, drawn: Iterable[DrawnCase], version: str = "") -> list["CampaignRun"]:
        """Runs of drawn cases in a version of `versions`; "" is the campaign without a version."""
        nested = as_dict(self.base)
        changed = self.versions[version] if version else {}
        return [
            CampaignRun(
                case=case.case,
                base=nested,
                values=case.values,
                metrics=self.names,
                version=version,
                changed=changed,
            )
            for case in drawn
        ]

    def all_runs(self, drawn: Sequence[DrawnCase]) -> list["CampaignRun"]:
        """Runs of drawn cases, and of the first cases in each version."""
        repeated = drawn[: self.version_cases]
        versions = [run for name in self.versions for run in self.runs_of(repeated, name)]
        return self.runs_of(drawn) + versions


def keys_of(names: str) -> list[str]:
    """Keys of an entry of the grid; keys joined by a comma take their values together."""
    return [name.strip() for name in names.split(",")]


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRun:
    """One run of a campaign, as a small value that can be sent to a worker process."""

    case: int
    base: Mapping[str, Any]  # tables of the scenario
    values: Mapping[str, Any]  # by dotted key
    metrics: tuple[str, ...]  # dotted names
    version: str = ""  # name of a version of the campaign; empty: none
    changed: Mapping[str, Any] = field(default_factory=dict)  # values that this version sets

    def scenario(self) -> Scenario:
        """Scenario of the run.

        Raises:
            ConfigurationError: A value is not allowed.
        """
        nested = copy.deepcopy(dict(self.base))
        for name, setting in {**self.values, **self.changed}.items():
            put(nested, name, setting)
        return from_dict(nested)


def read_campaign(
    file: str | Path, changed: Sequence[str] = (), *, trust: bool = False
) -> Campaign:
    """The campaign in a TOML file.

    Args:
        file: The file.
        changed: Values as for `scenario_file.assigned`, in addition to those of its table [set],
            and in place of draws.
        trust: Whether to import classes MODULE:CLASS that the file or its base names, which runs
            their code.

    Raises:
        ConfigurationError: The file cannot be read, names code without `trust`, or has a key or
            value that is not allowed; the message names it.
    """
    path = Path(file)
    what = named(path, "campaign")
    document = _document(path)
    refuse_code(document, what, trust=trust)

    try:
        content = _READER.made(_CampaignFile, document)
        return _campaign(content, path, assigned(changed), trust=trust)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from error


def read_drawn(
    file: str | Path, campaign: Campaign, changed: Sequence[str] = ()
) -> tuple[DrawnCase, ...]:
    """The drawn cases in a file, as a campaign can run them.

    Args:
        file: File for `uuv.experiment.drawn_cases`, with the drawn values by dotted key.
        campaign: The campaign that is to run them.
        changed: Values as for `scenario_file.assigned`, which replace those of the file in all
            runs.

    Raises:
        ConfigurationError: The file contains no cases of a campaign, or has a value that is not
            allowed.
    """
    fixed = assigned(changed)
    drawn = tuple(
        replace(case, values={k: v for k, v in case.values.items() if k not in fixed})
        for case in read_cases(file, EXPERIMENT)
    )

    for run in campaign.runs_of(drawn):
        try:
            run.scenario()
        except ConfigurationError as error:
            where = named(Path(file), "drawn cases")
            raise ConfigurationError(f"{where}: case {run.case}: {error}") from error
    return drawn


@cache
def _schema(schema: str) -> Mapping[str, Any]:
    return schema_files.GENERATED[schema]()


def metric_names(scenario: Scenario) -> frozenset[str]:
    """Dotted names of the numbers and verdicts in the metrics of `scenario` that a row may keep."""
    of_metrics = _numbers(_schema(scenario.task.schema)["properties"], "")
    return frozenset((*of_metrics, *figure_names(scenario)))


def _numbers(properties: Mapping[str, Any], before: str) -> list[str]:
    names: list[str] = []
    for name, entry in properties.items():
        if "properties" in entry:
            names += _numbers(entry["properties"], f"{before}{name}.")
        elif {"number", "integer", "boolean"} & set(np.atleast_1d(entry.get("type", ())).tolist()):
            names.append(before + name)

    # Timings differ between repetitions, and the format is not a figure.
    return [name for name in names if name != FORMAT_KEY and not name.startswith("timings.")]


def _checked_key(base: Scenario, name: str) -> None:
    """Refuse a parameter that the campaign sets itself, or that is not in a table of the
    scenario.
    """
    if name in (*_SEEDS, "name"):
        raise ConfigurationError(
            f"{name!r}: must not be drawn or set, since the campaign's seed determines it"
        )

    put(as_dict(base), name, None)


_LIKE = "like"  # key: another campaign's file, which supplies the keys that a file lacks
# tables whose keys are dotted keys of a scenario file
_OF_VALUES = ("set", "distributions", "grid")
_WORD = {"schema": {"title": "letters, digits, - and _"}}
_NAMES = {"schema": {"title": "a list of names", "items": {"title": "a name"}}}
_BASE = f"{', '.join(jobs.JOBS.names())} or a scenario file (.toml)"


@dataclass(frozen=True, slots=True, kw_only=True)
class _MetricNames:
    """Table [metrics] of a campaign's file."""

    names: tuple[str, ...] = field(default=(), metadata=_NAMES)


@dataclass(frozen=True, slots=True, kw_only=True)
class _CampaignFile:
    """Keys of a campaign's file; see `Campaign` for their meaning."""

    base: str = field(metadata={"schema": {"title": _BASE}})
    cases: int = field(metadata={"schema": {"minimum": 1, "maximum": _MOST_CASES}})
    name: str | None = field(default=None, metadata=_WORD)  # None: the name of the file
    quick: bool = False
    job: Mapping[str, Any] = field(default_factory=dict)  # options of the base job
    seed: int = field(default=0, metadata={"schema": {"minimum": 0}})
    design: Design = "random"
    set: Mapping[str, Any] = field(default_factory=dict)  # by dotted key of a scenario file
    distributions: Mapping[str, Any] = field(default_factory=dict)  # likewise
    metrics: _MetricNames = field(default_factory=_MetricNames)
    bounds: Mapping[str, float] = field(default_factory=dict)
    kept: float | None = field(default=None, metadata={"schema": {"minimum": 0, "maximum": 1}})
    limits: Limits = field(default_factory=Limits)
    grid: Mapping[str, list[Any]] = field(default_factory=dict)  # by dotted key
    versions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    version_cases: int | None = field(default=None, metadata={"schema": {"minimum": 1}})
    also: Mapping[str, float] = field(default_factory=dict)
    never: tuple[str, ...] = field(default=(), metadata=_NAMES)


_READER = TableReader(places_faults=True)


def _document(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Tables of a campaign's file, completed by those of the campaign that its key `like` names.

    Raises:
        ConfigurationError: A file cannot be read, or its key `like` leads back to it.
    """
    document = toml_of(path, "campaign")
    like = document.pop(_LIKE, None)
    if like is None:
        return document

    what = named(path, "campaign")
    if not isinstance(like, str):
        raise ConfigurationError(f"{what}: {_LIKE}: must be a campaign file, got {shown(like)}")
    if path.resolve() in above:
        raise ConfigurationError(f"{what}: {_LIKE}: must not lead back to the file itself")

    other = _document(path.parent / like, (*above, path.resolve()))
    other.pop("name", None)
    if str(other.get("base", "")).endswith(".toml"):
        other["base"] = str(Path(like).parent / other["base"])
    return _joined(other, document)


def _joined(other: dict[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """`other`, updated by the tables of `document`. A key that `document` sets, draws or takes in
    turn is removed from the other tables.
    """
    value_tables = [document.get(table) for table in _OF_VALUES]
    names = [names for table in value_tables if isinstance(table, Mapping) for names in table]
    ours = {key for entry in names for key in keys_of(entry)}
    for name in _OF_VALUES:
        if isinstance(table := other.get(name), Mapping):
            other[name] = {k: v for k, v in table.items() if ours.isdisjoint(keys_of(k))}

    for key, entries in document.items():
        both = isinstance(entries, Mapping) and isinstance(other.get(key), Mapping)
        other[key] = {**other[key], **entries} if both else entries
    return other


def _campaign(
    file: _CampaignFile, path: Path, changed: Mapping[str, Any], *, trust: bool
) -> Campaign:
    """The campaign in a file, with the values of `changed`, which are then no longer drawn."""
    name = folder_name(path.stem if file.name is None else file.name, "name")
    nested = as_dict(_base(file, path.parent, trust=trust))
    for key, entry in {**file.set, **changed}.items():
        put(nested, key, entry)

    distributions = {}
    for key, entry in file.distributions.items():
        if key in changed:
            continue
        try:
            distributions[key] = Distribution.of(entry)
        except ConfigurationError as error:
            raise ConfigurationError(f"{inside('distributions', key)}: {error}") from error

    return Campaign(
        name=name,
        base=replace(from_dict(nested), name=name),
        distributions=distributions,
        metrics=file.metrics.names,
        cases=file.cases,
        seed=file.seed,
        design=file.design,
        bounds=file.bounds,
        kept=file.kept,
        limits=file.limits,
        grid={key: tuple(entries) for key, entries in file.grid.items() if key not in changed},
        versions=file.versions,
        version_cases=file.version_cases,
        also=file.also,
        never=file.never,
    )


def _base(file: _CampaignFile, beside: Path, *, trust: bool) -> Scenario:
    """The job with a name, or the scenario in a file."""
    if file.base in jobs.JOBS:
        quick = {"quick": True} if file.quick else {}
        return jobs.named(file.base)(**{**quick, **file.job})

    if not file.base.endswith(".toml"):
        near = did_you_mean(file.base, jobs.JOBS.names())
        raise ConfigurationError(f"base: allowed {_BASE}, got {shown(file.base)}{near}")
    if file.quick or file.job:
        rule = "only allowed with a job as base, since a scenario file already states its options"
        raise ConfigurationError(f"{'quick' if file.quick else 'job'}: {rule}")
    return read_scenario(beside / file.base, trust=trust)

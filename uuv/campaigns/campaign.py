"""Campaign: a base scenario, distributions of its parameters, and the metrics of each run; as a
value and as a file.

    name = "contact_quick"
    base = "clean-barrel"           # or a scenario file, relative to this one
    quick = true
    cases = 4

    [set]
    "belief.water_error" = 0.0

    [distributions]
    "site.current" = { direction = [0.0, 0.4] }
    "perturbations.Pad.stiffness" = { log_uniform = [1e4, 1e6] }

    [metrics]
    names = ["contact.force_error_rms_n"]

docs/campaigns.md lists all keys.
"""

import copy
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from uuv import jobs
from uuv.campaigns.distributions import DESIGNS, Design, Distribution, drawn
from uuv.experiment.drawn_cases import DrawnCase, read_cases
from uuv.experiment.worker import Limits
from uuv.scenario import Scenario
from uuv.scenario_file import as_dict, assigned, from_dict, put, read_scenario, refuse_code
from uuv.sim.evaluation import schema_files
from uuv.sim.interfaces.documents import inside, named, toml_of
from uuv.sim.interfaces.errors import ConfigurationError, UuvError, did_you_mean
from uuv.sim.interfaces.files import folder_name
from uuv.sim.interfaces.spatial import finite_number, shown, whole_number
from uuv.sim.interfaces.streams import Streams
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.runs.run_folder import FORMAT_KEY

_MOST_CASES = 10_000_000  # runs of a campaign: 10 GB of rows
EXPERIMENT = "campaign"  # whose cases a file of drawn ones holds
_TRACE = 2000  # characters of a traceback that a row keeps
_SEEDS = ("perturbation_seed", "seed")  # drawn for every run
FAILED, CRASHED = "not set up", "crashed"  # states of a run that ended with an error


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """Many runs of one scenario with drawn parameters."""

    name: str
    base: Scenario
    # by dotted key of a scenario file; perturbations.KIND.field
    distributions: Mapping[str, Distribution]
    metrics: tuple[str, ...]  # dotted names of metrics.json
    cases: int
    seed: int = 0
    design: Design = "random"
    # of metrics, at most; none: the verdict of the run
    bounds: Mapping[str, float] = field(default_factory=dict)
    kept: float | None = None  # share of the runs that must keep them; None: no verdict
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        whole_number(self.cases, "cases", least=1, most=_MOST_CASES)
        whole_number(self.seed, "seed")
        if self.design not in DESIGNS:
            raise ConfigurationError(
                f"design: allowed {', '.join(DESIGNS)}, got {shown(self.design)}"
            )
        if self.kept is not None:
            finite_number(self.kept, "kept", least=0.0, most=1.0)
        allowed = metric_names(self.base)
        for name in (*self.metrics, *self.bounds):
            if name not in allowed:
                known = ", ".join(sorted(allowed)) + did_you_mean(name, sorted(allowed))
                raise ConfigurationError(f"no metric {shown(name)}; this task has {known}")
        for name, bound in self.bounds.items():
            finite_number(bound, f"bounds: {name}")
        for name in self.distributions:
            _checked_key(self.base, name)
        self.runs(1)[0].scenario()

    def drawn(self, cases: int | None = None) -> tuple[DrawnCase, ...]:
        """What is drawn for each run of the campaign, or for its first `cases`, by dotted key."""
        count = self.cases if self.design == "latin-hypercube" or cases is None else cases
        values = drawn(self.distributions, count, self.seed, self.design)

        runs = []
        for case, parameters in enumerate(values[:cases]):
            streams = Streams(self.seed, case)
            seeds = {name: int(streams[name].integers(2**31)) for name in _SEEDS}
            runs.append(DrawnCase(case=case, values={**seeds, **parameters}))
        return tuple(runs)

    def runs(self, cases: int | None = None) -> list["CampaignRun"]:
        """The runs of the campaign, or those of its first `cases`."""
        return self.runs_of(self.drawn(cases))

    def runs_of(self, drawn: Iterable[DrawnCase]) -> list["CampaignRun"]:
        """Runs of cases that were drawn, by this campaign or elsewhere."""
        nested, metrics = as_dict(self.base), tuple(dict.fromkeys((*self.metrics, *self.bounds)))
        return [
            CampaignRun(case=case.case, base=nested, values=case.values, metrics=metrics)
            for case in drawn
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRun:
    """One run of a campaign; a small value that a worker can be sent."""

    case: int
    base: Mapping[str, Any]  # tables of the scenario
    values: Mapping[str, Any]  # by dotted key
    metrics: tuple[str, ...]  # dotted names

    def scenario(self) -> Scenario:
        """Its scenario.

        Raises:
            ConfigurationError: A value is not allowed.
        """
        nested = copy.deepcopy(dict(self.base))
        for name, value in self.values.items():
            put(nested, name, value)
        return from_dict(nested)


def read_campaign(
    file: str | Path, changed: Sequence[str] = (), *, trust: bool = False
) -> Campaign:
    """The campaign in a TOML file.

    Args:
        file: The file.
        changed: As for `scenario_file.assigned`, beside the values of its table [set], and in place
            of draws.
        trust: Import the classes MODULE:CLASS that it or its base names, which runs their code.

    Raises:
        ConfigurationError: The file cannot be read, names code without `trust`, or a key or value
            is none of those allowed; the message names them.
    """
    path = Path(file)
    document = toml_of(path, "campaign")
    what = named(path, "campaign")
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
        file: As `uuv.experiment.drawn_cases` reads it; values by dotted key, as they are drawn.
        campaign: The campaign that is to run them.
        changed: As for `scenario_file.assigned`: the campaign has these values in all runs, in
            place of those of the file.

    Raises:
        ConfigurationError: The file holds no cases of a campaign, or a value that is not allowed.
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
            place = named(Path(file), "drawn cases")
            raise ConfigurationError(f"{place}: case {run.case}: {error}") from error
    return drawn


def one_run(task: CampaignRun) -> dict[str, Any]:
    """Row of a run; an error of the run is part of the row."""
    from uuv.assembly import assemble
    from uuv.runner import run

    row = failed_row(task, "")
    try:
        built = assemble(task.scenario())
        row["drawn"] = dict(built.drawn)
        metrics = run(built).assessment.metrics
    except UuvError as error:
        return row | {"code": type(error).__name__, "failed": [str(error)]}
    except Exception as error:
        trace = traceback.format_exc()[-_TRACE:]
        return row | {"state": CRASHED, "code": type(error).__name__, "failed": [trace]}
    own = metrics["run"]
    return row | {
        "state": own["state"],
        "code": own["abort"] or "",
        "accepted": metrics["accepted"],
        "failed": list(metrics["failed"]),
        "trajectory_sha256": own["trajectory_sha256"],
        "metrics": {name: _at(metrics, name) for name in task.metrics},
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _CampaignRow:
    """Entries of a row of a campaign that a summary or a comparison reads."""

    case: int
    values: Mapping[str, Any]
    state: str
    metrics: Mapping[str, float | bool | None]
    drawn: Mapping[str, Any] = field(default_factory=dict)
    code: str = ""
    accepted: bool = False
    failed: list[str] = field(default_factory=list)


def checked_row(row: Mapping[str, Any]) -> Mapping[str, Any]:
    """A row of a campaign as it was read from a file.

    Raises:
        ConfigurationError: It is none.
    """
    TableReader("a row of a campaign", passes_unknown=True).made(_CampaignRow, row)
    return row


def crashed_row(task: CampaignRun, reason: str) -> dict[str, Any]:
    """Row of a run that was ended from outside for `reason`: time, memory, death of its process."""
    return failed_row(task, reason) | {"state": CRASHED}


def failed_row(task: CampaignRun, reason: str) -> dict[str, Any]:
    """Row of a run that could not be begun for `reason`."""
    return {
        "case": task.case,
        "values": dict(task.values),
        "drawn": {},
        "state": FAILED,
        "code": reason,
        "accepted": False,
        "failed": [reason] if reason else [],
        "trajectory_sha256": None,
        "metrics": {},
    }


@cache
def _schema(schema: str) -> Mapping[str, Any]:
    return schema_files.GENERATED[schema]()


def metric_names(scenario: Scenario) -> frozenset[str]:
    """Dotted names of the numbers and verdicts that metrics.json of a run of `scenario` holds."""
    return frozenset(_numbers(_schema(scenario.task.schema)["properties"], ""))


def _numbers(properties: Mapping[str, Any], before: str) -> list[str]:
    found: list[str] = []
    for name, entry in properties.items():
        if "properties" in entry:
            found += _numbers(entry["properties"], f"{before}{name}.")
        elif {"number", "integer", "boolean"} & set(np.atleast_1d(entry.get("type", ())).tolist()):
            found.append(before + name)
    # Timings differ between repetitions; the format is no figure.
    return [name for name in found if name != FORMAT_KEY and not name.startswith("timings.")]


def _at(nested: Any, name: str) -> Any:
    """Value at a dotted name; None where the run gave none."""
    for key in name.split("."):
        nested = nested.get(key) if isinstance(nested, Mapping) else None
    return nested


def _checked_key(base: Scenario, name: str) -> None:
    """Refuses a parameter that the campaign sets itself, or that lies in no table of the
    scenario.
    """
    if name in (*_SEEDS, "name"):
        raise ConfigurationError(f"{name!r} cannot be drawn: the campaign's seed gives it")
    put(as_dict(base), name, None)


_WORD = {"schema": {"title": "letters, digits, - and _"}}
_NAMES = {"schema": {"title": "a list of names", "items": {"title": "a name"}}}
_BASE = f"{', '.join(jobs.JOBS.names())} or a scenario file (.toml)"


@dataclass(frozen=True, slots=True, kw_only=True)
class _MetricNames:
    """Table [metrics] of a campaign's file."""

    names: tuple[str, ...] = field(default=(), metadata=_NAMES)


@dataclass(frozen=True, slots=True, kw_only=True)
class _CampaignFile:
    """Keys of a campaign's file; `Campaign` says what they are."""

    base: str = field(metadata={"schema": {"title": _BASE}})
    cases: int = field(metadata={"schema": {"minimum": 1, "maximum": _MOST_CASES}})
    name: str | None = field(default=None, metadata=_WORD)  # None: that of the file
    quick: bool = False
    job: Mapping[str, Any] = field(default_factory=dict)  # options of the base, as it takes them
    seed: int = field(default=0, metadata={"schema": {"minimum": 0}})
    design: Design = "random"
    set: Mapping[str, Any] = field(default_factory=dict)  # by dotted key of a scenario file
    distributions: Mapping[str, Any] = field(default_factory=dict)  # likewise
    metrics: _MetricNames = field(default_factory=_MetricNames)
    bounds: Mapping[str, float] = field(default_factory=dict)
    kept: float | None = field(default=None, metadata={"schema": {"minimum": 0, "maximum": 1}})
    limits: Limits = field(default_factory=Limits)


_READER = TableReader(places_faults=True)


def _campaign(
    file: _CampaignFile, path: Path, changed: Mapping[str, Any], *, trust: bool
) -> Campaign:
    """The campaign of a file, with the values that are `changed`, which are no longer drawn."""
    name = folder_name(path.stem if file.name is None else file.name, "name")
    nested = as_dict(_base(file, path.parent, trust=trust))
    for key, value in {**file.set, **changed}.items():
        put(nested, key, value)

    distributions = {}
    for key, value in file.distributions.items():
        if key in changed:
            continue
        try:
            distributions[key] = Distribution.of(value)
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
    )


def _base(file: _CampaignFile, beside: Path, *, trust: bool) -> Scenario:
    """A job by its name, or a scenario in a file."""
    if file.base in jobs.JOBS:
        quick = {"quick": True} if file.quick else {}
        return jobs.named(file.base)(**{**quick, **file.job})

    if not file.base.endswith(".toml"):
        near = did_you_mean(file.base, jobs.JOBS.names())
        raise ConfigurationError(f"base: allowed {_BASE}, got {shown(file.base)}{near}")
    if file.quick or file.job:
        rule = "only with a job as base; a scenario file says what its job is"
        raise ConfigurationError(f"{'quick' if file.quick else 'job'}: {rule}")
    return read_scenario(beside / file.base, trust=trust)

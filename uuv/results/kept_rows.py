"""Kept rows: the rows of a whole experiment in a small file, with the code that they depend on.

docs/results/rows/NAME.json contains the rows by column, the command, commit and date, and the last
check: its date, the deviations, and digests of the code that the rows depended on.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from uuv.catalogue import CHECKOUT, EXPERIMENTS
from uuv.experiment.case_options import ExperimentOptions
from uuv.experiment.columns import check_names
from uuv.experiment.declaration import DATA, Experiment
from uuv.experiment.loaded_code import digests
from uuv.experiment.row_log import METRICS, about_of, without_log
from uuv.experiment.row_table import Row, read_rows
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.runs.provenance import commit
from uuv.sim.runs.saving import write_whole

ROWS = CHECKOUT / "docs" / "results" / "rows"
# Code that carries out runs and shows rows, but does not affect their values.
HARNESS = ("uuv/experiment/", "uuv/results/", "uuv/cli/", "sim/runs/", "sim/reporting/")
_DIGITS = 8  # number of characters of a digest, enough to detect a change
_NAMED = 3  # number of changed files that a status names


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """Last comparison of the rows with those of the present code."""

    date: str
    commit: str
    deviations: tuple[str, ...] = ()
    # short digests of the files that the rows depended on, by folder and name
    code: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def changed_files(self) -> list[str]:
        """Files of the code that have changed since the check."""
        files = {f"{folder}/{name}": d for folder, f in self.code.items() for name, d in f.items()}
        present = digests(files)
        return [file for file, digest in files.items() if present[file][:_DIGITS] != digest]


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptRows:
    """Rows of an experiment, their origin, and their last check."""

    experiment: str
    command: str
    commit: str
    date: str
    check: Check
    columns: Mapping[str, list[Any]]

    @property
    def rows(self) -> list[Row]:
        """The rows, in the order of the cases."""
        columns = self.columns.values()

        return [dict(zip(self.columns, row, strict=True)) for row in zip(*columns, strict=True)]

    @property
    def seeds(self) -> str:
        """Seeds of the rows in words; empty if they have none."""
        seeds = sorted(set(self.columns.get("seed", ())))
        if not seeds:
            return ""
        return f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"

    @property
    def is_verified(self) -> bool:
        """Whether the last check found no deviation, and the code has not changed since."""
        return not self.check.deviations and not self.check.changed_files()

    @property
    def status(self) -> str:
        """Validity of the rows for the present code."""
        if self.check.deviations:
            more = (
                f" and {len(self.check.deviations) - 1} more" if self.check.deviations[1:] else ""
            )
            return f"*changed*, by the check of {self.check.date}: {self.check.deviations[0]}{more}"
        if changed := self.check.changed_files():
            named = ", ".join(f"`{file}`" for file in changed[:_NAMED])
            more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
            return f"*unverified*: changed since the check of {self.check.date}: {named}{more}"
        return f"verified {self.check.date}, commit {self.check.commit}"

    def write(self, folder: Path) -> None:
        """Write the file, with a line for each column.

        Raises:
            ConfigurationError: The file cannot be written.
        """
        # one line for each entry, so that a change is visible in a diff
        about = {name: getattr(self, name) for name in ("experiment", "command", "commit", "date")}
        lines = [f" {json.dumps(name)}: {json.dumps(value)}," for name, value in about.items()]
        check = {entry.name: getattr(self.check, entry.name) for entry in fields(self.check)}

        lines.append(f' "check": {_table(check)},')
        lines.append(f' "columns": {_table(self.columns)}')
        write_whole(folder / f"{self.experiment}.json", "{\n" + "\n".join(lines) + "\n}\n")


def kept_rows(name: str, folder: Path = ROWS) -> KeptRows | None:
    """Kept rows of an experiment; None if there are none.

    Raises:
        ConfigurationError: The file cannot be read, or has other content.
    """
    file = folder / f"{name}.json"
    if not file.is_file():
        return None

    record = TableReader(str(file)).made(KeptRows, json_of(file, "kept rows"))
    lengths = {len(column) for column in record.columns.values()}
    if len(lengths) != 1:
        raise ConfigurationError(
            f"{file}: all columns must have the same number of rows, got "
            f"{', '.join(map(str, sorted(lengths)))}"
        )
    return record


def keep(experiment: Experiment[Any, Any], run: Path) -> KeptRows:
    """Kept rows made from a finished run of the experiment.

    Args:
        experiment: The experiment.
        run: Folder of the run.

    Raises:
        ConfigurationError: The folder has no rows, or rows of another version or other code.
    """
    rows = [without_log(row) for row in read_rows(run)]
    if not rows or not (run / METRICS).is_file():
        raise ConfigurationError(
            f"--keep {run}: must be the folder of a finished run of an experiment"
        )
    for row in rows:
        check_names(experiment.columns, row, f"--keep {run}")

    about = about_of(run)
    check = replace(checked(about.code), date=_date_of(run / METRICS))
    if changed := check.changed_files():
        raise ConfigurationError(
            f"--keep {run}: the rows must be made by the present code (changed: "
            f"{', '.join(changed[:_NAMED])})"
        )

    options = experiment.options_with(_known(about.settings, experiment.options))
    return KeptRows(
        experiment=experiment.name,
        command=command_of(experiment, options),
        commit=check.commit,
        date=check.date,
        check=check,
        columns=_by_column(experiment, _in_order(experiment, options, rows)),
    )


def checked(code: Mapping[str, str], deviations: Sequence[str] = ()) -> Check:
    """A check made now.

    Args:
        code: Digests of the files that the rows depended on, in the form of study.json.
        deviations: Differences from the kept rows.
    """
    folders: dict[str, dict[str, str]] = {}
    for file, digest in sorted(code.items()):
        if not file.startswith(HARNESS):
            folder, _, name = file.rpartition("/")
            folders.setdefault(folder, {})[name] = digest[:_DIGITS]

    head = commit()
    changes = " with changes" if head.get("dirty") else ""
    return Check(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        commit=f"{head['commit'][:_DIGITS]}{changes}" if head else "unknown",
        deviations=tuple(deviations),
        code=folders,
    )


def command_of(experiment: Experiment[Any, Any], options: ExperimentOptions) -> str:
    """Command line with all options of the cases that differ from their defaults."""
    return " ".join(
        [f"./uvw run {file_of(experiment).relative_to(CHECKOUT).as_posix()}", *_quoted(options)]
    )


def words_of(options: ExperimentOptions) -> list[str]:
    """Words of the command line for all options of the cases that differ from their defaults."""
    harness = {entry.name for entry in fields(ExperimentOptions)}
    words: list[str] = []
    for entry in fields(options):
        value = getattr(options, entry.name)
        option = f"--{entry.name.replace('_', '-')}"
        if entry.name in harness or value == entry.default or value is None:
            continue

        if isinstance(value, bool):
            words.append(option if value else f"--no-{option[2:]}")
        else:
            several = isinstance(value, tuple | list)
            words += [option, *map(str, value if several else [value])]
    return words


def file_of(experiment: Experiment[Any, Any]) -> Path:
    """File of an experiment in the checkout."""
    return EXPERIMENTS.parent.joinpath(*experiment.__module__.split(".")).with_suffix(".py")


def _quoted(options: ExperimentOptions) -> list[str]:
    return [f"'{word}'" if " " in word else word for word in words_of(options)]


def _known(settings: Mapping[str, Any], kind: type[ExperimentOptions]) -> dict[str, Any]:
    """Settings of study.json as options of the cases."""
    harness = {entry.name for entry in fields(ExperimentOptions)}
    known = {entry.name for entry in fields(kind)} - harness

    chosen: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in settings.items()
        if name in known
    }
    if isinstance(chosen.get(DATA), str):
        chosen[DATA] = Path(chosen[DATA])
    return chosen


def _in_order(
    experiment: Experiment[Any, Any], options: ExperimentOptions, rows: Sequence[Row]
) -> list[Row]:
    """Rows in the order of the cases; they are stored in the order in which the runs ended."""
    places = {
        experiment.case_key(case): i for i, case in enumerate(experiment.study(options).cases)
    }

    keyed = {experiment.row_key(row): row for row in rows}
    lacking = [key for key in places if key not in keyed]
    if lacking:
        raise ConfigurationError(
            f"experiment {experiment.name}: {len(lacking)} of {len(places)} cases have no row"
        )
    return [keyed[key] for key in places]


def _by_column(experiment: Experiment[Any, Any], rows: Sequence[Row]) -> dict[str, list[Any]]:
    return {name: [row[name] for row in rows] for name in experiment.columns}


def _date_of(file: Path) -> str:
    return f"{datetime.fromtimestamp(file.stat().st_mtime, UTC):%Y-%m-%d}"


def _table(table: Mapping[str, Any]) -> str:
    """A table as JSON, with a line for each of its entries."""
    lines = (f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in table.items())
    return "{\n" + ",\n".join(lines) + "\n }"

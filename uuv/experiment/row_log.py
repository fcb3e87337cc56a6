"""Rows of a study on disk, with the code and options that they depend on; one process writes."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from uuv.experiment.loaded_code import digests
from uuv.experiment.row_table import SCHEMA_VERSION, Row, RowTable, delete_rows, has_rows
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.tables import TableReader
from uuv.sim.runs.provenance import versions
from uuv.sim.runs.run_folder import alone_in
from uuv.sim.runs.saving import write_json

# wall and processor time of a run [s]; None if its process died
Timing = Mapping[str, float | None]
KEY, TIMING = "case_id", "timing"  # entries that the log adds to a row
ABOUT = "study.json"  # file with the code and options that the rows depend on
METRICS, PAGE = "metrics.json", "report.html"  # files that are made from the rows of a log
_EARLIER = "results.jsonl"  # file of rows in the format before Parquet
_NAMED = 4  # number of changed files that a message names


class RowLog:
    """Rows of a study by case, and study.json: settings, versions, and digests of the code."""

    def __init__(
        self, folder: Path, *, anew: bool = False, of: Mapping[str, Any] | None = None
    ) -> None:
        """Open the log in `folder`.

        Only one process may do so at a time: see `open`.

        Args:
            folder: Existing folder.
            anew: Whether to delete old rows.
            of: Options that all its rows share, of JSON types, by name.

        Raises:
            ConfigurationError: The rows were made by other code or with other options, or the
                folder contains other files.
        """
        self.folder = folder
        self._of = dict(of or {})
        self._about = folder / ABOUT
        foreign = [
            path.name
            for path in folder.iterdir()
            if path.is_file() and not path.name.startswith(".")
        ]

        # Rows need their study.json. A folder with other files is left unchanged.
        if not self._about.exists() and has_rows(folder) and not anew:
            raise ConfigurationError(
                f"{folder} has rows, but {ABOUT} is missing, so their code and options are "
                "unknown; restore that file, or discard the rows by --anew"
            )
        if foreign and not self._about.exists() and not has_rows(folder):
            raise ConfigurationError(
                f"{folder} has files that are no experiment's ({', '.join(sorted(foreign))})"
            )

        for part in folder.glob(".*.parquet.*"):  # temporary files of a process that was killed
            part.unlink()
        if anew:
            delete_rows(folder)
            for name in (METRICS, PAGE, _EARLIER):
                (folder / name).unlink(missing_ok=True)

        if (folder / _EARLIER).exists():
            raise ConfigurationError(
                f"{folder} has rows of an earlier version ({_EARLIER}); discard them by --anew, or "
                "give another --out"
            )

        # Old rows must have the same options and the same code.
        self._code: dict[str, str] = {}
        self._settings: Mapping[str, Any] = {}
        if has_rows(folder):
            about = _read_about(self._about)
            self._code = dict(about.code)
            self._settings = about.settings
            before = about.of

            if other := [name for name, value in self._of.items() if before.get(name) != value]:
                present, requested = (
                    ", ".join(f"{name} {of.get(name)}" for name in other)
                    for of in (before, self._of)
                )
                raise ConfigurationError(
                    f"{folder} has runs of {present}, but runs of {requested} are requested; "
                    "discard the former by --anew, or give another --out"
                )

            if changed := self._changed(about):
                more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
                raise ConfigurationError(
                    f"{folder} has runs of other code (changed: "
                    f"{', '.join(changed[:_NAMED])}{more}); discard them by --anew, or give "
                    "another --out"
                )
        else:
            self._write_about()

        self._table = RowTable(folder)
        self.rows: dict[str, Row] = by_case(self._table.rows, folder)
        # in the table
        self._numbers = {row[KEY]: number for number, row in enumerate(self._table.rows)}

    @classmethod
    @contextmanager
    def open(
        cls, folder: Path, *, anew: bool = False, of: Mapping[str, Any] | None = None
    ) -> Iterator[Self]:
        """Context manager: the log in `folder`, created if necessary, locked for this process.

        Args:
            folder: Folder of the study.
            anew: Whether to delete old rows.
            of: Options that all its rows share, of JSON types, by name.

        Raises:
            ConfigurationError: As for `RowLog`, or another process works in the folder.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f"--out {folder}: the folder cannot be created ({error.strerror})"
            ) from error
        with alone_in(folder):
            yield cls(folder, anew=anew, of=of)

    def has(self, key: str) -> bool:
        """True if the case has a row of a run that ended; a run whose process died is repeated."""
        return key in self.rows and self.rows[key][TIMING]["wall_s"] is not None

    def depends_on(self, code: Mapping[str, str]) -> None:
        """Add files, named as in `loaded_files`, to those that the rows depend on.

        Args:
            code: Digests of the files, as read by a process of the study.

        Raises:
            ConfigurationError: Two processes have read different contents of a file.
        """
        if other := [
            file for file, digest in code.items() if self._code.get(file, digest) != digest
        ]:
            raise ConfigurationError(
                f"{', '.join(other[:_NAMED])}: changed during the experiment, or differs between "
                "machines; the existing rows belong to the earlier content"
            )

        if code.keys() - self._code.keys():
            self._code |= code
            self._write_about()

    def made_with(self, settings: Mapping[str, Any]) -> None:
        """Write the settings of the study, which are JSON types, to study.json."""
        if settings != self._settings:
            self._settings = settings
            self._write_about()

    def add(self, done: Iterable[tuple[str, Row, Timing]]) -> None:
        """Add rows, which replace those of the same cases. They are on disk when this returns.

        Args:
            done: For each case its key, its result in JSON types, and its times.

        Raises:
            ConfigurationError: A file cannot be written.
        """
        rows = {key: {**row, KEY: key, TIMING: dict(timing)} for key, row, timing in done}

        # Rows of known cases are replaced; the other rows are appended.
        self._table.replace(
            {self._numbers[key]: row for key, row in rows.items() if key in self._numbers}
        )
        new = [key for key in rows if key not in self._numbers]
        start = len(self._table.rows)
        self._table.extend([rows[key] for key in new])
        self._numbers |= {key: start + k for k, key in enumerate(new)}

        self.rows |= rows

    def _write_about(self) -> None:
        about = {
            "schema": SCHEMA_VERSION,
            "settings": self._settings,
            "of": self._of,
            "versions": versions(),
            "code": self._code,
        }
        write_json(self._about, about)

    def _changed(self, about: "RowsAbout") -> list[str]:
        current = digests(self._code)
        files = [file for file, digest in self._code.items() if current[file] != digest]
        return files if about.versions == versions() else [*files, "versions of packages"]


def by_case(rows: Iterable[Row], folder: Path) -> dict[str, Row]:
    """Rows of a log by the key of their case.

    Raises:
        ConfigurationError: A row has no key, or lacks other entries that the log adds.
    """
    reader = TableReader("a row", passes_unknown=True)
    try:
        return {reader.made(_Logged, row).case_id: row for row in rows}
    except ConfigurationError as error:
        raise ConfigurationError(f"{folder}: {error}; discard the rows by --anew") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class _Times:
    """Computing times of a run, as stored in a row."""

    wall_s: float | None
    cpu_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Logged:
    """Entries that the log adds to a row; the fields are KEY and TIMING."""

    case_id: str
    timing: _Times


@dataclass(frozen=True, slots=True, kw_only=True)
class RowsAbout:
    """Content of study.json."""

    schema: int = SCHEMA_VERSION
    settings: Mapping[str, Any] = field(default_factory=dict)
    of: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    code: Mapping[str, str] = field(default_factory=dict)


def about_of(folder: Path) -> RowsAbout:
    """Code and options that the rows in a folder depend on.

    Raises:
        ConfigurationError: The file is missing, or has other content.
    """
    return _read_about(folder / ABOUT)


def _read_about(file: Path) -> RowsAbout:
    try:
        return TableReader(ABOUT).made(RowsAbout, json_of(file, "study"))
    except ConfigurationError as error:
        raise ConfigurationError(f"{error} ({file}); discard the rows by --anew") from error


def without_log(row: Row) -> Row:
    """A row without the entries that the log adds."""
    return {name: value for name, value in row.items() if name not in (KEY, TIMING)}

"""Rows of a study on disk, and what they depend on: one process writes, one code."""

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

Timing = Mapping[str, float | None]  # wall and processor time of a run [s]; None: its process died
KEY, TIMING = "case_id", "timing"  # entries that the log adds to a row
ABOUT = "study.json"  # what the rows depend on
METRICS, PAGE = "metrics.json", "report.html"  # files made from the rows of a log
_EARLIER = "results.jsonl"  # rows before they were Parquet
_NAMED = 4  # changed files that a message names


class RowLog:
    """Rows of a study by case, and study.json: settings, versions, and digests of the code."""

    def __init__(
        self, folder: Path, *, anew: bool = False, of: Mapping[str, Any] | None = None
    ) -> None:
        """Opens the log in `folder`.

        For one process at a time: see `open`.

        Args:
            folder: Existing folder.
            anew: Delete old rows.
            of: Options that all its rows share, of JSON types, by name.

        Raises:
            ConfigurationError: The rows were made by other code or with other options, or the
                folder holds other files.
        """
        self.folder = folder
        self._of = dict(of or {})
        self._about = folder / ABOUT
        foreign = [
            path.name
            for path in folder.iterdir()
            if path.is_file() and not path.name.startswith(".")
        ]

        # Rows need their study.json, and a folder of other files is left alone.
        if not self._about.exists() and has_rows(folder) and not anew:
            raise ConfigurationError(
                f"{folder} holds rows, but {ABOUT} is missing, so their code and options are "
                "unknown; restore it, or --anew discards them"
            )
        if foreign and not self._about.exists() and not has_rows(folder):
            raise ConfigurationError(
                f"{folder} holds files that are not of an experiment ({', '.join(sorted(foreign))})"
            )

        for part in folder.glob(".*.parquet.*"):  # of a process that was killed
            part.unlink()
        if anew:
            delete_rows(folder)
            for name in (METRICS, PAGE, _EARLIER):
                (folder / name).unlink(missing_ok=True)

        if (folder / _EARLIER).exists():
            raise ConfigurationError(
                f"{folder} holds rows of an earlier version ({_EARLIER}); --anew discards them, "
                "or take another --out"
            )

        # Old rows must be of the same options and the same code.
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
                    f"{folder} holds runs of {present}, requested are those of {requested}; --anew "
                    "discards them, or take another --out"
                )

            if changed := self._changed(about):
                more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
                raise ConfigurationError(
                    f"{folder} holds runs of other code (changed: "
                    f"{', '.join(changed[:_NAMED])}{more}); --anew discards them, or take another "
                    "--out"
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
            anew: Delete old rows.
            of: Options that all its rows share, of JSON types, by name.

        Raises:
            ConfigurationError: As `RowLog` does, or another process works in the folder.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f"--out {folder}: cannot be made a folder ({error.strerror})"
            ) from error
        with alone_in(folder):
            yield cls(folder, anew=anew, of=of)

    def has(self, key: str) -> bool:
        """True if that case has a row of a run that ended; one whose process died is done again."""
        return key in self.rows and self.rows[key][TIMING]["wall_s"] is not None

    def depends_on(self, code: Mapping[str, str]) -> None:
        """Adds files, by name as of `loaded_files`, to those that the rows depend on.

        Args:
            code: Their digests, as a process of the study has read them.

        Raises:
            ConfigurationError: A process has read another content of a file than an earlier one.
        """
        if other := [
            file for file, digest in code.items() if self._code.get(file, digest) != digest
        ]:
            raise ConfigurationError(
                f"{', '.join(other[:_NAMED])}: changed during the experiment, or different on "
                "another machine; the existing rows are of the earlier content"
            )

        if code.keys() - self._code.keys():
            self._code |= code
            self._write_about()

    def made_with(self, settings: Mapping[str, Any]) -> None:
        """Puts the settings of the study, of JSON types, into study.json."""
        if settings != self._settings:
            self._settings = settings
            self._write_about()

    def add(self, done: Iterable[tuple[str, Row, Timing]]) -> None:
        """Adds rows, in place of those of the same cases; they are on the disk when this returns.

        Args:
            done: Key of a case, its result, of JSON types, and its times; for each.

        Raises:
            ConfigurationError: A file cannot be written.
        """
        rows = {key: {**row, KEY: key, TIMING: dict(timing)} for key, row, timing in done}

        # Rows of known cases are replaced, the others follow.
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
        ConfigurationError: One has none, or lacks what the log adds to a row.
    """
    reader = TableReader("a row", passes_unknown=True)
    try:
        return {reader.made(_Logged, row).case_id: row for row in rows}
    except ConfigurationError as error:
        raise ConfigurationError(f"{folder}: {error}; --anew discards the rows") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class _Times:
    """Times of a run, as a row holds them."""

    wall_s: float | None
    cpu_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Logged:
    """What the log adds to a row; the fields are KEY and TIMING."""

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
    """What the rows in a folder depend on.

    Raises:
        ConfigurationError: There is no such file, or it holds something else.
    """
    return _read_about(folder / ABOUT)


def _read_about(file: Path) -> RowsAbout:
    try:
        return TableReader(ABOUT).made(RowsAbout, json_of(file, "study"))
    except ConfigurationError as error:
        raise ConfigurationError(f"{error} ({file}); --anew discards the rows") from error


def without_log(row: Row) -> Row:
    """A row without what the log adds to it."""
    return {name: value for name, value in row.items() if name not in (KEY, TIMING)}

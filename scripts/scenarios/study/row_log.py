"""Log of a study's rows, one JSON object a line, from which an interrupted study is resumed."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from scenarios.study.loaded_code import digests
from scenarios.study.summary import Row
from sim.interfaces.errors import ConfigurationError
from sim.runs.provenance import versions
from sim.runs.run_folder import alone_in
from sim.runs.saving import write_json

KEY, TIMING = "case_id", "timing"  # entries that the log adds to a row
METRICS, PAGE = "metrics.json", "report.html"  # files made from the rows of a log
_NAMED = 4  # changed files that a message names


class RowLog:
    """results.jsonl of a study, beside study.json: versions and digests of the files that the rows depend on."""

    def __init__(self, folder: Path, *, anew: bool = False) -> None:
        """Opens the log in `folder`.

        For one process at a time: see `open`.

        Args:
            folder: Existing folder.
            anew: Delete old rows.

        Raises:
            ConfigurationError: The rows were made by other code, or the folder holds other files.
        """
        self.folder = folder
        self._file, self._about = folder / "results.jsonl", folder / "study.json"
        foreign = [path.name for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
        if foreign and not self._about.exists():
            raise ConfigurationError(
                f"{folder} is in use by something else than a study ({', '.join(sorted(foreign))})"
            )
        if anew:
            for name in (self._file.name, METRICS, PAGE):
                (folder / name).unlink(missing_ok=True)
        self._code: dict[str, str] = {}
        if self._file.exists() and self._file.stat().st_size:
            about = json.loads(self._about.read_text(encoding="utf-8"))
            self._code = about.get("code", {})
            if changed := self._changed(about):
                more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
                raise ConfigurationError(
                    f"{folder} holds runs of other code (changed: {', '.join(changed[:_NAMED])}{more}); --anew throws "
                    "them away, or take another --out"
                )
        else:
            self._write_about()
        self.rows: dict[str, Row] = {row[KEY]: row for row in _whole_lines(self._file)}

    @classmethod
    @contextmanager
    def open(cls, folder: Path, *, anew: bool = False) -> Iterator[Self]:
        """Context manager: the log in `folder`, created if necessary, locked for this process.

        Args:
            folder: Folder of the study.
            anew: Delete old rows.

        Raises:
            ConfigurationError: As `RowLog` does, or another process works in the folder.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(f"--out {folder}: cannot be made a folder ({error.strerror})") from error
        with alone_in(folder):
            yield cls(folder, anew=anew)

    def depends_on(self, files: Iterable[str]) -> None:
        """Adds files, named as by `loaded_files`, to those that the rows depend on."""
        if new := set(files) - self._code.keys():
            self._code |= digests(new)
            self._write_about()

    def add(self, key: str, row: Row, timing: Mapping[str, float | None]) -> None:
        """Appends a row; it is on the disk when this returns.

        Args:
            key: Identifies the case.
            row: Its result, of JSON types.
            timing: Wall and processor time [s].

        Raises:
            ConfigurationError: The file cannot be written.
        """
        self.rows[key] = {**row, KEY: key, TIMING: timing}
        try:
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps(self.rows[key], allow_nan=False) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ConfigurationError(f"{self._file}: cannot be written ({error.strerror})") from error

    def _write_about(self) -> None:
        write_json(self._about, {"versions": versions(), "code": self._code})

    def _changed(self, about: dict[str, Any]) -> list[str]:
        now = digests(self._code)
        files = [file for file, digest in self._code.items() if now[file] != digest]
        return files if about.get("versions") == versions() else [*files, "versions of packages"]


def _whole_lines(file: Path) -> list[Row]:
    """Rows of a log; a last line that was cut short by an interruption is removed from the file.

    Raises:
        ConfigurationError: An invalid line is followed by rows. That is no interruption, and those rows are valuable.
    """
    if not file.exists():
        return []
    rows: list[Row] = []
    whole = 0  # bytes of valid lines
    bad = 0  # number of the first invalid line
    with file.open("rb+") as log:
        for number, line in enumerate(log, start=1):
            row = _row(line)
            if row is None:
                bad = bad or number
            elif bad:
                raise ConfigurationError(
                    f"{file}: line {bad} is no row of a study, and rows follow it; mend it or take it out (--anew "
                    "throws all of them away)"
                )
            else:
                rows.append(row)
                whole += len(line)
        log.truncate(whole)
    return rows


def _row(line: bytes) -> Row | None:
    """Row in a line of a log; None for a line that was cut short, also by a power failure."""
    try:
        row = json.loads(line)
    except ValueError:
        return None
    return row if line.endswith(b"\n") and isinstance(row, dict) and KEY in row else None

"""Result log of a study, one JSON row a line, from which an interrupted study resumes."""

import ast
import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from scenarios.campaigns.contact_study import CRASHED, RunTask
from sim.interfaces.errors import ConfigurationError
from sim.runs.command_line import ROOMS
from sim.runs.provenance import versions
from sim.runs.run_folder import alone_in
from sim.runs.saving import write_json

Row = dict[str, Any]
_MADE_OF_IT = ("metrics.json", "report.html")  # files made from the runs in a log


class StudyLog:
    """results.jsonl of a study, beside study.json with its settings."""

    def __init__(self, folder: Path, settings: dict[str, Any], *, anew: bool = False) -> None:
        """Opens the log in `folder`; a log of the same settings and code is resumed.

        For one process at a time: see `open`.

        Args:
            folder: Existing folder.
            settings: Settings of the study.
            anew: Delete old runs.

        Raises:
            ConfigurationError: The log is of another study, or the folder holds other files.
        """
        self._file, about = folder / "results.jsonl", folder / "study.json"
        said = json.loads(json.dumps({**settings, "code": fingerprint(), "versions": versions()}))
        foreign = [path.name for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
        if foreign and not about.exists():
            raise ConfigurationError(
                f"{folder} is in use by something else than a study ({', '.join(sorted(foreign))})"
            )
        if anew:
            for name in (self._file.name, *_MADE_OF_IT):
                (folder / name).unlink(missing_ok=True)
        elif self._file.exists() and (old := json.loads(about.read_text(encoding="utf-8"))) != said:
            other = sorted(key for key in {*old, *said} if old.get(key) != said.get(key))
            raise ConfigurationError(
                f"{folder} holds runs of another study (other: {', '.join(other)}); --anew throws them away, or take "
                "another --out"
            )
        write_json(about, said)
        self.rows = _whole_lines(self._file)

    @classmethod
    @contextmanager
    def open(cls, folder: Path, settings: dict[str, Any], *, anew: bool = False) -> Iterator[Self]:
        """Context manager: the log in `folder`, created if necessary, locked for this process.

        Args:
            folder: Folder of the study.
            settings: Settings of the study.
            anew: Delete old runs.

        Raises:
            ConfigurationError: As `StudyLog` does, or another process works in the folder.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(f"--out {folder}: cannot be made a folder ({error.strerror})") from error
        with alone_in(folder):
            yield cls(folder, settings, anew=anew)

    def add(self, row: Row) -> None:
        """Appends `row`; it is on the disk when this returns.

        Raises:
            ConfigurationError: The file cannot be written.
        """
        self.rows.append(row)
        try:
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row, allow_nan=False) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ConfigurationError(f"{self._file}: cannot be written ({error.strerror})") from error


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
    return row if line.endswith(b"\n") and isinstance(row, dict) else None


def fingerprint() -> str:
    """Hash of all code and models that a run depends on: every file of the rooms, and the scripts of the study."""
    home, digest = Path(__file__).resolve().parents[3], hashlib.sha256()
    of_rooms = (path for room in ROOMS for path in (home / room).rglob("*"))
    kept = {path for path in of_rooms if path.is_file() and "__pycache__" not in path.parts}
    for file in sorted(
        kept | imported_scripts(home / "scripts" / "scenarios" / "campaigns" / "contact_study.py", home / "scripts")
    ):
        digest.update(file.relative_to(home).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def imported_scripts(file: Path, scripts: Path) -> set[Path]:
    """`file` and all files below the folder `scripts` that it imports, directly or through others."""
    found, ahead = set[Path](), [file]
    while ahead:
        path = ahead.pop()
        if path in found or not path.is_file():
            continue
        found.add(path)
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            else:
                continue
            ahead += [scripts / f"{name.replace('.', '/')}.py" for name in names]
    return found


def died(task: RunTask) -> Row:
    """Row of a run that crashed its process."""
    return {
        "run": task.run,
        "without": task.without,
        "path": task.path,
        "seed": None,
        "varied": {},
        "class": CRASHED,
        "kind": "its process died",
        "detail": "",
        "missed": [],
        "figures": {},
        "timing": {"wall_s": None, "cpu_s": None},
    }


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows sorted by method and run, without the timing, which differs between repetitions."""
    rows = sorted(rows, key=lambda row: (row["without"], row["run"]))
    return [{key: value for key, value in row.items() if key != "timing"} for row in rows]

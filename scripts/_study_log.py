"""The rows of a study, kept line by line, so that it goes on where it was stopped."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from _study import CRASHED, Task

from sim.interfaces.errors import ConfigurationError
from sim.startup import ROOMS

Row = dict[str, Any]


class Log:
    """results.jsonl of a study, with study.json beside it that says what the study is."""

    def __init__(self, folder: Path, settings: dict[str, Any], *, anew: bool = False) -> None:
        """Open the log in `folder`, to be gone on with if it is of the same `settings` and the same code.

        Raises ConfigurationError if it is of others; `anew` throws those away.
        """
        self._file, about = folder / "results.jsonl", folder / "study.json"
        said = json.dumps({**settings, "code": fingerprint()}, indent=2, sort_keys=True) + "\n"
        if anew:
            self._file.unlink(missing_ok=True)
        elif self._file.exists() and about.exists() and about.read_text(encoding="utf-8") != said:
            old = json.loads(about.read_text(encoding="utf-8"))
            new = json.loads(said)
            other = sorted(key for key in {*old, *new} if old.get(key) != new.get(key))
            raise ConfigurationError(
                f"{folder} holds runs of another study (other: {', '.join(other)}); --anew throws them away, or take "
                "another --out"
            )
        about.write_text(said, encoding="utf-8")
        self.rows = _whole_lines(self._file)

    def add(self, row: Row) -> None:
        self.rows.append(row)
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row, allow_nan=False) + "\n")


def _whole_lines(file: Path) -> list[Row]:
    """The rows of a log; a last line that was cut short when the study was stopped is taken off the file."""
    if not file.exists():
        return []
    text = file.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if len(whole) < len(text):
        file.write_bytes(whole)
    return [json.loads(line) for line in whole.splitlines()]


def fingerprint() -> str:
    """Of all code and models that a run depends on."""
    home, digest = Path(__file__).resolve().parents[1], hashlib.sha256()
    folders = [*(home / room for room in ROOMS), home / "scripts"]
    for file in sorted(path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".xml")):
        if file.parent.name != "scripts" or file.name in _OURS:
            digest.update(file.relative_to(home).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()[:16]


_OURS = ("_study.py", "_job.py", "_job_parts.py", "_variation.py", "clean_barrel.py")


def died(task: Task) -> Row:
    """The row of a run that killed its process."""
    return {
        "run": task.run, "without": task.without, "path": task.path, "seed": None, "varied": {}, "class": CRASHED,
        "kind": "its process died", "detail": "", "missed": [], "figures": {},
        "timing": {"wall_s": None, "cpu_s": None},
    }  # fmt: skip


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows by run and method, without what differs from one time to another."""
    rows = sorted(rows, key=lambda row: (row["without"], row["run"]))
    return [{key: value for key, value in row.items() if key != "timing"} for row in rows]

"""Runs of a study on all cores: each in a process of its own making, kept line by line, resumed where they stopped."""

import hashlib
import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from _study import CRASHED, Task, one_run

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


def run_all(
    tasks: Sequence[Task], workers: int, run: Callable[[Task], Row] = one_run
) -> Iterator[tuple[Task, Row]]:  # fmt: skip
    """Do all `tasks` in `workers` processes; each with its row, as they are done.

    What a run gives does not depend on the others, nor on the process that it is in. A process that dies takes its pool
    with it: the runs that were under way are then done one at a time, and one that kills its process again is a row of
    class CRASHED.
    """
    waiting, suspects = list(reversed(tasks)), []
    while waiting or suspects:
        alone = bool(suspects)
        source, size = (suspects, 1) if alone else (waiting, workers)
        under_way: dict[Future[Row], Task] = {}
        with _pool(size) as pool:
            try:
                while source or under_way:
                    while source and len(under_way) < size:
                        task = source.pop()
                        under_way[pool.submit(run, task)] = task
                    for done in wait(under_way, return_when=FIRST_COMPLETED).done:
                        row = done.result()
                        yield under_way.pop(done), row
            except BrokenProcessPool:
                lost = list(under_way.values())
                if alone:
                    yield lost[0], _died(lost[0])
                else:
                    suspects += reversed(lost)
            except BaseException:
                _stop(pool)
                raise


def _pool(workers: int) -> ProcessPoolExecutor:
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the workers: they share the cores by themselves
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends a worker without a word; the study says it once


def _stop(pool: ProcessPoolExecutor) -> None:
    for process in multiprocessing.active_children():
        process.terminate()
    pool.shutdown(wait=False, cancel_futures=True)


def _died(task: Task) -> Row:
    return {
        "run": task.run, "without": task.without, "path": task.path, "seed": None, "varied": {}, "class": CRASHED,
        "kind": "its process died", "detail": "", "missed": [], "figures": {},
        "timing": {"wall_s": None, "cpu_s": None},
    }  # fmt: skip


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows by run and method, without what differs from one time to another."""
    rows = sorted(rows, key=lambda row: (row["without"], row["run"]))
    return [{key: value for key, value in row.items() if key != "timing"} for row in rows]

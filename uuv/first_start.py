"""First start: compiles the loop's kernels on all cores instead of one by one in one process.

The list (first_start.json, written by `scripts/experiments/runtime/list_kernels.py`) contains the
kernels that a contact job needs, their argument types, and their callees. The list only saves time.
A kernel that is not in the list, or whose argument types have changed, is compiled when it is first
called.
"""

import contextlib
import importlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numba
import numpy as np
from numba.core.registry import CPUDispatcher
from numba.np import numpy_support
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from uuv.sim.evaluation.run_metrics import StartMetrics
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.kernels import is_stored, store
from uuv.sim.interfaces.kernels.record_box import RecordBoxType
from uuv.sim.interfaces.kernels.stored import counts
from uuv.sim.interfaces.tables import TableReader

LIST = Path(__file__).with_suffix(".json")
# Functions that compile kernels: argument, time [s] (roughly), kernels to compile before.
CALLS = (
    ("uuv.sim.hydrodynamics:install", (), 8.0, "uuv.sim.native."),
    ("uuv.controllers.ik.entries:entry", ("kinematics",), 0.5, "uuv.controllers.ik."),
    ("uuv.controllers.ik.entries:entry", ("keep",), 2.0, "uuv.controllers.ik."),
    ("uuv.controllers.ik.entries:entry", ("hybrid",), 4.0, "uuv.controllers.ik."),
)
PACKAGE = "uuv"
# the names of this module are made at run time
_config: Any = importlib.import_module("numba.core.config")
MOST = 8  # largest number of processes; more would wait for each other


WORTH_IT = 4.0  # [s] of compilation above which separate processes save time
SILENCE = 10.0  # [s] between two lines if the output is not a terminal
_READER = TableReader("a row of the list")
_complete = False  # `build` has found all kernels in the store; set once in a process


@dataclass(frozen=True, slots=True)
class KernelJob:
    """One kernel to compile, or a function to call that compiles some kernels."""

    kernel: str  # module:name
    takes: list[Any] | None  # encoded types of its arguments; None for a function to call
    given: tuple[str, ...]  # argument of the function
    after: tuple[int, ...]  # rows of the list with its callees
    # [s] time on one core, without the callees, on the machine where the list was made
    seconds: float

    def do(self) -> None:
        """Compile the kernel into the store."""
        if self.takes is None:
            self._named()(*self.given)
        else:
            self._named().compile(self._types())

    def is_stored(self) -> bool:
        """True if the store has its machine code; always False for a function to call."""
        return self.takes is not None and is_stored(self._named(), self._types())

    def _named(self) -> Any:
        module, name = self.kernel.split(":")
        try:
            return getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            anew = "scripts/experiments/runtime/list_kernels.py makes a new list"
            raise UuvError(f"list of kernels: {self.kernel} does not exist; {anew}") from error

    def _types(self) -> tuple[Any, ...]:
        return tuple(decoded(described) for described in self.takes or ())


@cache
def jobs() -> list[KernelJob]:
    """The list, in which the callees of a job come before the job."""
    return [_READER.made(KernelJob, row) for row in json_of(LIST, "list of kernels")]


def encoded(kind: Any) -> Any:
    """Numba's type `kind` as values of JSON.

    Raises:
        UuvError: There is no encoding for such a type.
    """
    types = numba.types
    if isinstance(kind, types.Array):
        flags = ("" if kind.mutable else "readonly ") + ("" if kind.aligned else "unaligned ")
        return {f"{flags}{kind.ndim}{kind.layout}": encoded(kind.dtype)}
    if isinstance(kind, types.Record):
        return {"record": np.lib.format.dtype_to_descr(numpy_support.as_dtype(kind))}

    # A named tuple is also a tuple, so it is tested first.
    if isinstance(kind, (types.NamedTuple, types.NamedUniTuple)):
        of = kind.instance_class
        return {f"{of.__module__}:{of.__qualname__}": [encoded(inner) for inner in kind.types]}
    if isinstance(kind, (types.Tuple, types.UniTuple)):
        return [encoded(inner) for inner in kind.types]
    if isinstance(kind, RecordBoxType):
        return {"box": encoded(kind.field_dict["record"])}
    if isinstance(kind, types.Literal):
        return {"literal": kind.literal_value}

    if isinstance(kind, (types.Number, types.Boolean, types.NoneType)):
        return str(kind)

    raise UuvError(f"list of kernels: there is no encoding for numba's type {kind}")


def decoded(value: Any) -> Any:
    """Numba's type, from a result of `encoded`."""
    types = numba.types
    if isinstance(value, str):
        return getattr(types, {"bool": "boolean"}.get(value, value))
    if isinstance(value, list):
        return types.BaseTuple.from_types([decoded(inner) for inner in value])

    ((word, inner),) = value.items()
    if word == "record":
        return numba.from_dtype(np.lib.format.descr_to_dtype(_as_descr(inner)))
    if word == "box":
        return RecordBoxType([("record", decoded(inner))])
    if word == "literal":
        return types.literal(inner)

    if ":" in word:
        module, name = word.split(":")
        return types.BaseTuple.from_types(
            [decoded(entry) for entry in inner], getattr(importlib.import_module(module), name)
        )

    *flags, form = word.split()
    return types.Array(
        decoded(inner),
        int(form[:-1]),
        form[-1],
        readonly="readonly" in flags,
        aligned="unaligned" not in flags,
    )


def _as_descr(rows: Any) -> Any:
    """Description of a numpy dtype after a round trip through JSON, which has no tuples."""
    if not isinstance(rows, list):
        return rows
    return [
        tuple(tuple(part) if i == 2 else _as_descr(part) for i, part in enumerate(row))
        for row in rows
    ]


class _Worker:
    """Process that compiles one kernel after the other."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "uuv.first_start"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def compile(self, row: int) -> bool:
        """Compile the kernel of a row; False if that failed, or if the process has died."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(f"{row}\n")
            self._process.stdin.flush()
            return self._process.stdout.readline().strip() == "done"
        except OSError:
            return False

    def end(self) -> None:
        """Stop the process, also during a compilation."""
        self._process.kill()
        self._process.communicate()


def build() -> int:
    """Compile the kernels that the loop needs and the store lacks, on all cores, with progress on
    stderr.

    A kernel that cannot be compiled here is left to its first call, which raises the error.

    Returns:
        Number of kernels compiled.
    """
    global _complete
    if _config.DISABLE_JIT or _complete:
        return 0

    rows = jobs()
    lacking = {
        row: job.seconds
        for row, job in enumerate(rows)
        if job.takes is not None and not job.is_stored()
    }
    if sum(lacking.values()) < WORTH_IT:
        _complete = True
        return 0

    # The kernels that the calls compile are not listed; each call takes a moment if the store has
    # them.
    lacking |= {row: job.seconds for row, job in enumerate(rows) if job.takes is None}
    if store.folder() is None:
        _say(
            "there is no store of compiled kernels, so every start compiles them, in about "
            f"{sum(lacking.values()):.0f} s"
        )
        return 0
    return _compiled_by_workers(lacking)


def noted(built: int) -> StartMetrics:
    """Numbers of kernels of this start so far, including those that `build` compiled; recorded in
    the store.
    """
    start = StartMetrics(kernels_loaded=counts.loaded, kernels_compiled=counts.compiled + built)
    store.note_start(start.kernels_loaded, start.kernels_compiled)
    return start


def _compiled_by_workers(lacking: Mapping[int, float]) -> int:
    """Compile these rows in separate processes, and return how many succeeded."""
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    workers = SimpleQueue[_Worker]()
    started = [_Worker() for _ in range(min(MOST, cores))]
    for worker in started:
        workers.put(worker)

    def compile_one(row: int) -> bool:
        worker = workers.get()
        try:
            return worker.compile(row)
        finally:
            workers.put(worker)

    done = 0
    try:
        with _progress(lacking, len(started)) as advance, ThreadPoolExecutor(len(started)) as pool:
            for row, fine in _in_order(
                jobs(), lacking, lambda row: pool.submit(compile_one, row), len(started)
            ):
                done += fine
                advance(row)
    finally:
        for worker in started:
            worker.end()

    if done < len(lacking):
        _say(f"{len(lacking) - done} of {len(lacking)} compile at their first call")
    return done


@contextlib.contextmanager
def _progress(seconds: Mapping[int, float], workers: int) -> Iterator[Callable[[int], None]]:
    """Show the progress over rows that take these seconds: a bar on a terminal, otherwise some
    lines.
    """
    whole = sum(seconds.values())
    if sys.stderr.isatty():
        columns = (
            TextColumn("[progress.description]{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
        )
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task("first start: compiling the inner loops", total=whole)
            yield lambda row: bar.advance(task, seconds[row])
        return

    about = max(whole / workers, 1.0)
    began = time.monotonic()
    done = []
    ended = threading.Event()

    def say_on() -> None:
        while not ended.wait(SILENCE):
            _say(f"{len(done)} of {len(seconds)} after {time.monotonic() - began:.0f} s")

    _say(f"compiling {len(seconds)} inner loops, about {about:.0f} s on {workers} cores, once")
    speaker = threading.Thread(target=say_on, daemon=True)
    speaker.start()
    try:
        yield done.append
    finally:
        ended.set()
        speaker.join()
    _say(f"ended after {time.monotonic() - began:.0f} s; the loops are kept in {store.folder()}")


def _say(message: str) -> None:
    print(f"first start: {message}", file=sys.stderr, flush=True)


def _in_order(
    rows: Sequence[KernelJob],
    chosen: Collection[int],
    submit: Callable[[int], Future[bool]],
    most: int,
) -> Iterator[tuple[int, bool]]:
    """Submit the chosen rows, at most `most` at once, each after its callees, longest chains first.

    Yields:
        Row, and the result of its future.
    """
    longest = [job.seconds for job in rows]
    for row in reversed(range(len(rows))):
        for before in rows[row].after:
            longest[before] = max(longest[before], rows[before].seconds + longest[row])

    left = set(chosen)
    done = set(range(len(rows))) - left
    running = dict[Future[bool], int]()

    while left or running:
        ready = [row for row in left if done.issuperset(rows[row].after)]
        for row in sorted(ready, key=lambda row: -longest[row])[: most - len(running)]:
            left.discard(row)
            running[submit(row)] = row

        for future in wait(running, return_when=FIRST_COMPLETED).done:
            row = running.pop(future)
            done.add(row)
            yield row, future.result()


def kernels() -> Iterator[tuple[str, Any]]:
    """All imported kernels of the project, with their names module:name."""
    for module in list(sys.modules.values()):
        if getattr(module, "__name__", "").partition(".")[0] == PACKAGE:
            for name, member in list(vars(module).items()):
                if (
                    isinstance(member, CPUDispatcher)
                    and member.py_func.__module__ == module.__name__
                ):
                    yield f"{module.__name__}:{name}", member


def _work() -> None:
    """Compile the rows of the list that are read from stdin."""
    answers, sys.stdout = sys.stdout, sys.stderr

    todo = jobs()
    for line in sys.stdin:
        try:
            todo[int(line)].do()
            answers.write("done\n")
        except Exception as error:  # the kernel's first call raises the error, whatever it is
            answers.write(f"{type(error).__name__}\n")
        answers.flush()


if __name__ == "__main__":
    _work()

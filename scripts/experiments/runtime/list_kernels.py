"""Lists the kernels that a contact job compiles in first_start.json, after a change of kernels.

    ./uvw run scripts/experiments/runtime/list_kernels.py

Slow, for it compiles all of them, into a store of its own.
"""

from uuv.start import run_scenario  # isort: skip

import json
import os
import tempfile
import time
from dataclasses import asdict
from typing import Any

from numba.core import event

from uuv import assemble, jobs
from uuv.first_start import CALLS, LIST, PACKAGE, KernelJob, decoded, encoded, kernels
from uuv.runner import run_through
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.kernels import store
from uuv.sim.interfaces.kernels.stored import StoredKernel


class _Stopwatch(event.Listener):
    """Seconds of each compilation, without those of the project's kernels within it."""

    def __init__(self) -> None:
        self.spent: dict[tuple[int, Any], float] = {}  # by dispatcher and arguments
        self._open: list[tuple[float, list[float]]] = []

    def on_start(self, event: event.Event) -> None:
        self._open.append((time.process_time(), []))

    def on_end(self, event: event.Event) -> None:
        began, inner = self._open.pop()
        record: Any = event.data

        whole = time.process_time() - began
        kernel = record["dispatcher"]
        ours = kernel.py_func.__module__.partition(".")[0] == PACKAGE
        self.spent[id(kernel), record["args"]] = whole - sum(inner)

        if self._open:
            self._open[-1][1].extend([whole] if ours else inner)


def _can_be_told(args: Any) -> bool:
    """True if types can be listed; a kernel with others, such as the water's, is compiled with
    those that call it.
    """
    try:
        return all(
            decoded(json.loads(json.dumps(encoded(argument)))) == argument for argument in args
        )
    except UuvError:
        return False


def listed() -> list[KernelJob]:
    """What a job of clean_barrel.py compiles; slow, and it needs an empty cache."""
    watch = _Stopwatch()

    with event.install_listener("numba:compile", watch):
        for name, signature, *_ in CALLS:
            KernelJob(name, None, signature, (), 0.0).do()
        run_through(assemble(jobs.clean_barrel(quick=True)))

    compiled_kernels = [
        (name, args, kernel)
        for name, kernel in kernels()
        for args in kernel.overloads
        if isinstance(kernel._cache, StoredKernel) and kernel._can_compile and _can_be_told(args)
    ]
    rows = {
        id(kernel.overloads[args].library): row
        for row, (_, args, kernel) in enumerate(compiled_kernels)
    }

    def called(library: Any) -> set[int]:
        callees = set[int]()
        for linked in library._linking_libraries:
            callees |= {rows[id(linked)]} if id(linked) in rows else called(linked)
        return callees

    after = [
        called(kernel.overloads[args].library) - {row}
        for row, (_, args, kernel) in enumerate(compiled_kernels)
    ]
    order: list[int] = []
    while len(order) < len(compiled_kernels):  # those that a job calls before it
        order += [
            row
            for row in range(len(compiled_kernels))
            if row not in order and after[row].issubset(order)
        ]

    kernel_jobs: list[KernelJob] = []
    for row in order:
        name, args, kernel = compiled_kernels[row]
        before = tuple(sorted(order.index(row_before) for row_before in after[row]))
        seconds = round(watch.spent.get((id(kernel), args), 0.0), 2)
        kernel_jobs.append(
            KernelJob(name, [encoded(argument) for argument in args], (), before, seconds)
        )

    for name, signature, seconds, needs in CALLS:
        before = tuple(row for row, job in enumerate(kernel_jobs) if job.kernel.startswith(needs))
        kernel_jobs.append(KernelJob(name, None, signature, before, seconds))

    return kernel_jobs


def main() -> int:
    """Compiles a job in an empty store, writes what that took, and returns the exit code."""
    with tempfile.TemporaryDirectory() as empty:
        os.environ[store.FOLDER] = empty
        rows = [json.dumps(asdict(job)) for job in listed()]

    LIST.write_text("[\n" + ",\n".join(rows) + "\n]\n", encoding="utf-8")
    print(f"{len(rows)} kernels listed in {LIST}")
    return 0


if __name__ == "__main__":
    run_scenario(main)

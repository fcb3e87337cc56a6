"""Tasks on all cores, each in a process of its own making; one that kills its process does not take others with it."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from typing import TypeVar

Task = TypeVar("Task")
Row = TypeVar("Row")


def run_all(
    tasks: Sequence[Task], workers: int, run: Callable[[Task], Row], died: Callable[[Task], Row]
) -> Iterator[tuple[Task, Row]]:
    """Do all `tasks` by `run` in `workers` processes; each with what it gave, as they are done.

    What a task gives does not depend on the others, nor on the process that it is in. A process that dies takes its
    pool with it: the tasks that were under way are then done one at a time, and for one that kills its process again
    `died` tells what to keep. Both functions must be found by a fresh Python under their module's name.
    """
    waiting: list[Task] = list(reversed(tasks))
    suspects: list[Task] = []
    while waiting or suspects:
        alone = bool(suspects)
        source, size = (suspects, 1) if alone else (waiting, workers)
        under_way: dict[Future[Row], Task] = {}
        with _pool(size) as pool:
            try:
                while source or under_way:
                    while source and len(under_way) < size:
                        task = source[-1]
                        under_way[pool.submit(run, task)] = task  # raises where the pool broke since the last one
                        source.pop()
                    for done in wait(under_way, return_when=FIRST_COMPLETED).done:
                        row = done.result()
                        yield under_way.pop(done), row
            except BrokenProcessPool:
                lost = list(under_way.values())
                if alone and lost:
                    yield lost[0], died(lost[0])
                elif not alone:
                    suspects += reversed(lost)
            except BaseException:
                _stop(pool)
                raise


def _pool(workers: int) -> ProcessPoolExecutor:
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the workers: they share the cores by themselves
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)


def _begin() -> None:
    """Let a worker end with the study: without a word on Ctrl-C, and on whatever else ends it, SIGKILL too."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # of nohup, which is for the workers too
            signal.signal(number, signal.SIG_DFL)  # the study says it once
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait_for([parent.sentinel])  # a pipe that the system closes when the parent is gone
    os._exit(1)


def _stop(pool: ProcessPoolExecutor) -> None:
    for process in multiprocessing.active_children():
        process.kill()  # SIGTERM may be ignored
    pool.shutdown(wait=False, cancel_futures=True)

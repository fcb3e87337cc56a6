"""Process pool that survives a crash: each task runs in a spawned process, and one crash does not stop the others."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from typing import TypeVar

from scenarios import first_start

Task = TypeVar("Task")
Row = TypeVar("Row")


def run_all(
    tasks: Sequence[Task], workers: int, run: Callable[[Task], Row], died: Callable[[Task], Row]
) -> Iterator[tuple[Task, Row]]:
    """Runs all tasks in a pool and yields each task with its result, in order of completion.

    A result depends neither on the other tasks nor on the process. A process that dies breaks its pool. The tasks that
    were running then are repeated one at a time. For a task that crashes its process again, `died` gives the result.
    Both functions must be importable by a fresh Python under their module's name.

    Args:
        tasks: Picklable tasks.
        workers: Number of processes.
        run: Result of a task.
        died: Result of a task that crashed its process.

    Yields:
        Task, result.
    """
    first_start.build()  # else every worker would compile the same
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
                        under_way[pool.submit(run, task)] = task  # raises if the pool broke since the last one
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
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread for each worker: the workers share the cores
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)


def _begin() -> None:
    """Initialiser of a worker: ends silently on Ctrl-C, and whenever the study's process ends, also by SIGKILL."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # ignored under nohup: the workers keep that
            signal.signal(number, signal.SIG_DFL)  # only the study prints a message
    end_with_study()


def end_with_study() -> None:
    """Lets this process end when the study's process does; for workers and for processes that a worker forks."""
    parent = multiprocessing.parent_process()
    if parent is not None:  # else this is the study's process, or one that it forked
        threading.Thread(target=_wait_and_end, args=(parent.sentinel,), daemon=True).start()


def _wait_and_end(sentinel: int) -> None:
    wait_for([sentinel])  # a pipe that the system closes when the study ends
    os._exit(1)


def _stop(pool: ProcessPoolExecutor) -> None:
    for process in multiprocessing.active_children():
        process.kill()  # SIGTERM may be ignored
    pool.shutdown(wait=False, cancel_futures=True)

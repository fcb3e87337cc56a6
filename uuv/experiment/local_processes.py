"""Local processes by loky: fresh memory for each run, and a worker that dies loses only its own
run.
"""

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, TypeVar

from uuv.experiment.worker import Limits, begin

if TYPE_CHECKING:
    from loky import ProcessPoolExecutor

Task = TypeVar("Task")
Result = TypeVar("Result")
NO_LIMITS = Limits()


def run_all(
    tasks: Sequence[Task],
    workers: int,
    run: Callable[[Task], Result],
    died: Callable[[Task], Result],
    limits: Limits = NO_LIMITS,
) -> Iterator[tuple[Task, Result]]:
    """Run all tasks in worker processes and yield each task with its result, in order of
    completion.

    A result depends neither on the other tasks nor on the process. A process that dies breaks its
    pool. The tasks that were running are then repeated, one at a time, so that a task that kills
    its process is identified. Both functions must be importable by a fresh Python under their
    module's name.

    Args:
        tasks: Picklable tasks.
        workers: Number of processes.
        run: Function that returns the result of a task.
        died: Function that returns the result of a task whose process died each time.
        limits: Memory of a worker, and number of repetitions of a task whose process died.

    Yields:
        Task, result.
    """
    from uuv import first_start  # not imported in the workers, since it loads the compiler

    first_start.build()  # otherwise every worker would compile the same kernels
    waiting: list[Task] = list(reversed(tasks))
    # tasks, and the number of times that their process has died
    suspects: list[tuple[Task, int]] = []
    while waiting or suspects:
        alone = bool(suspects)
        source = [task for task, _ in suspects] if alone else waiting
        size = 1 if alone else min(workers, len(source))
        under_way: dict[Future[Result], Task] = {}
        pool = _pool(size, limits)
        try:
            while source or under_way:
                while source and len(under_way) < size:
                    task = source[-1]
                    # raises if the pool broke since the last result
                    under_way[pool.submit(run, task)] = task
                    source.pop()
                for done in wait(under_way, return_when=FIRST_COMPLETED).done:
                    outcome = done.result()
                    task = under_way.pop(done)
                    if alone:
                        suspects.pop()
                    yield task, outcome
        except BrokenProcessPool:
            if not alone:
                suspects = [(task, 1) for task in reversed(list(under_way.values()))]
            elif under_way:
                task, deaths = suspects.pop()
                if deaths < limits.retries:
                    suspects.append((task, deaths + 1))
                else:
                    yield task, died(task)
        finally:
            pool.shutdown(wait=True, kill_workers=True)


def _pool(workers: int, limits: Limits) -> "ProcessPoolExecutor":
    from loky import ProcessPoolExecutor

    # one thread for each worker, since the workers share the cores
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # loky replaces a worker that has grown by 300 MB, and warns of it; no run is lost.
    warnings.filterwarnings(
        "ignore", "A worker (stopped|was restarted) while some jobs", UserWarning
    )
    return ProcessPoolExecutor(workers, initializer=begin, initargs=(os.getpid(), limits))

"""Ray engine: runs of a study on a Ray cluster, an existing one or one started here."""

import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar

import numpy as np

from uuv.experiment.cluster_keeper import kept_cluster
from uuv.experiment.worker import Limits, limit_memory
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.kernels import store

# Read when Ray is imported. Under `uv run`, Ray would start each worker by uv, in a copy of this
# folder. The other setting disables Ray's usage reports.
os.environ.setdefault("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
try:
    ray: Any = import_module("ray")
    lost: Any = import_module("ray.exceptions")
except ImportError as error:
    raise ConfigurationError(
        "--engine ray: Ray is not installed; install it by ./uvw sync --extra cluster, or pip "
        "install 'uuv-arm[cluster]'"
    ) from error

Task = TypeVar("Task")
Result = TypeVar("Result")
ADDRESS = "RAY_ADDRESS"  # Ray's own variable: address of a cluster
# number of waiting or running tasks for each processor of the cluster, so that no processor has to
# wait
_AHEAD = 2
_LOOK = 5.0  # [s] between two queries of the number of processors, since a cluster may grow
_THREADS = "OMP_NUM_THREADS"
# signals that Ray handles by printing a stack trace; the command handles them itself
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_HANDED_ON = (store.FOLDER, store.LIMIT)  # environment variables of this process that workers get


@dataclass(frozen=True, slots=True)
class RayCluster:
    """Engine that carries out runs on the cluster of RAY_ADDRESS, or on one started here for the
    study.

    A task uses one processor, and is sent as a message of a few kB, and so is its result. A run
    whose worker or node is lost is repeated up to `Limits.retries` times, on any free processor.
    """

    workers: int  # number of processors of a cluster that is started here; 0: all
    limits: Limits

    @property
    def place(self) -> str:
        """Same as `Engine.place`."""
        return (
            f"the Ray cluster {os.environ[ADDRESS]}"
            if os.environ.get(ADDRESS)
            else "a Ray cluster started here"
        )

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """Same as `Engine.results`."""
        from uuv import first_start

        first_start.build()  # otherwise every worker would compile the same kernels
        with (
            nullcontext() if os.environ.get(ADDRESS) else kept_cluster() as folder,
            _connected(self.workers, folder),
        ):
            yield from _carried_out(tasks, ray.put(run), died, self.limits)


@contextmanager
def _connected(workers: int, folder: str | None) -> Iterator[None]:
    """Context manager that connects to the cluster; at its end it stops a cluster started here, and
    all running tasks.

    Args:
        workers: As for `RayCluster`.
        folder: Folder for the files of a cluster that is started here; None: Ray's own.
    """
    exists = os.environ.get(ADDRESS)
    settings = {_THREADS: "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    settings |= {name: value for name in _HANDED_ON if (value := os.environ.get(name))}

    try:
        ray.init(
            address=exists or "local",
            num_cpus=None if exists else (workers or os.cpu_count()),
            include_dashboard=None if exists else False,
            log_to_driver=False,
            _temp_dir=folder,
            logging_level="ERROR",
            runtime_env={"env_vars": settings},
        )
    except (ConnectionError, RuntimeError, ValueError, lost.RayError) as error:
        where = f" at {exists}" if exists else ""
        raise ConfigurationError(
            f"--engine ray: no cluster{where}: {one_line(str(error))}"
        ) from error

    # Ray has replaced the signal handlers, which are restored here.
    for number, handler in handlers.items():
        signal.signal(number, handler)
    try:
        yield
    finally:
        ray.shutdown()


def _carried_out(
    tasks: Sequence[Task], run: Any, died: Callable[[Task], Result], limits: Limits
) -> Iterator[Sequence[tuple[Task, Result]]]:
    """The tasks with their results; `run` is a reference to a function that is stored in the
    cluster.
    """
    # repetitions are made by this loop, which counts the deaths
    remote: Any = ray.remote(num_cpus=1, max_retries=0)(_run_task)
    waiting = deque(range(len(tasks)))
    deaths = [0] * len(tasks)
    under_way: dict[Any, int] = {}
    room = 0
    looked = -np.inf

    while waiting or under_way:
        if (time_s := time.monotonic()) > looked + _LOOK:
            room = max(1, int(_AHEAD * ray.cluster_resources().get("CPU", 1.0)))
            looked = time_s

        # Submit as many tasks as the cluster has room for.
        while waiting and len(under_way) < room:
            number = waiting.popleft()
            under_way[remote.remote(run, tasks[number], limits)] = number

        # Wait for finished results, at least one.
        ray.wait(list(under_way), num_returns=1)
        done, _ = ray.wait(list(under_way), num_returns=len(under_way), timeout=0.0)
        outcomes: list[tuple[Task, Result]] = []

        for reference in done:
            number = under_way.pop(reference)
            try:
                outcome = ray.get(reference)
            except lost.RayTaskError as error:
                raise error.as_instanceof_cause() from None
            except (lost.LocalRayletDiedError, lost.RuntimeEnvSetupError) as error:
                raise ConfigurationError(
                    "--engine ray: the connection to the cluster was lost "
                    f"({one_line(str(error))}); the rows are kept, and the same command continues "
                    "the study"
                ) from error
            except lost.RayError:  # the worker or node is lost, or the result with it
                deaths[number] += 1
                if deaths[number] <= limits.retries:
                    waiting.append(number)
                    continue
                outcome = died(tasks[number])
            outcomes.append((tasks[number], outcome))

        if outcomes:
            yield outcomes


def _run_task(run: Callable[[Task], Result], task: Task, limits: Limits) -> Result:
    """The result of a task, in a worker."""
    limit_memory(limits)
    return run(task)

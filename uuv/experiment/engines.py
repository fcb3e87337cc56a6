"""Engines, which carry out the runs of a study on one machine or on a cluster.

All engines give the same rows, in any order.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

from uuv.experiment.worker import Limits

Task = TypeVar("Task")
Result = TypeVar("Result")
EngineName = Literal["processes", "ray"]


class Engine(Protocol):
    """Engine that carries out the runs of a study."""

    @property
    def place(self) -> str:
        """Place of the runs, in a few words."""
        ...

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """Carry out all tasks and yield each with its result, in order of completion; finished
        tasks are yielded together.

        Args:
            tasks: Picklable tasks.
            run: Function that returns the result of a task. `run` and `died` must be importable by
                a fresh Python under their module's name.
            died: Function that returns the result of a task whose process died each time.

        Yields:
            Some tasks, at least one, with their results.

        Raises:
            ConfigurationError: The engine is not available here, or the connection to it is lost.
        """
        ...


@dataclass(frozen=True, slots=True)
class ThisProcess:
    """Engine that carries out one run after the other in the process of the study. An interruption
    of the process loses the present run.
    """

    place: str = "this process"

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """Same as `Engine.results`."""
        del died
        return ([(task, run(task))] for task in tasks)


@dataclass(frozen=True, slots=True)
class LocalProcesses:
    """Engine that carries out runs in processes of this machine."""

    workers: int
    limits: Limits

    @property
    def place(self) -> str:
        """Same as `Engine.place`."""
        return f"{self.workers} processes" if self.workers > 1 else "one process"

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """Same as `Engine.results`."""
        from uuv.experiment.local_processes import run_all

        return ([outcome] for outcome in run_all(tasks, self.workers, run, died, self.limits))


def _processes(workers: int, tasks: int, limits: Limits) -> Engine:
    count = workers or (os.cpu_count() or 1 if tasks > 1 else 1)
    return LocalProcesses(count, limits) if count > 1 or limits.need_a_worker else ThisProcess()


def _ray(workers: int, tasks: int, limits: Limits) -> Engine:
    from uuv.experiment.ray_cluster import RayCluster  # an optional package

    del tasks
    return RayCluster(workers, limits)


_ENGINES: Mapping[EngineName, Callable[[int, int, Limits], Engine]] = {
    "processes": _processes,
    "ray": _ray,
}


def engine_for(name: EngineName, workers: int, tasks: int, limits: Limits) -> Engine:
    """Engine with a name.

    Args:
        name: Name as in the option --engine.
        workers: Number as in the option --workers.
        tasks: Number of tasks that the engine will get; without tasks it is this process.
        limits: Limits of each run.

    Raises:
        ConfigurationError: The engine is not installed.
    """
    return _ENGINES[name](workers, tasks, limits) if tasks else ThisProcess()

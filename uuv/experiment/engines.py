"""Engines: where the runs of a study are carried out.

All of them give the same rows, in any order.
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
    """Carries out the runs of a study."""

    @property
    def place(self) -> str:
        """Where the runs are carried out, in a few words."""
        ...

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """Carries out all tasks and yields each with its result, in order of completion, those
        together that are there.

        Args:
            tasks: Picklable tasks.
            run: Result of a task. It and `died` must be importable by a fresh Python under their
                module's name.
            died: Result of a task whose process died each time.

        Yields:
            Some tasks, at least one, with their results.

        Raises:
            ConfigurationError: The engine is not to be had here, or is lost.
        """
        ...


@dataclass(frozen=True, slots=True)
class ThisProcess:
    """Carries out one run after the other in the process of the study; an interruption of it costs
    the run.
    """

    place: str = "this process"

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """As `Engine.results`."""
        del died
        return ([(task, run(task))] for task in tasks)


@dataclass(frozen=True, slots=True)
class LocalProcesses:
    """Carries out runs in processes of this machine."""

    workers: int
    limits: Limits

    @property
    def place(self) -> str:
        """As `Engine.place`."""
        return f"{self.workers} processes" if self.workers > 1 else "one process"

    def results(
        self, tasks: Sequence[Task], run: Callable[[Task], Result], died: Callable[[Task], Result]
    ) -> Iterator[Sequence[tuple[Task, Result]]]:
        """As `Engine.results`."""
        from uuv.experiment.local_processes import run_all

        return ([outcome] for outcome in run_all(tasks, self.workers, run, died, self.limits))


def _processes(workers: int, tasks: int, limits: Limits) -> Engine:
    count = workers or (os.cpu_count() or 1 if tasks > 1 else 1)
    return LocalProcesses(count, limits) if count > 1 or limits.need_a_worker else ThisProcess()


def _ray(workers: int, tasks: int, limits: Limits) -> Engine:
    from uuv.experiment.ray_cluster import RayCluster  # an extra

    del tasks
    return RayCluster(workers, limits)


_ENGINES: Mapping[EngineName, Callable[[int, int, Limits], Engine]] = {
    "processes": _processes,
    "ray": _ray,
}


def engine_for(name: EngineName, workers: int, tasks: int, limits: Limits) -> Engine:
    """Engine of a name.

    Args:
        name: As the option --engine.
        workers: As the option --workers.
        tasks: Number of tasks that it will get; without any it is this process.
        limits: Of each run.

    Raises:
        ConfigurationError: It is not installed.
    """
    return _ENGINES[name](workers, tasks, limits) if tasks else ThisProcess()

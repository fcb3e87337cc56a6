"""Jobs for which a vehicle is checked: scenarios with the arm, currents of station keeping."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.check.conditions import Conditions
from uuv.jobs import (
    Job,
    clean_barrel,
    clean_object,
    clean_pile,
    collect,
    insert_sampler,
    move_plug,
    sample_seabed,
    turn_valve,
)
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.tasks.surface_work import TAP_FORCE, TAPPED

if TYPE_CHECKING:
    from uuv.scenario import Scenario

# [m/s] current of the job hover-current
CURRENT = (0.3 * float(np.cos(np.pi / 6)), 0.3 * float(np.sin(np.pi / 6)), 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedJob:
    """A job of the arm, for which a vehicle is checked; a call returns its scenario."""

    job: Job
    options: Mapping[str, Any] = field(default_factory=dict)
    changed: "Callable[[Scenario], Scenario] | None" = None  # sets a task that no job has
    asked: bool = False  # it is checked only if it is asked for
    # options of the job that mean something else than that of the check
    other: Collection[str] = ()

    def __call__(self, **options: Any) -> "Scenario":
        """The scenario with further options of the job."""
        scenario = self.job(**{**self.options, **options})
        return scenario if self.changed is None else self.changed(scenario)

    def takes(self, word: str) -> bool:
        """True if the job has an option of that name and meaning."""
        return word not in self.other and word in self.job.options()

    @property
    def brings_tool(self) -> bool:
        """True if the job's task replaces the vehicle's tool."""
        return self.job().task.tool is not None

    @property
    def command(self) -> str:
        """Arguments of `uuv run` for the job; empty if no command runs the job."""
        if self.changed is not None:
            return ""

        # Defaults need not be typed.
        usual = self.job.options()
        typed = [f"--{w} {value}" for w, value in self.options.items() if value != usual[w].default]
        return " ".join([self.job.name, *typed])


def _tapping(scenario: "Scenario") -> "Scenario":
    """The scenario with the task of tapping points on a line along the barrel."""
    from uuv.tasks.surface_work import SurfaceWorkTask
    from uuv.tasks.tapping import TappingTask

    task = scenario.task_of(SurfaceWorkTask)

    return replace(scenario, task=TappingTask(path=task.path, forces=task.forces, range=task.range))


_ANGULAR = ("speed",)  # of the handle [rad/s], not of the tool along a path
ARM_JOBS = {
    "barrel-longitudinal": CheckedJob(job=clean_barrel),
    "barrel-transverse": CheckedJob(job=clean_barrel, options={"path": "transverse"}),
    "pile": CheckedJob(job=clean_pile),
    "object": CheckedJob(job=clean_object, asked=True),
    "tap": CheckedJob(
        job=clean_barrel, options={"length": TAPPED[-1], "forces": (TAP_FORCE,)}, changed=_tapping
    ),
    "insertion": CheckedJob(job=insert_sampler),
    "seabed-core": CheckedJob(job=sample_seabed),
    "collect": CheckedJob(job=collect, asked=True),
    "turn-valve": CheckedJob(job=turn_valve, asked=True, other=_ANGULAR),
    "turn-valve-bar": CheckedJob(
        job=turn_valve, options={"handle": "bar"}, asked=True, other=_ANGULAR
    ),
    "move-plug": CheckedJob(job=move_plug, asked=True),
}
OBJECT = "object"  # the job on an object of the user's choice
HOVERING = {"hover": (0.0, 0.0, 0.0), "hover-current": CURRENT}
JOBS = (*HOVERING, *(name for name, job in ARM_JOBS.items() if not job.asked))  # without a choice
JOBS_ON_OBJECT = (*HOVERING, OBJECT)
ALL_JOBS = (*HOVERING, *ARM_JOBS)


def check_jobs(names: Iterable[str]) -> None:
    """Refuse a name that is not in ALL_JOBS."""
    for name in names:
        if name not in ALL_JOBS:
            known = f"{', '.join(ALL_JOBS)}{did_you_mean(name, ALL_JOBS)}"
            raise ConfigurationError(f"--jobs: no job {name!r}; there are {known}")


def check_options(jobs: Collection[str], conditions: Conditions) -> None:
    """Refuse an option that no job has, and a value that a job refuses.

    Raises:
        ConfigurationError: Which option, and what is allowed.
    """
    of_arm = [name for name in jobs if name in ARM_JOBS]
    for word in conditions.options:
        if word == "forces":  # the arm is judged by them whatever the jobs
            continue
        hovers = word == "current" and "hover-current" in jobs
        if not hovers and not any(ARM_JOBS[name].takes(word) for name in of_arm):
            raise ConfigurationError(
                f"--{word}: must be an option of one of the jobs {', '.join(jobs)}"
            )

    if conditions.flow is not None and not of_arm:  # no option, but a part of a job's site
        raise ConfigurationError(f"--flow: must be an option of one of the jobs {', '.join(jobs)}")

    for name in of_arm:
        job = ARM_JOBS[name]
        scenario = job(**{w: v for w, v in conditions.options.items() if job.takes(w)})
        scenario.task.check_inputs(scenario)

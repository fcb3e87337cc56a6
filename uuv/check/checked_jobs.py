"""Jobs for which a vehicle is checked: scenarios with the arm, currents of station keeping."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.jobs import Job, clean_barrel, clean_pile, insert_sampler, sample_seabed
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

    def __call__(self, **options: Any) -> "Scenario":
        """The scenario with further options of the job."""
        scenario = self.job(**{**self.options, **options})
        return scenario if self.changed is None else self.changed(scenario)

    @property
    def takes_forces(self) -> bool:
        """Whether its force is a list of set forces."""
        return "forces" in self.job.options()

    @property
    def brings_tool(self) -> bool:
        """Whether its task brings a tool."""
        return self.job().task.tool is not None

    @property
    def command(self) -> str:
        """Arguments of `uuv run` for the job; empty: no command runs it."""
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


ARM_JOBS = {
    "barrel-longitudinal": CheckedJob(job=clean_barrel),
    "barrel-transverse": CheckedJob(job=clean_barrel, options={"path": "transverse"}),
    "pile": CheckedJob(job=clean_pile),
    "tap": CheckedJob(
        job=clean_barrel, options={"length": TAPPED[-1], "forces": (TAP_FORCE,)}, changed=_tapping
    ),
    "insertion": CheckedJob(job=insert_sampler),
    "seabed-core": CheckedJob(job=sample_seabed),
}
HOVERING = {"hover": (0.0, 0.0, 0.0), "hover-current": CURRENT}
JOBS = (*HOVERING, *ARM_JOBS)


def check_jobs(names: Iterable[str]) -> None:
    """Refuse names that are not in JOBS."""
    for name in names:
        if name not in JOBS:
            raise ConfigurationError(
                f"--jobs: no job {name!r}; there are {', '.join(JOBS)}{did_you_mean(name, JOBS)}"
            )

"""Jobs for which a vehicle is checked, by name: scenarios of those with the arm, currents of station keeping."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from uuv.jobs import clean_barrel, clean_pile, insert_sampler, sample_seabed
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean

if TYPE_CHECKING:
    from uuv.scenario import Scenario

CURRENT = (0.3 * float(np.cos(np.pi / 6)), 0.3 * float(np.sin(np.pi / 6)), 0.0)  # [m/s] of the job hover-current


def _barrel(path: Literal["longitudinal", "transverse"], **given: Any) -> "Scenario":
    return clean_barrel(path=path, **given)


def _pile(**given: Any) -> "Scenario":
    return clean_pile(**given)


def _tap(**given: Any) -> "Scenario":
    """The points to tap, on a line along the barrel."""
    from uuv.tasks.surface_work import TAP_FORCE, TAPPED, SurfaceWorkTask
    from uuv.tasks.tapping import TappingTask

    options: dict[str, Any] = {"length": TAPPED[-1], "forces": (TAP_FORCE,)} | given
    scenario = clean_barrel(**options)
    task = scenario.task_of(SurfaceWorkTask)
    return replace(scenario, task=TappingTask(path=task.path, forces=task.forces, range=task.range))


def _insertion(**given: Any) -> "Scenario":
    return insert_sampler(**given)


def _core(**given: Any) -> "Scenario":
    return sample_seabed(**given)


ARM_JOBS: "dict[str, Callable[..., Scenario]]" = {
    "barrel-longitudinal": partial(_barrel, "longitudinal"),
    "barrel-transverse": partial(_barrel, "transverse"),
    "pile": _pile,
    "tap": _tap,
    "insertion": _insertion,
    "seabed-core": _core,
}
HOVERING = {"hover": (0.0, 0.0, 0.0), "hover-current": CURRENT}
JOBS = (*HOVERING, *ARM_JOBS)


def check_jobs(names: Iterable[str]) -> None:
    """Refuses a name that is none of JOBS."""
    for name in names:
        if name not in JOBS:
            raise ConfigurationError(f"--jobs: no job {name!r}; there are {', '.join(JOBS)}{did_you_mean(name, JOBS)}")

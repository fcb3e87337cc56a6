"""Steps of the set force while the tool moves along a barrel: one run and its figures."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uuv.assembly import assemble
from uuv.jobs import clean_barrel
from uuv.perturbations.pad import Pad
from uuv.runner import run
from uuv.scenario import Scenario
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import Recording
from uuv.tasks.surface_work import SurfaceWorkTask

BEFORE, AFTER = 0.2, 2.3  # [s] window around the beginning of a step
SAMPLE = 0.002  # [s] sampling period of the responses
SPEED, LENGTH = 0.02, 0.6  # [m/s] of the tool, [m] length of the path


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTask:
    """One run with several steps up, each followed by a step down; a case of the study."""

    stiffness: float  # [N/m]
    seed: int
    low: float  # [N]
    high: float  # [N]
    steps: int
    rate: float  # [N/s] rate of change of the set force
    current: tuple[float, float, float]
    gust: float


def responses(task: StepTask) -> dict[str, Any]:
    """Set and true force (k, N) [N] of k steps up at `times()`; empty if the run was aborted."""
    recording = run(assemble(scenario_of(task))).recording
    note = recording.final.note if recording.final.state is not WorkState.DONE else ""

    found = steps_up(recording, task.low, task.high)
    return {"stiffness": task.stiffness, "seed": task.seed, "note": note, **found}


def scenario_of(task: StepTask) -> Scenario:
    """Scenario of a run with steps."""
    scenario = clean_barrel(
        seed=task.seed,
        current=task.current,
        gust=task.gust,
        speed=SPEED,
        length=LENGTH,
        forces=(task.low, task.high) * task.steps,
    )

    work = replace(scenario.task_of(SurfaceWorkTask), force_rate=task.rate)
    return replace(scenario, task=work, perturbations=(Pad(stiffness=task.stiffness),))


def failed(task: StepTask, reason: str) -> dict[str, Any]:
    """Result in place of `responses` for a run that failed for `reason`."""
    return {"stiffness": task.stiffness, "seed": task.seed, "note": reason, "set": [], "true": []}


def times() -> Array:
    """Sampling times (N,) [s] relative to the beginning of a step."""
    return np.linspace(-BEFORE, AFTER, 1 + round((BEFORE + AFTER) / SAMPLE))


def steps_up(recording: Recording, low: float, high: float) -> dict[str, Array]:
    """Extracts set and true normal force around each step up in the work state.

    Args:
        recording: Recording of the run.
        low: [N] set force before the step.
        high: [N] set force after the step.

    Returns:
        "set" and "true", each (k, N) [N] for k complete steps.
    """
    work = recording.within(WorkState.WORK)
    time, set_force = recording["set_force"].time, recording["set_force"].scalar

    leaves = np.flatnonzero((set_force[:-1] == low) & (set_force[1:] > low) & work[1:])
    found: dict[str, list[Array]] = {"set": [], "true": []}

    for first in leaves:
        at = time[first + 1] + times()
        if at[-1] > time[work][-1] or set_force[np.searchsorted(time, at[-1]) - 1] != high:
            continue  # the run ended, or the force changed again
        found["set"].append(np.interp(at, time, set_force))
        found["true"].append(np.interp(at, time, recording["contact_normal"].scalar))

    return {name: np.array(rows).reshape(-1, len(times())) for name, rows in found.items()}


def figures(
    response: Array, low: float, high: float, band: float = 0.05
) -> dict[str, float | None]:
    """Rise time, overshoot and settling time of one response.

    Args:
        response: (N,) [N] at `times()`.
        low: [N] set force before the step.
        high: [N] set force after the step.
        band: Settling band, share of the step.

    Returns:
        "rise_s" from 10 to 90 % [s], "overshoot" as a share of the step, "settling_s" from the
        beginning of the step [s]; None where the response does not get there within the window.
    """
    step, t = (response - low) / (high - low), times()
    after = t >= 0.0
    step, t = step[after], t[after]

    def first(level: float) -> float | None:
        above = np.flatnonzero(step >= level)
        return float(t[above[0]]) if above.size else None

    tenth, most = first(0.1), first(0.9)
    outside = np.flatnonzero(np.abs(step - 1.0) > band)
    settling = float(t[outside[-1] + 1]) if outside.size and outside[-1] + 1 < len(t) else None

    return {
        "rise_s": most - tenth if tenth is not None and most is not None else None,
        "overshoot": max(0.0, float(step.max()) - 1.0),
        "settling_s": settling if outside.size else 0.0,
    }

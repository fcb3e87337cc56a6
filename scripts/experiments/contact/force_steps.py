"""Steps of the set force while the tool moves along a barrel: one run and its figures."""

from dataclasses import replace

import numpy as np

from uuv.assembly import assemble
from uuv.jobs import clean_barrel
from uuv.perturbations.pad import Pad
from uuv.runner import run
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import Recording
from uuv.tasks.surface_work import SurfaceWorkTask

BEFORE, AFTER = 0.2, 2.3  # [s] window around the beginning of a step
SAMPLE = 0.002  # [s] sampling period of the responses
SPEED, LENGTH = 0.02, 0.6  # [m/s] of the tool, [m] length of the path


def steps_of(
    *,
    stiffness: float,
    forces: tuple[float, ...],
    rate: float,
    seed: int,
    current: tuple[float, float, float],
    gust: float,
) -> tuple[Array, Array, str]:
    """Runs the job with a set force that steps up and down.

    Args:
        stiffness: Of pad and surface in series [N/m].
        forces: Set forces [N], the lower and the higher one in turn.
        rate: Of change of the set force [N/s].
        seed: Of the run.
        current: Steady current in W [m/s].
        gust: Standard deviation of the gusts [m/s] per axis.

    Returns:
        Set and true force, each (k, N) [N], of k steps up at `times()`, and why the run ended
        early; empty if it did not.
    """
    scenario = clean_barrel(
        seed=seed, current=current, gust=gust, speed=SPEED, length=LENGTH, forces=forces
    )
    work = replace(scenario.task_of(SurfaceWorkTask), force_rate=rate)
    scenario = replace(scenario, task=work, perturbations=(Pad(stiffness=stiffness),))

    recording = run(assemble(scenario)).recording
    curves = steps_up(recording, min(forces), max(forces))
    note = recording.final.note if recording.final.state is not WorkState.DONE else ""
    return curves["set"], curves["true"], note


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
    errors: dict[str, list[Array]] = {"set": [], "true": []}

    for first in leaves:
        at = time[first + 1] + times()
        if at[-1] > time[work][-1] or set_force[np.searchsorted(time, at[-1]) - 1] != high:
            continue  # the run ended, or the force changed again
        errors["set"].append(np.interp(at, time, set_force))
        errors["true"].append(np.interp(at, time, recording["contact_normal"].scalar))

    return {name: np.array(rows).reshape(-1, len(times())) for name, rows in errors.items()}


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

"""Outcome of a run: class of its end, and figures that its metrics.json does not contain."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.scenario import Scenario
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.interfaces.errors import HydrodynamicsError, UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import Recording
from uuv.tasks.surface_work import SurfaceWorkTask

if TYPE_CHECKING:
    from uuv.runner import Run

# Ends of a run; a finished run is kept, or has missed a bound.
DONE, BROKEN, REFUSED, DAMAGED, DIVERGED, CRASHED = (
    "done",
    "broken off",
    "refused",
    "damage",
    "diverged",
    "crashed",
)
KEPT, MISSED = "kept", "missed"
# classes in order of severity
CLASSES = (KEPT, MISSED, BROKEN, REFUSED, DAMAGED, DIVERGED, CRASHED)
_APPROACHED = (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK)

OVER_SET, UNFOLDING = "contact.force_over_set", "hull.unfolding_max_m"
OBJECT_SIGMA = "uncertainty.object_sigma_m"
SURFACE_FIGURES = (OVER_SET, UNFOLDING, OBJECT_SIGMA)  # figures of work on a surface


def ending(outcome: "Run", figures: Mapping[str, Any]) -> tuple[str, str]:
    """Class and reason of the end of a run; the reason is empty if the run is done.

    Damage takes precedence over an abort, and a figure that is not finite over both.

    Args:
        outcome: The run.
        figures: Figures of the run by dotted name, including those of `surface_figures`.
    """
    numbers = [value for value in figures.values() if isinstance(value, int | float)]
    if not np.isfinite(numbers).all():
        return DIVERGED, "a figure is not finite"

    if (figures.get(OVER_SET) or 0.0) > DAMAGE:
        return DAMAGED, f"force above {DAMAGE:g} times the set force"
    if figures["run.collision_s"]:
        return DAMAGED, "collision of the vehicle"

    final = outcome.recording.final
    if final.state is WorkState.DONE:
        return DONE, ""

    # Not done: distinguishes whether the tool had begun to approach.
    begun = outcome.recording.within(*_APPROACHED, *outcome.assembly.placed.begun).any()
    reason = "not finished in time" if final.abort is None else final.abort.value
    return (BROKEN if begun else REFUSED), reason


def ending_by(error: Exception) -> tuple[str, str]:
    """Class and reason of a run that ended with an error."""
    if isinstance(error, HydrodynamicsError):
        return DIVERGED, "unstable motion"
    return (REFUSED if isinstance(error, UuvError) else CRASHED), type(error).__name__


def surface_figures(outcome: "Run") -> dict[str, float | None]:
    """SURFACE_FIGURES of a run by name; empty for other work."""
    task = outcome.scenario.task
    recording = outcome.recording
    if not isinstance(task, SurfaceWorkTask):
        return {}
    promise = recording.promise
    return {
        OVER_SET: force_over_set(recording, task.forces[0]) if task.forces else None,
        UNFOLDING: unfolding(recording),
        OBJECT_SIGMA: None if promise is None else promise.object_sigma,
    }


def figure_names(scenario: Scenario) -> tuple[str, ...]:
    """Names of the figures of `surface_figures` of a scenario's runs."""
    return SURFACE_FIGURES if isinstance(scenario.task, SurfaceWorkTask) else ()


def force_over_set(recording: Recording, first: float) -> float:
    """Largest ratio of true normal force to set force; before the work the set force is `first`
    [N].
    """
    before = np.where(recording.within(WorkState.WORK), 0.0, first)
    set_force = np.maximum(recording["set_force"].scalar, before)
    return float((recording["contact_most"].scalar / np.maximum(set_force, 1.0)).max())


def unfolding(recording: Recording) -> float | None:
    """Largest distance [m] of the hull from a constant reference while the arm unfolds; None if
    there is none.
    """
    resting = np.all(np.diff(recording["p_WB_reference"].value, axis=0) == 0.0, axis=1)
    still = np.append(resting, True) & recording.within(WorkState.CLOSE_IN, WorkState.TARE)
    if not still.any():
        return None
    off = recording["p_WB"].value[still] - recording["p_WB_reference"].value[still]
    return float(np.linalg.norm(off, axis=1).max())

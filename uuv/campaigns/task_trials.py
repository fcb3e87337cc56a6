"""Trials of one scenario over many seeds: insertion and seabed sampling."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from uuv import first_start
from uuv.assembly import assemble
from uuv.campaigns.trials import Spread, Trials
from uuv.experiment.options import PoolOptions
from uuv.runner import assessed, run_through
from uuv.scenario import Scenario, Task
from uuv.sim.evaluation import insertion_metrics, seabed_metrics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.tasks.insertion import InsertionTask
from uuv.tasks.seabed_sampling import SeabedSamplingTask


def command_trials(scenario: Scenario, trials: int, options: PoolOptions) -> int:
    """Runs a scenario for the seeds from its own on, on all cores, and reports the statistics.

    Args:
        scenario: The description of the first.
        trials: How many seeds.
        options: Of the harness.

    Returns:
        The exit code.

    Raises:
        UuvError: An option is out of range.
    """
    # Which figures, or none.
    summed = TRIALS.get(type(scenario.task))
    if summed is None:
        kind = type(scenario.task).__name__
        reason = f"the figures of task {kind} are not summed up; a campaign does that"
        raise ConfigurationError(f"--trials: {reason}")

    # An error in the settings is raised here once, not in every worker.
    first_start.build()
    assemble(scenario)

    seeds = range(scenario.seed, scenario.seed + trials)
    return summed.carry_out(scenario.name, scenario, seeds, options)


def one_trial(case: tuple[Scenario, int]) -> Mapping[str, Any]:
    """Metrics of a scenario with another seed."""
    scenario, seed = case
    assembly = assemble(replace(scenario, seed=seed))
    return assessed(assembly, run_through(assembly)).metrics


def _searched(figures: Mapping[str, Any]) -> str:
    return f"; searched in {figures['searched']}"


_INSERTION: tuple[Spread, ...] = (
    ("side force, peak", "side_force_max_n", "N", 1.0, "max"),
    ("axial force, peak", "axial_force_max_n", "N", 1.0, "max"),
    ("depth reached", "depth_m", "mm", 1e3, "min"),
    ("time at the hole", "time_s", "s", 1.0, "max"),
    ("hole as found, off its axis", "found_aside_m", "mm", 1e3, "max"),
    ("hole as found, tilt", "found_tilt_rad", "deg", float(np.degrees(1.0)), "max"),
)
_SEABED: tuple[Spread, ...] = (
    ("target's height, of what is allowed", "target_error_share", "%", 100.0, "max"),
    ("push, worst while held", "push_error_share", "%", 100.0, "max"),
    ("push, peak", "push_max_n", "N", 1.0, "max"),
    ("depth of the core", "depth_m", "mm", 1e3, "min"),
    ("depth error, peak", "depth_error_max_m", "mm", 1e3, "max"),
    ("aside of the profile, peak", "side_max_m", "mm", 1e3, "max"),
    ("depth under the true surface, error, peak", "true_depth_error_max_m", "mm", 1e3, "max"),
    ("the same, RMS", "true_depth_error_rms_m", "mm", 1e3, "max"),
    ("force on the tool, peak", "force_max_n", "N", 1.0, "max"),
    ("hull, rise", "rise_max_m", "mm", 1e3, "max"),
    ("hull, excursion", "excursion_max_m", "mm", 1e3, "max"),
    ("hull over the true ground, least", "ground_gap_m", "mm", 1e3, "min"),
)

TRIALS: dict[type[Task], Trials] = {
    InsertionTask: Trials(
        one=one_trial,
        crashed=insertion_metrics.crashed,
        summary=insertion_metrics.summary,
        spreads=_INSERTION,
        also=_searched,
    ),
    SeabedSamplingTask: Trials(
        one=one_trial,
        crashed=seabed_metrics.crashed,
        summary=seabed_metrics.summary,
        spreads=_SEABED,
    ),
}

"""Trials of one scenario over many seeds: insertion and seabed sampling."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console

from scenarios.assembly import assemble
from scenarios.campaigns.trials import Row, check_trials, report_trials, run_trials
from scenarios.options import TrialOptions
from scenarios.runner import assessed, rehearse, run_through
from scenarios.scenario import Scenario
from scenarios.scenario_file import as_dict
from scenarios.tasks.insertion import InsertionTask
from scenarios.tasks.seabed_sampling import SeabedSamplingTask
from scenarios.tasks.task import Task
from sim.evaluation import insertion_metrics, seabed_metrics
from sim.runs.provenance import provenance

Metrics = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskTrials:
    """How trials of a task are counted and shown."""

    crashed: Callable[[int, str], Metrics]  # metrics of a seed whose trial failed, with the message
    summary: Callable[[Sequence[Metrics]], Metrics]
    rows: tuple[Row, ...]


_INSERTION: tuple[Row, ...] = (
    ("side force, peak", "side_force_max_n", "N", 1.0, "max"),
    ("axial force, peak", "axial_force_max_n", "N", 1.0, "max"),
    ("depth reached", "depth_m", "mm", 1e3, "min"),
    ("time at the hole", "time_s", "s", 1.0, "max"),
    ("hole as found, off its axis", "found_aside_m", "mm", 1e3, "max"),
    ("hole as found, tilt", "found_tilt_rad", "deg", float(np.degrees(1.0)), "max"),
)
_SEABED: tuple[Row, ...] = (
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
TRIALS: dict[type[Task], TaskTrials] = {
    InsertionTask: TaskTrials(crashed=insertion_metrics.crashed, summary=insertion_metrics.summary, rows=_INSERTION),
    SeabedSamplingTask: TaskTrials(crashed=seabed_metrics.crashed, summary=seabed_metrics.summary, rows=_SEABED),
}


def command_trials(scenario: Scenario, options: TrialOptions) -> int:
    """Runs a scenario for the seeds from --seed on, on all cores, and reports the statistics.

    Args:
        scenario: The description of the first.
        options: Number of trials, of processes, and folder.

    Returns:
        The exit code.

    Raises:
        UuvError: An option is out of range.
    """
    check_trials(options.trials, options.workers)
    console = Console()
    folder, kind = options.folder(scenario.name), TRIALS[type(scenario.task)]
    assemble(scenario)  # an error in the settings is raised here once, not in every worker
    seeds = range(scenario.seed, scenario.seed + options.trials)
    trials = run_trials(partial(one_trial, scenario), kind.crashed, seeds, options.workers, console)
    figures, made_by = kind.summary(trials), provenance(scenario.name, as_dict(scenario))
    said = f"; searched in {figures['searched']}" if "searched" in figures else ""
    return report_trials(trials, figures, kind.rows, folder, made_by, console, said)


def one_trial(scenario: Scenario, seed: int) -> Metrics:
    """Metrics of one seed."""
    assembly = assemble(replace(scenario, seed=seed))
    rehearse(assembly)
    return dict(assessed(assembly, run_through(assembly)).metrics)

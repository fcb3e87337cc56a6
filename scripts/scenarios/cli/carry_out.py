"""Carries out what a command describes: one run, or trials over many seeds."""

from typing import TYPE_CHECKING

from scenarios.options import TrialOptions
from sim.runs.command_line import RunOptions

if TYPE_CHECKING:  # a help text does without
    from scenarios.scenario import Scenario


def run_job(scenario: "Scenario", options: RunOptions, started: float, after: str = "") -> int:
    """Checks the inputs of a job, then runs it once, or over many seeds where its options ask for trials.

    What runs it is imported, and compiled, only after the check.

    Args:
        scenario: What the options describe.
        options: Those of the job.
        started: [s] time.perf_counter() at the start of the command.
        after: Appended to the title of log and report.

    Returns:
        The exit code.

    Raises:
        UuvError: An input is wrong, or the work could not begin.
    """
    from scenarios.inputs import check_inputs

    check_inputs(scenario, options.longest)
    if isinstance(options, TrialOptions) and options.trials:
        from scenarios.campaigns.task_trials import command_trials

        return command_trials(scenario, options.trials, options)
    from scenarios.command import command

    return command(scenario, options, started, after)

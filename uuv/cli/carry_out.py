"""Carries out what a command describes: one run, or trials over many seeds."""

from typing import TYPE_CHECKING

from uuv.jobs import TrialOptions
from uuv.sim.runs.command_line import RunOptions

if TYPE_CHECKING:  # a help text does without
    from uuv.scenario import Scenario


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
    from uuv.inputs import check_inputs

    check_inputs(scenario, options.longest)
    if isinstance(options, TrialOptions) and options.trials:
        from uuv.campaigns.task_trials import command_trials

        return command_trials(scenario, options.trials, options)
    from uuv.command import command

    return command(scenario, options, started, after)

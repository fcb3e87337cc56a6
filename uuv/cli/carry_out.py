"""Carries out the run that a command describes, and prints its output."""

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from tyro.conf import UseAppendAction

from uuv.cli.json_output import file_alone, folder_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions

if TYPE_CHECKING:  # not needed for a help text
    from uuv.scenario import Scenario

# the same name is in `uuv.sim.reporting.series_tables`, which a help text does not import
METRICS = "metrics.json"
# type of the option --set: KEY=VALUE ..., repeatable
Assignments = Annotated[tuple[tuple[str, ...], ...], UseAppendAction]


@dataclass(kw_only=True)
class Output:
    """Options for the printed output of a run."""

    quiet: bool = False
    """Print the verdict and the folder alone."""
    json: bool = False
    """Print metrics.json alone."""


def values_of(assignments: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    """All assignments of --set, in order.

    Raises:
        ConfigurationError: A --set has no assignment.
    """
    if not all(assignments):
        raise ConfigurationError("--set: KEY=VALUE is missing")
    return tuple(itertools.chain(*assignments))


def run_job(scenario: "Scenario", options: RunOptions, started: float, after: str = "") -> int:
    """Checks the inputs of a job, then runs it.

    The modules of the run are imported, and compiled, only after the check.

    Args:
        scenario: The description of the run.
        options: Options of the run.
        started: [s] time.perf_counter() at the start of the command.
        after: Appended to the title of log and report.

    Returns:
        The exit code.

    Raises:
        UuvError: An input is wrong, or the work could not begin.
    """
    from uuv.inputs import check_inputs

    check_inputs(scenario, options.longest)
    from uuv.command import command

    return command(scenario, options, started, after)


def run_printed(
    scenario: "Scenario", options: RunOptions, output: Output, started: float, after: str = ""
) -> int:
    """Like `run_job`; `output` selects all lines, only verdict and folder, or only metrics.json."""

    def work() -> int:
        return run_job(scenario, options, started, after)

    if output.json:
        return file_alone(work, METRICS)
    if not output.quiet:
        return work()

    code, folder = folder_of(work)
    from uuv.sim.interfaces.documents import json_of

    metrics = json_of(folder / METRICS, "metrics")
    failed = "; ".join(metrics["failed"])
    print(f"{f'not accepted: {failed}' if failed else 'accepted'}\n{folder}")
    return code

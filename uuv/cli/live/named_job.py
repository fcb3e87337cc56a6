"""Options that name a job, or a scenario file, and change it; the scenario that they describe."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from uuv.cli.carry_out import Assignments, values_of
from uuv.sim.runs.command_line import RunOptions

if TYPE_CHECKING:  # not needed for a help text
    from uuv.scenario import Scenario


@dataclass(kw_only=True)
class NamedJobOptions(RunOptions):
    """A job or a scenario by its name."""

    name: Annotated[
        Positional[str], arg(metavar="NAME", help="A job by its name, or a scenario, FILE.toml.")
    ]
    quick: bool = False
    """The short form of the job."""
    seed: int | None = None
    """Seed instead of the job's."""
    set: Assignments = ()
    """KEY=VALUE, repeatable: values by the keys of a scenario file."""
    trust: bool = False
    """Also run the code that a scenario file names."""
    json: bool = False
    """Print metrics.json alone."""


def named_scenario(options: NamedJobOptions) -> "Scenario":
    """The scenario that the options name.

    Raises:
        ConfigurationError: There is no such job or file, or a value is wrong.
    """
    from uuv import jobs
    from uuv.scenario_file import read_scenario, with_values

    if options.name.endswith(".toml"):
        scenario = read_scenario(options.name, trust=options.trust)
    else:
        words = {"quick": True} if options.quick else {}
        scenario = jobs.named(options.name)(**words)
    if options.seed is not None:
        scenario = replace(scenario, seed=options.seed)
    return with_values(scenario, values_of(options.set), "--set") if options.set else scenario

"""`uuv identify water`: added mass, damping, trim and thruster gains of a vehicle from logs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from uuv.cli.carry_out import METRICS
from uuv.cli.json_output import file_alone
from uuv.sim.runs.command_line import as_base
from uuv.start import parse
from uuv.water_identification.options import WaterOptions, check_inputs

_PLAN = "plan.json"  # the result if nothing is identified


@dataclass(kw_only=True)
class WaterVerb(WaterOptions):
    """Identify added mass, damping, trim and thrust of a vehicle from logs.

    The vehicle's present coefficients are the prior. Parameters that the logs do not identify are
    listed; with --plan the most informative next manoeuvre is proposed. Without --log a vehicle
    drawn from the prior is simulated; with --plan alone the first manoeuvre is planned.
    """

    groups: ClassVar[Mapping[str, str]] = {"output": "json"}

    json: bool = False
    """Print metrics.json alone, or plan.json if nothing is identified."""


def main(verb: str, args: Sequence[str]) -> int:
    """Identifies or plans, writes the results; returns the exit code."""
    del verb
    options = parse(WaterVerb, args)
    plain = as_base(options, WaterOptions)
    output = _PLAN if options.plan and not options.log else METRICS
    work = partial(identify_water, plain)
    return file_alone(work, output) if options.json else work()


def identify_water(options: WaterOptions) -> int:
    """Checks the inputs, identifies or plans, writes the results; returns the exit code.

    Raises:
        UuvError: Options, vehicle or logs are wrong.
    """
    check_inputs(options)
    from uuv.sim.runs.terminal import console
    from uuv.water_identification.command import run  # imported, and compiled, after the check

    return run(options, console())

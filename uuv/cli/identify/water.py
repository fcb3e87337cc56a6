"""`uuv identify-water`: options and inputs are checked before what carries it out is imported and compiled."""

from collections.abc import Sequence

from uuv.start import parse
from uuv.water_identification.options import WaterOptions, check_inputs


def main(verb: str, args: Sequence[str]) -> int:
    """The verb `uuv identify-water`."""
    del verb
    return identify_water(parse(WaterOptions, args))


def identify_water(options: WaterOptions) -> int:
    """Checks the inputs, identifies or plans, writes the results; returns the exit code.

    Raises:
        UuvError: Options, vehicle or logs are wrong.
    """
    check_inputs(options)
    from uuv.sim.runs.terminal import console
    from uuv.water_identification.command import run  # imported, and compiled, after the check

    return run(options, console())

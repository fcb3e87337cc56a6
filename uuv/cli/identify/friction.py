"""`uuv identify friction`: dry and viscous friction of the arm's gears, free of contact."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from uuv.cli.carry_out import Output, run_printed
from uuv.jobs import GearOptions
from uuv.sim.runs.command_line import as_base
from uuv.start import parse


@dataclass(kw_only=True)
class FrictionVerb(Output, GearOptions):
    """Identify the friction of the arm's gears.

    The vehicle keeps station while its joints swing, slowly, then fast. Encoders, torque sensors at
    the gear outputs and motor torques give the friction of each gear, which is compared with the
    true one. The true gears deviate from those that the vehicle believes in. Rotor inertias are
    known. No other command reads the result.
    """


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the identification; returns the exit code."""
    del verb
    started = time.perf_counter()
    options = parse(FrictionVerb, args)
    plain = as_base(options, GearOptions)
    return run_printed(plain.scenario(), plain, as_base(options, Output), started)

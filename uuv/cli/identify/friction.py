"""Identification of the dry and viscous friction of the arm's gears, in water, free of contact.

The vehicle keeps station while its joints swing, slowly, then fast. Encoders, torque sensors at the gear outputs and
motor torques give the friction of each gear, which is compared with the true one. The true gears deviate from those
that the vehicle believes in. Rotor inertias are known. No other command reads the result.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import GearOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

"""Sampling of an unknown seabed: sonar scan, choice of the working height, and force-controlled work in the soil.

The vehicle approaches over the plane that its Doppler velocity log (DVL) measures, and reconstructs the ground from
sonar scans. It projects the targets onto the ground, judges the relief and chooses a pose for station keeping. It
pushes a core tube into the soil with a set force, or drags a box along the profile between two targets at a set depth.
Then it withdraws the tool. If the cloud is no ground, or the ground is unsuitable, the vehicle stays where it is: one
line with the reason, exit code 2.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import SeabedOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

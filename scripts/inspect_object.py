"""Inspection of a known object: orbits with the camera on it [Konoplin 2019, eq. 6].

The object lies on the seabed; the vehicle knows its model and its coarse pose. Where the orbit would bring hull or arm
too near, the vehicle stays where it is: one line with the reason, exit code 2.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import InspectionOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

"""Insertion of a sampler into a hole of a subsea manifold, and its withdrawal.

The vehicle knows the manifold's shape and roughly where it is. It keeps station, takes a depth frame, identifies the
manifold and moves the sampler before the hole. The insertion is force-controlled along the axis and compliant across
it. With --trials N, the N seeds from --seed on run on all cores, and a table gives the success rate.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import InsertionOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

"""Contact cleaning of a barrel in a current: scan, identification, and force-controlled motion of a pad along a path.

The vehicle knows the barrel's shape and roughly where it is. It keeps station, takes a depth frame, identifies the
barrel, carries the tool path onto it and closes in. The contact force is estimated from joint torques alone.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import BarrelOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

"""Contact cleaning of a barrel in a current: scan, identification, and force-controlled motion of a pad along a path.

The vehicle knows the barrel's shape and roughly where it is. It keeps station, takes a depth frame, identifies the
barrel, carries the tool path onto it and closes in. The contact force is estimated from joint torques alone.
"""

from scenarios.start import parse, run_scenario  # isort: skip

import time

import numpy as np

from scenarios.barrel import Options, barrel_job
from scenarios.contact_job import run_contact_job


def main() -> int:
    """Runs the scenario and returns the exit code."""
    options = parse(Options)
    rng = np.random.default_rng(options.seed)
    return run_contact_job(barrel_job(options, rng), options, rng, started=time.perf_counter())


if __name__ == "__main__":
    run_scenario(main)

"""Clean a barrel under water: hover, scan, identify, and move a tool along it with a set force, in a current.

The vehicle knows the barrel's shape and roughly where it is. It takes a depth frame, finds the barrel, carries a tool
path onto it, closes in, and presses a pad along the path with forces felt through the joint torques alone.
"""

from scenarios.start import parse, run_scenario  # isort: skip

import time

import numpy as np

from scenarios.barrel import Options, barrel_job
from scenarios.contact_job import run_contact_job


def main() -> int:
    options = parse(Options)
    rng = np.random.default_rng(options.seed)
    return run_contact_job(barrel_job(options, rng), options, rng, started=time.perf_counter())


if __name__ == "__main__":
    run_scenario(main)

"""Contact cleaning of a vertical pile with the arm on the vehicle's side.

The task is that of clean_barrel.py with a pile 3 m long, of which the camera sees a part. The flange determines the
height of the visible part.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import PileOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

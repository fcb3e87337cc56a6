"""Contact cleaning of any known object: one of the library by name, or a mesh file with a path laid on it.

The task is that of clean_barrel.py with another object. A named object is worked along one of its own paths. On a mesh
file [m] the path is a line over its top, along x, projected onto the mesh from above.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time

from uuv.cli.carry_out import run_job
from uuv.jobs import ObjectOptions as Options


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    return run_job(options.scenario(), options, started)


if __name__ == "__main__":
    run_scenario(main)

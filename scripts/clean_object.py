"""Contact cleaning of any known object: one of the library by name, or a mesh file with a path laid
on it.

The task is that of clean_barrel.py with another object. A named object is worked along one of its
own paths. On a mesh file [m] the path is a line over its top, along x, projected onto the mesh from
above.

The same as `uuv run clean-object`.
"""

from uuv.start import run_scenario  # isort: skip

import sys

from uuv.cli import run_job


def main() -> int:
    """Runs the job and returns the exit code."""
    return run_job.main("run", ["clean-object", *sys.argv[1:]])


if __name__ == "__main__":
    run_scenario(main)

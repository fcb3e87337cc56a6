"""Inspection of a known object: orbits with the camera on it [Konoplin 2019, eq. 6].

The object lies on the seabed; the vehicle knows its model and its coarse pose. Where the orbit
would bring hull or arm
too near, the vehicle stays where it is: one line with the reason, exit code 2.

The same as `uuv run inspect-object`.
"""

from uuv.start import run_scenario  # isort: skip

import sys

from uuv.cli import run_job


def main() -> int:
    """Runs the job and returns the exit code."""
    return run_job.main("run", ["inspect-object", *sys.argv[1:]])


if __name__ == "__main__":
    run_scenario(main)

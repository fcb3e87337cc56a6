"""Contact cleaning of a barrel in a current: scan, identification, and force-controlled motion of a
pad along a path.

The vehicle knows the barrel's shape and roughly where it is. It keeps station, takes a depth frame,
identifies the barrel, carries the tool path onto it and closes in. The contact force is estimated
from joint torques alone.

The same as `uuv run clean-barrel`.
"""

from uuv.start import run_scenario  # isort: skip

import sys

from uuv.cli import run_job


def main() -> int:
    """Runs the job and returns the exit code."""
    return run_job.main("run", ["clean-barrel", *sys.argv[1:]])


if __name__ == "__main__":
    run_scenario(main)

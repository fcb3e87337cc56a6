"""Contact cleaning of a vertical pile with the arm on the vehicle's side.

The task is that of clean_barrel.py with a pile 3 m long, of which the camera sees a part. The
flange determines the height of the visible part.

The same as `uuv run clean-pile`.
"""

from uuv.start import run_scenario  # isort: skip

import sys

from uuv.cli import run_job


def main() -> int:
    """Runs the job and returns the exit code."""
    return run_job.main("run", ["clean-pile", *sys.argv[1:]])


if __name__ == "__main__":
    run_scenario(main)

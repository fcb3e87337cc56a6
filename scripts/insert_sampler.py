"""Insertion of a sampler into a hole of a subsea manifold, and its withdrawal.

The vehicle knows the manifold's shape and roughly where it is. It keeps station, takes a depth
frame, identifies the manifold and moves the sampler before the hole. The insertion is
force-controlled along the axis and compliant across it. `uuv campaign
scripts/campaigns/insertion.toml` runs it over many seeds, with the success rate.

The same as `uuv run insert-sampler`.
"""

from uuv.start import run_scenario  # isort: skip

import sys

from uuv.cli import run_job


def main() -> int:
    """Runs the job and returns the exit code."""
    return run_job.main("run", ["insert-sampler", *sys.argv[1:]])


if __name__ == "__main__":
    run_scenario(main)

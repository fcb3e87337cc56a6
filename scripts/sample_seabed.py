"""Sampling of an unknown seabed: sonar scan, choice of the working height, and force-controlled
work in the soil.

The vehicle approaches over the plane that its Doppler velocity log (DVL) measures, and reconstructs
the ground from sonar scans. It projects the targets onto the ground, judges the relief and chooses
a pose for station keeping. It pushes a core tube into the soil with a set force, or drags a box
along the profile between two targets at a set depth. Then it withdraws the tool. If the cloud is no
ground, or the ground is unsuitable, the vehicle stays where it is: one line with the reason, exit
code 2.

The same as `uuv run sample-seabed`.
"""

from uuv.start import run_scenario  # isort: skip

import sys

from uuv.cli import run_job


def main() -> int:
    """Runs the job and returns the exit code."""
    return run_job.main("run", ["sample-seabed", *sys.argv[1:]])


if __name__ == "__main__":
    run_scenario(main)

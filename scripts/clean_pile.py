"""Contact cleaning of a vertical pile with the arm on the vehicle's side.

The task is that of clean_barrel.py with a pile 3 m long, of which the camera sees a part. The flange determines the
height of the visible part.
"""

from scenarios.start import parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from models.objects.targets import helix, pile, ring, vertical
from scenarios.contact_job import ContactJob, run_contact_job
from scenarios.contact_options import ContactOptions
from sim.interfaces.spatial import exp_so3, pose


@dataclass(kw_only=True)
class Options(ContactOptions):
    """Clean a vertical pile with a set force."""

    path: Literal["vertical", "ring", "helix"] = "vertical"
    """Up the pile, around it, or both at once."""
    length: float = 0.5
    """Length of the vertical path [m]."""
    arc: float = 100.0
    """Arc of ring and helix [deg]; where the reach ends sooner, the largest possible from 80 deg on is worked and
    reported."""
    rise: float = 0.3
    """Rise of the helix [m]."""
    azimuth: float = 0.0
    """Azimuth of the path's middle [deg], from the side that the vehicle approaches."""
    height: float = -0.15
    """Height of the path's middle above the pile's [m]; the flange is 0.2 to 0.3 m above it."""
    range: float = 1.8
    """Range from camera to the pile's axis at the scan [m]."""
    vehicle: str = "uuv_puma_side"


def pile_job(options: Options, rng: np.random.Generator) -> ContactJob:
    """The contact job for `options`; the pile's pose and its coarse detection are drawn from `rng`."""
    arc = 40.0 if options.quick else options.arc
    length = 0.2 if options.quick else options.length
    azimuth, height = np.radians(options.azimuth), options.height
    if options.path == "vertical":
        path = vertical(length, azimuth, height)
    elif options.path == "ring":
        path = ring(np.radians(arc), azimuth, height)
    else:
        path = helix(np.radians(arc), options.rise * arc / options.arc, azimuth, height)
    # The vehicle approaches from -x, to within 0.6 rad of azimuth 0. The pile tilts by 0.5 deg (1 sigma) about x and y.
    lean = np.radians(0.5) * rng.standard_normal(3) * [1.0, 1.0, 0.0]
    X_WT = pose(exp_so3(lean) @ exp_so3([0.0, 0.0, np.pi + rng.uniform(-0.6, 0.6)]), rng.uniform(-0.2, 0.2, 3))
    target = pile({options.path: path})
    up = options.path == "vertical"
    return options.job(
        "clean_pile",
        target,
        options.path,
        X_WT,
        rng,
        forces=(60.0, 90.0, 60.0) if up else (60.0, 90.0),
        least_share=1.0 if up else min(1.0, 80.0 / arc),
    )


def main() -> int:
    """Runs the scenario and returns the exit code."""
    options = parse(Options)
    rng = np.random.default_rng(options.seed)
    return run_contact_job(pile_job(options, rng), options, rng, started=time.perf_counter())


if __name__ == "__main__":
    run_scenario(main)

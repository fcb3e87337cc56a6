"""Barrel cleaning: its options and its contact job."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from models.objects.targets import barrel
from scenarios.contact_job import ContactJob
from scenarios.contact_options import ContactOptions
from sim.interfaces.spatial import exp_so3, pose


@dataclass(kw_only=True)
class Options(ContactOptions):
    """Clean a barrel with a set force."""

    path: Literal["longitudinal", "transverse"] = "longitudinal"
    """Along the barrel's top, or half around it."""
    length: float = 0.6
    """Length of the longitudinal path [m]."""
    arc: float = 180.0
    """Arc of the transverse path [deg]; where the reach ends sooner, the largest from 150 deg on is worked and
    reported."""
    azimuth: float = 0.0
    """Azimuth of the path around the barrel [deg], from the top; a large one is out of reach."""


def barrel_job(options: Options, rng: np.random.Generator) -> ContactJob:
    """The contact job for `options`; the barrel's pose and its coarse detection are drawn from `rng`."""
    arc = 60.0 if options.quick else options.arc
    azimuth = np.radians(options.azimuth)
    length = 0.2 if options.quick else options.length
    target = barrel(line_length=length, line_azimuth=azimuth, arc=np.radians(arc), arc_azimuth=azimuth)
    X_WT = pose(exp_so3([0.0, 0.0, rng.uniform(-0.6, 0.6)]), rng.uniform(-0.2, 0.2, 3) - [0.0, 0.0, 1.5])
    along = options.path == "longitudinal"
    return options.job(
        "clean_barrel",
        target,
        options.path,
        X_WT,
        rng,
        forces=(60.0, 90.0, 60.0) if along else (60.0, 90.0),
        least_share=1.0 if along else min(1.0, 150.0 / arc),
    )

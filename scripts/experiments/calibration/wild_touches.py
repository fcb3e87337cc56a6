"""Calibration from touches of which some are wild: displaced in all joints.

The simulated arm is the UR10e of [Yukhimets 2023] with 63 touches. Errors are those of moves of
the flange, beside those of the fit without the displacements.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass

import numpy as np

from experiments.calibration.simulated_arm import (
    FLANGE_POINTS,
    POINTS,
    TOUCHES,
    nominal_arm,
    touched_arm,
)
from uuv.calib import identify
from uuv.calib.verification import compare, flange_poses
from uuv.experiment import Page, column, experiment, stat
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number
from uuv.sim.interfaces.streams import Streams


@dataclass(frozen=True, kw_only=True)
class WildCase:
    """Calibration of one arm from touches of which some are displaced."""

    size: float
    """Standard deviation of the displacement of every joint [rad]."""
    wild: int
    """Number of touches that are displaced."""
    seed: int
    """Seed of errors and touches."""

    def __post_init__(self) -> None:
        finite_number(self.size, "--size [rad]", above=0.0)
        if not 0 <= self.wild <= POINTS * TOUCHES:
            raise ConfigurationError(
                f"--wild: must be from 0 to {POINTS * TOUCHES}, got {self.wild}"
            )


@dataclass(frozen=True, kw_only=True)
class WildRow:
    """Errors with and without the displacements, and which touches the fit holds for wild."""

    undisturbed: float = column("without wild touches", "mm", digits=3, factor=1e3)
    identified: float = column("identified", "mm", digits=3, factor=1e3)
    ratio: float = column("error over that without wild touches", digits=2)
    right: int = column("wild ones with reduced weight", digits=1)
    wrong: int = column("ordinary ones with reduced weight", digits=1)
    left_out: int = column("left out", digits=1)


@experiment(
    "calibration_wild_touches",
    seeds=10,
    vary={"size": (0.05, 0.005), "wild": (0, 3, 6, 9, 12)},
    paired=True,
    quick={"runs": 1},
)
def calibration_wild_touches(case: WildCase) -> WildRow:
    """Calibrates one arm."""
    nominal = nominal_arm()
    touched, truth = touched_arm(case.seed)

    # displaced touches
    streams = Streams(case.seed, case.wild)
    series = [np.array(q) for q in touched.touches.series]
    drawn = streams["wild touches"].choice(POINTS * TOUCHES, case.wild, replace=False)
    wild = {divmod(int(k), TOUCHES) for k in drawn}
    for i, j in sorted(wild):
        series[i][j] += case.size * streams[f"touch {i}, {j}"].standard_normal(nominal.n)

    # both fits
    calibration = identify(series, nominal)
    undisturbed = identify(touched.touches.series, nominal)
    q = flange_poses(nominal, np.random.default_rng(0), FLANGE_POINTS)
    origin = np.zeros(3)
    models = {
        "undisturbed": undisturbed.arm.tips(q, origin),
        "identified": calibration.arm.tips(q, origin),
    }
    clouds = compare(truth.arm.tips(q, origin), models)

    flagged = {
        (i, j)
        for i, weights in enumerate(calibration.weights)
        for j in np.flatnonzero(weights < 1.0).tolist()
    }
    return WildRow(
        undisturbed=clouds["undisturbed"].rms,
        identified=clouds["identified"].rms,
        ratio=clouds["identified"].rms / clouds["undisturbed"].rms,
        right=len(flagged & wild),
        wrong=len(flagged - wild),
        left_out=len(calibration.outliers),
    )


calibration_wild_touches.page = Page().table(
    f"Wild touches among {POINTS * TOUCHES}: error of moves of the flange over that of the fit "
    "without them",
    by=("size", "wild"),
    columns=[
        stat("median", "ratio", "error ratio, median"),
        stat("largest", "ratio", "largest"),
        stat("mean", "right"),
        stat("mean", "wrong"),
        stat("mean", "left_out"),
    ],
)

if __name__ == "__main__":
    run_scenario(calibration_wild_touches.main)

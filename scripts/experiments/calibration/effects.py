"""Calibration of an arm that has what real arms have: eccentric gears, seating errors, sag.

The simulated arm is the UR10e of [Yukhimets 2023], with errors of manufacture and 63 touches of
three points. Errors are those of moves of the flange, by the nominal table and by the identified
one.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from experiments.calibration.simulated_arm import reduced_touches, touched_arm
from uuv.arm_identification.calibration_case import TrueArm
from uuv.arm_identification.calibration_outcome import solve
from uuv.arm_identification.simulated_touches import RealEffects
from uuv.calib import Calibration
from uuv.experiment import Page, Row, column, experiment, stat

PUBLISHED = 0.6715, 0.2262  # [mm] nominal and identified, by the tracker [Yukhimets 2023]
PUBLISHED_COST = 28.7  # [mm^2] of the real arm
STRAIGHT = "ideal, straight pin"
# Amplitudes of gears: half of the peak-to-peak accuracy of component sets of sizes 25 and 14
# [HarmonicDrive CSF]. Seating: real touches scatter about their socket by 0.08 to 0.2 mm along each
# axis, all errors together (real_arms.py).
EFFECTS = {
    "ideal, off-axis pin": RealEffects(),
    STRAIGHT: RealEffects(),
    "gears 0.15 mrad": RealEffects(gears=1.5e-4),
    "gears 0.22 mrad": RealEffects(gears=2.2e-4),
    "gears 1 mrad": RealEffects(gears=1e-3),
    "seating 0.05 mm": RealEffects(seating=5e-5),
    "seating 0.2 mm": RealEffects(seating=2e-4),
    "sag 2 µrad/(N m)": RealEffects(compliance=2e-6),
    "sag 5 µrad/(N m)": RealEffects(compliance=5e-6),
    "sag 25 µrad/(N m)": RealEffects(compliance=2.5e-5),
    "gears 0.15 mrad, seating 0.1 mm, sag 2 µrad/(N m)": RealEffects(
        gears=1.5e-4, seating=1e-4, compliance=2e-6
    ),
}


@dataclass(frozen=True, kw_only=True)
class EffectCase:
    """Calibration of a simulated arm with one of EFFECTS."""

    effect: str
    """What the true arm has beside errors of its table."""
    seed: int
    """Seed of errors and touches."""


@dataclass(frozen=True, kw_only=True)
class EffectRow:
    """Errors of moves of the flange, and what the fit says of itself."""

    nominal: float = column("nominal", "mm", digits=3, factor=1e3)
    identified: float = column("identified", "mm", digits=3, factor=1e3)
    ratio: float = column("ratio", digits=2)
    cost: float = column("J", "mm²", digits=1, factor=1e6)
    rank: int = column("rank of 27", digits=0)
    covered: int = column("combinations whose interval holds the truth")
    combinations: int = column("combinations that the touches determine")
    reduced: int = column("touches with reduced weight", digits=1)


@experiment(
    "calibration_effects", seeds=20, vary={"effect": tuple(EFFECTS)}, paired=True, quick={"runs": 2}
)
def calibration_effects(case: EffectCase) -> EffectRow:
    """Calibrates one arm."""
    pin = "straight" if case.effect == STRAIGHT else "off-axis"
    touched, truth = touched_arm(case.seed, EFFECTS[case.effect], pin)
    outcome = solve(touched, free=(), prior={}, method="map")

    clouds = {name: cloud.rms for name, cloud in outcome.clouds.items()}
    inside = _inside(outcome.calibration, truth)
    return EffectRow(
        nominal=clouds["nominal"],
        identified=clouds["identified"],
        ratio=clouds["nominal"] / clouds["identified"],
        cost=outcome.calibration.cost,
        rank=outcome.calibration.rank.rank,
        covered=sum(inside),
        combinations=len(inside),
        reduced=reduced_touches(outcome.calibration),
    )


def _inside(calibration: Calibration, truth: TrueArm) -> list[bool]:
    """Of each determined combination of parameters, whether its 95 % interval holds the truth."""
    true_values = np.concatenate([truth.arm.table.ravel(), truth.tcp, np.zeros(truth.arm.n)])
    estimate = calibration.estimate
    change = true_values[estimate.parameters.index] - (estimate.values - estimate.changes)

    scaled = change / calibration.rank_free.scales
    inside = []
    for combination in calibration.combinations():
        low, high = combination.interval
        inside.append(bool(low <= combination.weights @ scaled <= high))
    return inside


def _ratios(rows: list[Row]) -> tuple[str, str, Figure]:
    """Picture of the ratios by effect: extremes, quartiles and median."""
    effects = list(dict.fromkeys(row["effect"] for row in rows))
    figure = Figure(figsize=(9.0, 0.42 * len(effects) + 1.2), layout="constrained")
    axes = figure.subplots()

    for level, effect in enumerate(effects, start=1):
        ratios = [row["ratio"] for row in rows if row["effect"] == effect]
        least, low, median, high, most = np.quantile(ratios, [0.0, 0.25, 0.5, 0.75, 1.0])
        y = [level, level]
        axes.plot([least, most], y, color="#0072B2", linewidth=1.0)
        axes.plot([low, high], y, color="#0072B2", linewidth=7.0, solid_capstyle="butt")
        axes.plot(median, level, "|", color="#222222", markersize=12, markeredgewidth=2.0)

    axes.set_yticks(range(1, len(effects) + 1), effects)
    axes.axvline(PUBLISHED[0] / PUBLISHED[1], color="#D55E00", linewidth=1.0)
    axes.axvline(1.0, color="#999999", linewidth=0.8, linestyle=":")
    axes.invert_yaxis()
    axes.set_xlabel("error of the nominal arm over that of the identified one")
    caption = (
        "Bars: quartiles with the median; lines: all seeds. The vertical line is the ratio of the "
        "real arm [Yukhimets 2023]."
    )
    return "Ratio of the errors", caption, figure


calibration_effects.page = (
    Page()
    .table(
        "Effects of real arms on a UR10e, medians",
        by="effect",
        columns=[
            stat("median", "nominal", "nominal"),
            stat("median", "identified", "identified"),
            stat("median", "ratio"),
            stat("p10", "ratio"),
            stat("p90", "ratio"),
            stat("median", "cost", "J"),
            stat("share", "covered", "in 95 % interval", among="combinations"),
        ],
    )
    .add(
        lambda _: (
            f"[Yukhimets 2023], the real arm: {PUBLISHED[0]:.3f} and {PUBLISHED[1]:.3f} mm, ratio "
            f"{PUBLISHED[0] / PUBLISHED[1]:.2f}, J {PUBLISHED_COST} mm². A wrong pose of the base "
            "changes nothing: the tracker's frame is aligned."
        )
    )
    .table(
        "The fits",
        by="effect",
        columns=[stat("least", "rank"), stat("largest", "rank"), stat("mean", "reduced")],
    )
    .add(_ratios)
)

if __name__ == "__main__":
    run_scenario(calibration_effects.main)

"""Effects of real arms on a calibration: what gears and sag cost, and the page."""

import numpy as np

from experiments.calibration.effects import EffectCase, calibration_effects

IDEAL, GEARS, SAG = "ideal, off-axis pin", "gears 1 mrad", "sag 25 µrad/(N m)"


def test_gears_and_sag_spoil_what_touching_finds():
    """The ratio of the errors, nominal over identified, is half of the ideal one at most."""
    rows = [
        calibration_effects.row(EffectCase(effect=effect, seed=seed))
        for seed in range(2)
        for effect in (IDEAL, GEARS, SAG)
    ]
    ratios = {
        effect: float(np.median([row["ratio"] for row in rows if row["effect"] == effect]))
        for effect in (IDEAL, GEARS, SAG)
    }
    assert ratios[IDEAL] > 2.0 * max(ratios[GEARS], ratios[SAG])
    assert {row["rank"] for row in rows if row["effect"] == IDEAL} == {18}

    summary = calibration_effects.summary(rows)
    cells = {row[0]: row for row in summary.tables[0].rows}
    assert cells[GEARS][summary.tables[0].columns.index("ratio, median")] == f"{ratios[GEARS]:.2f}"
    assert len(list(summary.pictures)) == 1


def test_quantiles_of_the_ratio_are_on_the_page():
    """Of 1 to 11 the quantiles are 2 and 10."""
    row = {"effect": IDEAL, "nominal": 3e-4, "identified": 1e-4, "cost": 1e-6, "rank": 18}
    row |= {"covered": 17, "combinations": 18, "reduced": 0}
    rows = [row | {"seed": seed, "ratio": 1.0 + seed} for seed in range(11)]

    table = calibration_effects.summary(rows).tables[0]
    cells = dict(zip(table.columns, table.rows[0], strict=True))
    assert cells["ratio, 10 %"] == "2.00"
    assert cells["ratio, 90 %"] == "10.00"
    assert cells["nominal [mm]"] == "0.300"
    assert cells["in 95 % interval [%]"].startswith("94.4 (")


def test_the_quick_subset_is_some_of_the_default_cases():
    whole = calibration_effects.space.cases(calibration_effects.options_with({}))
    quick = calibration_effects.space.cases(
        calibration_effects.options_with(calibration_effects.quick)
    )
    assert len(whole) == 220
    assert set(quick) < set(whole)

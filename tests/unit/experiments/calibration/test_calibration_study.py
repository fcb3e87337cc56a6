"""The calibration study: rows of each kind, and what its tables say of them."""

from pathlib import Path

import numpy as np
import pytest

from experiments.calibration.calibration_study import (
    EffectCase,
    LoadCase,
    RealCase,
    WildCase,
    real_cases,
    run,
    simulated_cases,
    summarise,
)
from uuv.calib.simulation import touch, wrong_arm
from uuv.calib.touch_files import write_touches
from uuv.models.arms import published_arms
from uuv.sim.interfaces.errors import ConfigurationError


def test_every_case_is_told_apart():
    cases = list(simulated_cases(0, 2, 2))
    assert len(set(cases)) == len(cases)
    assert {type(case) for case in cases} == {EffectCase, LoadCase, WildCase}


def test_gears_and_sag_spoil_what_touching_finds():
    """The nominal error is that of the same arm; sag in the fit costs nothing where compliances are
    identified.
    """
    rows = [
        run(EffectCase(effect, seed))
        for seed in range(3)
        for effect in ("ideal, off-axis pin", "gears 1 mrad", "sag 25 µrad/(N m)")
    ]
    rows += [run(LoadCase((0.0, 10.0), elastic, 0)) for elastic in (False, True)]
    rows.append(run(WildCase(6, 0.05, 0)))
    summary = summarise(rows)
    effects = summary.metrics["effect"]
    ideal = effects["ideal, off-axis pin"]
    assert ideal["rank"] == [18]
    assert ideal["ratio"] > 2.0 * max(
        effects["gears 1 mrad"]["ratio"], effects["sag 25 µrad/(N m)"]["ratio"]
    )
    loads = summary.metrics["load"]
    rigid, elastic = (loads[f"0 10 kg, {name}"] for name in ("rigid", "elastic"))
    assert rigid["identified_m"]["10"] > 5.0 * elastic["identified_m"]["10"]
    assert elastic["hidden"] == ["c1", "c6"]
    assert (
        max(elastic["relative_sigma"][1:5])
        < 0.1
        < min(elastic["relative_sigma"][0], elastic["relative_sigma"][5])
    )
    assert summary.metrics["wild"]["rows"][0]["right"] == 6
    assert len(summary.tables) == 4
    assert all(len(row) == len(table.columns) for table in summary.tables for row in table.rows)
    assert len(list(summary.pictures)) == 1


def test_real_touches_are_left_out_by_position(tmp_path: Path):
    """Files as of a real arm, here of one with known errors: positions left out are predicted to
    their noise.
    """
    rng = np.random.default_rng(2)
    nominal = published_arms.load("ur10e")
    true = wrong_arm(nominal, {"theta": 2e-3, "a": 1e-3, "alpha": 2e-3}, rng)
    middles = np.array([[0.6, -0.4, 0.3], [0.6, 0.4, 0.3], [0.3, 0.7, 0.5]])
    for name, middle in zip("abc", middles, strict=True):
        points = np.array([middle, np.add(middle, [0.05, 0.0, 0.0])])
        series = touch(true, (0.06, 0.0, 0.15), rng, points=points, touches=15)
        write_touches(tmp_path / name, ["hole_0", "hole_1"], series, _JOINTS)
    cases = list(real_cases(tmp_path, "ur10e", 0.05, ("c",)))
    assert [type(case) for case in cases] == [RealCase] * 6
    out, alone = run(cases[0]), run(cases[3])
    assert set(out["held_out_m"]) == {"a"}
    assert out["touches"] == 60
    assert out["held_out_m"]["a"] < 2.5e-4  # noise of 0.092 mm along three axes: 0.16 mm
    assert set(alone["held_out_m"]) == {"b"}
    said = summarise([out, alone]).metrics["real"]
    assert 0.8 < said[f"{tmp_path.name}, trained on all others"]["covered"] <= 1.0
    with pytest.raises(ConfigurationError, match="at least two folders"):
        list(real_cases(tmp_path / "a", "ur10e", 0.05, ()))


def test_intervals_are_judged_by_the_errors_that_they_hold():
    """Of 100 errors of 0.01 to 1 mm, 80 are within 0.805 mm; that is 0.85 of their 95 %
    quantile.
    """
    errors = 1e-5 * np.arange(1, 101)
    row = {
        "kind": "real",
        "robot": "r",
        "alone": False,
        "position": "a",
        "touches": 100,
        "reduced": 0,
        "left_out": 2,
    }
    row |= {
        "held_out_m": {"b": 2e-4, "c": 4e-4},
        "errors_m": errors.tolist(),
        "half_widths_m": [8.05e-4] * 100,
    }
    told = summarise([row]).metrics["real"]["r, trained on all others"]
    assert told["covered"] == pytest.approx(0.8)
    assert told["width_over_spread"] == pytest.approx(8.05e-4 / np.quantile(errors, 0.95))
    assert told["median_m"] == pytest.approx(3e-4)


_JOINTS = tuple(f"joint{k}" for k in range(1, 7))

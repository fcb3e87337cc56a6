"""Touches of real arms: positions left out and alone, and how their intervals are judged."""

from pathlib import Path

import numpy as np
import pytest

from experiments.calibration.real_arms import RealArmCase, RealTouches, calibration_real_arms, cases
from uuv.calib.simulation import touch, wrong_arm
from uuv.calib.touch_files import write_touches
from uuv.models.arms import published_arms
from uuv.sim.interfaces.errors import ConfigurationError

JOINTS = tuple(f"joint{k}" for k in range(1, 7))


def test_touches_are_left_out_by_position(tmp_path: Path):
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
        write_touches(tmp_path / "robot" / name, ["hole_0", "hole_1"], series, JOINTS)

    drawn = list(cases(RealTouches(data=tmp_path, arm="ur10e", aside=("c",))))
    assert [type(case) for case in drawn] == [RealArmCase] * 6
    others, alone = (calibration_real_arms.row(drawn[k]) for k in (0, 3))

    assert set(others["held_out"]) == {"a"}
    assert others["touches"] == 60
    assert others["held_out"]["a"] < 2.5e-4  # noise of 0.092 mm along three axes: 0.16 mm
    assert set(alone["held_out"]) == {"b"}
    summary = calibration_real_arms.summary([others, alone])
    assert 0.8 < summary.metrics["intervals"]["robot, all others"]["covered"] <= 1.0
    assert len(list(summary.pictures)) == 1

    with pytest.raises(ConfigurationError, match="at least two folders"):
        list(cases(RealTouches(data=tmp_path, robots=("robot/a",))))


def test_intervals_are_judged_by_the_errors_that_they_hold():
    """Of 100 errors of 0.01 to 1 mm, 80 are within 0.805 mm; that is 0.85 of their 95 %
    quantile.
    """
    errors = 1e-5 * np.arange(1, 101)
    row = {"folder": "x/r", "position": "a", "training": "all others", "arm": "panda"}
    row |= {"socket_distance": 0.05, "aside": [], "robot": "r", "touches": 100, "reduced": 0}
    row |= {"left_out": 2, "held_out": {"b": 2e-4, "c": 4e-4}}
    row |= {"errors": errors.tolist(), "half_widths": [8.05e-4] * 100}

    summary = calibration_real_arms.summary([row])
    metrics = summary.metrics["intervals"]["r, all others"]
    assert metrics["covered"] == pytest.approx(0.8)
    assert metrics["width_over_spread"] == pytest.approx(8.05e-4 / np.quantile(errors, 0.95))
    assert summary.tables[0].rows[0] == ["r", "all others", "0.300", "2"]

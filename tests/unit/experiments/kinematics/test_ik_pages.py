"""Means over arms on the page of inverse kinematics, and exponents by the number of links."""

import math

import pytest

from experiments.kinematics.ik_growth import exponents
from experiments.kinematics.ik_pages import kernel_goals, mean_ratio, over_hybrid


def row_of(arm: str, ratio: float, start: str = "cold") -> dict:
    solvers = {"hybrid": 1.0, "TRAC-IK": ratio}
    return {
        "arm": arm,
        "limits": 180,
        "start": start,
        "bar": "A",
        "targets": 100,
        "solved": {"hybrid": 100, "TRAC-IK": 95},
        "median": {name: 1e-5 * duration for name, duration in solvers.items()},
        "ratio": solvers,
        "ratio_sigma": {"hybrid": 0.0, "TRAC-IK": 0.1},
        "kernel": {"hybrid": 4e-6},
    }


def test_a_mean_ratio_is_geometric_and_its_error_shrinks_with_the_arms():
    rows = [row_of("puma560", 20.0), row_of("ur5", 80.0)]
    ratio = mean_ratio(rows, "TRAC-IK")
    sigma = 0.1 / math.sqrt(2.0)
    assert ratio == pytest.approx(
        [40.0, 40.0 * math.exp(-1.959964 * sigma), 40.0 * math.exp(1.959964 * sigma)]
    )
    assert mean_ratio(rows, "EAIK") is None


def test_goals_are_compared_by_start():
    rows = [row_of("puma560", 21.0), row_of("puma560", 11.0, "warm")]
    cells = over_hybrid(rows).rows[1]
    assert cells[0] == "TRAC-IK"
    assert cells[2] == "95.0"
    assert cells[4].endswith("(goal 20: met)")
    assert cells[8].endswith("(goal 12: missed)")
    assert [line.rsplit(": ", 1)[1] for line in kernel_goals(rows)] == ["met)", "missed)"]


def test_an_exponent_is_fitted_to_long_chains_alone():
    rows = [
        {"links": links, "median": {"hybrid": 5.0 if links < 24 else 1e-7 * links**1.5}}
        for links in (6, 24, 48, 96)
    ]
    assert exponents(rows) == {"hybrid": pytest.approx(1.5)}
    assert exponents(rows[:2]) == {}

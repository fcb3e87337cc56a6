"""Step response: figures of the mean of rows made by hand, and what is not accepted."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from experiments.contact import force_steps
from experiments.contact.step_response import StepCase, spread, step_response
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

RISE = 60.0 + 30.0 * np.clip(force_steps.times() / 0.2, 0.0, 1.0)


def row(stiffness: float, *curves: Array, note: str = "") -> dict[str, Any]:
    """A row of a run with these responses."""
    return {
        **asdict(StepCase(stiffness=stiffness, seed=0)),
        "set_force": [RISE.tolist()] * len(curves),
        "true_force": [curve.tolist() for curve in curves],
        "note": note,
    }


def test_spread_of_the_steps_is_about_their_mean_response():
    """Two runs 3 N to either side of a rise of 30 N: the spread is 3 N, whatever the rise."""
    rows = [row(1e5, RISE - 3.0), row(1e5, RISE + 3.0)]
    assert spread(rows) == pytest.approx(3.0)
    summary = step_response.summary(rows)
    (table,) = summary.tables
    assert [list(line) for line in table.rows] == [
        ["100000.0", "2", "0.16", "0.00", "0.19", "3.00"]  # settled 5 % below
    ]
    assert summary.accepted
    assert len(list(summary.pictures)) == 1


def test_an_overshoot_of_the_mean_on_one_surface_and_a_run_that_ended_are_not_accepted():
    """Single responses may overshoot: +-3 N about the rise is 10 % of the step."""
    soft = row(1e4, RISE - 3.0, RISE + 3.0)
    hard = row(1e6, RISE + np.where(RISE == 90.0, 1.8, 0.0))
    lost = row(3e4, note="contact lost")
    assert step_response.summary([soft, hard, lost]).failed == [
        "stiffness [N/m] 1e+06, overshoot: 6 %, at most 5 % is allowed",
        "stiffness [N/m] 3e+04, overshoot: no value",
        "runs that ended early: 1, at most 0 is allowed",
    ]
    assert step_response.summary([lost]).lines == ["30000 N/m, seed 0: contact lost"]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"low": 90.0}, "--low, --high: must rise from above zero, got 90.0, 90.0 N"),
        ({"rate": 0.0}, "--rate must be > 0 N/s, --steps from 1 to 6"),
        ({"steps": 7}, "--rate must be > 0 N/s, --steps from 1 to 6"),
    ],
)
def test_steps_that_are_refused(changed: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message):
        StepCase(stiffness=1e4, seed=0, **changed)

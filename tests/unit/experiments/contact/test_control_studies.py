"""What the studies of control say of rows made by hand: spreads, settling, and a gyro's axis that
is named.
"""

from typing import Any

import numpy as np
import pytest

from experiments.contact import force_step_figures as step_response
from experiments.contact import force_steps
from experiments.faults import gyro_steps
from uuv.sim.interfaces.messages import FaultKind


def test_spread_of_the_steps_is_about_their_mean_response():
    """Two answers 3 N to either side of a rise of 30 N: the spread is 3 N, whatever the rise."""
    mean = 60.0 + 30.0 * np.clip(force_steps.times() / 0.2, 0.0, 1.0)
    told = step_response.figures_of(1e5, np.array([mean - 3.0, mean + 3.0]), 60.0, 90.0)
    assert told["spread_n"] == pytest.approx(3.0)
    assert told["steps"] == 2
    assert told["rise_s"] == pytest.approx(0.16, abs=2.0 * force_steps.SAMPLE)
    assert told["settling_s"] == pytest.approx(0.19, abs=2.0 * force_steps.SAMPLE)  # to 5 % below


def steps_found(kind: FaultKind, part: str, found_s: float, **changed: Any) -> dict[str, Any]:
    """A row of a step of 0.03 rad/s about x."""
    row = {
        "path": "longitudinal",
        "seed": 1,
        "axis": "x",
        "size_rad_s": -0.03,
        "kind": kind.value,
        "part": part,
    }
    return {
        **row,
        "found_s": found_s,
        "force_max_n": 95.0,
        "path_max_m": 0.0021,
        "left": "",
        **changed,
    }


def test_a_gyro_is_named_by_its_kind_and_its_axis():
    """Of four steps one is named as another axis, and one as the attitude; the last is left."""
    rows = [
        steps_found(FaultKind.GYRO, "x", 0.4),
        steps_found(FaultKind.GYRO, "y", 3.0),
        steps_found(FaultKind.ATTITUDE, "", 2.0),
        steps_found(FaultKind.GYRO, "x", 0.7, size_rad_s=0.03, force_max_n=131.0, left="estimate"),
    ]
    (told,) = gyro_steps.summarise(rows).metrics["sizes"]
    assert tuple(told.values()) == ("0.03", "4", "2", "0.70", "131", "2.1", "1")

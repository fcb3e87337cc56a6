"""What the studies of control say of rows made by hand: spreads and settling."""

from typing import Any

import numpy as np
import pytest

from experiments.contact import force_step_figures as step_response
from experiments.contact import force_steps
from experiments.vehicles import hover


def test_cells_of_a_push_are_median_quantile_and_largest_and_the_current_is_rms():
    """Of 0 to 20 mm the 95 % is 19 mm; errors of the current of 30 and 10 mm/s have an RMS of
    22.
    """
    row: dict[str, Any] = {
        "excursion": (1e-3 * np.arange(21)).tolist(),
        "tilt": np.radians(0.1 * np.arange(21)).tolist(),
        "turn": np.radians(0.5 * np.arange(21)).tolist(),
        "saturated": [0.0, 0.1],
        "force_error": [4.0, 8.0],
        "current_error": [0.03, -0.01],
        "command_rate": 0.123,
    }
    columns = hover.hover.columns
    cells = [figure.bound_to(columns, "test").cell([row]) for figure in hover.FIGURES]
    assert cells == [
        "10.0, 19.0, 20.0",
        "1.0, 1.9, 2.0",
        "5.0, 9.5, 10.0",
        "5.0",
        "6",
        "22",
        "0.12",
    ]


def test_spread_of_the_steps_is_about_their_mean_response():
    """Two answers 3 N to either side of a rise of 30 N: the spread is 3 N, whatever the rise."""
    mean = 60.0 + 30.0 * np.clip(force_steps.times() / 0.2, 0.0, 1.0)
    told = step_response.figures_of(1e5, np.array([mean - 3.0, mean + 3.0]), 60.0, 90.0)
    assert told["spread_n"] == pytest.approx(3.0)
    assert told["steps"] == 2
    assert told["rise_s"] == pytest.approx(0.16, abs=2.0 * force_steps.SAMPLE)
    assert told["settling_s"] == pytest.approx(0.19, abs=2.0 * force_steps.SAMPLE)  # to 5 % below

"""Pushes at full reach: what the cells of a push say, and which cases there are."""

import numpy as np

from experiments.vehicles.hover import FIGURES, hover


def test_cells_of_a_push_are_median_quantile_and_largest_and_the_current_is_rms():
    """Of 0 to 20 mm the 95 % is 19 mm; errors of the current of 30 and 10 mm/s have an RMS of
    22.
    """
    row = {
        "excursion": (1e-3 * np.arange(21)).tolist(),
        "tilt": np.radians(0.1 * np.arange(21)).tolist(),
        "turn": np.radians(0.5 * np.arange(21)).tolist(),
        "saturated": [0.0, 0.1],
        "force_error": [4.0, 8.0],
        "current_error": [[0.03], [-0.01]],
        "command_rate": 0.123,
    }
    cells = [figure.bound_to(hover.columns, "test").cell([row]) for figure in FIGURES]
    assert cells == [
        "10.0, 19.0, 20.0",
        "1.0, 1.9, 2.0",
        "5.0, 9.5, 10.0",
        "5.0",
        "6",
        "22",
        "0.12",
    ]


def test_the_quick_subset_is_some_of_the_cases_of_the_envelope():
    whole = hover.space.cases(hover.options_with({"table": ("envelope",)}))
    quick = hover.space.cases(hover.options_with(hover.quick))
    assert [case.variant for case in quick] == ["compensation", "no compensation"]
    assert len(whole) == 6
    assert set(quick) < set(whole)

"""The study of the felt force: what is stated for each axis is what the draws show, on arms of any
number of joints.
"""

import numpy as np
import pytest

from experiments.contact.tip_force_errors import LIMITS, ForceCase, run


@pytest.mark.parametrize("arm", LIMITS)
def test_the_stated_deviation_of_each_axis_is_that_of_the_errors(arm: str):
    row = run(ForceCase(arm, "sensor, bias", "weighted", seed=0, runs=1000, noise=0.01, bias=0.5))
    assert row["nees_share"] == pytest.approx(1.0, abs=0.1)
    assert row["axes_rms_n"] == pytest.approx(row["axes_stated_n"], rel=0.1)  # measured 0.087
    assert np.linalg.norm(row["axes_rms_n"]) == pytest.approx(row["rms_n"])


def test_unweighted_torques_state_nothing():
    assert (
        run(ForceCase("default", "sensor, bias", "least squares", 0, 100, 0.01, 0.5))[
            "axes_stated_n"
        ]
        is None
    )

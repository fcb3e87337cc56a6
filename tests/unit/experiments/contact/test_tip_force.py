"""Error of the tip force: what is stated for each axis is what the draws show, on arms of any
number of joints.
"""

from typing import Any

import numpy as np
import pytest

from experiments.contact.tip_force import LIMITS, ForceCase, tip_force_errors
from uuv.sim.interfaces.errors import ConfigurationError


@pytest.mark.parametrize("arm", LIMITS)
def test_the_stated_deviation_of_each_axis_is_that_of_the_errors(arm: str):
    case = ForceCase(arm=arm, source="sensor, bias", form="weighted", postures=1000)
    row = tip_force_errors(case)
    assert row.nees == pytest.approx(1.0, abs=0.1)
    assert row.axes_rms == pytest.approx(row.axes_stated, rel=0.1)  # measured 0.087
    assert np.linalg.norm(row.axes_rms) == pytest.approx(row.rms)


def test_estimators_are_compared_on_the_same_draws():
    """Where one deviation holds for all torques, weighing them changes next to nothing."""
    plain, weighted = (
        tip_force_errors(
            ForceCase(arm="panda", source="sensor, bias", form=form, postures=50, noise=0.0)
        )
        for form in ("least squares", "weighted")
    )
    assert plain.axes_rms == pytest.approx(weighted.axes_rms, rel=5e-3)  # measured 5e-4
    assert plain.near_singular == pytest.approx(weighted.near_singular, rel=2e-2)  # measured 3e-3


def test_unweighted_torques_state_nothing():
    case = ForceCase(arm="default", source="sensor, bias", form="least squares", postures=100)
    row = tip_force_errors(case)
    assert row.axes_stated is None
    assert row.nees is None


def test_the_closed_form_is_of_the_default_arm_alone():
    cases = tip_force_errors.space.cases(tip_force_errors.options_with({}))
    assert {case.arm for case in cases if case.form == "closed form"} == {"default"}
    assert len(cases) == 4 * 5 * 3 + 5


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"postures": 1}, "--postures: must be at least 20, got 1"),
        ({"seed": -1}, "--seed"),
        ({"noise": -0.1}, "--noise"),
        ({"bias": np.nan}, "--bias"),
    ],
)
def test_values_that_are_refused(changed: dict[str, Any], message: str):
    values: dict[str, Any] = {"arm": "panda", "source": "sensor, bias", "form": "weighted"}
    with pytest.raises(ConfigurationError) as refused:
        ForceCase(**(values | changed))
    assert message in str(refused.value)

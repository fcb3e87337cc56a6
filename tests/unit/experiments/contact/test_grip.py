"""Grip: what the computed setting holds and where it slips, and what others drop."""

import pytest

from experiments.contact.grip import ACROSS, COMPUTED, DRIFT, HOLD, OUT, TURN, GripCase, grip
from uuv.sim.interfaces.errors import ConfigurationError

PUMA = "uuv_puma"


@pytest.mark.parametrize("trial", [ACROSS, OUT, TURN])
def test_the_object_slips_at_the_friction_cone(trial: str) -> None:
    row = grip(GripCase(trial=trial, shape="sphere", setting=COMPUTED, vehicle=PUMA))
    assert not row.kept
    assert row.off is not None
    assert row.off < 0.02


def test_the_object_is_held_where_a_usual_setting_drops_it() -> None:
    usual, computed = (
        grip(GripCase(trial=HOLD, shape="sphere", setting=s, vehicle=PUMA, duration=25.0))
        for s in ("elliptic, 1", COMPUTED)
    )
    assert not usual.kept
    assert usual.creep is None
    assert computed.kept
    assert computed.creep is not None
    assert computed.creep < 0.002 * 25.0 / 60.0


def test_a_vehicle_adrift_holds_the_object() -> None:
    row = grip(GripCase(trial=DRIFT, shape="box", setting=COMPUTED, vehicle=PUMA, duration=1.0))
    assert row.kept
    assert row.creep is not None
    assert row.creep < 1e-4


def test_vehicles_drift_with_one_setting_and_matter_to_no_other_trial() -> None:
    cases = grip.space.cases(grip.options_with({}))
    assert len([case for case in cases if case.trial == DRIFT]) == 2
    assert len(cases) == 4 * 3 * 6 + 2


@pytest.mark.parametrize(
    ("changed", "message"),
    [({"trial": "throw"}, "--trial"), ({"force": 0.0}, "--force"), ({"shape": "cone"}, "--shape")],
)
def test_a_trial_that_cannot_be_run_is_refused(changed: dict, message: str) -> None:
    case = {"trial": HOLD, "shape": "box", "setting": COMPUTED, "vehicle": PUMA}
    with pytest.raises(ConfigurationError, match=message):
        GripCase(**{**case, **changed})


def test_more_than_the_motor_s_force_is_refused() -> None:
    case = GripCase(trial=HOLD, shape="box", setting=COMPUTED, vehicle=PUMA, force=150.0)
    with pytest.raises(ConfigurationError, match="at most 100 N, got 150 N"):
        grip(case)

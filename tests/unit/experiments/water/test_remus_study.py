"""REMUS 100 beside its source: figures that are near each other, and values that are refused."""

from typing import Any

import pytest

from experiments.water.remus import RemusCase, remus
from uuv.sim.interfaces.errors import ConfigurationError


def test_the_first_seconds_are_those_of_the_source():
    case = RemusCase(rudder=-4.0, duration=4.0)
    row = remus(case)
    assert row.here["distance [m]"] > 2.0
    assert row.here["heading [deg]"] * row.source["heading [deg]"] > 0.0  # the same side
    for name, off in row.off.items():
        assert 0.0 < off < 0.03 * row.largest[name], name  # measured 0.008, of r
    values = {name: getattr(case, name) for name in remus.case_names}
    ends, whole = remus.summary([values | vars(row)]).tables
    assert [line[1] for line in ends.rows] == ["distance [m]", "speed [m/s]", "heading [deg]"]
    assert [line[1] for line in whole.rows] == ["u [m/s]", "v [m/s]", "r [rad/s]"]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"step": 0.003}, "--step: must be a multiple of 0.002 s, got 0.003"),
        ({"step": 1e-12}, "--step: must be a multiple of 0.002 s, got 1e-12"),
        ({"duration": 0.05}, "--duration: must be a multiple of 0.02 s, got 0.05"),
        ({"duration": 0.0}, "--duration"),
        ({"rpm": 1e5}, "--rpm"),
        ({"rudder": 90.0}, "--rudder"),
    ],
)
def test_values_that_are_refused(changed: dict[str, Any], message: str):
    values = {"rudder": 0.0, **changed}
    with pytest.raises(ConfigurationError) as refused:
        RemusCase(**values)
    assert message in str(refused.value)

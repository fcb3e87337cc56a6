"""Identification, calibration, inverse kinematics, the hover: figures of short runs against the
behaviour baseline.
"""

import pytest

import holding

ANOTHER_OBJECT = pytest.mark.long(
    guarded_by="tests/baseline/test_parts.py::test_figures_keep_their_bands"
)


@pytest.mark.parametrize(
    "name",
    [
        "identification_barrel",
        pytest.param("identification_valve", marks=ANOTHER_OBJECT),
        pytest.param("identification_rock", marks=ANOTHER_OBJECT),
        "calibration",
        "inverse_kinematics",
        "hover_envelope",
    ],
)
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)

"""Identification, calibration, inverse kinematics, the hover: figures of short runs against the
behaviour baseline.
"""

import pytest

import holding


@pytest.mark.parametrize(
    "name",
    [
        "identification_barrel",
        "identification_valve",
        pytest.param("identification_rock", marks=pytest.mark.long),
        "calibration",
        "inverse_kinematics",
        "hover_envelope",
    ],
)
def test_figures_keep_their_bands(name, fresh_seeds):
    holding.check(name, fresh_seeds)

"""T200 at a voltage that is left out: better than one curve, and only where it can be judged."""

import pytest

from experiments.water.t200_voltages import VoltageCase, t200_voltages
from uuv.sim.interfaces.errors import ConfigurationError


def test_the_sheets_on_either_side_predict_the_one_between():
    row = t200_voltages(VoltageCase(voltage=14.0))
    assert row.full_thrust == pytest.approx(44.38)
    assert row.thrust_share == pytest.approx(row.thrust / 44.38)
    assert row.thrust < 0.1 * row.one_curve
    assert row.dead_band <= 4.0  # a row of the sheet


@pytest.mark.parametrize("voltage", [10.0, 12.0])
def test_a_voltage_without_a_sheet_on_either_side_is_refused(voltage):
    with pytest.raises(ConfigurationError, match=r"--voltage \[V\]: allowed 14 and 16"):
        VoltageCase(voltage=voltage)

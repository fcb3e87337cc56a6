"""Water from geometry: errors of a known shape, coefficients by axis, and what is refused."""

import numpy as np
import pytest

from experiments.water.added_mass import SHAPES, ShapeCase, added_mass
from experiments.water.hull_geometry import AXES, HullCase, hull_geometry
from experiments.water.robot_geometry import file_of
from uuv.models.vehicles.bluerov2_heavy import WU_2018
from uuv.sim.interfaces.errors import ConfigurationError


def test_more_panels_are_nearer_to_the_closed_form():
    case = ShapeCase(shape="ellipsoid 1 1 0.2", panels=(100, 400))
    row = added_mass(case)
    assert row.error["400 panels"] < row.error["100 panels"] < 0.2
    assert row.extrapolated < row.error["100 panels"]
    values = {"shape": case.shape, "panels": [100, 400]}
    first, errors, seconds = added_mass.summary([values | vars(row)]).tables
    assert first.rows[0][:2] == ["ellipsoid 1 1 0.2", "Lamb 1932"]
    assert errors.columns == seconds.columns == ("shape", "100 panels", "400 panels")


def test_axes_of_revolution_are_not_compared():
    factors = SHAPES["ellipsoid 2 1 1"].factors
    assert factors[3] != factors[3]
    assert (factors[[0, 1, 4]] > 0.0).all()


@pytest.mark.parametrize("panels", [(400,), (800, 400), (1, 400)])
def test_panels_that_do_not_rise_are_refused(panels: tuple[int, ...]):
    with pytest.raises(ConfigurationError, match="--panels: must be two or more rising numbers"):
        ShapeCase(shape="cube", panels=panels)


def test_published_coefficients_are_by_axis():
    row = hull_geometry(HullCase(hull="Wu 2018"))
    assert tuple(row.added_mass) == tuple(row.linear) == AXES
    assert row.volume == WU_2018.volume
    assert row.linear["sway"] == np.asarray(WU_2018.linear_damping)[1]


def test_a_package_that_is_not_there_is_named():
    with pytest.raises(ConfigurationError, match="needs the package example-robot-data"):
        file_of("UR5")

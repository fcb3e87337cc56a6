"""Coverage of identified water: shares by group of rows made by hand."""

from dataclasses import asdict
from typing import Any

import pytest

from experiments.water.coverage import DrawCase, covered_least, water_coverage
from experiments.water.plans import water_plans
from uuv.sim.interfaces.errors import ConfigurationError


def row(seed: int, surge: float, trim: float) -> dict[str, Any]:
    """A draw with errors in stated deviations; half an interval is 2.5 of them."""
    names = ("added mass surge", "added mass sway", "net buoyancy")
    errors = (surge, 1.0, trim)
    case = DrawCase(vehicle="uuv_puma", seed=seed)
    return {
        **asdict(case),
        "error": dict(zip(names, errors, strict=True)),
        "told": dict(zip(names, (0.9, 0.7, 0.5), strict=True)),
        "quantile": 2.5,
        "seconds": 4.0 + seed,
    }


ROWS = [row(0, -2.2, 0.1), row(1, 3.0, -2.6), row(2, 0.4, -0.2)]


def test_shares_that_cover_and_are_told_are_by_group():
    """Of six intervals of added masses one misses, of three of the trim another one; the normal
    interval of 1.96 deviations misses -2.2 too.
    """
    covers, told, single = (table.rows[0] for table in water_coverage.summary(ROWS).tables)
    assert covers == ["uuv_puma", "83.3", "-", "-", "66.7", "-", "-", "77.8", "66.7"]
    assert told == ["uuv_puma", "80", "-", "-", "50", "-", "-", "70"]
    assert single[1] == "3"
    assert single[3] == "33.3"  # of the second draw two of three miss
    assert single[5:] == ["5.0", "6.0"]


def test_parameters_covered_least_come_first():
    first, second, third = covered_least(ROWS).split("; ")
    assert {first, second} == {"added mass surge 67 %", "net buoyancy 67 %"}
    assert third == "added mass sway 100 %"


def test_values_that_are_refused():
    for values, message in (({"duration": 0.0}, "--duration"), ({"gust": -1.0}, "--gust")):
        options = water_plans.options_with(values)
        with pytest.raises(ConfigurationError, match=message):
            water_plans.study(options)

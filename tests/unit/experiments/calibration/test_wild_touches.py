"""Wild touches: all are seen, and which numbers of them are refused."""

import pytest

from experiments.calibration.wild_touches import WildCase, calibration_wild_touches
from uuv.sim.interfaces.errors import ConfigurationError


def test_all_wild_touches_lose_weight():
    row = calibration_wild_touches(WildCase(size=0.05, wild=6, seed=0))
    assert row.right == 6
    assert row.wrong <= 2
    assert 0.5 < row.ratio < 1.5
    assert row.ratio == row.identified / row.undisturbed


@pytest.mark.parametrize(("size", "wild"), [(0.0, 3), (0.05, -1), (0.05, 64)])
def test_no_more_touches_can_be_wild_than_there_are(size: float, wild: int):
    with pytest.raises(ConfigurationError, match="--size" if size == 0.0 else "--wild"):
        WildCase(size=size, wild=wild, seed=0)

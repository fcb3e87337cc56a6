"""The bands themselves: what they let through and what not, by the closed form; and that no case is
left out.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

import store
from bands import FALSE_ALARMS, Band, bands_of, faults, numbers_of
from cases import CASES


def test_a_figure_that_no_seed_changes_is_held_to_rounding():
    band = Band.of([60.0] * 8)
    assert not band.fault(60.0 * (1.0 + 1e-12))
    assert "above" in band.fault(60.001)
    assert "below" in band.fault(59.999)


@pytest.mark.parametrize("factor", [True, False])
def test_a_band_is_as_wide_as_students_interval_of_one_more_run(factor):
    """Over many sets of seeds the share of alarms is FALSE_ALARMS; here seen at a level that can be
    counted.
    """
    rng = np.random.default_rng(1)
    x = rng.standard_normal((4000, 12))
    bands = [Band.of(np.exp(0.2 * row) if factor else row) for row in x]
    assert {band.factor for band in bands} == (
        {True} if factor else {False, *(row.min() > 0.0 for row in x)}
    )
    wide = np.array([band.high for band in bands])
    # of the true distribution, above
    alarms = norm.sf(np.log(wide) / 0.2 if factor else wide).mean()
    assert 0.3 * FALSE_ALARMS / 2 < alarms < 3.0 * FALSE_ALARMS / 2


def test_what_is_missing_and_what_should_not_be_there_is_said():
    bands = bands_of(
        [{"a": 1.0 + 0.1 * k, "none": None, "some": None if k % 2 else 1.0} for k in range(8)]
    )
    assert list(bands) == ["a", "none"]
    assert faults({"a": 1.4, "none": None, "new": 3.0}, bands) == []
    assert faults({"a": None, "none": 2.0}, bands) == [
        "a: no figure",
        "none: 2, where no run gave a figure",
    ]
    with pytest.raises(ValueError, match="at least 8"):
        Band.of([1.0] * 7)


def test_a_verdict_is_held_on_the_seeds_that_it_was_seen_on():
    bands = bands_of([{"accepted": True, "varies": k > 3} for k in range(8)])
    assert list(bands) == ["accepted"]
    assert len(faults({"accepted": False}, bands)) == 1
    assert faults({"accepted": False}, bands, fresh=True) == []


def test_numbers_of_nested_metrics_have_dotted_names():
    metrics = {
        "run": {"state": "done", "wall_s": 3.0, "ok": True},
        "parts": [{"n": 60.0}],
        "gap": None,
    }
    assert numbers_of(metrics, without=["run.wall_s"]) == {
        "run.ok": True,
        "parts.0.n": 60.0,
        "gap": None,
    }


def test_every_case_is_held_and_tested():
    tested = "".join(file.read_text() for file in Path(__file__).parent.glob("test_*.py"))
    assert set(store.read()) == set(CASES)
    assert {name for name in CASES if re.search(rf'"{name}"', tested)} == set(CASES)

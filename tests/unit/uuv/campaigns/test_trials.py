"""The summary of many trials of one job: the share that is wanted, and what the table calls the
worst.
"""

from typing import Any

import pytest

from uuv.campaigns.trials import Trials


@pytest.mark.parametrize(("good", "failed"), [(19, []), (18, ["accepted: 90.0%, wanted 95%"])])
def test_the_wanted_share_is_enough(good: int, failed: list[str]):
    """19 of 20 are 95 %."""
    figures: dict[str, Any] = {
        "accepted": good,
        "trials": 20,
        "share": good / 20,
        "share_low": 0.7,
        "share_high": 0.99,
        "failures": {"jammed": 20 - good},
        "failed_seeds": [3],
        "depth_m": {"median": 0.1, "p95": 0.12, "max": 0.13, "min": 0.02},
        "force_n": None,
    }
    trials = Trials(
        one=lambda _: {},
        crashed=lambda *_: {},
        summary=lambda _: figures,
        spreads=(("depth", "depth_m", "mm", 1e3, "min"), ("force", "force_n", "N", 1.0, "max")),
    )
    told = trials._summarise([])
    assert told.failed == failed
    assert (told.tables or [])[0].rows == [("depth", "mm", "100.00", "120.00", "20.00")]

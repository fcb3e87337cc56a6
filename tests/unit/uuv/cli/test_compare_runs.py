"""Which figures of two runs count as alike."""

import math
from typing import Any

import pytest

from uuv.cli.past.compare_runs import alike, numbers


@pytest.mark.parametrize(
    ("values", "same"),
    [
        ([0.001, 0.00101], True),  # millimetres differ by a share too
        ([0.001, 0.002], False),
        ([60.0, 61.0], True),
        ([60.0, 62.0], False),
        ([-60.0, 60.0], False),
        ([-60.0, -61.0], True),
        ([0.0, 0.0], True),
        ([None, 0.0], False),
        ([True, False], False),
        (["done", "abort"], False),
        ([1.0, math.inf], False),
    ],
)
def test_figures_are_alike_within_a_share_of_the_larger(values: list[Any], same: bool):
    assert alike(values) is same
    assert alike(values[::-1]) is same


def test_figures_have_dotted_names():
    metrics = {
        "run": {"state": "done", "note": "n"},
        "contact": {"lost_s": None, "segments": [1]},
        "accepted": True,
    }
    assert dict(numbers(metrics)) == {"run.state": "done", "contact.lost_s": None, "accepted": True}

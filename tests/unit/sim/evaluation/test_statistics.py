"""What is said of many trials: shares with their intervals, spreads, failures by kind."""

import numpy as np
import pytest

from uuv.sim.evaluation.statistics import (
    crashed_run,
    kind_of_failure,
    share_interval,
    spread,
    verdicts,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import AbortCode


def test_wilson_against_the_published(within):
    """Newcombe 1998, Statistics in Medicine 17:857, table I: 81 of 263, 15 of 148, 0 of 20, 1 of
    29.
    """
    for good, of, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        within(f"{good} of {of}", np.subtract(share_interval(good, of), (low, high)), 6e-5)
    with pytest.raises(ConfigurationError, match="good"):
        share_interval(3, 2)


def test_spread_leaves_out_what_is_not_there():
    assert spread([None, 3.0, 1.0, 2.0]) == {
        "median": 2.0,
        "p95": pytest.approx(2.9),
        "max": 3.0,
        "min": 1.0,
    }
    assert spread([None, None]) is None


def trial(
    state: str, abort: AbortCode | None = None, failed: str = "", *, accepted: bool = False
) -> dict:
    # words that tell nothing
    whole = crashed_run(5, "the tube is full: no hole, stopped at the limit")
    whole["run"] |= {"state": state, "abort": None if abort is None else abort.value}
    return {**whole, "accepted": accepted, "failed": [failed]}


def test_the_code_tells_the_kind():
    said = [
        kind_of_failure(one)
        for one in (
            trial("abort", AbortCode.JAMMED),
            trial("retreat", AbortCode.FORCE_LIMIT),  # on its way back when the time was over
            trial("insert"),
            trial("done", failed="force: 3 N, allowed 2 N"),
            trial("crashed"),
            trial("done", accepted=True),
        )
    ]
    assert said == ["jammed", "force limit", "not ended", "force", "crashed", ""]


def test_verdicts_count():
    trials = [trial("done", accepted=True)] * 3 + [trial("abort", AbortCode.JAMMED)]
    figures = verdicts(trials)
    assert (figures["trials"], figures["accepted"], figures["share"]) == (4, 3, 0.75)
    assert (figures["failures"], figures["failed_seeds"]) == ({"jammed": 1}, [5])
    assert figures["share_low"] < 0.75 < figures["share_high"]

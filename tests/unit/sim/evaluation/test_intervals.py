"""Intervals against published tables, closed forms, and resamples that are drawn here."""

import numpy as np
import pytest

from uuv.sim.evaluation.intervals import (
    bootstrap_interval,
    median_interval,
    middle,
    ratio_interval,
    share_interval,
)
from uuv.sim.interfaces.errors import ConfigurationError


def test_score_interval_of_a_share_against_the_published(within):
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


def test_exact_interval_of_a_share_that_is_whole(within):
    """All of n trials: the lower limit solves p^n = 0.025."""
    low, high = share_interval(17, 17, "exact")
    within("lower limit", low - 0.025 ** (1.0 / 17.0), 1e-12)
    assert high == 1.0


@pytest.mark.parametrize(("good", "of"), [(3, 2), (-1, 4), (0, 0)])
def test_impossible_counts_are_refused(good, of):
    with pytest.raises(ConfigurationError, match=f"expected 0 <= good <= of.*got {good} of {of}"):
        share_interval(good, of)


def test_the_interval_of_a_median_is_by_order_statistics(rng):
    """Of six values it is their whole range (97 %), of five there is none; of 60 it leaves out 21
    on either side.
    """
    assert median_interval(np.zeros(0)) is median_interval(np.arange(5.0)) is None
    assert median_interval(rng.permutation(6.0 + np.arange(6.0))) == (6.0, 11.0)
    assert median_interval(rng.permutation(np.arange(60.0))) == (21.0, 38.0)


def test_bootstrap_of_paired_samples_draws_them_together(rng):
    """The ratio of medians over resamples of the pairs, drawn here by the same generator."""
    a = rng.lognormal(sigma=0.4, size=41)
    b = a * rng.lognormal(sigma=0.1, size=41)
    interval = ratio_interval(a, b, np.random.default_rng(7), 500)
    picks = np.random.default_rng(7).integers(41, size=(500, 41))
    expected = np.median(a[picks], axis=1) / np.median(b[picks], axis=1)
    assert np.array_equal(interval.resampled, expected)
    assert (interval.low, interval.high) == pytest.approx(middle(expected), rel=1e-12)
    assert interval.low < np.median(a) / np.median(b) < interval.high


def test_bootstrap_of_one_value_is_that_value_and_of_none_is_refused(rng):
    interval = bootstrap_interval(np.median, np.array([2.5]), rng=rng)
    assert interval.low == interval.high == 2.5
    with pytest.raises(ConfigurationError, match="at least one value"):
        bootstrap_interval(np.median, np.zeros(0), rng=rng)

"""Confidence intervals (95 %) of shares, medians and other statistics, computed by SciPy.

The import of SciPy's statistics takes a second. The functions import it when they are called, since
the metrics of every job import this module.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

LEVEL = 0.95  # confidence level of every interval
TAILS = (0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL))
SIGMAS = 1.959963984540054  # standard deviations to either side of a normal interval
RESAMPLES = 9999  # of a bootstrap
_AT_ONCE = 1_000_000  # values drawn at a time, which bounds the memory


def share_interval(
    good: int, of: int, method: Literal["wilson", "exact"] = "wilson"
) -> tuple[float, float]:
    """Confidence interval of a share, by the score method [Wilson 1927] or the exact one of Clopper
    and Pearson.

    Args:
        good: Number of successes.
        of: Number of trials.
        method: Which interval. The score interval has its confidence level on average over all
            shares, the exact one at every share.

    Returns:
        Lower and upper limit.

    Raises:
        ConfigurationError: The counts are impossible.
    """
    if not 0 <= good <= of or of < 1:
        raise ConfigurationError(f"share: expected 0 <= good <= of, of > 0; got {good} of {of}")

    from scipy.stats import binomtest

    interval = binomtest(good, of).proportion_ci(LEVEL, method)
    return float(interval.low), float(interval.high)


def median_interval(values: Array) -> tuple[float, float] | None:
    """Confidence interval of the median of `values` (n,) by order statistics, for any distribution.

    None for fewer than six values.
    """
    from scipy.stats import quantile_test

    if not len(values):
        return None
    interval = quantile_test(values, q=0.0, p=0.5).confidence_interval(LEVEL)
    return (float(interval.low), float(interval.high)) if np.isfinite(interval.low) else None


@dataclass(frozen=True, slots=True, eq=False)
class Bootstrap:
    """Percentile interval of a statistic, and the values (resamples,) of the statistic."""

    low: float
    high: float
    resampled: Array


def bootstrap_interval(
    statistic: Callable[..., Any],
    *samples: Array,
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
) -> Bootstrap:
    """Bootstrap of a statistic.

    Args:
        statistic: Function of one array for each sample, and of the `axis` of the resamples.
        samples: Values (n,) of each sample. Several samples are paired, and drawn together.
        rng: Draws the resamples.
        resamples: Number of resamples.

    Raises:
        ConfigurationError: There are no values.
    """
    count = len(samples[0])
    if not count:
        raise ConfigurationError("bootstrap: expected at least one value, got none")
    if count == 1:  # every resample equals the sample, a case that SciPy refuses
        estimate = float(statistic(*samples, axis=0))
        return Bootstrap(estimate, estimate, np.full(resamples, estimate))

    from scipy.stats import bootstrap

    resampled = bootstrap(
        samples,
        statistic,
        n_resamples=resamples,
        batch=max(1, _AT_ONCE // count),
        vectorized=True,
        paired=len(samples) > 1,
        confidence_level=LEVEL,
        method="percentile",
        rng=rng,
    )
    interval = resampled.confidence_interval
    return Bootstrap(float(interval.low), float(interval.high), resampled.bootstrap_distribution)


def ratio_interval(
    values: Array, base: Array, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Bootstrap:
    """Bootstrap of the ratio of the medians of `values` and `base`, both (n,) and of the same
    trials.
    """

    def ratio(a: Array, b: Array, axis: int) -> Array:
        return np.median(a, axis=axis) / np.median(b, axis=axis)

    return bootstrap_interval(ratio, values, base, rng=rng, resamples=resamples)


def middle(resampled: Array) -> tuple[Array, Array]:
    """Ends of the percentile interval of the resampled values (resamples, ...) of a statistic."""
    low, high = np.quantile(resampled, TAILS, axis=0)
    return low, high

"""Runs in pairs with the same draw: differences and ratios of a metric, and shares of kept runs."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, wilcoxon

from uuv.campaigns.sensitivity import RESAMPLES
from uuv.sim.evaluation.intervals import bootstrap_interval
from uuv.sim.interfaces.spatial import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedMetric:
    """A metric in the runs that both campaigns have, as differences B - A."""

    name: str
    pairs: int  # number of runs with a value in both
    median_a: float
    median_b: float
    median: float  # median of the differences
    low: float
    high: float  # bootstrap interval of this median
    p: float  # p of Wilcoxon's signed ranks, two-sided; 1 if nothing differs
    less: int  # number of runs in which B is below A
    equal: int
    more: int

    @classmethod
    def of(cls, name: str, a: Array, b: Array, rng: np.random.Generator) -> "PairedMetric":
        """The metric from its values (pairs,) in both campaigns, at least one pair."""
        # Differences of the pairs, and their median with its interval.
        change = b - a
        interval = bootstrap_interval(np.median, change, rng=rng, resamples=RESAMPLES)
        return cls(
            name=name,
            pairs=len(change),
            median_a=float(np.median(a)),
            median_b=float(np.median(b)),
            median=float(np.median(change)),
            low=interval.low,
            high=interval.high,
            p=float(wilcoxon(change).pvalue) if change.any() else 1.0,
            less=int((change < 0.0).sum()),
            equal=int((change == 0.0).sum()),
            more=int((change > 0.0).sum()),
        )


def mcnemar(a: Iterable[bool], b: Iterable[bool]) -> tuple[int, int, float]:
    """Numbers of pairs true only in A and only in B, and the exact two-sided p of McNemar's
    test.
    """
    # Only pairs that differ count. Without an effect, equally many are expected in each direction.
    pairs = list(zip(a, b, strict=True))
    only_a, only_b = sum(x and not y for x, y in pairs), sum(y and not x for x, y in pairs)
    p = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0
    return only_a, only_b, p

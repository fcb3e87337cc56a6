"""Runs in pairs of the same draw: differences and ratios of a metric, and shares kept."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, binomtest, wilcoxon

from uuv.campaigns.sensitivity import LEVEL, RESAMPLES
from uuv.sim.interfaces.spatial import Array

_PART = 1_000_000  # values drawn at a time: bounds the memory


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedMetric:
    """A metric in the runs that both campaigns have, B less A."""

    name: str
    pairs: int  # runs with a value in both
    median_a: float
    median_b: float
    median: float  # of the differences
    low: float
    high: float  # bootstrap interval of it
    p: float  # Wilcoxon's signed ranks, two-sided; 1 if nothing differs
    less: int  # runs in which B is below A
    equal: int
    more: int

    @classmethod
    def of(cls, name: str, a: Array, b: Array, rng: np.random.Generator) -> "PairedMetric":
        """The metric from its values (pairs,) in both campaigns, at least one."""
        change = b - a
        medians, at_once = np.empty(RESAMPLES), max(1, _PART // len(change))
        for begin in range(0, RESAMPLES, at_once):
            here = medians[begin : begin + at_once]
            here[:] = np.median(rng.choice(change, (len(here), len(change))), axis=1)
        low, high = np.quantile(medians, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
        return cls(
            name=name,
            pairs=len(change),
            median_a=float(np.median(a)),
            median_b=float(np.median(b)),
            median=float(np.median(change)),
            low=float(low),
            high=float(high),
            p=float(wilcoxon(change).pvalue) if change.any() else 1.0,
            less=int((change < 0.0).sum()),
            equal=int((change == 0.0).sum()),
            more=int((change > 0.0).sum()),
        )


def mcnemar(a: Iterable[bool], b: Iterable[bool]) -> tuple[int, int, float]:
    """Pairs that are true in A alone, in B alone, and the exact two-sided p that they differ by
    chance only.
    """
    pairs = list(zip(a, b, strict=True))
    only_a, only_b = sum(x and not y for x, y in pairs), sum(y and not x for x, y in pairs)
    p = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0
    return only_a, only_b, p


def ratio_interval(ratios: Array) -> tuple[float, float] | None:
    """Interval of the median that holds with 95 % whatever the distribution, by order statistics;
    None: too few.

    Args:
        ratios: (n,) in rising order.
    """
    n = len(ratios)
    # so many values lie below the interval, and as many above it
    below = int(binom.ppf(0.025, n, 0.5)) - 1
    return (float(ratios[below]), float(ratios[n - 1 - below])) if n and below >= 0 else None

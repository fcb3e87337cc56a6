"""Runs in pairs of the same draw: differences and ratios of a metric, and shares kept."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, wilcoxon

from uuv.campaigns.sensitivity import RESAMPLES
from uuv.sim.evaluation.intervals import bootstrap_interval
from uuv.sim.interfaces.spatial import Array


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
        # Differences of the pairs; their median with its interval.
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
    """Pairs true in A alone, in B alone, and the exact two-sided p that they differ by chance."""
    # Only the pairs that differ count: of these, as many either way if nothing is changed.
    pairs = list(zip(a, b, strict=True))
    only_a, only_b = sum(x and not y for x, y in pairs), sum(y and not x for x, y in pairs)
    p = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0
    return only_a, only_b, p

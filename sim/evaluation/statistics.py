"""Statistics over many trials: success rate with interval, distributions, kinds of failure."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from uuv.sim.evaluation.run_metrics import EveryRun, RunMetrics, Timings
from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState

CRASHED = "crashed"  # state of a trial that ended with an error


def wilson(good: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson score interval of a proportion [Wilson 1927].

    Args:
        good: Number of successes.
        of: Number of trials.
        z: Quantile of the normal distribution; 1.96 for 95 %.

    Returns:
        Lower and upper limit.

    Raises:
        ConfigurationError: The counts are impossible.
    """
    if not 0 <= good <= of or of < 1:
        raise ConfigurationError(f"share: expected 0 <= good <= of, of > 0; got {good} of {of}")
    share = good / of
    middle = share + z * z / (2.0 * of)
    half = z * np.sqrt(share * (1.0 - share) / of + z * z / (4.0 * of * of))
    whole = 1.0 + z * z / of
    return float((middle - half) / whole), float((middle + half) / whole)


def spread(values: Iterable[float | None]) -> dict[str, float] | None:
    """Median, 95th percentile, maximum and minimum of the known values; None if there are none."""
    known = [figure for figure in values if figure is not None]
    if not known:
        return None
    return {
        "median": float(np.median(known)),
        "p95": float(np.percentile(known, 95.0)),
        "max": float(np.max(known)),
        "min": float(np.min(known)),
    }


def kind_of_failure(metrics: Mapping[str, Any]) -> str:
    """Short name of the cause of a failed trial; empty if it was accepted.

    The name is the `AbortCode` of work that was broken off, else the first metric that missed its
    bound.
    """
    if metrics["accepted"]:
        return ""
    run = metrics["run"]
    if run["state"] == CRASHED:
        return CRASHED
    if run["abort"] is not None:
        return run["abort"]
    if run["state"] != WorkState.DONE.value:
        return "not ended"
    return metrics["failed"][0].split(":")[0]


def verdicts(trials: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Success rate of many trials with its interval, and failures counted by their kind."""
    good = sum(bool(trial["accepted"]) for trial in trials)
    low, high = wilson(good, len(trials))
    return {
        "trials": len(trials),
        "accepted": good,
        "share": good / len(trials),
        "share_low": low,
        "share_high": high,
        "failures": dict(Counter(kind for trial in trials if (kind := kind_of_failure(trial)))),
        "failed_seeds": [trial["run"]["seed"] for trial in trials if not trial["accepted"]],
    }


def crashed_run(seed: int, reason: str) -> dict[str, Any]:
    """Metrics common to all tasks, for a trial that crashed for `reason`."""
    run = unmeasured(RunMetrics, seed=seed, state=CRASHED, note=reason)
    nothing = EveryRun(run=run, accepted=False, failed=[reason], timings=unmeasured(Timings))
    return {
        name: entry
        for name, entry in asdict(nothing).items()
        if name not in ("provenance", "start")
    }

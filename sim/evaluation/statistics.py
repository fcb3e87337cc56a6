"""Many trials of one job, summed up: the share accepted with its interval, how figures spread, why others failed."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import WorkState


def wilson(good: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share, `good` of `of`; `z` = 1.96 for 95 %.

    Raises ConfigurationError for counts that cannot be.
    """
    if not 0 <= good <= of or of < 1:
        raise ConfigurationError(f"share: expected 0 <= good <= of, of > 0; got {good} of {of}")
    share = good / of
    middle = share + z * z / (2.0 * of)
    half = z * np.sqrt(share * (1.0 - share) / of + z * z / (4.0 * of * of))
    whole = 1.0 + z * z / of
    return float((middle - half) / whole), float((middle + half) / whole)


def spread(values: Iterable[float | None]) -> dict[str, float] | None:
    """Median, 95th percentile and worst of what is there; None of nothing."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return {
        "median": float(np.median(known)),
        "p95": float(np.percentile(known, 95.0)),
        "max": float(np.max(known)),
        "min": float(np.min(known)),
    }


def kind_of_failure(metrics: Mapping[str, Any], kinds: Iterable[tuple[str, str]]) -> str:
    """In a word or two, why a trial was not accepted; empty if it was.

    `kinds`: words of the run's note, and what they stand for, the first that are found.
    """
    if metrics["accepted"]:
        return ""
    state, note = metrics["run"]["state"], metrics["run"]["note"]
    if state == "crashed":
        return "crashed"
    for words, kind in kinds:
        if words in note:
            return kind
    if state != WorkState.DONE.value:
        return "not ended"
    return metrics["failed"][0].split(":")[0]


def verdicts(trials: Sequence[Mapping[str, Any]], kind: Callable[[Mapping[str, Any]], str]) -> dict[str, Any]:
    """Share accepted with its interval, and failures by `kind`, of the metrics of many trials."""
    good = sum(bool(trial["accepted"]) for trial in trials)
    low, high = wilson(good, len(trials))
    return {
        "trials": len(trials),
        "accepted": good,
        "share": good / len(trials),
        "share_low": low,
        "share_high": high,
        "failures": dict(Counter(said for trial in trials if (said := kind(trial)))),
        "failed_seeds": [trial["run"]["seed"] for trial in trials if not trial["accepted"]],
    }


def crashed_run(seed: int, reason: str) -> dict[str, Any]:
    """The parts of a trial's metrics that every job has, of one that broke down for `reason`."""
    run = ("simulated_s", "collision_s", "trajectory_sha256")
    return {
        "run": {**dict.fromkeys(run), "seed": seed, "state": "crashed", "note": reason},
        "accepted": False,
        "failed": [reason],
        "timings": dict.fromkeys(("wall_s", "real_time_factor", "identification_s")),
    }

"""Verdict on a row of a campaign: kept, missed with the bounds that it missed, or its end."""

from collections.abc import Mapping

from uuv.campaigns.run_outcome import CLASSES, DONE, KEPT, MISSED
from uuv.experiment import Row


def outcome(row: Row, bounds: Mapping[str, float]) -> str:
    """Outcome of a row: kept; missed, with the metrics beyond their bounds; or class and reason of
    another end.

    Without bounds the verdict of the run decides. A metric without a value counts as missed.
    """
    if not is_done(row):
        return ": ".join(filter(None, (row.get("ended") or row["state"], row["code"])))

    if not bounds:
        return KEPT if row["accepted"] else MISSED
    missed = beyond(row, bounds)
    return f"{MISSED}: {', '.join(missed)}" if missed else KEPT


def is_done(row: Row) -> bool:
    """True if the work was finished without damage."""
    return (row.get("ended") or row["state"]) == DONE


def class_of(verdict: str) -> str:
    """Class of an outcome."""
    return verdict.partition(":")[0]


def severity(verdict: str) -> int:
    """Rank of an outcome by severity: kept first; a class that is unknown to this version last."""
    word = class_of(verdict)
    return CLASSES.index(word) if word in CLASSES else len(CLASSES)


def within(row: Row, name: str, most: float) -> bool:
    """True if a run has a metric and it does not exceed `most`, up to rounding."""
    figure = row["metrics"].get(name)
    return figure is not None and figure <= most * (1.0 + 1e-9)


def beyond(row: Row, bounds: Mapping[str, float]) -> list[str]:
    """Metrics of a run that are beyond their bounds, or have no value."""
    return [name for name, most in bounds.items() if not within(row, name, most)]


def reasons(row: Row, bounds: Mapping[str, float]) -> list[str]:
    """Reasons why a run is not kept: each metric beyond its bound, or class and reason of its
    end.
    """
    verdict = outcome(row, bounds)
    if verdict == KEPT:
        return []
    return beyond(row, bounds) if is_done(row) and bounds else [verdict]

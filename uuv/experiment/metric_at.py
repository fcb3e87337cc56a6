"""Metric of a run by its name in metrics.json."""

from collections.abc import Mapping
from typing import Any


def metric_at(metrics: Any, name: str) -> Any:
    """Value at a dotted name, as "contact.force_error_rms_n"; None if the run gave none.

    Args:
        metrics: Of a run (`uuv.sim.evaluation.metrics.Assessment.metrics`).
        name: Keys from the outside in, with a dot between.
    """
    for key in name.split("."):
        metrics = metrics.get(key) if isinstance(metrics, Mapping) else None
    return metrics

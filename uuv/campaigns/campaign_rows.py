"""Rows of a campaign: each run as one row, also if it failed."""

import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from uuv.campaigns.campaign import CampaignRun, metric_names
from uuv.campaigns.run_outcome import CRASHED, REFUSED, ending, ending_by, surface_figures
from uuv.experiment.columns import metric_at
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.tables import TableReader

_TRACE = 2000  # characters of a traceback that a row keeps
FAILED = "not set up"  # state of a run that ended with an error of the program


def one_run(task: CampaignRun) -> dict[str, Any]:
    """Row of a run; an error of the run is part of the row."""
    from uuv.assembly import assemble
    from uuv.runner import run

    row = failed_row(task, "")
    try:
        built = assemble(task.scenario())
        row["drawn"] = dict(built.drawn)
        outcome = run(built)
    except Exception as error:
        ended, code = ending_by(error)
        expected = isinstance(error, UuvError)
        text = str(error) if expected else traceback.format_exc()[-_TRACE:]
        state = FAILED if expected else CRASHED
        return row | {"state": state, "ended": ended, "code": code, "failed": [text]}

    # The end is decided by all figures; the row keeps those that the campaign names.
    metrics = outcome.assessment.metrics
    figures = {name: metric_at(metrics, name) for name in metric_names(outcome.scenario)}
    figures |= surface_figures(outcome)
    ended, code = ending(outcome, figures)
    return row | {
        "state": metrics["run"]["state"],
        "ended": ended,
        "code": code,
        "accepted": metrics["accepted"],
        "failed": list(metrics["failed"]),
        "note": outcome.recording.final.note,
        "trajectory_sha256": metrics["run"]["trajectory_sha256"],
        "metrics": {name: figures[name] for name in task.metrics},
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _CampaignRow:
    """Entries of a campaign's row that a summary or a comparison reads."""

    case: int
    values: Mapping[str, Any]
    state: str
    metrics: Mapping[str, float | bool | None]
    drawn: Mapping[str, Any] = field(default_factory=dict)
    version: str = ""
    ended: str = ""  # class of the run's end; empty for a campaign of a version without classes
    code: str = ""
    accepted: bool = False
    failed: list[str] = field(default_factory=list)


def checked_row(row: Mapping[str, Any]) -> Mapping[str, Any]:
    """Check and return a row of a campaign that was read from a file.

    Raises:
        ConfigurationError: It is not such a row.
    """
    TableReader("a row of a campaign", passes_unknown=True).made(_CampaignRow, row)
    return row


def crashed_row(task: CampaignRun, reason: str) -> dict[str, Any]:
    """Row of a run that was ended from outside for a `reason`: time, memory, or death of its
    process.
    """
    return failed_row(task, reason) | {"state": CRASHED, "ended": CRASHED}


def failed_row(task: CampaignRun, reason: str) -> dict[str, Any]:
    """Row of a run that could not be started, for a `reason`."""
    return {
        "case": task.case,
        "version": task.version,
        "values": dict(task.values),
        "drawn": {},
        "state": FAILED,
        "ended": REFUSED,
        "code": reason,
        "accepted": False,
        "failed": [reason] if reason else [],
        "note": "",
        "trajectory_sha256": None,
        "metrics": {},
    }

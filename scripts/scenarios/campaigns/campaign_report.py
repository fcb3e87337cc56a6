"""Summary of a campaign: share kept with its interval, outcomes with their replay commands, distributions."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import binomtest

from scenarios.campaigns.campaign import Campaign
from scenarios.study import Row, Summary, Table

KEPT, MISSED = "kept", "missed"
_SHOWN = 3  # cases of an outcome that the table names


def outcome(row: Row, bounds: Mapping[str, float]) -> str:
    """Kept; missed, with the metrics beyond their bounds; or the state and code in which a run ended.

    Without bounds the verdict of the run decides. A metric without a value is missed.
    """
    if row["state"] != "done":
        return ": ".join(filter(None, (row["state"], row["code"])))
    if not bounds:
        return KEPT if row["accepted"] else MISSED
    values = row["metrics"]
    beyond = [name for name, most in bounds.items() if values.get(name) is None or values[name] > most]
    return f"{MISSED}: {', '.join(beyond)}" if beyond else KEPT


def summarise(rows: list[Row], campaign: Campaign, file: str) -> Summary:
    """Summary of a campaign's rows.

    Args:
        rows: Of all its runs.
        campaign: The campaign.
        file: Its file, for the replay commands.
    """
    outcomes = [outcome(row, campaign.bounds) for row in rows]
    counts = Counter(outcomes).most_common()
    kept = outcomes.count(KEPT)
    low, high = binomtest(kept, len(rows)).proportion_ci(method="wilson")
    share = kept / len(rows)
    failed = None
    if campaign.kept is not None:
        failed = [f"{share:.1%} of the runs kept the bounds, not {campaign.kept:.1%}"] if share < campaign.kept else []
    first = {name: [row["case"] for row, one in zip(rows, outcomes, strict=True) if one == name] for name, _ in counts}
    tables = [
        Table(
            title="Outcomes",
            columns=("outcome", "runs", "cases", "replay"),
            rows=[
                (
                    name,
                    str(count),
                    ", ".join(map(str, first[name][:_SHOWN])) + (", ..." if count > _SHOWN else ""),
                    f"scripts/run_campaign.py {file} --replay {first[name][0]}",
                )
                for name, count in counts
            ],
        ),
        *_distributions(rows, campaign),
    ]
    interval = f"{kept} of {len(rows)} runs kept: {share:.1%}, 95 % interval {low:.1%} to {high:.1%} (Wilson)"
    return Summary(
        metrics={
            "runs": len(rows),
            "kept": {"runs": kept, "share": share, "low": low, "high": high},
            "outcomes": dict(counts),
            "metrics": {name: _quantiles(_values(rows, name)) for name in _names(campaign)},
        },
        tables=tables,
        lines=[interval],
        failed=failed,
    )


def _names(campaign: Campaign) -> list[str]:
    return list(dict.fromkeys((*campaign.metrics, *campaign.bounds)))


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [value for row in rows if (value := row["metrics"].get(name)) is not None]


def _quantiles(values: Sequence[float]) -> dict[str, float | int | None]:
    found = np.quantile(values, (0.05, 0.5, 0.95, 1.0)) if values else [None] * 4
    return {"runs": len(values), **dict(zip(("low", "median", "high", "largest"), found, strict=True))}


def _distributions(rows: Sequence[Row], campaign: Campaign) -> list[Table]:
    lines = []
    for name in _names(campaign):
        found = _quantiles(_values(rows, name))
        figures = ["-" if found[key] is None else f"{found[key]:.4g}" for key in ("low", "median", "high", "largest")]
        bound = f"{campaign.bounds[name]:g}" if name in campaign.bounds else ""
        lines.append((name, str(found["runs"]), *figures, bound))
    columns = ("metric", "runs", "5 %", "median", "95 %", "largest", "bound")
    return [Table(title="Metrics", columns=columns, rows=lines)] if lines else []

"""Summary of a campaign: share kept with its interval, outcomes with their replay commands,
distributions.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from uuv.campaigns.campaign import Campaign, checked_row
from uuv.campaigns.sensitivity import worst_ratio
from uuv.campaigns.sensitivity_report import MISSED, WORST, SensitivityReport
from uuv.experiment import Row, Summary, Table
from uuv.sim.evaluation.intervals import share_interval
from uuv.sim.interfaces.palette import BLUE, VERMILION, WIDTH

KEPT = "kept"
_PANELS = 3  # histograms beside each other
_LONG_TAIL = 30.0  # ratio of the 99 % to the median beyond which a histogram's axis is logarithmic
_SHOWN = 3  # cases of an outcome that the table names


def outcome(row: Row, bounds: Mapping[str, float]) -> str:
    """Kept; missed, with the metrics beyond their bounds; or the state and code in which a run
    ended.

    Without bounds the verdict of the run decides. A metric without a value is missed.
    """
    if row["state"] != "done":
        return ": ".join(filter(None, (row["state"], row["code"])))
    if not bounds:
        return KEPT if row["accepted"] else MISSED
    missed = beyond(row, bounds)
    return f"{MISSED}: {', '.join(missed)}" if missed else KEPT


def beyond(row: Row, bounds: Mapping[str, float]) -> list[str]:
    """Metrics of a run that are beyond their bounds, or have no value."""
    values = row["metrics"]
    return [
        name for name, most in bounds.items() if values.get(name) is None or values[name] > most
    ]


def reasons(row: Row, bounds: Mapping[str, float]) -> list[str]:
    """Why a run is not kept: each metric beyond its bound, or the state and code in which it
    ended.
    """
    said = outcome(row, bounds)
    if said == KEPT:
        return []
    return beyond(row, bounds) if row["state"] == "done" and bounds else [said]


def sensitivities(rows: Sequence[Row], campaign: Campaign) -> SensitivityReport:
    """Sensitivity of the worst ratio to a bound, of kept or missed, and of each metric, to all that
    was drawn.
    """
    done = [row["state"] == "done" for row in rows]
    ratios = [
        worst_ratio(row["metrics"], campaign.bounds) if ended else np.inf
        for row, ended in zip(rows, done, strict=True)
    ]
    missed = np.array([outcome(row, campaign.bounds) != KEPT for row in rows], dtype=np.float64)
    figures = {
        name: np.array(
            [np.nan if (value := row["metrics"].get(name)) is None else value for row in rows],
            dtype=float,
        )
        for name in _names(campaign)
    }
    return SensitivityReport.of(
        [{**row["values"], **row["drawn"]} for row in rows],
        {**({WORST: np.array(ratios)} if campaign.bounds else {}), MISSED: missed, **figures},
        [reasons(row, campaign.bounds) for row in rows],
    )


def summarise(rows: list[Row], campaign: Campaign, file: str) -> Summary:
    """Summary of a campaign's rows.

    Args:
        rows: Of all its runs.
        campaign: The campaign.
        file: Its file, and the options that change it, for the replay commands.
    """
    for row in rows:  # --page sums up what is there, whoever has made it
        checked_row(row)
    replay = f"uuv campaign {file} --replay"
    outcomes = [outcome(row, campaign.bounds) for row in rows]
    counts = Counter(outcomes).most_common()
    kept = outcomes.count(KEPT)
    low, high = share_interval(kept, len(rows))
    share = kept / len(rows)
    failed = None
    if campaign.kept is not None:
        failed = (
            [f"{share:.1%} of the runs kept the bounds, not {campaign.kept:.1%}"]
            if share < campaign.kept
            else []
        )
    first = {
        name: [row["case"] for row, one in zip(rows, outcomes, strict=True) if one == name]
        for name, _ in counts
    }
    found = sensitivities(rows, campaign)
    tables = [
        Table(
            title="Outcomes",
            columns=("outcome", "runs", "cases", "replay"),
            rows=[
                (
                    name,
                    str(count),
                    ", ".join(map(str, first[name][:_SHOWN])) + (", ..." if count > _SHOWN else ""),
                    f"{replay} {first[name][0]}",
                )
                for name, count in counts
            ],
        ),
        *_distributions(rows, campaign),
        *found.tables(),
    ]
    interval = (
        f"{kept} of {len(rows)} runs kept: {share:.1%}, 95 % interval {low:.1%} to "
        f"{high:.1%} (Wilson)"
    )
    return Summary(
        metrics={
            "runs": len(rows),
            "bounds": dict(campaign.bounds),
            "replay": replay,
            "kept": {"runs": kept, "share": share, "low": low, "high": high},
            "outcomes": dict(counts),
            "metrics": {name: _quantiles(_values(rows, name)) for name in _names(campaign)},
            "sensitivity": found.metrics,
        },
        tables=tables,
        lines=[interval, *found.lines],
        pictures=_pictures(rows, campaign, found),
        failed=failed,
    )


def _names(campaign: Campaign) -> list[str]:
    return list(dict.fromkeys((*campaign.metrics, *campaign.bounds)))


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [value for row in rows if (value := row["metrics"].get(name)) is not None]


def _quantiles(values: Sequence[float]) -> dict[str, float | int | None]:
    found = np.quantile(values, (0.05, 0.5, 0.95, 1.0)) if values else [None] * 4
    return {
        "runs": len(values),
        **dict(zip(("low", "median", "high", "largest"), found, strict=True)),
    }


def _distributions(rows: Sequence[Row], campaign: Campaign) -> list[Table]:
    lines = []
    for name in _names(campaign):
        found = _quantiles(_values(rows, name))
        figures = [
            "-" if found[key] is None else f"{found[key]:.4g}"
            for key in ("low", "median", "high", "largest")
        ]
        bound = f"{campaign.bounds[name]:g}" if name in campaign.bounds else ""
        lines.append((name, str(found["runs"]), *figures, bound))
    columns = ("metric", "runs", "5 %", "median", "95 %", "largest", "bound")
    return [Table(title="Metrics", columns=columns, rows=lines)] if lines else []


def _pictures(
    rows: Sequence[Row], campaign: Campaign, found: SensitivityReport
) -> Iterator[tuple[str, str, Figure]]:
    names = [name for name in _names(campaign) if _values(rows, name)]
    if names:
        yield (
            "Distributions",
            "Runs by the value of each metric. Dashed: the bound. A run without a value is in no "
            "bar.",
            histogram_figure({name: _values(rows, name) for name in names}, campaign.bounds),
        )
    yield from found.pictures()


def histogram_figure(values: Mapping[str, Sequence[float]], bounds: Mapping[str, float]) -> Figure:
    """Histogram of each metric with its bound; logarithmic where the largest values are far above
    the median.
    """
    lines = -(-len(values) // _PANELS)
    figure = Figure(figsize=(WIDTH, 0.3 + 2.1 * lines), layout="constrained")
    panels = figure.subplots(lines, _PANELS, squeeze=False)
    for axes in panels.flat[len(values) :]:
        axes.set_visible(False)
    for axes, (name, given) in zip(panels.flat, values.items(), strict=False):
        found = np.asarray(given, dtype=np.float64)
        low, median, high = np.quantile(found, (0.0, 0.5, 0.99))
        count = int(np.clip(np.sqrt(len(found)) * 2, 5, 40))
        if low > 0.0 and high > _LONG_TAIL * median:
            axes.set_xscale("log")
            edges = np.geomspace(low, found.max() * (1.0 + 1e-9), count + 1)
        elif found.min() < found.max():
            edges = np.histogram_bin_edges(found, count)
        else:  # one bar around the only value
            edges = median + (abs(median) or 1.0) * np.array([-0.05, 0.05])
            axes.set_xlim(*(median + (abs(median) or 1.0) * np.array([-0.5, 0.5])))
        axes.hist(found, edges, color=BLUE, edgecolor="white", linewidth=0.4)
        if name in bounds:
            axes.axvline(bounds[name], color=VERMILION, linewidth=1.1, linestyle="--")
        axes.set_xlabel(f"{name}, {len(given)} runs", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.yaxis.get_major_locator().set_params(integer=True)
        if axes.get_xscale() == "linear":
            axes.locator_params(axis="x", nbins=4)
    for axes in panels[:, 0]:
        axes.set_ylabel("runs", fontsize=9)
    return figure

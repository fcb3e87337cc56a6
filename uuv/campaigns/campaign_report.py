"""Summary of a campaign: share of kept runs, outcomes with their replay commands, distributions."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.campaigns.campaign import Campaign, keys_of
from uuv.campaigns.campaign_rows import checked_row
from uuv.campaigns.campaign_tables import (
    group_tables,
    groups,
    interval,
    kept,
    kept_and_also,
    reliability,
    reliability_table,
    version_tables,
    versions,
)
from uuv.campaigns.run_outcome import CLASSES, KEPT
from uuv.campaigns.sensitivity import Factor, worst_ratio
from uuv.campaigns.sensitivity_report import MISSED, WORST, SensitivityReport, label
from uuv.campaigns.verdicts import class_of, is_done, outcome, reasons, severity, within
from uuv.experiment import Row, Summary, Table
from uuv.sim.evaluation.intervals import share_interval
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.palette import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    WIDTH,
)
from uuv.sim.interfaces.spatial import Array

_QUANTILES = {"least": 0.0, "low": 0.05, "median": 0.5, "high": 0.95, "top": 0.99, "largest": 1.0}
_COLORS = (BLUE, ORANGE, GREEN, PURPLE, SKY)  # colours of parts of the runs
_CLASS_COLORS = dict(zip(CLASSES, (BLUE, ORANGE, PURPLE, FAINT, VERMILION, INK, SKY), strict=True))
_SCATTERED = 3  # number of bounded metrics that are plotted over each parameter
_DOTS = 5  # number of scatter plots in a row
_PANELS = 3  # number of histograms in a row
# ratio of the 99th percentile to the median above which a histogram's axis is logarithmic
_LONG_TAIL = 30.0
_SHOWN = 3  # number of cases of an outcome that the table names


def sensitivities(rows: Sequence[Row], campaign: Campaign) -> SensitivityReport:
    """Sensitivities to all draws: of the worst ratio to a bound, of a missed bound, and of each
    metric.
    """
    # Of values that change together the first represents all, since a regression cannot separate
    # them.
    together = {key for names in campaign.grid for key in keys_of(names)[1:]}
    done = [is_done(row) for row in rows]
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
        for name in campaign.names
    }

    return SensitivityReport.of(
        [_draws(row, together) for row in rows],
        {**({WORST: np.array(ratios)} if campaign.bounds else {}), MISSED: missed, **figures},
        [reasons(row, campaign.bounds) for row in rows],
    )


def _draws(row: Row, left_out: Set[str]) -> dict[str, Any]:
    """Drawn values of a run, by name."""
    draws = {**row["values"], **row["drawn"]}
    return {name: value for name, value in draws.items() if name not in left_out}


def summarise(rows: list[Row], campaign: Campaign, file: str) -> Summary:
    """Summary of a campaign's rows.

    Args:
        rows: Rows of all runs of the campaign.
        campaign: The campaign.
        file: File of the campaign, and the options that change it, for the replay commands.
    """
    for row in rows:  # --page summarises the existing rows, whoever has made them
        checked_row(row)
    replay = f"uuv campaign {file} --replay"
    plain = [row for row in rows if not row.get("version")]
    if not plain:
        raise ConfigurationError("only rows of versions, none of the campaign itself")

    # Ends of the runs.
    verdicts = [outcome(row, campaign.bounds) for row in plain]
    number = verdicts.count(KEPT)
    share = verdicts.count(KEPT) / len(plain)
    low, high = share_interval(number, len(plain))
    lines = [
        f"{number} of {len(plain)} runs passed: {share:.1%}, 95 % interval {low:.1%} to "
        f"{high:.1%} (Wilson)"
    ]
    if campaign.also:
        wished = ", ".join(f"{name} at most {most:g}" for name, most in campaign.also.items())
        lines.append(f"{kept_and_also(plain, campaign)} of the passed runs also have {wished}")

    # Differences between kept and missed runs, and effects of a version.
    sensitivity = sensitivities(plain, campaign)
    bins = reliability(plain, campaign)
    compared = versions(rows, campaign)

    return Summary(
        metrics={
            "runs": len(plain),
            "bounds": dict(campaign.bounds),
            "replay": replay,
            "kept": {"runs": number, "share": share, "low": low, "high": high},
            "kept_and_also": kept_and_also(plain, campaign),
            "outcomes": dict(Counter(verdicts).most_common()),
            "metrics": {name: _quantiles(_values(plain, name)) for name in campaign.names},
            "by": {
                name: {
                    value: {"runs": len(part), "kept": kept(part, campaign)}
                    for value, part in parts.items()
                }
                for name, parts in groups(plain, campaign)
            },
            "reliability": bins,
            "versions": compared,
            "sensitivity": sensitivity.metrics,
        },
        # The page.
        tables=[
            _outcomes(plain, verdicts, replay),
            *group_tables(plain, campaign),
            *_distributions(plain, campaign),
            *reliability_table(bins),
            *version_tables(compared),
            *sensitivity.tables(),
        ],
        lines=[*lines, *sensitivity.lines],
        pictures=_pictures(plain, campaign, sensitivity),
        failed=_failed(verdicts, campaign),
    )


def _outcomes(rows: Sequence[Row], verdicts: Sequence[str], replay: str) -> Table:
    """Outcomes in order of severity, with the first cases of each."""
    counts = Counter(verdicts)
    cells = []
    for verdict in sorted(
        counts, key=lambda verdict: (severity(verdict), -counts[verdict], verdict)
    ):
        cases = [row["case"] for row, other in zip(rows, verdicts, strict=True) if other == verdict]
        named = ", ".join(map(str, cases[:_SHOWN])) + (", ..." if len(cases) > _SHOWN else "")
        share = f"{len(cases) / len(rows):.1%}"
        of_all = interval(len(cases), len(rows))
        cells.append((verdict, str(len(cases)), share, of_all, named, f"{replay} {cases[0]}"))

    columns = ("outcome", "runs", "share", "95 % interval", "cases", "replay")
    return Table(title="Outcomes", columns=columns, rows=cells)


def _failed(verdicts: Sequence[str], campaign: Campaign) -> list[str] | None:
    """Reasons why the campaign is not accepted; None if it has no verdict."""
    if campaign.kept is None and not campaign.never:
        return None
    share = verdicts.count(KEPT) / len(verdicts)
    failed = []
    if campaign.kept is not None and share < campaign.kept:
        failed.append(f"{share:.1%} of the runs passed, but {campaign.kept:.1%} are required")

    # A class of ends, or a reason.
    for word in campaign.never:
        if count := sum(
            word in (class_of(verdict), verdict.partition(": ")[2]) for verdict in verdicts
        ):
            failed.append(f"{count} runs ended with a forbidden outcome: {word}")
    return failed


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [value for row in rows if (value := row["metrics"].get(name)) is not None]


def _quantiles(values: Sequence[float]) -> dict[str, float | int | None]:
    shares = [*_QUANTILES.values()]
    figures = np.quantile(values, shares) if values else [None] * len(shares)
    return {"runs": len(values), **dict(zip(_QUANTILES, figures, strict=True))}


def _distributions(rows: Sequence[Row], campaign: Campaign) -> list[Table]:
    lines = []
    bounds = {**campaign.also, **campaign.bounds}
    for name in campaign.names:
        quantiles = _quantiles(_values(rows, name))
        figures = [_figure(quantiles[key]) for key in _QUANTILES]
        bound, inside = "", ""
        if name in bounds:
            count = sum(within(row, name, bounds[name]) for row in rows)
            bound, inside = f"{bounds[name]:g}", f"{count / len(rows):.1%}"
        lines.append((name, str(quantiles["runs"]), *figures, bound, inside))

    shares = ("least", "5 %", "median", "95 %", "99 %", "largest")
    columns = ("metric", "runs", *shares, "bound", "within")
    caption = "Within: share of all runs; a run that ended without the metric counts as outside."
    return [Table(title="Metrics", columns=columns, rows=lines, caption=caption)] if lines else []


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _pictures(
    rows: Sequence[Row], campaign: Campaign, sensitivity: SensitivityReport
) -> Iterator[tuple[str, str, Figure]]:
    names = [name for name in campaign.names if _values(rows, name)]
    if names:
        yield (
            "Distributions",
            "Runs by the value of each metric, coloured by the first key of the grid. Dashed: "
            "the bound. Runs without a value are left out.",
            histogram_figure(_parts(rows, campaign, names), campaign.bounds),
        )
        for name in [name for name in names if name in campaign.bounds][:_SCATTERED]:
            yield (
                f"{name} over the drawn parameters",
                "One dot a run, by its class.",
                scatter_figure(rows, name, campaign.bounds, sensitivity.factors),
            )
    yield from sensitivity.pictures()


def _parts(
    rows: Sequence[Row], campaign: Campaign, names: Sequence[str]
) -> dict[str, dict[str, list[float]]]:
    """Values of metrics by name, and by the value of the first key that the cases take in turn."""
    parts = next((parts for _, parts in groups(rows, campaign)), {"": list(rows)})
    return {name: {value: _values(part, name) for value, part in parts.items()} for name in names}


def histogram_figure(
    values: Mapping[str, Mapping[str, Sequence[float]]], bounds: Mapping[str, float]
) -> Figure:
    """Histogram of each metric with its bound; logarithmic if a tail is far above the median.

    Args:
        values: Values of each metric, by part of the runs.
        bounds: Bounds by metric.
    """
    lines = -(-len(values) // _PANELS)
    figure = Figure(figsize=(WIDTH, 0.3 + 2.1 * lines), layout="constrained")
    panels = figure.subplots(lines, _PANELS, squeeze=False)
    for axes in panels.flat[len(values) :]:
        axes.set_visible(False)

    for axes, (name, parts) in zip(panels.flat, values.items(), strict=False):
        edges = _edges(axes, np.concatenate([*map(np.asarray, parts.values())]))
        colors = [_COLORS[k % len(_COLORS)] for k in range(len(parts))]
        axes.hist(
            list(parts.values()),
            edges,
            color=colors,
            label=list(parts),
            stacked=True,
            edgecolor="white",
            linewidth=0.4,
        )

        if name in bounds:
            axes.axvline(bounds[name], color=VERMILION, linewidth=1.1, linestyle="--")

        axes.set_xlabel(f"{name}, {sum(map(len, parts.values()))} runs", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.yaxis.get_major_locator().set_params(integer=True)
        if axes.get_xscale() == "linear":
            axes.locator_params(axis="x", nbins=4)

    if len(next(iter(values.values()))) > 1:
        panels[0, 0].legend(frameon=False, fontsize=7)
    for axes in panels[:, 0]:
        axes.set_ylabel("runs", fontsize=9)
    return figure


def _edges(axes: Any, values: Array) -> Array:
    """Edges of the bars of a histogram; sets a logarithmic axis, or limits around a single
    value.
    """
    low, median, high = np.quantile(values, (0.0, 0.5, 0.99))
    count = int(np.clip(np.sqrt(len(values)) * 2, 5, 40))
    if low > 0.0 and high > _LONG_TAIL * median:
        axes.set_xscale("log")
        return np.geomspace(low, values.max() * (1.0 + 1e-9), count + 1)
    if values.min() < values.max():
        return np.histogram_bin_edges(values, count)
    # One bar around the only value.
    width = abs(median) or 1.0
    axes.set_xlim(*(median + width * np.array([-0.5, 0.5])))
    return median + width * np.array([-0.05, 0.05])


def scatter_figure(
    rows: Sequence[Row], name: str, bounds: Mapping[str, float], factors: Sequence[Factor]
) -> Figure:
    """Scatter plots of a metric over each drawn number, coloured by class.

    Args:
        rows: Rows of the runs.
        name: Name of the metric.
        bounds: Bounds of the campaign.
        factors: Drawn parameters; those of several columns are left out.
    """
    classes = np.array([class_of(outcome(row, bounds)) for row in rows])
    metric = np.array([row["metrics"].get(name) for row in rows], dtype=np.float64)
    single = [factor for factor in factors if factor.columns.shape[1] == 1]

    lines = max(1, -(-len(single) // _DOTS))
    figure = Figure(figsize=(WIDTH, 0.5 + 1.8 * lines), layout="constrained")
    panels = figure.subplots(lines, _DOTS, sharey=True, squeeze=False)
    for axes in panels.flat[len(single) :]:
        axes.set_visible(False)

    for axes, factor in zip(panels.flat, single, strict=False):
        drawn = factor.columns[:, 0]
        for verdict in sorted({*classes.tolist()}, key=severity):
            mine = classes == verdict
            color = _CLASS_COLORS.get(verdict, INK)
            axes.scatter(drawn[mine], metric[mine], s=9, color=color, label=verdict, alpha=0.75)
        if np.nanmin(drawn) > 0.0 and np.nanmax(drawn) > _LONG_TAIL * np.nanmin(drawn):
            axes.set_xscale("log")
        axes.set_xlabel(label(factor.name), fontsize=7)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=7)

    if single:
        panels[0, 0].legend(frameon=False, fontsize=7)
    return figure

"""Comparison of two campaigns of the same draws, run by run: metrics, kept runs, verdicts."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from uuv.campaigns.campaign_rows import checked_row
from uuv.campaigns.paired import PairedMetric, mcnemar
from uuv.campaigns.run_outcome import KEPT
from uuv.campaigns.sensitivity_report import shown_p
from uuv.campaigns.verdicts import outcome
from uuv.experiment import Row, Summary, Table, read_rows
from uuv.experiment.row_log import METRICS
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.palette import BLUE, FAINT, INK, WIDTH
from uuv.sim.interfaces.spatial import Array, shown
from uuv.sim.interfaces.tables import TableReader


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """A finished campaign, read from its folder."""

    folder: Path
    rows: Mapping[int, Row]  # rows by case
    bounds: Mapping[str, float]
    replay: str  # command without the case number

    @classmethod
    def read(cls, folder: Path) -> "Finished":
        """The campaign in a folder.

        Raises:
            ConfigurationError: The folder has no campaign, or an unfinished one.
        """
        rows = read_rows(folder)
        if not rows:
            raise ConfigurationError(
                f"{folder}: must be the folder of a campaign; it has no rows of one"
            )

        try:
            for row in rows:
                checked_row(row)
            file = folder / METRICS
            about = TableReader(METRICS, passes_unknown=True).made(
                _About, json_of(file, "metrics of a campaign")
            )
        except ConfigurationError as error:
            raise ConfigurationError(
                f"{folder}: must be the folder of a finished campaign: {error}"
            ) from error

        rows = [row for row in rows if not row.get("version")]
        by_case = {row["case"]: row for row in rows}
        if len(by_case) < len(rows):
            raise ConfigurationError(
                f"{folder}: must have rows of one campaign, got {len(rows)} rows of {len(by_case)} "
                "cases"
            )
        return cls(folder=folder, rows=by_case, bounds=about.bounds, replay=about.replay)


@dataclass(frozen=True, slots=True, kw_only=True)
class _About:
    """Entries of a campaign's metrics.json that a comparison needs."""

    bounds: Mapping[str, float]
    replay: str


def compared(a: Finished, b: Finished) -> Summary:
    """Comparison of two campaigns over the cases that both have.

    Raises:
        ConfigurationError: No case is in both, or the draws, metrics or bounds differ.
    """
    cases = _checked(a, b)
    outcomes = {
        case: (outcome(a.rows[case], a.bounds), outcome(b.rows[case], b.bounds)) for case in cases
    }

    # Kept in A and in B. McNemar's test uses the runs that only one of both kept.
    is_kept = [[verdicts[i] == KEPT for verdicts in outcomes.values()] for i in (0, 1)]
    only_a, only_b, p = mcnemar(*is_kept)

    # Each metric, in the pairs in which both runs have it.
    figures = _paired(a, b, cases)
    metrics = []
    for name, (left, right) in figures.items():
        if len(left):
            metrics.append(PairedMetric.of(name, left, right, np.random.default_rng(len(cases))))

    # Verdicts that changed, and runs of cases that only one campaign has.
    changed = [
        case
        for case, (verdict_a, verdict_b) in outcomes.items()
        if (verdict_a == KEPT) != (verdict_b == KEPT)
    ]
    alone = [len(campaign.rows) - len(cases) for campaign in (a, b)]
    unpaired = (
        [f"only in one campaign: {alone[0]} runs of A, {alone[1]} of B"] if any(alone) else []
    )

    return Summary(
        metrics={
            "a": str(a.folder),
            "b": str(b.folder),
            "pairs": len(cases),
            "without_partner": {"a": alone[0], "b": alone[1]},
            "kept": {
                "a": sum(is_kept[0]),
                "b": sum(is_kept[1]),
                "only_a": only_a,
                "only_b": only_b,
                "p": p,
            },
            "metrics": metrics,
            "changed": [
                {"case": case, "a": outcomes[case][0], "b": outcomes[case][1]} for case in changed
            ],
        },
        # The page.
        tables=[*_tables(metrics), *_changes(a, b, changed, outcomes)],
        lines=[
            f"passed: {sum(is_kept[0])} of {len(cases)} in A, {sum(is_kept[1])} in B; {only_a} in "
            f"A only, {only_b} in B only, p {shown_p(p)} (McNemar, exact)",
            *unpaired,
        ],
        pictures=_pictures({name: pair for name, pair in figures.items() if len(pair[0])}),
        caption=f"A: {a.folder}. B: {b.folder}. {len(cases)} pairs of the same draw.",
    )


def _checked(a: Finished, b: Finished) -> list[int]:
    """The cases that both campaigns have, after a check that the campaigns can be compared."""
    cases = sorted(a.rows.keys() & b.rows.keys())
    if not cases:
        raise ConfigurationError(f"{a.folder} and {b.folder}: no common case")

    # The draws must be equal, and so must metrics and bounds.
    for case in cases:
        left, right = a.rows[case]["values"], b.rows[case]["values"]
        for name in dict.fromkeys((*left, *right)):
            if name not in left or name not in right or left[name] != right[name]:
                in_a, in_b = shown(left.get(name)), shown(right.get(name))
                raise ConfigurationError(
                    f"the draws must be equal: case {case} has {name} {in_a} in A, {in_b} in B"
                )

    if missing := _metrics_of(a, cases) ^ _metrics_of(b, cases):
        raise ConfigurationError(
            f"both must keep the same metrics; only one has {', '.join(sorted(missing))}"
        )
    if a.bounds != b.bounds:
        raise ConfigurationError(
            f"the bounds must be equal: {shown(dict(a.bounds))} in A, {shown(dict(b.bounds))} in B"
        )

    return cases


def _metrics_of(campaign: Finished, cases: Sequence[int]) -> set[str]:
    return {name for case in cases for name in campaign.rows[case]["metrics"]}


def _paired(a: Finished, b: Finished, cases: Sequence[int]) -> dict[str, tuple[Array, Array]]:
    """Values of each metric in A and B, of the runs that have a value in both."""
    names = dict.fromkeys(name for case in cases for name in a.rows[case]["metrics"])

    figures = {}
    for name in names:
        both = [
            (a.rows[case]["metrics"].get(name), b.rows[case]["metrics"].get(name)) for case in cases
        ]
        complete = np.array([pair for pair in both if None not in pair], dtype=np.float64).reshape(
            -1, 2
        )
        figures[name] = (complete[:, 0], complete[:, 1])
    return figures


def _tables(metrics: Sequence[PairedMetric]) -> Iterator[Table]:
    if metrics:
        yield Table(
            title="Metrics, B less A",
            columns=(
                "metric",
                "pairs",
                "median A",
                "median B",
                "median B - A",
                "95 % interval",
                "p",
                "less/equal/more",
            ),
            # A row for each metric.
            rows=[
                (
                    metric.name,
                    str(metric.pairs),
                    f"{metric.median_a:.4g}",
                    f"{metric.median_b:.4g}",
                    f"{metric.median:+.3g}",
                    f"{metric.low:+.3g} to {metric.high:+.3g}",
                    shown_p(metric.p),
                    f"{metric.less}/{metric.equal}/{metric.more}",
                )
                for metric in metrics
            ],
            caption="Median of the differences with its bootstrap interval; p of Wilcoxon's "
            "signed ranks; runs in which B is less than, equal to and more than A.",
        )


def _changes(
    a: Finished, b: Finished, changed: Sequence[int], outcomes: Mapping[int, tuple[str, str]]
) -> Iterator[Table]:
    if changed:
        yield Table(
            title="Changed verdicts",
            columns=("case", "in A", "in B", "replay of A", "replay of B"),
            rows=[
                (str(case), *outcomes[case], f"{a.replay} {case}", f"{b.replay} {case}")
                for case in changed
            ],
            labels=5,
        )


def _pictures(figures: Mapping[str, tuple[Array, Array]]) -> Iterator[tuple[str, str, Figure]]:
    if figures:
        yield (
            "Run by run",
            "One dot for each run, by its values in A and in B; on the line both are equal.",
            _dots(figures),
        )


def _dots(figures: Mapping[str, tuple[Array, Array]]) -> Figure:
    """Scatter plot of each metric, B over A."""
    columns = min(4, len(figures))
    lines = -(-len(figures) // columns)
    figure = Figure(figsize=(WIDTH, WIDTH / 4 * lines + 0.3), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False)
    for axes in panels.flat[len(figures) :]:
        axes.set_visible(False)

    for axes, (name, (left, right)) in zip(panels.flat, figures.items(), strict=False):
        low, high = min(left.min(), right.min()), max(left.max(), right.max())
        ends = np.array([low, high]) + (0.05 * (high - low) or 1.0) * np.array([-1.0, 1.0])

        axes.plot(ends, ends, color=FAINT, linewidth=0.8)
        axes.scatter(left, right, s=12, color=BLUE, linewidths=0, alpha=0.8)
        axes.set(xlim=ends, ylim=ends, box_aspect=1.0)
        axes.set_title(name, fontsize=8, color=INK)
        axes.set_xlabel("A", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.locator_params(nbins=4)
        axes.tick_params(labelsize=7)

    for axes in panels[:, 0]:
        axes.set_ylabel("B", fontsize=8)
    return figure

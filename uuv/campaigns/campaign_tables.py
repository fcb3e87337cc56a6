"""Further tables of a campaign: runs by the values of the grid, by the probability stated before
contact, and its versions on the same draws.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from uuv.campaigns.campaign import Campaign, keys_of
from uuv.campaigns.paired import PairedMetric, mcnemar
from uuv.campaigns.run_outcome import KEPT
from uuv.campaigns.sensitivity_report import label, shown_p
from uuv.campaigns.verdicts import outcome, within
from uuv.experiment import Row, Table
from uuv.sim.evaluation.intervals import median_interval, share_interval
from uuv.sim.interfaces.spatial import Array

# metric: probability, stated before contact, of keeping the path
CHANCE = "uncertainty.chance_kept"
# bounds of the bins of that probability
CHANCES = (0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
_COUNTS = ("pairs", "kept_plain", "kept", "only_plain", "only_version")
_COLUMNS = (
    "median without it",
    "median",
    "factor",
    "95 % interval",
    "p",
    "largest without it",
    "largest",
)
MOST_VALUES = 20  # largest number of values of a grid key for a table by its values


def interval(share: int, of: int) -> str:
    """Wilson's 95 % interval of a share, as text."""
    low, high = share_interval(share, of)
    return f"{low:.1%} to {high:.1%}"


def kept(rows: Sequence[Row], campaign: Campaign) -> int:
    """Number of runs within their bounds."""
    return sum(outcome(row, campaign.bounds) == KEPT for row in rows)


def kept_and_also(rows: Sequence[Row], campaign: Campaign) -> int:
    """Number of these runs that are within the bounds of [also] too."""
    return sum(
        outcome(row, campaign.bounds) == KEPT
        and all(within(row, name, most) for name, most in campaign.also.items())
        for row in rows
    )


# -- what the cases take in turn -------------------------------------------------------------------


def groups(rows: Sequence[Row], campaign: Campaign) -> Iterator[tuple[str, dict[str, list[Row]]]]:
    """Rows by the values of each grid key that has only a few values."""
    for names, levels in campaign.grid.items():
        if 2 <= len(levels) <= MOST_VALUES:
            name, *_ = keys_of(names)
            yield name, by_value(rows, name)


def by_value(rows: Sequence[Row], name: str) -> dict[str, list[Row]]:
    """Rows by a drawn value as text, in the order of first appearance."""
    parts: dict[str, list[Row]] = {}
    for row in rows:
        parts.setdefault(value_text(row["values"].get(name)), []).append(row)
    return parts


def value_text(value: Any) -> str:
    """A value as text; a vector as its components."""
    if isinstance(value, list | tuple):
        return f"({', '.join(f'{component:g}' for component in value)})"
    return f"{value:g}" if isinstance(value, float) else str(value)


def group_tables(rows: Sequence[Row], campaign: Campaign) -> Iterator[Table]:
    """Tables of kept runs by each value of a grid key, and by the values of the first two keys."""
    also = ("and within [also]",) if campaign.also else ()
    named = list(groups(rows, campaign))

    for name, parts in named:
        cells = []
        for level, part in parts.items():
            number = kept(part, campaign)
            extra = (str(kept_and_also(part, campaign)),) if also else ()
            share = f"{number / len(part):.1%}"
            cells.append(
                (level, str(len(part)), str(number), share, interval(number, len(part)), *extra)
            )

        columns = (label(name), "runs", "passed", "share", "95 % interval", *also)
        yield Table(title=f"By {label(name)}", columns=columns, rows=cells)

    if len(named) > 1:
        yield _map(named[0], named[1], campaign)


def _map(
    down: tuple[str, dict[str, list[Row]]],
    across: tuple[str, dict[str, list[Row]]],
    campaign: Campaign,
) -> Table:
    """Numbers of kept runs by the values of two keys, with medians of the first two metrics."""
    shown = campaign.metrics[:2]
    cells = []

    for level, part in down[1].items():
        columns = by_value(part, across[0])
        line = [_cell(columns.get(header, []), shown, campaign) for header in across[1]]
        cells.append((level, *line))

    return Table(
        title=f"Runs passed, by {label(down[0])} and {label(across[0])}",
        columns=(label(down[0]), *across[1]),
        rows=cells,
        caption=f"Then medians: {', '.join(shown)}." if shown else "",
    )


def _cell(rows: Sequence[Row], shown: Sequence[str], campaign: Campaign) -> str:
    medians = [
        f"{np.median(measured):.3g}"
        for name in shown
        if len(measured := [v for row in rows if (v := row["metrics"].get(name)) is not None])
    ]

    return f"{kept(rows, campaign)}/{len(rows)}  {', '.join(medians)}".rstrip()


# -- probability that was stated before contact ----------------------------------------------------


def reliability(rows: Sequence[Row], campaign: Campaign) -> list[dict[str, Any]]:
    """Runs by the probability stated before contact: number, mean probability, and number kept."""
    stated = [row for row in rows if row["metrics"].get(CHANCE) is not None]
    probability = np.array([row["metrics"][CHANCE] for row in stated])
    is_kept = np.array([outcome(row, campaign.bounds) == KEPT for row in stated])

    # Bins by the stated probability; empty ones are left out.
    bins = []
    for least, most in itertools.pairwise(CHANCES):
        inside = (probability >= least) & ((probability < most) | (most == 1.0))
        if inside.any():
            mean = float(probability[inside].mean())
            number = int(is_kept[inside].sum())
            counts = {"runs": int(inside.sum()), "mean": mean, "kept": number}
            bins.append({"least": least, "most": most, **counts})

    return bins


def reliability_table(bins: Sequence[Mapping[str, Any]]) -> Iterator[Table]:
    """Table of `reliability`, if any run stated a probability."""
    if bins:
        yield Table(
            title="Probability of a path within tolerance, predicted before contact",
            columns=("predicted", "runs", "mean", "passed", "share", "95 % interval"),
            rows=[
                (
                    f"{part['least']:.0%} to {part['most']:.0%}",
                    str(part["runs"]),
                    f"{part['mean']:.1%}",
                    str(part["kept"]),
                    f"{part['kept'] / part['runs']:.1%}",
                    interval(part["kept"], part["runs"]),
                )
                for part in bins
            ],
        )


# -- versions --------------------------------------------------------------------------------------


def versions(rows: Sequence[Row], campaign: Campaign) -> dict[str, dict[str, Any]]:
    """Each version compared with the campaign's runs of the same draws: runs kept, and each
    metric.
    """
    plain = {row["case"]: row for row in rows if not row.get("version")}
    compared = {}

    for name in campaign.versions:
        pairs = [
            (plain[row["case"]], row)
            for row in rows
            if row.get("version") == name and row["case"] in plain
        ]
        if not pairs:
            continue

        # Runs kept. McNemar's test uses the runs that only one of both kept.
        sides = [list(side) for side in zip(*pairs, strict=True)]
        verdicts = [[outcome(row, campaign.bounds) == KEPT for row in side] for side in sides]
        only_plain, only_version, p = mcnemar(*verdicts)

        compared[name] = {
            "pairs": len(pairs),
            "kept_plain": sum(verdicts[0]),
            "kept": sum(verdicts[1]),
            "only_plain": only_plain,
            "only_version": only_version,
            "p": p,
            "metrics": {m: _paired(m, pairs) for m in campaign.names},
        }

    return compared


def _paired(name: str, pairs: Sequence[tuple[Row, Row]]) -> dict[str, Any]:
    """A metric in the pairs in which both runs have it: differences, and ratios of values above
    0.
    """
    both = [(a["metrics"].get(name), b["metrics"].get(name)) for a, b in pairs]
    complete: Array = np.array([pair for pair in both if None not in pair], dtype=np.float64)
    if not len(complete):
        return {"pairs": 0}

    plain, version = complete.T
    metric = PairedMetric.of(name, plain, version, np.random.default_rng(len(plain)))
    ratios = np.sort(version[plain > 0.0] / plain[plain > 0.0])

    return {
        "pairs": metric.pairs,
        "median_plain": metric.median_a,
        "median": metric.median_b,
        "largest_plain": float(plain.max()),
        "largest": float(version.max()),
        "p": metric.p,
        "factor": float(np.median(ratios)) if len(ratios) else None,
        "factor_interval": median_interval(ratios),
    }


def version_tables(compared: Mapping[str, Mapping[str, Any]]) -> Iterator[Table]:
    """Tables of the runs kept in each version, and of its metrics next to those of the same draws
    without it.
    """
    if not compared:
        return

    yield Table(
        title="Versions on the same draws: runs passed",
        columns=(
            "version",
            "pairs",
            "passed without it",
            "passed",
            "only without",
            "only with",
            "p",
        ),
        rows=[
            (name, *(str(of[key]) for key in _COUNTS), shown_p(of["p"]))
            for name, of in compared.items()
        ],
        caption="p of McNemar's exact test on the runs that passed in one version only.",
    )

    cells = []
    for name, of in compared.items():
        for metric, figures in of["metrics"].items():
            if figures["pairs"]:
                cells.append((name, metric, str(figures["pairs"]), *_figures(figures)))

    if cells:
        yield Table(
            title="Versions on the same draws: metrics",
            columns=("version", "metric", "pairs", *_COLUMNS),
            rows=cells,
            labels=2,
            caption="Factor: median over the runs of the metric in the version over that without "
            "it, with its 95 % interval by order statistics; p of Wilcoxon's signed ranks.",
        )


def _figures(of: Mapping[str, Any]) -> tuple[str, ...]:
    low_high = of["factor_interval"]
    return (
        f"{of['median_plain']:.4g}",
        f"{of['median']:.4g}",
        "" if of["factor"] is None else f"{of['factor']:.3g}",
        "" if low_high is None else "{:.3g} to {:.3g}".format(*low_high),
        shown_p(of["p"]),
        f"{of['largest_plain']:.4g}",
        f"{of['largest']:.4g}",
    )

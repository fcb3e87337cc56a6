"""Summary of the contact study: distributions, failures, causes and ablations over its runs, in
tables and figures.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from uuv.campaigns import contact_study
from uuv.campaigns.contact_study import CLASSES, DAMAGED, DIVERGED, KEPT, StudyBounds, within
from uuv.campaigns.sensitivity import worst_ratio
from uuv.campaigns.sensitivity_report import MISSED, WORST, SensitivityReport
from uuv.experiment import Summary, Table
from uuv.sim.evaluation.intervals import median_interval
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
    plain_axes,
)
from uuv.sim.interfaces.spatial import Array

Row = Mapping[str, Any]

_COLORS = dict(zip(CLASSES, (BLUE, ORANGE, PURPLE, FAINT, VERMILION, INK, SKY), strict=True))
_MOST_RUNS = 8  # runs listed for one kind of failure
SHARE = 0.99  # share of the runs that must be kept
FEWEST = 8  # runs needed for a rank correlation
# bounds of the bins of the promised chance
CHANCES = (0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)


@dataclass(frozen=True, slots=True)
class Shown:
    """Label, unit and scale of a figure."""

    name: str
    unit: str
    scale: float  # from SI to `unit`


SHOWN = {
    "force_rms_n": Shown("force error, RMS", "N", 1.0),
    "force_peak_n": Shown("force error, peak", "N", 1.0),
    "lost_s": Shown("contact lost", "s", 1.0),
    "cross_rms_m": Shown("across the path, RMS", "mm", 1e3),
    "cross_max_m": Shown("across the path, peak", "mm", 1e3),
    "along_rms_m": Shown("along the path, RMS", "mm", 1e3),
    "along_max_m": Shown("along the path, peak", "mm", 1e3),
    "object_deviation_max_m": Shown("tip off the ideal path on the object, peak", "mm", 1e3),
    "estimate_rms_n": Shown("estimate of the normal force, RMS error", "N", 1.0),
    "estimate_vector_rms_n": Shown("estimate of the force vector, RMS error", "N", 1.0),
    "tool_tilt_max_rad": Shown("tool tilt, peak", "deg", float(np.degrees(1.0))),
    "hull_excursion_max_m": Shown("hull excursion at work, peak", "mm", 1e3),
    "hull_tilt_max_rad": Shown("hull tilt at work, peak", "deg", float(np.degrees(1.0))),
    "hull_unfolding_max_m": Shown("hull off its place before work, peak", "mm", 1e3),
    "force_over_set": Shown("greatest force over the set one", "", 1.0),
    "saturated_s": Shown("thrusters saturated", "s", 1.0),
    "identification_error_m": Shown("identified position, error", "mm", 1e3),
    "promised_chance": Shown("chance promised before contact", "", 1.0),
    "navigation_sigma_m": Shown("stated error of the hull's place", "mm", 1e3),
    "object_sigma_m": Shown("stated error of the object's place", "mm", 1e3),
}
# Figures that are correlated with DRIVERS.
DRIVEN = (
    "force_rms_n",
    "force_peak_n",
    "cross_max_m",
    "along_max_m",
    "estimate_rms_n",
    "hull_excursion_max_m",
)
DRIVERS = {  # varied quantities: label, unit, scale from SI
    "current": ("current", "m/s", 1.0),
    "current_up": ("current, upward", "m/s", 1.0),
    "gust": ("gusts", "m/s", 1.0),
    "hull_added_mass": ("hull's added mass", "× believed", 1.0),
    "hull_drag": ("hull's drag", "× believed", 1.0),
    "arm_mass": ("arm's mass", "× believed", 1.0),
    "too_heavy_kg": ("out of trim", "kg", 1.0),
    "thruster_lag": ("thruster lag", "× believed", 1.0),
    "thruster_gain": ("thruster gain", "× believed", 1.0),
    "gear_friction": ("gear friction", "× believed", 1.0),
    "vision_period": ("vision period", "ms", 1e3),
    "vision_delay": ("vision delay", "ms", 1e3),
    "vision_noise": ("vision noise", "mm", 1e3),
    "friction": ("friction", "", 1.0),
    "stiffness": ("stiffness", "N/m", 1.0),
    "surface_offset": ("surface off", "mm", 1e3),
}

# The figure by which the ablation of each method is judged.
METHODS = {
    "compensation": "hull_excursion_max_m",
    "hydrodynamic-term": "hull_unfolding_max_m",
    "dynamic-term": "hull_unfolding_max_m",
    "contact-term": "hull_excursion_max_m",
    "drift-correction": "cross_max_m",
    "force-control": "force_rms_n",
    "fusion": "force_rms_n",
}


def summarise(rows: Sequence[Row], bounds: StudyBounds, settings: Mapping[str, Any]) -> Summary:
    """Summary of all runs, with tables and figures.

    Args:
        rows: Rows of all runs.
        bounds: Bounds of the figures.
        settings: Settings of the study.
    """
    rows = sorted(rows, key=lambda row: (row["without"], row["run"]))
    metrics, main = summary(rows, bounds, settings), [row for row in rows if not row["without"]]
    found = sensitivities(main, bounds)
    return Summary(
        metrics={**metrics, "sensitivity": found.metrics},
        tables=(*tables(metrics), *found.tables()),
        lines=found.lines,
        pictures=(*figures(main, metrics, bounds), *found.pictures()),
        caption=f"{metrics['kept']} of {metrics['runs']} runs kept contact and stayed within "
        f"{bounds.deviation * 1e3:g} mm and {bounds.force_peak:g} N.",
        failed=metrics["failed"],
    )


def values(rows: Sequence[Row], name: str) -> Array:
    """Values of one figure over all rows that have it."""
    found = (row["figures"].get(name) for row in rows)
    return np.array([value for value in found if value is not None], dtype=np.float64)


def bound_of(name: str, bounds: StudyBounds) -> float | None:
    """Bound of a figure in SI units; None where it has none."""
    return {
        "force_peak_n": bounds.force_peak,
        "cross_max_m": bounds.deviation,
        "along_max_m": bounds.deviation,
        "lost_s": 0.0,
    }.get(name)


def distributions(
    rows: Sequence[Row], bounds: StudyBounds
) -> dict[str, dict[str, float | int | None]]:
    """For each figure: median, 95th and 99th percentile, maximum, and the share of all runs within
    its bound.

    A run that ended before it gave a figure counts as not within the bound.
    """
    table: dict[str, dict[str, float | int | None]] = {}
    for name in SHOWN:
        found, bound = values(rows, name), bound_of(name, bounds)
        quantiles = (
            np.quantile(found, [0.5, 0.95, 0.99, 1.0]).tolist() if len(found) else [None] * 4
        )
        inside = (
            sum(within(value, bound) for value in found.tolist()) if bound is not None else None
        )
        table[name] = {
            "count": len(found),
            **dict(zip(("median", "p95", "p99", "max"), quantiles, strict=True)),
            "bound": bound,
            "share_within": inside / len(rows) if inside is not None and rows else None,
        }
    return table


def outcomes(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Classes and kinds of outcome with the numbers of their runs, in order of severity."""
    groups: dict[tuple[str, str], list[int]] = defaultdict(list)
    for row in rows:
        groups[row["class"], row["kind"]].append(row["run"])
    order = sorted(groups, key=lambda key: (CLASSES.index(key[0]), -len(groups[key]), key[1]))
    return [
        {
            "class": key[0],
            "kind": key[1],
            "count": len(groups[key]),
            "share": len(groups[key]) / len(rows),
            "runs": sorted(groups[key]),
        }
        for key in order
    ]


def drivers(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Spearman rank correlation of each figure in DRIVEN with each quantity in DRIVERS that
    varied.
    """
    found: dict[str, dict[str, float]] = {}
    for figure in DRIVEN:
        having = [row for row in rows if row["figures"].get(figure) is not None]
        for driver in DRIVERS:
            pairs = np.array(
                [
                    (row["varied"][driver], row["figures"][figure])
                    for row in having
                    if driver in row["varied"]
                ]
            ).reshape(-1, 2)
            if len(pairs) >= FEWEST and np.all(np.ptp(pairs, axis=0) > 0.0):
                found.setdefault(figure, {})[driver] = float(spearmanr(pairs[:, 0], pairs[:, 1])[0])
    return found


def sensitivities(rows: Sequence[Row], bounds: StudyBounds) -> SensitivityReport:
    """Sensitivity of the worst ratio to a bound, of kept or missed, and of each figure in DRIVEN,
    to all that varied.

    Args:
        rows: Rows of the runs without ablation.
        bounds: Bounds of the figures.
    """
    most = {name: bound for name in SHOWN if (bound := bound_of(name, bounds)) is not None}
    worked = (KEPT, contact_study.MISSED)
    ratios = [
        worst_ratio(row["figures"], most) if row["class"] in worked else np.inf for row in rows
    ]
    return SensitivityReport.of(
        [{**row["varied"], "path": row["path"]} for row in rows],
        {
            WORST: np.array(ratios),
            MISSED: np.array([row["class"] != KEPT for row in rows], dtype=np.float64),
            **{
                SHOWN[name].name: np.array(
                    [_or_nan(row["figures"].get(name)) for row in rows], dtype=np.float64
                )
                for name in DRIVEN
            },
        },
        [[] if row["class"] == KEPT else list(row["missed"]) or [row["kind"]] for row in rows],
    )


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def reliability(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Runs by the chance that was promised before contact: how many, the mean chance, and how many
    were kept.
    """
    promised = [row for row in rows if row["figures"].get("promised_chance") is not None]
    chance = np.array([row["figures"]["promised_chance"] for row in promised])
    kept = np.array([row["class"] == KEPT for row in promised])
    table = []
    for least, most in itertools.pairwise(CHANCES):
        inside = (chance >= least) & ((chance < most) | (most == 1.0))
        if inside.any():
            found = {
                "runs": int(inside.sum()),
                "mean": float(chance[inside].mean()),
                "kept": int(kept[inside].sum()),
            }
            table.append({"least": least, "most": most, **found})
    return table


def ablations(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """For each ablated method: its figure with and without it, and the median of the ratio run by
    run.
    """
    whole = {row["run"]: row for row in rows if not row["without"]}
    table = []
    for method in dict.fromkeys(row["without"] for row in rows if row["without"]):
        figure = METHODS[method]
        without = [row for row in rows if row["without"] == method and row["run"] in whole]
        pairs = np.array(
            [
                (whole[row["run"]]["figures"].get(figure), row["figures"].get(figure))
                for row in without
                if whole[row["run"]]["figures"].get(figure)
                and row["figures"].get(figure) is not None
            ],
            dtype=np.float64,
        ).reshape(-1, 2)

        some, ratios = len(pairs) > 0, pairs[:, 1] / pairs[:, 0]
        interval = median_interval(ratios)
        table.append(
            {
                "method": method,
                "figure": figure,
                "runs": len(without),
                "pairs": len(pairs),
                "median_with": float(np.median(pairs[:, 0])) if some else None,
                "median_without": float(np.median(pairs[:, 1])) if some else None,
                "factor": float(np.median(ratios)) if some else None,
                "factor_interval": list(interval) if interval else None,
                "kept_with": sum(whole[row["run"]]["class"] == KEPT for row in without),
                "kept_without": sum(row["class"] == KEPT for row in without),
            }
        )
    return table


def kept_on_object(rows: Sequence[Row], bounds: StudyBounds) -> int:
    """Number of kept runs whose true tip stayed within the path's bound of the ideal path on the
    true object.
    """
    off = [row["figures"].get("object_deviation_max_m") for row in rows if row["class"] == KEPT]
    return sum(within(value, bounds.deviation) for value in off)


def summary(
    rows: Sequence[Row], bounds: StudyBounds, settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Contents of metrics.json.

    Args:
        rows: Rows of all runs, without timing.
        bounds: Bounds of the figures.
        settings: Settings of the study.
    """
    main = [row for row in rows if not row["without"]]
    kept = sum(row["class"] == KEPT for row in main)
    worst = sum(row["class"] in (DAMAGED, DIVERGED) for row in main)
    failed = []
    if not main or kept < SHARE * len(main):
        failed.append(f"kept: {kept} of {len(main)} runs, wanted {SHARE:.0%}")
    if worst:
        failed.append(f"{worst} runs damaged or diverged")
    return {
        "settings": dict(settings),
        "runs": len(main),
        "kept": kept,
        "share_kept": kept / len(main) if main else None,
        "kept_on_object": kept_on_object(main, bounds),
        "damaged_or_diverged": worst,
        "outcomes": outcomes(main),
        "distributions": distributions(main, bounds),
        "by_path": {
            path: {
                "runs": len(of_path),
                "kept": sum(row["class"] == KEPT for row in of_path),
                "kept_on_object": kept_on_object(of_path, bounds),
            }
            for path in dict.fromkeys(row["path"] for row in main)
            for of_path in [[row for row in main if row["path"] == path]]
        },
        "refused_anyway": [
            {"run": row["run"], "outcome": row["anyway"]} for row in main if row.get("anyway")
        ],
        "reliability": reliability(main),
        "drivers": drivers(main),
        "ablations": ablations(rows),
        "accepted": not failed,
        "failed": failed,
    }


def tables(metrics: Mapping[str, Any]) -> Iterator[Table]:
    """Yields every table."""
    yield _table(
        "What came of the runs",
        ("class", "kind", "runs", "share", "which"),
        [
            (
                group["class"],
                group["kind"],
                str(group["count"]),
                f"{group['share']:.1%}",
                "" if group["class"] == KEPT else _named(group["runs"]),
            )
            for group in metrics["outcomes"]
        ],
    )
    yield _table(
        "Figures of all runs that lived to give them",
        ("figure", "unit", "runs", "median", "95 %", "99 %", "max", "bound", "within"),
        [
            (
                SHOWN[name].name,
                SHOWN[name].unit,
                str(row["count"]),
                *(
                    _number(row[key], SHOWN[name].scale)
                    for key in ("median", "p95", "p99", "max", "bound")
                ),
                "" if row["share_within"] is None else f"{row['share_within']:.1%}",
            )
            for name, row in metrics["distributions"].items()
        ],
    )
    yield _table(
        "By path",
        ("path", "runs", "kept", "share", "and on the object"),
        [
            (
                path,
                str(row["runs"]),
                str(row["kept"]),
                f"{row['kept'] / row['runs']:.1%}",
                str(row["kept_on_object"]),
            )
            for path, row in metrics["by_path"].items()
        ],
    )
    if metrics["refused_anyway"]:
        yield _table(
            "Seas that were refused for their current, run without that refusal",
            ("run", "what became of it"),
            [(str(found["run"]), found["outcome"]) for found in metrics["refused_anyway"]],
        )
    if metrics["reliability"]:
        yield _table(
            "Chance promised before contact, and what came of it",
            ("chance", "runs", "mean", "kept", "share"),
            [
                (
                    f"{row['least']:.0%} to {row['most']:.0%}",
                    str(row["runs"]),
                    f"{row['mean']:.1%}",
                    str(row["kept"]),
                    f"{row['kept'] / row['runs']:.1%}",
                )
                for row in metrics["reliability"]
            ],
        )
    if metrics["ablations"]:
        yield _table(
            "What each method is worth: medians, and the median of the runs' own ratios",
            (
                "left out",
                "figure",
                "unit",
                "runs",
                "with",
                "without",
                "factor",
                "95 % interval",
                "kept with",
                "kept without",
            ),
            [
                (
                    row["method"],
                    SHOWN[row["figure"]].name,
                    SHOWN[row["figure"]].unit,
                    f"{row['pairs']} of {row['runs']}",
                    _number(row["median_with"], SHOWN[row["figure"]].scale),
                    _number(row["median_without"], SHOWN[row["figure"]].scale),
                    _number(row["factor"], 1.0),
                    ""
                    if row["factor_interval"] is None
                    else "{:.2f} to {:.2f}".format(*row["factor_interval"]),
                    str(row["kept_with"]),
                    str(row["kept_without"]),
                )
                for row in metrics["ablations"]
            ],
        )


def _table(title: str, columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    return Table(title=title, columns=columns, rows=rows, labels=2)


def figures(
    rows: Sequence[Row], metrics: Mapping[str, Any], bounds: StudyBounds
) -> Iterator[tuple[str, str, Figure]]:
    """Yields title, caption and figure of every plot that the runs allow.

    Args:
        rows: Rows of the runs without ablation.
        metrics: Contents of metrics.json.
        bounds: Bounds of the figures.
    """
    if not any(row["figures"].get("force_rms_n") is not None for row in rows):
        return
    yield (
        "Distributions",
        "Share of all runs up to a figure, each by its path; dashed: the bound. A curve that does "
        "not come to one has "
        "runs without that figure.",
        distribution_figure(rows, bounds),
    )
    if metrics["drivers"]:
        yield (
            "What drives the errors",
            "Rank correlation (Spearman) of each figure with each varied quantity: 1 if one "
            "always rises with the "
            f"other. With {len(rows)} runs, what is below {2.0 / np.sqrt(max(1, len(rows))):.2f} "
            "may be chance.",
            driver_figure(metrics["drivers"]),
        )
        for name in ("force_rms_n", "cross_max_m", "along_max_m"):
            yield (
                f"{SHOWN[name].name.capitalize()} against what varies",
                "One dot a run, by its class.",
                scatter_figure(rows, name),
            )


def distribution_figure(rows: Sequence[Row], bounds: StudyBounds) -> Figure:
    """Cumulative distributions of six figures, one curve for each path, with their bounds."""
    names = (
        "force_rms_n",
        "force_peak_n",
        "estimate_rms_n",
        "cross_max_m",
        "along_max_m",
        "hull_excursion_max_m",
    )
    paths = list(dict.fromkeys(row["path"] for row in rows))
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    for axes, name in zip(figure.subplots(2, 3).flat, names, strict=True):
        for path, color in zip(paths, (BLUE, ORANGE, GREEN, PURPLE), strict=False):
            here = [row["figures"].get(name) for row in rows if row["path"] == path]
            found = np.sort([value for value in here if value is not None]) * SHOWN[name].scale
            if len(found):
                share = np.arange(1, len(found) + 1) / len(here)
                axes.step(found, share, where="post", color=color, label=path, linewidth=1.4)
        bound = bound_of(name, bounds)
        if bound is not None:
            axes.axvline(bound * SHOWN[name].scale, color=VERMILION, linewidth=0.9, linestyle="--")
        axes.set_xscale("log")
        axes.set_ylim(0.0, 1.02)
        axes.set_xlabel(f"{SHOWN[name].name} [{SHOWN[name].unit}]", fontsize=9)
        plain_axes(axes, 8)
    figure.axes[0].set_ylabel("share of runs")
    figure.axes[3].set_ylabel("share of runs")
    figure.axes[0].legend(frameon=False, fontsize=8, loc="lower right")
    return figure


def driver_figure(found: Mapping[str, Mapping[str, float]]) -> Figure:
    """Matrix of rank correlations: `found` by figure and varied quantity."""
    drivers = [name for name in DRIVERS if any(name in row for row in found.values())]
    driven = [name for name in DRIVEN if name in found]
    matrix = np.array(
        [[found[figure].get(driver, np.nan) for driver in drivers] for figure in driven]
    )
    figure = Figure(figsize=(WIDTH, 1.6 + 0.42 * len(driven)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for (i, j), value in np.ndenumerate(matrix):
        color = "white" if abs(value) > 0.6 else INK
        axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=8, color=color)
    axes.set_xticks(
        range(len(drivers)),
        [DRIVERS[name][0] for name in drivers],
        rotation=35,
        ha="right",
        fontsize=8,
    )
    axes.set_yticks(range(len(driven)), [SHOWN[name].name for name in driven], fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return figure


def scatter_figure(rows: Sequence[Row], name: str) -> Figure:
    """Scatter plots of figure `name` against each varied quantity, coloured by class."""
    having = [row for row in rows if row["figures"].get(name) is not None]
    drivers = [
        key
        for key in DRIVERS
        if len({row["varied"].get(key) for row in having if key in row["varied"]}) > 1
    ]
    columns = 5
    lines = -(-len(drivers) // columns)
    figure = Figure(figsize=(WIDTH, 0.5 + 1.8 * lines), layout="constrained")
    all_axes = figure.subplots(lines, columns, sharey=True, squeeze=False)
    for axes, key in zip(all_axes.flat, drivers, strict=False):
        label, unit, scale = DRIVERS[key]
        for word in CLASSES:
            points = np.array(
                [
                    (row["varied"][key] * scale, row["figures"][name] * SHOWN[name].scale)
                    for row in having
                    if row["class"] == word and key in row["varied"]
                ]
            ).reshape(-1, 2)
            if len(points):
                axes.scatter(
                    *points.T, s=9, color=_COLORS[word], label=word, linewidths=0, alpha=0.75
                )
        axes.set_xlabel(f"{label} [{unit}]" if unit else label, fontsize=8)
        axes.set_yscale("log")
        if key == "stiffness":
            axes.set_xscale("log")
        plain_axes(axes, 8)
    for axes in list(all_axes.flat)[len(drivers) :]:
        axes.set_visible(False)
    for axes in all_axes[:, 0]:
        axes.set_ylabel(SHOWN[name].unit, fontsize=8)
    handles = {
        label: handle
        for axes in figure.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside upper center",
        ncols=len(CLASSES),
        frameon=False,
        fontsize=8,
    )
    return figure


def _named(runs: Sequence[int]) -> str:
    more = f" and {len(runs) - _MOST_RUNS} more" if len(runs) > _MOST_RUNS else ""
    return " ".join(map(str, runs[:_MOST_RUNS])) + more


def _number(value: float | None, scale: float) -> str:
    if value is None:
        return ""
    shown = value * scale
    return f"{shown:.2f}" if abs(shown) < 100.0 else f"{shown:.0f}"

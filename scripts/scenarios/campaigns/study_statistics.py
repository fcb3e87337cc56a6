"""Statistics over the runs of a study: distributions, failures, rank correlations with causes, ablations."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from scenarios.campaigns.contact_study import CLASSES, DAMAGED, DIVERGED, KEPT, StudyBounds, within
from sim.interfaces.spatial import Array

Row = Mapping[str, Any]

SHARE = 0.99  # share of the runs that must be kept
FEWEST = 8  # runs needed for a rank correlation


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
    "estimate_rms_n": Shown("estimate of the normal force, RMS error", "N", 1.0),
    "estimate_vector_rms_n": Shown("estimate of the force vector, RMS error", "N", 1.0),
    "tool_tilt_max_rad": Shown("tool tilt, peak", "deg", float(np.degrees(1.0))),
    "hull_excursion_max_m": Shown("hull excursion at work, peak", "mm", 1e3),
    "hull_tilt_max_rad": Shown("hull tilt at work, peak", "deg", float(np.degrees(1.0))),
    "hull_unfolding_max_m": Shown("hull off its place before work, peak", "mm", 1e3),
    "force_over_set": Shown("greatest force over the set one", "", 1.0),
    "saturated_s": Shown("thrusters saturated", "s", 1.0),
    "identification_error_m": Shown("identified position, error", "mm", 1e3),
}
# Figures that are correlated with DRIVERS.
DRIVEN = ("force_rms_n", "force_peak_n", "cross_max_m", "along_max_m", "estimate_rms_n", "hull_excursion_max_m")
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


def distributions(rows: Sequence[Row], bounds: StudyBounds) -> dict[str, dict[str, float | int | None]]:
    """For each figure: median, 95th and 99th percentile, maximum, and the share of all runs within its bound.

    A run that ended before it gave a figure counts as not within the bound.
    """
    table: dict[str, dict[str, float | int | None]] = {}
    for name in SHOWN:
        found, bound = values(rows, name), bound_of(name, bounds)
        quantiles = np.quantile(found, [0.5, 0.95, 0.99, 1.0]).tolist() if len(found) else [None] * 4
        inside = sum(within(value, bound) for value in found.tolist()) if bound is not None else None
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
    """Spearman rank correlation of each figure in DRIVEN with each quantity in DRIVERS that varied."""
    found: dict[str, dict[str, float]] = {}
    for figure in DRIVEN:
        having = [row for row in rows if row["figures"].get(figure) is not None]
        for driver in DRIVERS:
            pairs = np.array(
                [(row["varied"][driver], row["figures"][figure]) for row in having if driver in row["varied"]]
            ).reshape(-1, 2)
            if len(pairs) >= FEWEST and np.all(np.ptp(pairs, axis=0) > 0.0):
                found.setdefault(figure, {})[driver] = float(spearmanr(pairs[:, 0], pairs[:, 1])[0])
    return found


def ablations(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """For each ablated method: its figure with and without it, and the median of the ratio run by run."""
    whole = {row["run"]: row for row in rows if not row["without"]}
    table = []
    for method in dict.fromkeys(row["without"] for row in rows if row["without"]):
        figure = METHODS[method]
        without = [row for row in rows if row["without"] == method and row["run"] in whole]
        pairs = np.array(
            [
                (whole[row["run"]]["figures"].get(figure), row["figures"].get(figure))
                for row in without
                if whole[row["run"]]["figures"].get(figure) and row["figures"].get(figure) is not None
            ],
            dtype=np.float64,
        ).reshape(-1, 2)
        some = len(pairs) > 0
        table.append(
            {
                "method": method,
                "figure": figure,
                "runs": len(without),
                "pairs": len(pairs),
                "median_with": float(np.median(pairs[:, 0])) if some else None,
                "median_without": float(np.median(pairs[:, 1])) if some else None,
                "factor": float(np.median(pairs[:, 1] / pairs[:, 0])) if some else None,
                "kept_with": sum(whole[row["run"]]["class"] == KEPT for row in without),
                "kept_without": sum(row["class"] == KEPT for row in without),
            }
        )
    return table


def summary(rows: Sequence[Row], bounds: StudyBounds, settings: Mapping[str, Any]) -> dict[str, Any]:
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
        "damaged_or_diverged": worst,
        "outcomes": outcomes(main),
        "distributions": distributions(main, bounds),
        "by_path": {
            path: {
                "runs": sum(row["path"] == path for row in main),
                "kept": sum(row["path"] == path and row["class"] == KEPT for row in main),
            }
            for path in dict.fromkeys(row["path"] for row in main)
        },
        "drivers": drivers(main),
        "ablations": ablations(rows),
        "accepted": not failed,
        "failed": failed,
    }

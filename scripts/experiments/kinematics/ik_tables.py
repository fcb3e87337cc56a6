"""Tables and figure of the IK benchmark, from the contents of bench_ik.json."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.experiment import Table
from uuv.sim.interfaces.palette import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from uuv.sim.interfaces.spatial import Array

# Goals for a peer's time over hybrid's, cold and warm: geometric mean over the goals' arms at bar
# A.
RATIO_GOALS = {
    "TRAC-IK": (20.0, 12.0),
    "OptIK": (12.0, 9.0),
    "KDL LMA": (12.0, None),
    "RTB ik_LM": (5.0, 3.5),
    "ikdh seed": (1.5, 1.1),
    "EAIK": (1.3, 1.3),
}
KERNEL_GOALS = {"PUMA 560": {"cold": 8.0, "warm": 3.0}}  # [us]
STARTS = ("cold", "warm")
_COLORS = {
    "hybrid": BLUE,
    "jacobian_free": GREEN,
    "plain": ORANGE,
    "plain, joint's axes": PURPLE,
    "compiled DLS": VERMILION,
}


def tables(results: dict[str, Any], degrees: int) -> list[Table]:
    """All tables; times are those under joint limits of `degrees`."""
    return [
        _rates(results["rates"]),
        _ratios(results, degrees),
        _by_arm(results["race"], degrees),
        _kernel(results["kernel"]),
        _growth(results["growth"]),
    ]


def _rates(rows: list[dict[str, Any]]) -> Table:
    keys = list(dict.fromkeys((row["limits_deg"], row["start"]) for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    columns = (
        "arm",
        *(f"{method}, +-{degrees} {start}" for method in methods for degrees, start in keys),
    )
    body = []
    for arm in dict.fromkeys(row["arm"] for row in rows):
        cells = []
        for method in methods:
            for degrees, start in keys:
                found = [
                    row["rate"]
                    for row in rows
                    if (row["arm"], row["method"], row["limits_deg"], row["start"])
                    == (arm, method, degrees, start)
                ]
                cells.append(f"{100.0 * min(found):.2f}")
        body.append((arm, *cells))
    return Table(
        title="Solve rate [%], targets within 150 deg, the worse of bars A and B",
        columns=columns,
        rows=body,
    )


def _ratios(results: dict[str, Any], degrees: int) -> Table:
    """One row for each solver: solve rates, times, ratios to hybrid with intervals."""
    scope = (
        "goal arms" if any(row["scope"] == "goal arms" for row in results["ratios"]) else "all arms"
    )
    body = []
    for method in dict.fromkeys(row["method"] for row in results["ratios"]):
        cells = []
        for k, start in enumerate(STARTS):
            mean = _only(
                results["ratios"],
                scope=scope,
                method=method,
                start=start,
                limits_deg=degrees,
                bar="A",
            )
            everywhere = [
                row
                for row in results["race"]
                if (row["method"], row["start"], row["limits_deg"], row["bar"])
                == (method, start, degrees, "A")
            ]
            low, high = mean["ratio_95"]
            goal = RATIO_GOALS.get(method, (None, None))[k]
            said = (
                ""
                if goal is None
                else (f" (goal {goal:g}: {'met' if mean['ratio'] >= goal else 'missed'})")
            )
            cells += [
                f"{100.0 * min(row['rate'] for row in everywhere):.1f}",
                f"{_geometric([row['median_us'] for row in everywhere]):.1f}",
                f"{mean['ratio']:.2f} [{low:.2f}, {high:.2f}]{said}",
            ]
            if k == 0:
                cells.insert(0, f"{mean['arms']} / {len(everywhere)}")
        body.append((method, *cells))
    return Table(
        f"Time of a Python call over that of hybrid, limits +-{degrees} deg, bar A: geometric "
        "means, 95 % intervals",
        (
            "solver",
            f"{scope} / all",
            "cold: worst %",
            "[us], all",
            "ratio",
            "warm: worst %",
            "[us], all",
            "ratio",
        ),
        body,
    )


def _by_arm(rows: list[dict[str, Any]], degrees: int) -> Table:
    chosen = [row for row in rows if row["limits_deg"] == degrees]
    body = []
    for arm in dict.fromkeys(row["arm"] for row in chosen):
        cells = []
        for start in STARTS:
            for bar in ("A", "B"):
                case = {"arm": arm, "start": start, "bar": bar}
                ours = _only(chosen, method="hybrid", **case)
                base = _only(chosen, method="compiled DLS", **case)
                low, high = base["ratio_95"]
                cells += [
                    f"{ours['median_us']:.1f}",
                    f"{base['ratio']:.2f} [{low:.2f}, {high:.2f}]",
                ]
        body.append((arm, *cells))
    columns = tuple(
        f"{start} {bar} {what}"
        for start in STARTS
        for bar in ("A", "B")
        for what in ("[us]", "DLS / hybrid")
    )
    return Table(
        "hybrid a Python call, over it the compiled DLS, whose call checks nothing and gives q "
        f"alone, +-{degrees} deg",
        ("arm", *columns),
        body,
    )


def _kernel(rows: list[dict[str, Any]]) -> Table:
    body = []
    for arm in dict.fromkeys(row["arm"] for row in rows):
        cells = []
        for start in STARTS:
            row = _only(rows, arm=arm, start=start)
            goal = KERNEL_GOALS.get(arm, {}).get(start)
            said = (
                ""
                if goal is None
                else (f" (goal {goal:g}: {'met' if row['hybrid_us'] <= goal else 'missed'})")
            )
            low, high = row["ratio_95"]
            cells += [
                f"{row['hybrid_us']:.2f}{said}",
                f"{row['ratio']:.2f} [{low:.2f}, {high:.2f}]",
            ]
        body.append((arm, *cells))
    columns = ("arm", "cold [us]", "DLS / hybrid", "warm [us]", "DLS / hybrid")
    return Table(
        "Kernel without Python, bar A: mean time a target, the baseline's over it with 95 % "
        "interval",
        columns,
        body,
    )


def _growth(growth: dict[str, Any]) -> Table:
    body = []
    for method, times in growth["median_us"].items():
        slope = growth["exponent"].get(method)
        cells = [
            f"{us:.1f}" + ("" if share == 1.0 else f" ({100.0 * share:.0f} %)")
            for us, share in zip(times, growth["rate"][method], strict=True)
        ]
        body.append((method, *cells, "" if slope is None else f"{slope:.2f}"))
    columns = ("solver", *(str(n) for n in growth["links"]), "exponent from 24")
    return Table(
        "Median time [us] of a solve by the number of links, bar A (share solved, if not all)",
        columns,
        body,
    )


def draw(results: dict[str, Any], degrees: int, path: Path) -> None:
    """Plots ratios of all solvers, the baseline's ratio by arm, growth with the number of links,
    and solve rates.

    Args:
        results: Contents of bench_ik.json.
        degrees: Joint limits that are shown.
        path: PNG file.
    """
    figure = Figure(figsize=(13, 9), layout="constrained")
    axes = figure.subplot_mosaic([["ratios", "growth"], ["arms", "rates"]])
    _draw_ratios(axes["ratios"], results["ratios"], degrees)
    _draw_growth(axes["growth"], results["growth"])
    _draw_arms(axes["arms"], results["kernel"])
    _draw_rates(axes["rates"], results["rates"])
    figure.savefig(path, dpi=110)


def _draw_ratios(axes: Any, rows: list[dict[str, Any]], degrees: int) -> None:
    scope = "goal arms" if any(row["scope"] == "goal arms" for row in rows) else "all arms"
    rows = [r for r in rows if (r["scope"], r["limits_deg"], r["bar"]) == (scope, degrees, "A")]
    cold = sorted((r for r in rows if r["start"] == "cold"), key=lambda r: r["ratio"])
    names = [row["method"] for row in cold]
    for k, (start, color) in enumerate(zip(STARTS, (BLUE, ORANGE), strict=True)):
        chosen = [_only(rows, method=name, start=start) for name in names]
        values = np.array([row["ratio"] for row in chosen])
        bounds = np.array([row["ratio_95"] for row in chosen]).T
        places = np.arange(len(names)) + 0.38 * (k - 0.5)
        axes.barh(
            places,
            values,
            0.36,
            color=color,
            label=start,
            xerr=_bars(values, bounds),
            error_kw={"lw": 1.0},
        )
        for place, value, high in zip(places, values, bounds[1], strict=True):
            axes.annotate(
                f"{value:.2g}" if value < 10 else f"{value:.0f}",
                (max(value, high), place),
                (4, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
            )
    axes.set_yticks(range(len(names)), names)
    axes.set(
        xscale="log",
        xlabel="time over that of hybrid",
        title=f"A Python call, bar A, +-{degrees} deg: {scope}",
    )
    axes.axvline(1.0, color="0.3", lw=0.8)
    axes.margins(x=0.12)
    axes.legend(loc="lower right")


def _draw_growth(axes: Any, growth: dict[str, Any]) -> None:
    links = np.array(growth["links"], dtype=float)
    for method, values in growth["median_us"].items():
        slope = growth["exponent"].get(method)
        label = method if slope is None else f"{method}: n^{slope:.2f} from 24"
        axes.loglog(links, values, marker="o", color=_COLORS.get(method), label=label)
    first = growth["median_us"]["hybrid"][0]
    axes.loglog(links, first * links / links[0], "--", color="0.6", lw=1.0, label="linear")
    axes.set_xticks(links, [f"{n:.0f}" for n in links])
    axes.minorticks_off()
    axes.set(
        xlabel="links",
        ylabel="median time of a solve [us]",
        title="Growth with the number of links, bar A",
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left")


def _draw_arms(axes: Any, rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(row["arm"] for row in rows))
    for k, (start, color) in enumerate(zip(STARTS, (BLUE, ORANGE), strict=True)):
        chosen = [_only(rows, arm=name, start=start) for name in names]
        values = np.array([row["ratio"] for row in chosen])
        bounds = np.array([row["ratio_95"] for row in chosen]).T
        places = np.arange(len(names)) + 0.2 * (k - 0.5)
        axes.errorbar(
            places, values, _bars(values, bounds), fmt="o", color=color, capsize=3, label=start
        )
    axes.axhline(1.0, color="0.3", lw=0.8)
    axes.axhline(1.0 / 1.1, color=VERMILION, lw=0.8, ls="--", label="10 % slower than the baseline")
    axes.set_yscale("log")
    axes.set_yticks([0.9, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0], ["0.9", "1", "1.5", "2", "3", "5", "10"])
    axes.minorticks_off()
    axes.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
    axes.set(ylabel="compiled DLS / hybrid", title="Kernels, bar A (above 1: hybrid is faster)")
    axes.grid(alpha=0.3, axis="y")
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 0.3))


def _draw_rates(axes: Any, rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(row["arm"] for row in rows))
    for method in dict.fromkeys(row["method"] for row in rows):
        worst = [
            min(r["rate"] for r in rows if (r["arm"], r["method"]) == (name, method))
            for name in names
        ]
        axes.plot(
            range(len(names)),
            [100.0 * w for w in worst],
            "o-",
            color=_COLORS.get(method),
            label=method,
            lw=0.8,
        )
    axes.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
    axes.set(ylabel="solved [%]", title="The worst solve rate: starts, bars, limits")
    axes.set_ylim(bottom=0.0, top=104.0)
    axes.grid(alpha=0.3, axis="y")
    axes.legend(fontsize=8)


def _bars(values: Array, bounds: Array) -> Array:
    """Lengths (2, k) of the error bars; clipped at 0, since a bootstrap interval may exclude the
    median itself.
    """
    return np.maximum(np.stack([values - bounds[0], bounds[1] - values]), 0.0)


def _only(rows: list[dict[str, Any]], **wanted: object) -> dict[str, Any]:
    """The only row with these entries."""
    (row,) = (row for row in rows if all(row[key] == value for key, value in wanted.items()))
    return row


def _geometric(values: list[float]) -> float:
    return math.exp(sum(math.log(value) for value in values) / len(values))

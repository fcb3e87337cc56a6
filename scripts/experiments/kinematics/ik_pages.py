"""Tables and pictures of the bench of inverse kinematics that go over several arms."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.kinematics.ik_bench import BASELINE, COLD, METHODS, WARM
from uuv.experiment import Row, Table
from uuv.sim.evaluation.intervals import SIGMAS
from uuv.sim.interfaces.spatial import Array

GOAL_ARMS = ("puma560", "puma560_tool", "ur5", "iiwa7", "general6r")  # of the mean ratios
# Goals for a peer's time over hybrid's, cold and warm: geometric mean over GOAL_ARMS at bar A.
RATIO_GOALS = {
    "TRAC-IK": (20.0, 12.0),
    "OptIK": (12.0, 9.0),
    "KDL LMA": (12.0, None),
    "RTB ik_LM": (5.0, 3.5),
    "ikdh seed": (1.5, 1.1),
    "EAIK": (1.3, 1.3),
}
KERNEL_GOALS = {("puma560", COLD): 8.0, ("puma560", WARM): 3.0}  # [us]
STARTS = (COLD, WARM)
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
COLORS = {
    "hybrid": BLUE,
    "jacobian_free": GREEN,
    "plain": ORANGE,
    "plain, joint's axes": PURPLE,
    BASELINE: VERMILION,
}


def shown_rows(rows: Sequence[Row], start: str) -> list[Row]:
    """Rows at bar A under the first limits, from one start."""
    first = rows[0]["limits"]
    return [row for row in rows if (row["limits"], row["start"], row["bar"]) == (first, start, "A")]


def mean_ratio(rows: Sequence[Row], solver: str) -> tuple[float, float, float] | None:
    """Geometric mean over the goals' arms, or all if none is there, of a solver's time over that of
    hybrid, with its 95 % interval; None if it supports none of them.
    """
    rows = [row for row in rows if row["arm"] in GOAL_ARMS] or list(rows)
    rows = [row for row in rows if solver in row["ratio"]]
    if not rows:
        return None

    log = float(np.mean([math.log(row["ratio"][solver]) for row in rows]))
    sigma = math.sqrt(sum(row["ratio_sigma"][solver] ** 2 for row in rows)) / len(rows)
    low = log - SIGMAS * sigma
    high = log + SIGMAS * sigma
    return math.exp(log), math.exp(low), math.exp(high)


def solvers_in(rows: Sequence[Row]) -> list[str]:
    """Names of the solvers in their order."""
    return list(dict.fromkeys(name for row in rows for name in row["ratio"]))


def over_hybrid(rows: list[Row]) -> Table:
    """Solve rates and times of all solvers, with ratios to hybrid."""
    lines = []
    for solver in solvers_in(rows):
        cells = []
        for k, start in enumerate(STARTS):
            arms = [row for row in shown_rows(rows, start) if solver in row["ratio"]]
            ratio = mean_ratio(arms, solver)
            if ratio is None:
                cells += ["-"] * 4
                continue

            goal = RATIO_GOALS.get(solver, (None, None))[k]
            met = "" if goal is None else "met" if ratio[0] >= goal else "missed"
            solved = min(row["solved"][solver] / row["targets"] for row in arms)
            times = [math.log(row["median"][solver]) for row in arms]
            cells += [
                str(len(arms)),
                f"{100.0 * solved:.1f}",
                f"{1e6 * math.exp(np.mean(times)):.1f}",
                f"{ratio[0]:.2f} [{ratio[1]:.2f}, {ratio[2]:.2f}]"
                + (f" (goal {goal:g}: {met})" if met else ""),
            ]
        lines.append((solver, *cells))

    return Table(
        title="Time of a Python call over that of hybrid, first limits, bar A: geometric means "
        "over all arms; ratio over the goals' arms, 95 % intervals",
        columns=(
            "solver",
            *(
                f"{start}: {heading}"
                for start in STARTS
                for heading in ("arms", "worst %", "[us]", "ratio")
            ),
        ),
        rows=lines,
    )


def kernel_goals(rows: list[Row]) -> list[str]:
    """Times of the kernel beside their goals."""
    lines = []
    for (arm, start), goal in KERNEL_GOALS.items():
        for row in shown_rows(rows, start):
            if row["arm"] == arm:
                spent = 1e6 * row["kernel"]["hybrid"]
                word = "met" if spent <= goal else "missed"
                lines.append(f"kernel, {arm}, {start}: {spent:.2f} us (goal {goal:g}: {word})")
    return lines


def ratios_picture(rows: list[Row]) -> tuple[str, str, Figure]:
    """Ratios of all solvers to hybrid."""
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots()
    cold = {name: mean_ratio(shown_rows(rows, COLD), name) for name in solvers_in(rows)}
    names = sorted(
        (name for name, ratio in cold.items() if ratio), key=lambda name: cold[name] or (0.0,)
    )

    for k, (start, color) in enumerate(zip(STARTS, (BLUE, ORANGE), strict=True)):
        ratios = [mean_ratio(shown_rows(rows, start), name) for name in names]
        quotients = np.array([ratio or (np.nan,) * 3 for ratio in ratios]).reshape(-1, 3)
        places = np.arange(len(names)) + 0.38 * (k - 0.5)

        bars = _bars(quotients)
        axes.barh(places, quotients[:, 0], 0.36, color=color, label=start, xerr=bars)
        for y_bar, (quotient, _, high) in zip(places, quotients, strict=True):
            text = f"{quotient:.2g}" if quotient < 10 else f"{quotient:.0f}"
            axes.annotate(
                text, (high, y_bar), (4, 0), textcoords="offset points", va="center", fontsize=8
            )

    axes.set_yticks(range(len(names)), names)
    axes.set(xscale="log", xlabel="time over that of hybrid")
    axes.axvline(1.0, color="0.3", lw=0.8)
    axes.margins(x=0.12)
    axes.legend(loc="lower right")
    return "A Python call beside that of hybrid", "Bar A, geometric means over arms.", figure


def arms_picture(rows: list[Row]) -> tuple[str, str, Figure]:
    """The baseline's kernel over that of hybrid, by arm."""
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots()
    first = rows[0]["limits"]
    rows = [row for row in rows if row["limits"] == first and row["bar"] == "A"]
    names = list(dict.fromkeys(row["arm"] for row in rows))

    for k, (start, color) in enumerate(zip(STARTS, (BLUE, ORANGE), strict=True)):
        chosen = [row for row in rows if row["start"] == start]
        log = np.log([row["kernel_ratio"] for row in chosen])
        off = SIGMAS * np.array([row["kernel_sigma"] for row in chosen])
        quotients = np.exp(np.stack([log, log - off, log + off], axis=1))
        places = [names.index(row["arm"]) + 0.2 * (k - 0.5) for row in chosen]
        style = {"fmt": "o", "color": color, "capsize": 3, "label": start}
        axes.errorbar(places, quotients[:, 0], _bars(quotients), **style)

    axes.axhline(1.0, color="0.3", lw=0.8)
    axes.axhline(1.0 / 1.1, color=VERMILION, lw=0.8, ls="--", label="10 % slower than the baseline")
    axes.set_yscale("log")
    axes.set_yticks([0.9, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0], ["0.9", "1", "1.5", "2", "3", "5", "10"])
    axes.minorticks_off()
    axes.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
    axes.set_ylabel("compiled DLS / hybrid")
    axes.grid(alpha=0.3, axis="y")
    axes.legend(fontsize=8)
    return "Kernels, bar A", "Above 1: hybrid is faster.", figure


def rates_picture(rows: list[Row]) -> tuple[str, str, Figure]:
    """The worst solve rate of our methods, by arm."""
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots()
    names = list(dict.fromkeys(row["arm"] for row in rows))

    for method in METHODS:
        worst = [min(_share(row, method) for row in rows if row["arm"] == name) for name in names]
        axes.plot(names, worst, "o-", color=COLORS[method], label=method, lw=0.8)

    axes.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
    axes.set_ylabel("solved [%]")
    axes.set_ylim(bottom=0.0, top=104.0)
    axes.grid(alpha=0.3, axis="y")
    axes.legend(fontsize=8)
    return "Targets solved, the worst case", "Over starts, bars and limits.", figure


def _share(row: Mapping[str, Any], method: str) -> float:
    return 100.0 * row["reached"][method] / row["rates"]


def _bars(values: Array) -> Array:
    """Lengths (2, k) of the error bars of values (k, 3): value, lower and upper bound."""
    return np.stack([values[:, 0] - values[:, 1], values[:, 2] - values[:, 0]])

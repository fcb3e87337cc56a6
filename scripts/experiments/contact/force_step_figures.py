"""Step response of the force loop over many runs: mean by surface, figures, and picture."""

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.contact.force_steps import figures, times
from uuv.experiment import Row, Summary, Table
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OVERSHOOT = 0.05  # largest overshoot, share of the step
COLUMNS = (
    "surface [N/m]",
    "steps",
    "rise, 10-90 % [s]",
    "overshoot [%]",
    "settling, 5 % [s]",
    "spread [N]",
)


def line(row: Row) -> str:
    """Line about a run that ended early; empty for others."""
    return f"{row['stiffness']:g} N/m, seed {row['seed']}: {row['note']}" if row["note"] else ""


def summarise(runs: list[Row], low: float, high: float) -> Summary:
    """Mean response on each surface.

    Args:
        runs: Rows of all runs.
        low: [N] set force before a step.
        high: [N] set force after a step.
    """
    curves = {
        stiffness: {
            name: np.concatenate(
                [
                    np.reshape(run[name], (-1, len(times())))
                    for run in runs
                    if run["stiffness"] == stiffness
                ]
            )
            for name in ("set", "true")
        }
        for stiffness in dict.fromkeys(run["stiffness"] for run in runs)
    }

    rows = [figures_of(stiffness, curve["true"], low, high) for stiffness, curve in curves.items()]
    failed = [f"{row['stiffness_n_m']:g} N/m: {_missed(row)}" for row in rows if _missed(row)]

    return Summary(
        metrics={"surfaces": rows},
        tables=[
            Table(
                title=f"Force from {low:g} to {high:g} N",
                columns=COLUMNS,
                rows=[*map(cells, rows)],
                labels=0,
            )
        ],
        pictures=_pictures(partial(picture_of, curves, low, high)),
        failed=[*failed, *filter(None, map(line, runs))],
    )


def _missed(row: dict[str, Any]) -> str:
    """The bound that a surface missed; empty if none."""
    if row["overshoot"] is None:
        return "no whole step"
    if row["overshoot"] > OVERSHOOT:
        return f"overshoot {100.0 * row['overshoot']:.3g} %, allowed {100.0 * OVERSHOOT:g} %"
    return ""


def _pictures(draw: Any) -> Iterator[tuple[str, str, "Figure"]]:
    yield (
        "Responses",
        "True normal force at the tool, moving along the path: each step thin, their mean thick; "
        "the set force dashed, and the bound of the overshoot.",
        draw(),
    )


def figures_of(stiffness: float, true: Array, low: float, high: float) -> dict[str, Any]:
    """Figures of the mean response on one surface, and the spread of single responses about it.

    Args:
        stiffness: [N/m] of pad and surface in series.
        true: (k, N) [N] responses.
        low: [N] set force before a step.
        high: [N] set force after a step.
    """
    none = {"rise_s": None, "overshoot": None, "settling_s": None, "spread_n": None}
    if not len(true):
        return {"stiffness_n_m": stiffness, "steps": 0, **none}

    mean = true.mean(axis=0)
    spread = float(np.sqrt(np.mean((true - mean) ** 2)))

    return {
        "stiffness_n_m": stiffness,
        "steps": len(true),
        **figures(mean, low, high),
        "spread_n": spread,
    }


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """Formatted cells of a row of the table."""
    scaled = (("rise_s", 1.0), ("overshoot", 100.0), ("settling_s", 1.0), ("spread_n", 1.0))
    numbers = ("–" if row[name] is None else f"{scale * row[name]:.2f}" for name, scale in scaled)
    return f"{row['stiffness_n_m']:.3g}", str(row["steps"]), *numbers


def picture_of(curves: dict[float, dict[str, Array]], low: float, high: float) -> "Figure":
    """Figure of the responses, one panel for each stiffness.

    Args:
        curves: "set" and "true", each (k, N) [N], by stiffness [N/m].
        low: [N] set force before a step.
        high: [N] set force after a step.
    """
    from matplotlib.figure import Figure

    from uuv.sim.interfaces import palette
    from uuv.sim.interfaces.palette import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, VERMILION, WIDTH

    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    all_axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    t = times()
    for axes, (stiffness, curve), color in zip(
        all_axes, curves.items(), (BLUE, ORANGE, GREEN, PURPLE, SKY) * len(curves), strict=False
    ):
        axes.plot(t, curve["true"].T, color=color, linewidth=0.4, alpha=0.35)
        if len(curve["true"]):
            axes.plot(t, curve["set"].mean(axis=0), color=INK, linewidth=1.0, linestyle="--")
            axes.plot(t, curve["true"].mean(axis=0), color=color, linewidth=2.0)

        limit = high + OVERSHOOT * (high - low)
        axes.axhline(limit, color=VERMILION, linewidth=0.9, linestyle="--")
        axes.set_title(f"{stiffness:.3g} N/m", fontsize=10)
        axes.set_xlabel("time from the step [s]")
        palette.plain_axes(axes, 9)

    all_axes[0].set_ylabel("normal force [N]")
    return figure

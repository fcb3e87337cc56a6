"""Study: step response of the force loop on soft, medium and hard surfaces with one tuning, the tool moving.

Each run steps the set force up and down several times. The mean response is judged, so that sensor noise and gusts do
not count as overshoot. Exit code 0: the mean response overshoots by at most 5 % on each surface.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from scenarios.campaigns.pool import run_all
from scenarios.command import NOT_ACCEPTED
from scenarios.force_steps import StepTask, died, figures, responses, times
from sim import hydrodynamics
from sim.interfaces.errors import ConfigurationError
from sim.reporting.report_figures import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, VERMILION, WIDTH
from sim.reporting.report_page import page, section, table, text
from sim.reporting.report_page import provenance as made_by
from sim.runs.provenance import provenance
from sim.runs.saving import write_json, write_whole

OVERSHOOT = 0.05  # largest overshoot, share of the step
COLUMNS = ("surface [N/m]", "steps", "rise, 10-90 % [s]", "overshoot [%]", "settling, 5 % [s]", "spread [N]")


@dataclass(kw_only=True)
class Options:
    """Steps of the set force on surfaces from soft to hard."""

    stiffness: tuple[float, ...] = (1e4, 3e4, 1e6)
    """Stiffness of pad and surface in series [N/m]."""
    low: float = 60.0
    """Set force before a step [N]."""
    high: float = 90.0
    """Set force after a step [N]."""
    rate: float = 60.0
    """Rate of change of the set force [N/s], default as in the jobs; 1e6 is nearly a step."""
    steps: int = 6
    """Number of steps up in a run."""
    runs: int = 3
    """Number of runs on each surface."""
    seed: int = 0
    """Seed of the first run."""
    current: tuple[float, float, float] = (0.15, 0.0, 0.0)
    """Steady current in W [m/s]."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    workers: int = 0
    """Number of processes; 0: one for each core."""
    out: Path | None = None
    """Folder for metrics.json and report.html; default: a new one in runs/step_response."""
    quick: bool = False
    """One run on each surface."""


def main() -> int:
    """Runs the study, writes its files and returns the exit code."""
    options = parse(Options)
    if not 0.0 < options.low < options.high:
        raise ConfigurationError(f"--low, --high: must rise from above zero, got {options.low}, {options.high} N")
    if not (options.rate > 0.0 and 1 <= options.steps <= 6 and options.runs >= 1 and options.workers >= 0):
        raise ConfigurationError("--rate must be > 0 N/s, --steps from 1 to 6, --runs at least 1, --workers at least 0")
    console = Console()
    folder = new_folder("step_response", options.out, options.seed)
    tasks = [
        StepTask(
            stiffness=stiffness,
            seed=options.seed + run,
            low=options.low,
            high=options.high,
            steps=options.steps,
            rate=options.rate,
            current=options.current,
            gust=options.gust,
        )
        for stiffness in options.stiffness
        for run in range(1 if options.quick else options.runs)
    ]
    hydrodynamics.install()
    by_task = dict(run_all(tasks, options.workers or os.cpu_count() or 1, responses, died))
    found = [by_task[task] for task in tasks]
    for one in found:
        if one["note"]:
            console.print(f"{one['task'].stiffness:g} N/m, seed {one['task'].seed}: {one['note']}", highlight=False)
    curves = {
        stiffness: {
            name: np.concatenate([one[name] for one in found if one["task"].stiffness == stiffness])
            for name in ("set", "true")
        }
        for stiffness in options.stiffness
    }
    rows = [judged(stiffness, curve["true"], options) for stiffness, curve in curves.items()]
    accepted = all(row["overshoot"] is not None and row["overshoot"] <= OVERSHOOT for row in rows)
    accepted &= not any(one["note"] for one in found)
    metrics = {"surfaces": rows, "accepted": accepted, "provenance": provenance("step_response", options)}
    write_json(folder / "metrics.json", metrics)
    shown = Table(title=f"Force from {options.low:g} to {options.high:g} N", title_justify="left")
    for column in COLUMNS:
        shown.add_column(column, justify="right")
    for row in rows:
        shown.add_row(*cells(row))
    console.print(shown)
    write_report(folder / "report.html", options, rows, curves, accepted)
    console.print("[green]accepted[/green]" if accepted else "[red]not accepted[/red]")
    console.print(f"written to {folder}/", highlight=False)
    return 0 if accepted else NOT_ACCEPTED


def judged(stiffness: float, true: np.ndarray, options: Options) -> dict[str, Any]:
    """Figures of the mean response on one surface, and the spread of single responses about it.

    Args:
        stiffness: [N/m] of pad and surface in series.
        true: (k, N) [N] responses.
        options: Options of the study.
    """
    none = {"rise_s": None, "overshoot": None, "settling_s": None, "spread_n": None}
    if not len(true):
        return {"stiffness_n_m": stiffness, "steps": 0, **none}
    mean = true.mean(axis=0)
    spread = float(np.sqrt(np.mean((true - mean) ** 2)))
    return {
        "stiffness_n_m": stiffness,
        "steps": len(true),
        **figures(mean, options.low, options.high),
        "spread_n": spread,
    }


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """Formatted cells of a row of the table."""
    scaled = (("rise_s", 1.0), ("overshoot", 100.0), ("settling_s", 1.0), ("spread_n", 1.0))
    numbers = ("–" if row[name] is None else f"{scale * row[name]:.2f}" for name, scale in scaled)
    return f"{row['stiffness_n_m']:.3g}", str(row["steps"]), *numbers


def write_report(
    file: Path, options: Options, rows: list[dict[str, Any]], curves: dict[float, dict[str, np.ndarray]], accepted: bool
) -> None:
    """Writes report.html.

    Args:
        file: HTML file.
        options: Options of the study.
        rows: Figures of each surface.
        curves: "set" and "true", each (k, N) [N], by stiffness [N/m].
        accepted: The verdict.
    """
    title = f"Step of the set force from {options.low:g} to {options.high:g} N"
    verdict = "accepted" if accepted else "not accepted"
    body = [
        f"<header><h1>{text(title)} <span class='{verdict.replace(' ', '-')}'>{verdict}</span></h1></header>",
        f"<section><h2>Figures of the mean response</h2>{table(COLUMNS, map(cells, rows))}</section>",
        section(
            "Responses",
            picture_of(options, curves),
            "True normal force at the tool, moving along the path: each step thin, their mean thick; the set force "
            "dashed, and the bound of the overshoot.",
        ),
        f"<section><h2>How it was made</h2>{made_by(asdict(options))}</section>",
    ]
    write_whole(file, page(title, "\n".join(body)))


def picture_of(options: Options, curves: dict[float, dict[str, np.ndarray]]) -> Figure:
    """Figure of the responses, one panel for each stiffness; `curves` as in `write_report`."""
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
        limit = options.high + OVERSHOOT * (options.high - options.low)
        axes.axhline(limit, color=VERMILION, linewidth=0.9, linestyle="--")
        axes.set_title(f"{stiffness:.3g} N/m", fontsize=10)
        axes.set_xlabel("time from the step [s]")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
        axes.tick_params(labelsize=9)
    all_axes[0].set_ylabel("normal force [N]")
    return figure


if __name__ == "__main__":
    run_scenario(main)

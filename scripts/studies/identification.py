"""Study: errors, decisions and computing time of identification over random scenes of each object and sensor.

A pose counts as found if its centre is within 1 % of the range and its attitude within 5 deg, modulo the object's
declared symmetry. Errors are over all scenes, found or not, accepted or not. Times are processor times of all threads.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.table import Table

from models.objects import targets
from perception.registration.fine_fit import ModelSurface
from perception.registration.identification import identify
from scenarios.campaigns.pool import run_all
from scenarios.object_scenes import SENSORS, object_scene, target_of
from scenarios.start import new_folder, parse, run_scenario
from sim.interfaces.errors import ConfigurationError
from sim.runs.saving import write_whole

FOUND = (0.01, 5.0)  # share of the range, [deg]: bounds of a found pose


@dataclass
class Options:
    """Random scenes for identification."""

    objects: tuple[str, ...] = targets.available()
    """Names of objects."""
    sensors: tuple[str, ...] = tuple(SENSORS)
    """Names of sensors."""
    scenes: int = 50
    """Number of scenes of each object and sensor."""
    first_seed: int = 0
    """Seed of the first scene; the others follow."""
    start: Literal["coarse", "place", "any"] = "coarse"
    """Prior knowledge: position and attitude within --start-error (coarse), position only (place), or none (any)."""
    start_error: tuple[float, float] = (0.3, 45.0)
    """Largest error of the coarse start [m], [deg]."""
    ranges: tuple[float, float] = (1.0, 2.0)
    """Distance from camera to object [m]."""
    gap: tuple[float, float] = (0.05, 0.4)
    """Distance from the object down to the seabed [m]; 0 0: it lies on it."""
    workers: int = 1
    """Processes at a time."""
    out: Path | None = None
    """Folder of scenes.json, figures.json and errors.png."""


@dataclass(frozen=True)
class SceneTask:
    """One scene for one sensor; a picklable value for a worker process."""

    name: str
    sensor: str
    seed: int
    options: Options


@cache
def surface_of(name: str) -> ModelSurface:
    """Surface model of the object `name`."""
    return ModelSurface.of(target_of(name))


def run(task: SceneTask) -> dict[str, Any]:
    """Row of one scene: errors, decision and computing time of identification."""
    options = task.options
    start_error = (options.start_error[0], float(np.deg2rad(options.start_error[1])))
    scene = object_scene(
        task.name, task.seed, task.sensor, ranges=options.ranges, start_error=start_error, gap=options.gap
    )
    scan, surface = scene.scan, surface_of(task.name)
    began = process_time()
    found = identify(
        scan,
        surface,
        scene.approach if options.start != "any" else None,
        scene.orientation if options.start == "coarse" else None,
        sensor=scene.sensor.model,
    )
    spent = process_time() - began
    position, angle = scene.error(found.X_sensor_target)
    return {
        "object": task.name,
        "sensor": task.sensor,
        "seed": task.seed,
        "range_m": scene.range_m,
        "position_m": position,
        "angle_deg": float(np.rad2deg(angle)),
        "found": bool(position < FOUND[0] * scene.range_m and np.rad2deg(angle) < FOUND[1]),
        "accepted": bool(found.accepted),
        "reason": found.reason,
        "margin": float(min(found.margin, 9.0)),
        "process_s": spent,
    }


def died(task: SceneTask) -> dict[str, Any]:
    """Raises ConfigurationError for a scene that crashed its process."""
    raise ConfigurationError(f"the process of {task.name}, seed {task.seed}, died")


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Figures over the scenes of one object and sensor."""

    def of(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows], dtype=np.float64)

    position, angle = 1e3 * of("position_m"), of("angle_deg")
    found, accepted = of("found"), of("accepted")
    return {
        "scenes": len(rows),
        "found_percent": 100.0 * found.mean(),
        "accepted_percent": 100.0 * accepted.mean(),
        "accepted_wrong": float(np.sum(accepted * (1.0 - found))),
        "median_mm": float(np.median(position)),
        "median_mm_per_m": float(np.median(position / of("range_m"))),
        "p95_mm": float(np.quantile(position, 0.95)),
        "p95_percent_of_range": float(np.quantile(0.1 * position / of("range_m"), 0.95)),
        "median_deg": float(np.median(angle)),
        "p95_deg": float(np.quantile(angle, 0.95)),
        "process_ms": 1e3 * float(np.median(of("process_s"))),
        "process_p95_ms": 1e3 * float(np.quantile(of("process_s"), 0.95)),
    }


def table_of(figures: dict[str, dict[str, float]], title: str) -> Table:
    """Table of the figures by object and sensor."""
    table = Table(title=title)
    for column in (
        "object, sensor",
        "scenes",
        "found [%]",
        "accepted [%]",
        "accepted, not found",
        "position: median, p95 [mm]",
        "p95 [% of range]",
        "angle: median, p95 [deg]",
        "process time: median, p95 [ms]",
    ):
        table.add_column(column, justify="left" if column.startswith("object") else "right")
    for name, f in figures.items():
        table.add_row(
            name,
            f"{f['scenes']:.0f}",
            f"{f['found_percent']:.0f}",
            f"{f['accepted_percent']:.0f}",
            f"{f['accepted_wrong']:.0f}",
            f"{f['median_mm']:.2f}, {f['p95_mm']:.2f}",
            f"{f['p95_percent_of_range']:.2f}",
            f"{f['median_deg']:.2f}, {f['p95_deg']:.2f}",
            f"{f['process_ms']:.0f}, {f['process_p95_ms']:.0f}",
        )
    return table


def picture(rows: Sequence[dict[str, Any]], file: Path) -> None:
    """Plots the errors of all scenes over the range into `file`, one column for each object."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(row["object"] for row in rows))
    sensors = list(dict.fromkeys(row["sensor"] for row in rows))
    figure, panels = plt.subplots(
        2, len(names), figsize=(3.2 * len(names), 5.5), sharex=True, sharey="row", squeeze=False
    )
    for column, name in enumerate(names):
        for sensor in sensors:
            part = [row for row in rows if row["object"] == name and row["sensor"] == sensor]
            x = [row["range_m"] for row in part]
            panels[0, column].semilogy(x, [1e3 * row["position_m"] for row in part], ".", label=sensor)
            panels[1, column].semilogy(x, [max(row["angle_deg"], 1e-3) for row in part], ".")
        panels[0, column].set_title(name)
        panels[1, column].set_xlabel("range [m]")
    limit = np.array([min(row["range_m"] for row in rows), max(row["range_m"] for row in rows)])
    for panel in panels[0]:
        panel.semilogy(limit, 5.0 * limit, "k--", linewidth=0.8, label="0.5 % of range")
        panel.grid(alpha=0.3)
    for panel in panels[1]:
        panel.axhline(0.5, color="k", linestyle="--", linewidth=0.8)
        panel.grid(alpha=0.3)
    panels[0, 0].set_ylabel("position error [mm]")
    panels[1, 0].set_ylabel("angle error [deg]")
    panels[0, 0].legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(file, dpi=110)
    plt.close(figure)


def main() -> int:
    """Runs the study, writes its files and returns the exit code."""
    options = parse(Options)
    if options.scenes < 1 or options.workers < 1:
        raise ConfigurationError("--scenes and --workers must be at least 1")
    for name in options.objects:
        target_of(name)
    folder = new_folder("study_identification", options.out, options.first_seed)
    console = Console(width=150)
    tasks = [
        SceneTask(name, sensor, options.first_seed + k, options)
        for name in options.objects
        for sensor in options.sensors
        for k in range(options.scenes)
    ]
    results = run_all(tasks, options.workers, run, died) if options.workers > 1 else ((t, run(t)) for t in tasks)
    rows = []
    for _, row in results:
        rows.append(row)
        if not row["found"] or not row["accepted"]:
            console.print(
                f"{row['object']}, {row['sensor']}, seed {row['seed']}: {1e3 * row['position_m']:.1f} mm,"
                f" {row['angle_deg']:.1f} deg, {'accepted' if row['accepted'] else row['reason']}",
                highlight=False,
            )
    rows.sort(key=lambda row: (row["object"], row["sensor"], row["seed"]))
    figures = {
        f"{name}, {sensor}": summary([row for row in rows if row["object"] == name and row["sensor"] == sensor])
        for name in options.objects
        for sensor in options.sensors
    }
    known = {
        "coarse": f"start within {options.start_error[0]} m, {options.start_error[1]:.0f} deg",
        "place": f"place within {options.start_error[0]} m, any attitude",
        "any": "nothing known beforehand",
    }[options.start]
    low, high = options.ranges
    console.print(table_of(figures, f"{low} to {high} m, {known}"))
    settings = {name: value for name, value in asdict(options).items() if name not in ("out", "workers")}
    write_whole(folder / "scenes.json", json.dumps(rows, indent=1))
    write_whole(folder / "figures.json", json.dumps({"options": settings, "figures": figures}, indent=1))
    picture(rows, folder / "errors.png")
    console.print(f"in {folder}: scenes.json, figures.json, errors.png", highlight=False)
    return 0


if __name__ == "__main__":
    run_scenario(main)

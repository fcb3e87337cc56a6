"""Identification over random scenes: errors, decision and time of one, and figures over many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from time import process_time
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from uuv.clouds.object_scenes import object_scene, target_of
from uuv.experiment import Row, Summary, Table
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Start:
    """Prior knowledge of the object, and where it lies."""

    known: Literal["coarse", "place", "any"]  # position and attitude, position only, or nothing
    error: tuple[float, float]  # largest error of the coarse start [m], [deg]
    ranges: tuple[float, float]  # [m] from camera to object
    gap: tuple[float, float]  # [m] from the object down to the seabed; 0 0: it lies on it

    def __str__(self) -> str:
        known = {
            "coarse": f"start within {self.error[0]} m, {self.error[1]:.0f} deg",
            "place": f"place within {self.error[0]} m, any attitude",
            "any": "nothing known beforehand",
        }[self.known]
        return f"{self.ranges[0]} to {self.ranges[1]} m, {known}"


@dataclass(frozen=True)
class SceneCase:
    """One scene for one sensor; a case of the study."""

    name: str
    sensor: str
    seed: int
    start: Start


@cache
def surface_of(name: str) -> ModelSurface:
    """Surface model of the object `name`."""
    return ModelSurface.of(target_of(name))


def run(task: SceneCase) -> dict[str, Any]:
    """Row of one scene: errors, decision and computing time of identification."""
    start = task.start
    start_error = (start.error[0], float(np.deg2rad(start.error[1])))

    scene = object_scene(
        task.name,
        task.seed,
        task.sensor,
        ranges=start.ranges,
        start_error=start_error,
        gap=start.gap,
    )

    scan, surface = scene.scan, surface_of(task.name)
    began = process_time()
    found = identify(
        scan,
        surface,
        scene.approach if start.known != "any" else None,
        scene.orientation if start.known == "coarse" else None,
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
        "found": scene.is_found(found.X_sensor_target),
        "accepted": bool(found.accepted),
        "reason": found.reason,
        "margin": float(min(found.margin, 9.0)),
        "process_s": spent,
    }


def line(row: Row) -> str:
    """Line about a scene whose object was not found or not accepted; empty for others."""
    if row["found"] and row["accepted"]:
        return ""

    return (
        f"{row['object']}, {row['sensor']}, seed {row['seed']}: {1e3 * row['position_m']:.1f} mm, "
        f"{row['angle_deg']:.1f} deg, {'accepted' if row['accepted'] else row['reason']}"
    )


def summarise(rows: list[Row], title: str) -> Summary:
    """Figures by object and sensor.

    Args:
        rows: Rows of all scenes.
        title: Title of the table.
    """
    pairs = dict.fromkeys((row["object"], row["sensor"]) for row in rows)
    rows = sorted(rows, key=lambda row: (row["object"], row["sensor"], row["seed"]))

    figures = {
        f"{name}, {sensor}": figures_of(
            [row for row in rows if (row["object"], row["sensor"]) == (name, sensor)]
        )
        for name, sensor in pairs
    }

    return Summary(
        metrics={"figures": figures}, tables=[table_of(figures, title)], pictures=_pictures(rows)
    )


def _pictures(rows: Sequence[Row]) -> Iterator[tuple[str, str, "Figure"]]:
    yield (
        "Errors",
        "Position and attitude of every scene over its range; dashed: 0.5 % of the range, 0.5 deg.",
        picture(rows),
    )


def figures_of(rows: Sequence[Row]) -> dict[str, float]:
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
    columns = (
        "object, sensor",
        "scenes",
        "found [%]",
        "accepted [%]",
        "accepted, not found",
        "position: median, p95 [mm]",
        "p95 [% of range]",
        "angle: median, p95 [deg]",
        "process time: median, p95 [ms]",
    )

    rows = [
        (
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
        for name, f in figures.items()
    ]

    return Table(title=title, columns=columns, rows=rows)


def picture(rows: Sequence[Row]) -> "Figure":
    """Plots the errors of all scenes over the range, one column for each object."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row["object"] for row in rows))
    sensors = list(dict.fromkeys(row["sensor"] for row in rows))

    figure = Figure(figsize=(3.2 * len(names), 5.5), layout="tight")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False)

    for column, name in enumerate(names):
        for sensor in sensors:
            part = [row for row in rows if row["object"] == name and row["sensor"] == sensor]
            x = [row["range_m"] for row in part]
            panels[0, column].semilogy(
                x, [1e3 * row["position_m"] for row in part], ".", label=sensor
            )
            panels[1, column].semilogy(x, [max(row["angle_deg"], 1e-3) for row in part], ".")

        panels[0, column].set_title(name)
        panels[1, column].set_xlabel("range [m]")

    # Bounds to compare with.
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
    return figure

"""Errors, decisions and computing time of identification over random scenes of each object and
sensor.

A pose counts as found if its centre is within 1 % of the range and its attitude within 5 deg,
modulo the object's declared symmetry. Errors are over all scenes, found or not, accepted or not.
Times are processor times of all threads, comparable with --workers 1 only.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from experiments.identification.scene_cases import (
    SceneCase,
    conditions,
    identified,
    surface_of,
    timed,
)
from uuv.clouds.frames import SENSORS
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.objects import targets

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class PoseRow:
    """Errors, decision and computing time of one identification."""

    range: float = column("range", "m")
    position: float = column("position", "mm", digits=2, factor=1e3)
    angle: float = column("angle", "deg", digits=2, factor=degrees(1.0))
    found: bool = column("found")
    accepted: bool = column("accepted")
    reason: str = column("reason")
    margin: float = column("margin of the likelihood", "nat")
    time: float = column("processor time", "ms", digits=0, factor=1e3, tolerance=None)


@experiment(
    "identification",
    seeds=50,
    vary={"object": targets.available(), "sensor": tuple(SENSORS)},
    paired=True,
    quick={"runs": 1, "object": ("barrel", "manifold", "valve")},
)
def identification(case: SceneCase) -> PoseRow:
    """Identifies the object of a scene."""
    scene = case.scene()
    surface = surface_of(case.object)
    time, verdict = timed(lambda: identified(scene, surface, case.start))

    position, angle = scene.error(verdict.X_sensor_target)
    return PoseRow(
        range=scene.range_m,
        position=position,
        angle=angle,
        found=scene.is_found(verdict.X_sensor_target),
        accepted=bool(verdict.accepted),
        reason=verdict.reason,
        margin=float(min(verdict.margin, 9.0)),
        time=time,
    )


def line(row: Row) -> str:
    """Line about a scene whose object was not found or not accepted; empty for others."""
    if row["found"] and row["accepted"]:
        return ""
    return (
        f"{row['object']}, {row['sensor']}, seed {row['seed']}: {1e3 * row['position']:.1f} mm, "
        f"{degrees(row['angle']):.1f} deg, {'accepted' if row['accepted'] else row['reason']}"
    )


def errors_over_range(rows: list[Row]) -> "tuple[str, str, Figure]":
    """Picture of the errors of all scenes over the range, one column for each object."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row["object"] for row in rows))
    sensors = list(dict.fromkeys(row["sensor"] for row in rows))
    figure = Figure(figsize=(3.2 * len(names), 5.5), layout="tight")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False)

    for above, below, name in zip(*panels, names, strict=True):
        for sensor in sensors:
            part = [row for row in rows if row["object"] == name and row["sensor"] == sensor]
            x = [row["range"] for row in part]
            above.semilogy(x, [1e3 * row["position"] for row in part], ".", label=sensor)
            below.semilogy(x, [max(degrees(row["angle"]), 1e-3) for row in part], ".")
        above.set_title(name)
        below.set_xlabel("range [m]")

    # Bounds to compare with.
    limit = np.array([min(row["range"] for row in rows), max(row["range"] for row in rows)])
    for above, below in panels.T:
        above.semilogy(limit, 5.0 * limit, "k--", linewidth=0.8, label="0.5 % of range")
        below.axhline(0.5, color="k", linestyle="--", linewidth=0.8)
        above.grid(alpha=0.3)
        below.grid(alpha=0.3)

    panels[0, 0].set_ylabel("position error [mm]")
    panels[1, 0].set_ylabel("angle error [deg]")
    panels[0, 0].legend(fontsize="small")
    caption = "Position and attitude of every scene; dashed: 0.5 % of the range, 0.5 deg."
    return "Errors over the range", caption, figure


FIGURES = [
    stat("share", "found", digits=0),
    stat("share", "accepted", digits=0),
    stat("count", lambda row: row["accepted"] and not row["found"], "accepted, not found"),
    stat("median", "position"),
    stat("p95", "position"),
    stat(
        "p95",
        lambda row: 100.0 * row["position"] / row["range"],
        "position, 95 %",
        unit="% of range",
        digits=2,
    ),
    stat("median", "angle"),
    stat("p95", "angle"),
    stat("median", "time"),
    stat("p95", "time"),
]
identification.line = line
identification.page = (
    Page()
    .add(conditions)
    .table("Poses by sensor", by="sensor", columns=FIGURES)
    .table("Poses by object and sensor", by=("object", "sensor"), columns=FIGURES)
    .add(errors_over_range)
)

if __name__ == "__main__":
    run_scenario(identification.main)

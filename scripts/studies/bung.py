"""Study: how well a bung in a barrel's shell determines the barrel's rotation about its axis, over random scenes.

The bung lies anywhere around the barrel. "Seen": the camera sees the middle of the bung's face. "Hidden": it sees
nothing of the bung. Otherwise it sees a part. Identification either determines the rotation or reports it as unknown. A
rotation determined with an error over 2 deg is a failure.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from models.objects.barrel import BARREL_DIAMETER, BUNG, barrel
from perception.registration.fine_fit import ModelSurface
from perception.registration.identification import identify
from scenarios.campaigns.pool import run_all
from scenarios.object_scenes import CAMERAS, ObjectScene, object_scene
from scenarios.start import new_folder, parse, run_scenario
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import exp_so3
from sim.runs.saving import write_whole

PLACES = 16  # positions of the bung around the barrel
WRONG = 2.0  # [deg] error of the rotation that counts as a failure


@dataclass
class Options:
    """Scenes of a barrel with a bung."""

    scenes: int = 100
    """Number of scenes of each sensor."""
    sensors: tuple[str, ...] = CAMERAS
    """Names of sensors."""
    first_seed: int = 0
    """Seed of the first scene; the others follow."""
    workers: int = 1
    """Processes at a time."""
    out: Path | None = None
    """Folder of scenes.json."""


@dataclass(frozen=True)
class BungTask:
    """One scene for one sensor; a picklable value for a worker process."""

    sensor: str
    seed: int


@cache
def surface_of(place: int) -> ModelSurface:
    """Surface model of the barrel with the bung at position `place`, of PLACES."""
    return ModelSurface.of(barrel(bung_azimuth=2.0 * np.pi * place / PLACES))


def run(task: BungTask) -> dict[str, Any]:
    """Row of one scene: rotation and its error, and the visibility of the bung."""
    place = int(np.random.default_rng([task.seed, 23]).integers(PLACES))
    surface = surface_of(place)
    scene = object_scene(surface.target, task.seed, task.sensor)
    found = identify(scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model)
    position, axis = scene.error(found.X_sensor_target)
    cosine = 0.5 * (np.trace(found.X_sensor_target[:3, :3].T @ scene.X_CT[:3, :3]) - 1.0)
    return {
        "sensor": task.sensor,
        "seed": task.seed,
        "range_m": scene.range_m,
        "bung": bung_in_view(scene, surface, place),
        "told": found.symmetry.angle_known,
        "turn_deg": float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))),
        "axis_deg": float(np.rad2deg(axis)),
        "position_m": position,
        "accepted": found.accepted,
    }


def bung_in_view(scene: ObjectScene, surface: ModelSurface, place: int) -> str:
    """Visibility of the bung at the true pose, as far as the barrel itself hides it: "seen", "in part" or "hidden".

    Args:
        scene: The scene.
        surface: Surface model of its barrel.
        place: Position of the bung, of PLACES.
    """
    radius, height, x = BUNG
    points = (surface.points - [x, 0.0, 0.0]) @ exp_so3([2.0 * np.pi * place / PLACES, 0.0, 0.0])
    on_it = (np.hypot(points[:, 0], points[:, 1]) < 1.01 * radius) & (points[:, 2] > 0.5 * BARREL_DIAMETER)
    middle = on_it & (np.hypot(points[:, 0], points[:, 1]) < 0.3 * radius)
    middle &= points[:, 2] > 0.5 * BARREL_DIAMETER + 0.9 * height
    visible = surface.visible(scene.X_CT, scene.scan, scene.sensor.model.max_incidence)
    if visible[middle].mean() > 0.5:
        return "seen"
    return "in part" if visible[on_it].any() else "hidden"


def died(task: BungTask) -> dict[str, Any]:
    """Raises ConfigurationError for a scene that crashed its process."""
    raise ConfigurationError(f"the process of {task} died")


def table_of(rows: Sequence[dict[str, Any]]) -> Table:
    """Table of the rows by sensor and visibility of the bung."""
    table = Table(
        "sensor",
        "bung",
        "scenes",
        "told",
        f"told, over {WRONG:.0f} deg wrong",
        "turn: median, worst [deg]",
        "axis: median, p95 [deg]",
    )
    for sensor, bung in dict.fromkeys((row["sensor"], row["bung"]) for row in rows):
        of = [row for row in rows if (row["sensor"], row["bung"]) == (sensor, bung)]
        turns = [row["turn_deg"] for row in of if row["told"]]
        axes = [row["axis_deg"] for row in of]
        table.add_row(
            sensor,
            bung,
            str(len(of)),
            str(len(turns)),
            str(sum(turn > WRONG for turn in turns)),
            f"{np.median(turns):.2f}, {max(turns):.2f}" if turns else "-",
            f"{np.median(axes):.3f}, {np.quantile(axes, 0.95):.3f}",
        )
    return table


def main() -> None:
    """Runs the study, prints its table and writes scenes.json."""
    options = parse(Options)
    if options.scenes < 1:
        raise ConfigurationError(f"--scenes: must be >= 1, got {options.scenes}")
    folder = new_folder("study_bung", options.out, options.first_seed)
    tasks = [BungTask(sensor, options.first_seed + k) for sensor in options.sensors for k in range(options.scenes)]
    rows = [row for _, row in run_all(tasks, options.workers, run, died)]
    rows.sort(key=lambda row: (row["sensor"], row["bung"], row["seed"]))
    console = Console()
    console.print(table_of(rows))
    for row in rows:
        if row["told"] and row["turn_deg"] > WRONG:
            console.print("told wrong:", row, highlight=False)
    write_whole(folder / "scenes.json", json.dumps(rows, indent=1))


if __name__ == "__main__":
    run_scenario(main)

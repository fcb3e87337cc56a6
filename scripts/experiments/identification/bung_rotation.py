"""Rotation of a barrel about its axis, resolved by a bung in its shell: one random scene, and the
summary of many.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from uuv.clouds.frames import ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.experiment import Row, Summary, Table
from uuv.models.objects.barrel import BARREL_DIAMETER, BUNG, barrel
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import exp_so3

PLACES = 16  # positions of the bung around the barrel
WRONG = 2.0  # [deg] error of the rotation that counts as a failure


@dataclass(frozen=True)
class BungCase:
    """One scene for one sensor; a case of the study."""

    sensor: str
    seed: int


@cache
def surface_of(place: int) -> ModelSurface:
    """Surface model of the barrel with the bung at position `place`, of PLACES."""
    return ModelSurface.of(barrel(bung_azimuth=2.0 * np.pi * place / PLACES))


def run(task: BungCase) -> dict[str, Any]:
    """Row of one scene: rotation and its error, and the visibility of the bung."""
    place = int(np.random.default_rng([task.seed, 23]).integers(PLACES))
    surface = surface_of(place)
    scene = object_scene(surface.target, task.seed, task.sensor)
    found = identify(
        scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
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
    """Visibility of the bung at the true pose, as far as the barrel itself hides it: "seen", "in
    part" or "hidden".

    Args:
        scene: The scene.
        surface: Surface model of its barrel.
        place: Position of the bung, of PLACES.
    """
    # Points of the model in the axes of the bung's face, z outwards.
    radius, height, x = BUNG
    points = (surface.points - [x, 0.0, 0.0]) @ exp_so3([2.0 * np.pi * place / PLACES, 0.0, 0.0])
    on_it = (np.hypot(points[:, 0], points[:, 1]) < 1.01 * radius) & (
        points[:, 2] > 0.5 * BARREL_DIAMETER
    )

    # The face is the outer tenth of the bung's height.
    middle = on_it & (np.hypot(points[:, 0], points[:, 1]) < 0.3 * radius)
    middle &= points[:, 2] > 0.5 * BARREL_DIAMETER + 0.9 * height

    visible = surface.visible(scene.X_CT, scene.scan, scene.sensor.model.max_incidence)
    if visible[middle].mean() > 0.5:
        return "seen"
    return "in part" if visible[on_it].any() else "hidden"


def summarise(rows: list[Row]) -> Summary:
    """Table by sensor and visibility of the bung, and the rotations that were resolved wrongly."""
    rows.sort(key=lambda row: (row["sensor"], row["bung"], row["seed"]))
    wrong = [row for row in rows if row["told"] and row["turn_deg"] > WRONG]

    return Summary(
        metrics={
            "scenes": len(rows),
            "told": sum(row["told"] for row in rows),
            "told_wrong": len(wrong),
        },
        tables=[table_of(rows)],
        lines=[f"told wrong: {row}" for row in wrong],
    )


def table_of(rows: Sequence[Row]) -> Table:
    """Table of the rows by sensor and visibility of the bung."""
    # Errors of the rotation count only where identification determined it.
    cells = []
    for sensor, bung in dict.fromkeys((row["sensor"], row["bung"]) for row in rows):
        of = [row for row in rows if (row["sensor"], row["bung"]) == (sensor, bung)]
        turns = [row["turn_deg"] for row in of if row["told"]]
        axes = [row["axis_deg"] for row in of]

        cells.append(
            (
                sensor,
                bung,
                str(len(of)),
                str(len(turns)),
                str(sum(turn > WRONG for turn in turns)),
                f"{np.median(turns):.2f}, {max(turns):.2f}" if turns else "-",
                f"{np.median(axes):.3f}, {np.quantile(axes, 0.95):.3f}",
            )
        )

    return Table(
        title="Rotation resolved by a bung",
        columns=(
            "sensor",
            "bung",
            "scenes",
            "told",
            f"told, over {WRONG:.0f} deg wrong",
            "turn: median, worst [deg]",
            "axis: median, p95 [deg]",
        ),
        rows=cells,
        labels=2,
    )

"""How well a bung in a barrel's shell determines the barrel's rotation about its axis, over random
scenes.

The bung lies anywhere around the barrel. "Seen": the camera sees the middle of the bung's face.
"Hidden": it sees nothing of the bung. Otherwise it sees a part. Identification either determines
the rotation or reports it as unknown. A rotation determined with an error over 2 deg is a failure.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import degrees, radians
from typing import Any

import numpy as np

from experiments.identification.scene_cases import identified
from uuv.clouds.frames import CAMERAS, ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.objects.barrel import BARREL_DIAMETER, BUNG, barrel
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import exp_so3

PLACES = 16  # positions of the bung around the barrel
WRONG = radians(2.0)  # [rad] error of the rotation that counts as a failure


@dataclass(frozen=True, kw_only=True)
class BungCase:
    """One scene for one sensor."""

    sensor: str
    """Name of the sensor."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class BungRow:
    """The rotation and its error, and what is visible of the bung."""

    range: float = column("range", "m")
    bung: str = column("bung")  # seen, in part or hidden
    turn: float | None = column("rotation", "deg", digits=2, factor=degrees(1.0))  # if determined
    axis: float = column("axis", "deg", digits=3, factor=degrees(1.0))
    position: float = column("position", "mm", digits=2, factor=1e3)
    accepted: bool = column("accepted")


@experiment("bung", seeds=100, vary={"sensor": CAMERAS}, paired=True, quick={"runs": 5})
def bung(case: BungCase) -> BungRow:
    """Identifies a barrel with a bung."""
    place = int(np.random.default_rng([case.seed, 23]).integers(PLACES))
    surface = surface_with_bung(place)
    scene = object_scene(surface.target, case.seed, case.sensor)
    verdict = identified(scene, surface)

    position, axis = scene.error(verdict.X_sensor_target)
    cosine = 0.5 * (np.trace(verdict.X_sensor_target[:3, :3].T @ scene.X_CT[:3, :3]) - 1.0)
    turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return BungRow(
        range=scene.range_m,
        bung=bung_in_view(scene, surface, place),
        turn=turn if verdict.symmetry.angle_known else None,
        axis=axis,
        position=position,
        accepted=verdict.accepted,
    )


@cache
def surface_with_bung(place: int) -> ModelSurface:
    """Surface model of the barrel with the bung at position `place`, of PLACES."""
    return ModelSurface.of(barrel(bung_azimuth=2.0 * np.pi * place / PLACES))


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


def is_wrong(row: Mapping[str, Any]) -> bool:
    """Whether a rotation was determined, and wrongly."""
    return row["turn"] is not None and row["turn"] > WRONG


def wrong_scenes(rows: list[Row]) -> list[str]:
    """Lines about the rotations that were determined wrongly."""
    return [
        f"determined wrongly: {row['sensor']}, seed {row['seed']}, bung {row['bung']}, "
        f"{degrees(row['turn']):.1f} deg"
        for row in rows
        if is_wrong(row)
    ]


bung.page = (
    Page()
    .table(
        "Rotation of a barrel by its bung",
        by=("sensor", "bung"),
        columns=[
            stat("share", lambda row: row["turn"] is not None, "determined", digits=0),
            stat("count", is_wrong, f"determined, over {degrees(WRONG):.0f} deg wrong"),
            stat("median", "turn"),
            stat("largest", "turn"),
            stat("median", "axis"),
            stat("p95", "axis"),
        ],
        total=True,
    )
    .add(wrong_scenes)
)

if __name__ == "__main__":
    run_scenario(bung.main)

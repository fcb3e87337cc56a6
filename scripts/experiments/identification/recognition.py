"""Recognition over random scenes: which of several objects was named, and figures over many."""

from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

from experiments.identification.pose_errors import Start, surface_of
from uuv.clouds.object_scenes import object_scene
from uuv.experiment import Row, Summary, Table
from uuv.perception.registration.recognition import recognise


@dataclass(frozen=True)
class RecognitionCase:
    """One scene for one sensor, and the objects that come into question; a case of the study."""

    name: str
    among: tuple[str, ...]
    sensor: str
    seed: int
    start: Start


def run(task: RecognitionCase) -> dict[str, Any]:
    """Row of one scene: which object was named, where, and how clearly."""
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

    surfaces = {name: surface_of(name) for name in task.among}
    began = process_time()
    made = recognise(
        scene.scan,
        surfaces,
        scene.approach if start.known != "any" else None,
        scene.orientation if start.known == "coarse" else None,
        sensor=scene.sensor.model,
    )
    spent = process_time() - began

    # The right object in the wrong place is not found.
    found = made.candidates[0].name == task.name and scene.is_found(made.found.X_sensor_target)

    return {
        "object": task.name,
        "sensor": task.sensor,
        "seed": task.seed,
        "named": made.name or "",
        "likeliest": made.candidates[0].name,
        "runner_up": made.candidates[1].name if len(made.candidates) > 1 else "",
        "right": made.name == task.name,
        "wrong": made.accepted and made.name != task.name,
        "found": bool(found),
        "reason": made.reason,
        "margin": float(min(made.margin, 1e4)),
        "process_s": spent,
    }


def line(row: Row) -> str:
    """Line about a scene whose object was not named; empty for others."""
    if row["right"] and row["found"]:
        return ""

    said = f"named {row['named']}" if row["named"] else row["reason"]
    return (
        f"{row['object']}, {row['sensor']}, seed {row['seed']}: {said}, pose "
        f"{'right' if row['found'] else 'wrong'}"
    )


def summarise(rows: list[Row], title: str) -> Summary:
    """Figures by object, and over all.

    Args:
        rows: Rows of all scenes.
        title: Title of the table.
    """
    names = sorted({row["object"] for row in rows})
    figures = {name: figures_of([row for row in rows if row["object"] == name]) for name in names}
    figures["all"] = figures_of(rows)

    columns = (
        "object",
        "scenes",
        "named rightly [%]",
        "named wrongly",
        "likeliest rightly [%]",
        "margin: least, median [nat]",
        "process time, median [s]",
    )

    table = [
        (
            name,
            f"{f['scenes']:.0f}",
            f"{f['right_percent']:.1f}",
            f"{f['wrong']:.0f}",
            f"{f['likeliest_percent']:.1f}",
            f"{f['margin_least']:.0f}, {f['margin_median']:.0f}",
            f"{f['process_s']:.1f}",
        )
        for name, f in figures.items()
    ]

    return Summary(
        metrics={"figures": figures},
        tables=[Table(title=title, columns=columns, rows=table)],
        pictures=[],
    )


def figures_of(rows: list[Row]) -> dict[str, float]:
    """Figures over some scenes."""
    return {
        "scenes": len(rows),
        "right_percent": 100.0 * float(np.mean([row["right"] and row["found"] for row in rows])),
        "wrong": float(np.sum([row["wrong"] for row in rows])),
        "likeliest_percent": 100.0
        * float(np.mean([row["likeliest"] == row["object"] for row in rows])),
        "margin_least": float(np.min([row["margin"] for row in rows])),
        "margin_median": float(np.median([row["margin"] for row in rows])),
        "process_s": float(np.median([row["process_s"] for row in rows])),
    }

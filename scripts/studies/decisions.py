"""Study: rates of false accepts, false refusals and rescans of PoseCheck over scenes of known truth.

Right scenes show the object clean, partly hidden, or fouled. Wrong ones show another object, none, or less than 30 % of
it. Besides, poses that are wrong by 3 cm, by 10 deg and, on a starfish of uneven arms, by 72 deg are checked on the
evidence of the right scenes.

A pose counts as found if its centre is within 1 % of the range and its attitude within 5 deg, modulo declared symmetry.
A false accept is an accepted pose that is not found, or any accepted pose where the object is absent. A found pose that
is refused is a false refusal; rescans of found poses are counted separately.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from perception.registration.fine_fit import ModelSurface
from perception.registration.identification import identify
from perception.registration.pose_check import Decision, check
from perception.registration.projection import published_criterion
from scenarios.campaigns.pool import run_all
from scenarios.decision_scenes import KINDS, NAMES, draw, object_of, wrong_poses
from scenarios.object_scenes import CAMERAS
from scenarios.start import new_folder, parse, run_scenario
from sim.interfaces.errors import ConfigurationError
from sim.runs.saving import write_whole

FOUND = (0.01, 5.0)  # share of the range, [deg]: bounds of a found pose
_COLOURS = {Decision.ACCEPT: "C2", Decision.RESCAN: "C1", Decision.REFUSE: "C3"}


@dataclass
class Options:
    """Scenes to decide on, spread evenly over kinds, objects and sensors."""

    scenes: int = 500
    """Number of scenes; poses forced wrong are added."""
    objects: tuple[str, ...] = NAMES
    """Names of objects."""
    sensors: tuple[str, ...] = CAMERAS
    """Names of sensors."""
    first_seed: int = 0
    """Seed of the first scene; the others follow."""
    workers: int = 1
    """Processes at a time."""
    out: Path | None = None
    """Folder of decisions.json and decisions.png."""


@dataclass(frozen=True)
class DecisionTask:
    """One scene for one sensor; a picklable value for a worker process."""

    name: str
    kind: str
    sensor: str
    seed: int


@cache
def surface_of(name: str) -> ModelSurface:
    """Surface model of the object `name`."""
    return ModelSurface.of(object_of(name))


def run(task: DecisionTask) -> list[dict[str, Any]]:
    """Rows of one scene: the decision on the identified pose, and on the poses that are forced wrong."""
    drawn, surface = draw(task.name, task.kind, task.seed, task.sensor), surface_of(task.name)
    scene = drawn.scene
    found = identify(scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model)
    position, angle = scene.error(found.X_sensor_target)
    there = task.kind not in ("other", "absent")
    rows = [
        {
            "object": task.name,
            "kind": task.kind,
            "sensor": task.sensor,
            "seed": task.seed,
            "decision": str(found.decision),
            "right": bool(there and position < FOUND[0] * scene.range_m and np.rad2deg(angle) < FOUND[1]),
            "position_m": position,
            "angle_deg": float(np.rad2deg(angle)),
            "hidden": drawn.hidden,
            "q_m": None
            if found.evidence is None
            else published_criterion(found.evidence, surface, found.X_sensor_target).q_m,
            "reason": found.reason,
        }
    ]
    if KINDS[task.kind] and found.evidence is not None:
        for name, X in wrong_poses(scene.X_CT, surface.target, np.random.default_rng([task.seed, 19])).items():
            verdict = check(found.evidence, surface, X)
            q_m = published_criterion(found.evidence, surface, X).q_m
            wrong = {"kind": name, "decision": str(verdict.decision), "right": False, "q_m": q_m}
            rows.append({**rows[0], **wrong, "reason": verdict.reason})
    return rows


def died(task: DecisionTask) -> list[dict[str, Any]]:
    """Raises ConfigurationError for a scene that crashed its process."""
    raise ConfigurationError(f"the process of {task} died")


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """Counts of found and wrong poses by kind of scene and decision."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    table = {}
    for kind in kinds:
        of = [row for row in rows if row["kind"] == kind]
        right = [row for row in of if row["right"]]
        table[kind] = {
            "scenes": len(of),
            "found": len(right),
            **{f"found, {d}": sum(row["decision"] == d for row in right) for d in Decision},
            **{f"wrong, {d}": sum(row["decision"] == d and not row["right"] for row in of) for d in Decision},
        }
    return table


def rates(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Rates [%]: false accepts over all decisions and over wrong poses, false refusals and rescans over found poses."""
    right = [row for row in rows if row["right"] and KINDS.get(row["kind"], False)]
    accepts = sum(row["decision"] == Decision.ACCEPT and not row["right"] for row in rows)
    wrong = sum(not row["right"] for row in rows)
    return {
        "false accepts of all": 100.0 * accepts / len(rows),
        "false accepts of wrong poses": 100.0 * accepts / max(1, wrong),
        "false refusals": 100.0 * sum(row["decision"] == Decision.REFUSE for row in right) / max(1, len(right)),
        "found, rescan asked": 100.0 * sum(row["decision"] == Decision.RESCAN for row in right) / max(1, len(right)),
    }


def picture(table: dict[str, dict[str, int]], file: Path) -> None:
    """Bar chart of the decisions on found and on wrong poses, by kind of scene."""
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    for axes, of in zip(figure.subplots(1, 2, sharey=True), ("found", "wrong"), strict=True):
        left = np.zeros(len(table))
        for decision, colour in _COLOURS.items():
            count = np.array([row[f"{of}, {decision}"] for row in table.values()])
            axes.barh(list(table), count, left=left, color=colour, label=str(decision))
            left += count
        axes.set_title(f"pose {of}")
        axes.set_xlabel("decisions")
        axes.invert_yaxis()
    figure.axes[0].legend()
    figure.axes[0].invert_yaxis()
    figure.savefig(file, dpi=120)


def main() -> None:
    """Runs the study, prints its rates and writes its files."""
    options = parse(Options)
    if options.scenes < 1:
        raise ConfigurationError(f"--scenes: must be >= 1, got {options.scenes}")
    combined = [(kind, name, sensor) for sensor in options.sensors for name in options.objects for kind in KINDS]
    tasks = [
        DecisionTask(name, kind, sensor, options.first_seed + i)
        for i, (kind, name, sensor) in enumerate(islice(cycle(combined), options.scenes))
    ]
    folder = new_folder("study_decisions", options.out, options.first_seed)
    rows: list[dict[str, Any]] = []
    for _, part in run_all(tasks, options.workers, run, died):
        rows += part
    rows.sort(key=lambda row: row["seed"])
    table = summary(rows)
    console = Console()
    shown = Table("kind", *next(iter(table.values())))
    for kind, counts in table.items():
        shown.add_row(kind, *map(str, counts.values()))
    console.print(shown)
    console.print(rates(rows))
    for row in rows:
        if row["decision"] == Decision.ACCEPT and not row["right"]:
            console.print("false accept:", {k: row[k] for k in ("object", "kind", "sensor", "seed")}, highlight=False)
    write_whole(folder / "decisions.json", json.dumps({"rates": rates(rows), "table": table, "rows": rows}, indent=1))
    picture(table, folder / "decisions.png")


if __name__ == "__main__":
    run_scenario(main)

"""Decisions of PoseCheck on scenes of known truth: one scene, and the rates over many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from uuv.clouds.scene_kinds import KINDS, draw, object_of, wrong_poses
from uuv.experiment import Row, Summary, Table
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import Decision, check
from uuv.perception.registration.published.paper_check import published_criterion
from uuv.sim.interfaces.streams import Streams

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {Decision.ACCEPT: "C2", Decision.RESCAN: "C1", Decision.REFUSE: "C3"}


@dataclass(frozen=True)
class DecisionCase:
    """One scene for one sensor; a case of the study."""

    name: str
    kind: str
    sensor: str
    seed: int


@cache
def surface_of(name: str) -> ModelSurface:
    """Surface model of the object `name`."""
    return ModelSurface.of(object_of(name))


def run(task: DecisionCase) -> Row:
    """Decisions of one scene: on the identified pose, then on the poses that are forced wrong."""
    scene = draw(task.name, task.kind, task.seed, task.sensor)
    surface = surface_of(task.name)
    found = identify(
        scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    position, angle = scene.error(found.X_sensor_target)

    # Neither another object nor an empty place has a right pose.
    there = task.kind not in ("other", "absent")

    rows = [
        {
            "object": task.name,
            "kind": task.kind,
            "sensor": task.sensor,
            "seed": task.seed,
            "decision": str(found.decision),
            "right": there and scene.is_found(found.X_sensor_target),
            "position_m": position,
            "angle_deg": float(np.rad2deg(angle)),
            "hidden": scene.hidden,
            "q_m": None
            if found.evidence is None
            else published_criterion(found.evidence, surface, found.X_sensor_target).q_m,
            "reason": found.reason,
        }
    ]

    # The same evidence, with poses that are known to be wrong.
    if KINDS[task.kind] and found.evidence is not None:
        for name, X in wrong_poses(scene.X_CT, surface.target, Streams(task.seed)).items():
            verdict = check(found.evidence, surface, X)
            q_m = published_criterion(found.evidence, surface, X).q_m
            wrong = {"kind": name, "decision": str(verdict.decision), "right": False, "q_m": q_m}
            rows.append({**rows[0], **wrong, "reason": verdict.reason})

    return {"decisions": rows}


def summarise(scenes: list[Row]) -> Summary:
    """Rates, counts by kind of scene, and the false accepts."""
    rows = sorted(
        (row for scene in scenes for row in scene["decisions"]), key=lambda row: row["seed"]
    )
    table, found = counts_of(rows), rates(rows)
    false = [row for row in rows if row["decision"] == Decision.ACCEPT and not row["right"]]

    return Summary(
        metrics={"rates": found, "table": table},
        tables=[
            Table(
                title="Decisions by kind of scene",
                columns=("kind", *next(iter(table.values()))),
                rows=[(kind, *map(str, counts.values())) for kind, counts in table.items()],
            )
        ],
        lines=[
            ", ".join(f"{name} {value:.3g} %" for name, value in found.items()),
            *(
                f"false accept: { {k: row[k] for k in ('object', 'kind', 'sensor', 'seed')} }"
                for row in false
            ),
        ],
        pictures=_pictures(table),
    )


def _pictures(table: dict[str, dict[str, int]]) -> Iterator[tuple[str, str, "Figure"]]:
    yield "Decisions", "On found and on wrong poses, by kind of scene.", picture(table)


def counts_of(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
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
            **{
                f"wrong, {d}": sum(row["decision"] == d and not row["right"] for row in of)
                for d in Decision
            },
        }

    return table


def rates(rows: Sequence[Row]) -> dict[str, float]:
    """Rates [%]: false accepts over all and wrong poses; refusals and rescans over found poses."""
    right = [row for row in rows if row["right"] and KINDS.get(row["kind"], False)]
    accepts = sum(row["decision"] == Decision.ACCEPT and not row["right"] for row in rows)
    wrong = sum(not row["right"] for row in rows)

    return {
        "false accepts of all": 100.0 * accepts / len(rows),
        "false accepts of wrong poses": 100.0 * accepts / max(1, wrong),
        "false refusals": 100.0
        * sum(row["decision"] == Decision.REFUSE for row in right)
        / max(1, len(right)),
        "found, rescan asked": 100.0
        * sum(row["decision"] == Decision.RESCAN for row in right)
        / max(1, len(right)),
    }


def picture(table: dict[str, dict[str, int]]) -> "Figure":
    """Bar chart of the decisions on found and on wrong poses, by kind of scene."""
    from matplotlib.figure import Figure

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
    return figure

"""Rates of false accepts, false refusals and rescans of PoseCheck over scenes of known truth.

Right scenes show the object clean, partly hidden, or fouled. Wrong ones show another object, none,
or less than 30 % of it. Besides, poses that are wrong by 3 cm, by 10 deg and, on a starfish of
uneven arms, by 72 deg are checked on the evidence of the right scenes.

A pose counts as right if its centre is within 1 % of the range and its attitude within 5 deg,
modulo declared symmetry; where another object stands or none, no pose is right. A false accept is
an accepted pose that is not right, a false refusal a right pose that is refused; rescans of right
poses are counted separately. Refusals and rescans are those of scenes that show enough of the
object.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.identification.scene_cases import identified, surface_of
from uuv.clouds.frames import CAMERAS
from uuv.clouds.scene_kinds import KINDS, NAMES, draw, wrong_poses
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.statistic import Statistic
from uuv.perception.registration.pose_check import Decision, check
from uuv.perception.registration.published.paper_check import published_criterion
from uuv.sim.interfaces.streams import Streams

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = ("clean", "hidden", "fouled", "hidden_most", "other", "absent")  # kinds of scenes
_COLOURS = {Decision.ACCEPT: "C2", Decision.RESCAN: "C1", Decision.REFUSE: "C3"}


@dataclass(frozen=True, kw_only=True)
class DecisionCase:
    """One scene for one sensor."""

    sensor: str
    """Name of the sensor."""
    object: str
    """Name of the object."""
    kind: str
    """Kind of the scene."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class DecisionRow:
    """Decisions on the identified pose, whose key is the kind of the scene, and on poses that are
    wrong by a known amount.
    """

    position: float = column("position", "mm", digits=2, factor=1e3)
    angle: float = column("angle", "deg", digits=2, factor=degrees(1.0))
    hidden: float = column("hidden share of the object", "%", digits=0, factor=100.0)
    decision: Mapping[str, str] = column("decision", by="pose")
    right: Mapping[str, bool] = column("right", by="pose")
    reason: Mapping[str, str] = column("reason", by="pose")
    published: Mapping[str, float | None] = column(
        "published criterion", "mm", digits=2, factor=1e3, by="pose"
    )


@experiment(
    "decisions",
    seeds=500,
    vary={"sensor": CAMERAS, "object": NAMES, "kind": SHOWN},
    quick={"runs": 12},
)
def decisions(case: DecisionCase) -> DecisionRow:
    """Decides on the identified pose of a scene, then on the poses that are forced wrong."""
    scene = draw(case.object, case.kind, case.seed, case.sensor)
    surface = surface_of(case.object)
    outcome = identified(scene, surface)
    evidence, X_CT = outcome.evidence, outcome.X_sensor_target

    # Neither another object nor an empty place has a right pose.
    right = case.kind not in ("other", "absent") and scene.is_found(X_CT)
    poses = {case.kind: X_CT}
    verdicts = {case.kind: (str(outcome.decision), outcome.reason)}

    # The same evidence, with poses that are known to be wrong.
    if KINDS[case.kind] and evidence is not None:
        wrong = wrong_poses(scene.X_CT, surface.target, Streams(case.seed))
        checks = {name: check(evidence, surface, X) for name, X in wrong.items()}
        poses |= wrong
        verdicts |= {
            name: (str(verdict.decision), verdict.reason) for name, verdict in checks.items()
        }

    position, angle = scene.error(X_CT)
    return DecisionRow(
        position=position,
        angle=angle,
        hidden=scene.hidden,
        decision={name: decision for name, (decision, _) in verdicts.items()},
        right={name: name == case.kind and right for name in poses},
        reason={name: reason for name, (_, reason) in verdicts.items()},
        published={
            name: None if evidence is None else published_criterion(evidence, surface, X).q_m
            for name, X in poses.items()
        },
    )


def is_false_accept(record: Mapping[str, Any]) -> bool:
    """Whether a pose that is not right was accepted."""
    return record["decision"] == Decision.ACCEPT and not record["right"]


def of_right(record: Mapping[str, Any], decision: Decision) -> bool | None:
    """Whether a right pose got a decision; None for a wrong one, or where too little is visible."""
    visible = record["right"] and KINDS[record["kind"]]
    return record["decision"] == decision if visible else None


def verdicts_of(rows: list[Row]) -> Iterator[dict[str, Any]]:
    """Each verdict of the rows, with its pose."""
    for row in rows:
        for pose, decision in row["decision"].items():
            yield {**row, "pose": pose, "decision": decision, "right": row["right"][pose]}


def false_accepts(rows: list[Row]) -> list[str]:
    """Lines about the false accepts."""
    return [
        f"false accept: {verdict['object']}, {verdict['pose']}, {verdict['sensor']}, seed "
        f"{verdict['seed']}"
        for verdict in verdicts_of(rows)
        if is_false_accept(verdict)
    ]


def decisions_by_pose(rows: list[Row]) -> "tuple[str, str, Figure]":
    """Bar chart of the decisions on right and on wrong poses."""
    from matplotlib.figure import Figure

    verdicts = list(verdicts_of(rows))
    poses = list(dict.fromkeys(verdict["pose"] for verdict in verdicts))
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)

    for panel, right in zip(axes, (True, False), strict=True):
        left = np.zeros(len(poses))
        for decision, colour in _COLOURS.items():
            key = (right, decision)
            numbers = [
                sum((v["right"], v["decision"]) == key for v in verdicts if v["pose"] == pose)
                for pose in poses
            ]
            panel.barh(poses, numbers, left=left, color=colour, label=str(decision))
            left += numbers

        panel.set_title("right poses" if right else "wrong poses")
        panel.set_xlabel("decisions")

    axes[0].legend()
    axes[0].invert_yaxis()
    return "Decisions", "On right and on wrong poses, by kind of scene and of wrong pose.", figure


def counted(right: bool, decision: Decision) -> Statistic:
    """Number of right or of wrong poses with a decision, as a column."""
    return stat(
        "count",
        lambda record: (record["right"], record["decision"]) == (right, decision),
        f"{'right' if right else 'wrong'}, {decision}",
    )


decisions.page = (
    Page()
    .table(
        "Decisions by kind of scene, and on poses wrong by a known amount",
        by="pose",
        columns=[
            stat("count", lambda _: True, "poses"),
            stat("count", "right"),
            *(counted(right, decision) for right in (True, False) for decision in Decision),
        ],
        total=True,
    )
    .table(
        "Rates",
        by="pose",
        columns=[
            stat("share", is_false_accept, "false accepts"),
            stat(
                "share",
                lambda record: None if record["right"] else is_false_accept(record),
                "of wrong poses",
            ),
            stat("share", lambda record: of_right(record, Decision.REFUSE), "false refusals"),
            stat("share", lambda record: of_right(record, Decision.RESCAN), "right, rescan asked"),
        ],
        total=True,
    )
    .add(false_accepts)
    .add(decisions_by_pose)
)

if __name__ == "__main__":
    run_scenario(decisions.main)

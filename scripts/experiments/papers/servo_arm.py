"""Three experiments with the eight-joint servo arm of [Danilov 2021, ch. 4], by each method.

1, a single solution from the first row of its table 1 to the second; 2, motion along x; 3, motion
in trim; to the published accuracy of 0.001 m and 0.01 rad for each goal.

What was measured on the real arm is simulated: the joint values go to proportional drives, and the
arm rests beside them under its own weight (`uuv.models.arms.servo_drives`). Masses and gains are
those of common servos, for the paper gives none. The arm's dimensions are not public:
`uuv.models.arms.published_arms.SERVO_ARM` is a stand-in. The ranges of the two motions are ours. So
is the order of the angles: course about y, which is up, then trim about z, then roll about x. With
this order, the arm of the first row hangs straight down.

Accepted: every method reached the single solution, and the default one all poses.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from experiments.papers import servo_pictures
from experiments.papers.servo_motions import (
    DEFAULT,
    GIVEN,
    INITIAL,
    MEASURED,
    METHODS,
    MOTIONS,
    SOLVED,
    UP,
    goals_of,
    motion,
    motion_start,
    row_of,
    servo_chain,
    single_solution,
)
from uuv.controllers.mkps import Chain, IkResult, Method
from uuv.experiment import Page, Row, Table, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms import published_arms
from uuv.models.arms.servo_drives import Servo, rest, servo_model
from uuv.sim.interfaces.spatial import rotation_angle

ENTRIES = ("x", "y", "z", "course", "trim", "roll")  # of a row of table 1
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True, kw_only=True)
class ServoCase:
    """The three experiments by one method."""

    method: Method
    """IK method."""
    poses: int = 101
    """Number of poses of each motion."""

    def __post_init__(self) -> None:
        at_least(self, poses=2)


@dataclass(frozen=True, kw_only=True)
class ServoRow:
    """The single solution, in rows of table 1 [mm, deg], and figures of each motion."""

    solved: Sequence[float] = column("solved", "mm, deg", digits=3)
    measured: Sequence[float] = column("measured", "mm, deg", digits=3)
    iterations: int = column("iterations")
    converged: bool = column("converged")
    cause: str = column("ended by")
    goals: Sequence[float] = column("goals", "m, rad, rad", tolerance=None)

    reached: Mapping[str, float] = column("reached", "%", digits=1, factor=100.0, by="motion")
    median: Mapping[str, float] = column("iterations, median", digits=0, by="motion")
    most: Mapping[str, int] = column("most", by="motion")
    position_error: Mapping[str, float] = column(
        "position", "mm", digits=2, factor=1e3, by="motion"
    )
    orientation_error: Mapping[str, float] = column(
        "orientation", "deg", digits=3, factor=_DEGREES, by="motion"
    )
    joint_step: Mapping[str, float] = column(
        "joint step", "deg", digits=2, factor=_DEGREES, by="motion"
    )
    static_position: Mapping[str, float] = column(
        "at rest", "mm", digits=1, factor=1e3, by="motion"
    )
    static_orientation: Mapping[str, float] = column(
        "at rest", "deg", digits=1, factor=_DEGREES, by="motion"
    )


@experiment("servo_arm", vary={"method": METHODS}, quick={"method": ("jacobian_free", DEFAULT)})
def servo_arm(case: ServoCase) -> ServoRow:
    """Solves the three experiments."""
    chain = servo_chain()
    drives = servo_model(published_arms.SERVO_ARM, Servo(), UP)

    # Experiment 1, then 2 and 3.
    single = single_solution(case.method)
    runs = {name: motion(name, case.poses, case.method) for name in MOTIONS}
    shares = {name: _motion_figures(chain, drives, results) for name, results in runs.items()}

    def by_motion(name: str) -> dict[str, float]:
        return {motion: figures[name] for motion, figures in shares.items()}

    return ServoRow(
        solved=row_of(chain.forward(single.q)).tolist(),
        measured=row_of(chain.forward(rest(drives, single.q))).tolist(),
        iterations=single.iterations,
        converged=single.converged,
        cause=single.cause,
        goals=goals_of(single)[-1].tolist(),
        most={name: max(result.iterations for result in runs[name]) for name in runs},
        **{
            name: by_motion(name)
            for name in (
                "reached",
                "median",
                "position_error",
                "orientation_error",
                "joint_step",
                "static_position",
                "static_orientation",
            )
        },
    )


def _motion_figures(
    chain: Chain, drives: mujoco.MjModel, results: list[IkResult]
) -> dict[str, float]:
    """Figures of a motion, among them the largest static errors on proportional drives."""
    steps = np.abs(np.diff(np.vstack([motion_start(), *(result.q for result in results)]), axis=0))

    # Poses of the tool as solved, and where the arm rests.
    pairs = [(chain.forward(result.q), chain.forward(rest(drives, result.q))) for result in results]
    return {
        "reached": float(np.mean([result.converged for result in results])),
        "median": float(np.median([result.iterations for result in results])),
        "position_error": max(result.position_error for result in results),
        "orientation_error": max(result.orientation_error for result in results),
        "joint_step": float(steps.max()),
        "static_position": max(float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in pairs),
        "static_orientation": max(rotation_angle(a[:3, :3], b[:3, :3]) for a, b in pairs),
    }


def table_1(rows: list[Row]) -> dict[str, Any]:
    """Rows of table 1 by method, each with the names of its entries [mm, deg]."""
    poses = {
        row["method"]: {
            name: dict(zip(ENTRIES, row[name], strict=True)) for name in ("solved", "measured")
        }
        for row in rows
    }
    return {"Table 1": poses}


def published(rows: list[Row]) -> Table:
    """The rows of table 1 in the paper."""
    del rows

    lines = {"initial": INITIAL, "given": GIVEN, "solved": SOLVED, "measured": MEASURED}
    return Table(
        title="Published",
        columns=("", "X mm", "Y mm", "Z mm", "course deg", "trim deg", "roll deg"),
        rows=[
            [name, *(f"{x:.1f}" for x in line[:3]), *(f"{x:.3f}" for x in line[3:])]
            for name, line in lines.items()
        ],
    )


def pictures(rows: list[Row]) -> list[object]:
    """Joint values and goals over iterations, and over the motions."""
    methods = [row["method"] for row in rows]
    poses = rows[0]["poses"]

    return [
        (
            "Experiment 1: a single solution",
            "Joint values and goals over iterations [Danilov 2021, fig. 9]; dashed: accuracies.",
            lambda: servo_pictures.single(methods),
        ),
        (
            "Experiments 2 and 3",
            "Joint values and goals of hybrid, and iterations of each method.",
            lambda: servo_pictures.motions(methods, poses),
        ),
    ]


servo_arm.page = (
    Page()
    .table(
        "A single solution",
        by="method",
        columns=["solved", "measured", "iterations", "converged", "cause"],
    )
    .add(published)
    .add(table_1)
    .table(
        "Motions: largest errors, and at rest on proportional drives",
        by=("motion", "method"),
        columns=[
            "reached",
            "median",
            "most",
            "position_error",
            "orientation_error",
            "joint_step",
            "static_position",
            "static_orientation",
        ],
    )
    .accept(stat("share", "converged", "single solutions reached"), least=1.0)
    .accept(
        stat("least", lambda row: min(row["reached"].values()), f"poses reached by {DEFAULT}"),
        least=1.0,
        where=lambda row: row["method"] == DEFAULT,
    )
    .add(pictures)
)

if __name__ == "__main__":
    run_scenario(servo_arm.main)

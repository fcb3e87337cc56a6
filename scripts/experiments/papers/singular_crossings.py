"""Eleven paths through and beside singular configurations, by each recipe [Danilov 2021].

Each path is a straight line of the tool without turning, through a tip pose at which the wrist is
singular, or up to 20 mm beside it. That of the European Robotic Arm (ERA) is the published one
(figs. 6, 7); on the others the wrist has to spin. The tool is off its path where it is more than
0.1 mm or 1 mrad away.

The recipes are those of recipes.py beside this file: without passing; those of the paper, joints 5
and 6 kept within +-80 deg, or joint 1 held near the singularity; and those of this project. On the
PUMA and the UR5 such limits of joints 5 and 6 hardly act, and there is no joint to spare. Their
paths therefore have tables of their own. Accepted: no recipe but "without" exceeds the speed limit,
and the default one leaves the paths for the least share.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from experiments.papers.recipes import (
    DEFAULT,
    RECIPES,
    WITHOUT,
    RecipePath,
    begun,
    line,
    tip_errors,
    tracked,
)
from experiments.papers.track_singularity import lock
from uuv.controllers.mkps import Chain
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.statistic import Statistic
from uuv.models.arms import published_arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.spatial import Array, finite_number, one_of

# [rad] singular joint values, joint 5 at zero; and which directions of `fast_first` lead along and
# across
WRISTS = {
    "puma560": (np.array([0.3, -0.6, 0.5, 0.5, 0.0, 0.2]), 0, 2),
    "ur5": (np.array([0.3, -1.2, 1.4, -0.6, 0.0, 0.2]), 1, 2),
}
ERA = "era"
BESIDE = (0.002, 0.005, 0.01, 0.02)  # [m]
BESIDE_ERA = (0.0, 0.01, 0.02)  # [m]
PATHS: dict[str, tuple[str, float]] = {  # arm, and how far beside the singularity [m]
    f"{arm}, {1e3 * beside:.0f} mm": (arm, beside)
    for arm, distances in ((ERA, BESIDE_ERA), *((arm, BESIDE) for arm in WRISTS))
    for beside in distances
}
REACH_ERA, SLOW_ERA = 1.0, 0.4  # [m] of its path; [rad/s] speed limit on the way back to its begin
NEAR = 0.02  # [rad] beside the singularity
BACK = 0.01  # [s] between poses on the way back


@dataclass(frozen=True, kw_only=True)
class CrossingCase:
    """One path by one recipe."""

    recipe: str
    """How the singularity is passed."""
    path: str
    """Arm, and distance of the path from the singularity."""
    speed: float = 0.1
    """Speed of the tool [m/s]."""
    speed_limit: float = 2.0
    """Speed limit of every joint [rad/s]."""
    reach: float = 0.2
    """Length of each path before and after the singularity [m]; that of the ERA is 1 m."""
    period: float = 0.01
    """Time between poses [s]."""

    def __post_init__(self) -> None:
        one_of(self.recipe, RECIPES, "--recipe")
        one_of(self.path, PATHS, "--path")
        for name in ("speed", "speed_limit", "reach", "period"):
            finite_number(getattr(self, name), f"--{name.replace('_', '-')}", above=0.0)


@dataclass(frozen=True, kw_only=True)
class CrossingRow:
    """Largest errors of the tool, and what the joints do."""

    arm: str = column("arm")
    position_error: float = column("tool off", "mm", factor=1e3)
    orientation_error: float = column("tool off", "deg", factor=math.degrees(1.0))
    share_off: float = column("of the path off", "%", factor=100.0)
    joint_speed: float = column("joint speed", "rad/s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """One path, and joint values at its first pose."""

    arm: PublishedArm
    path: Array  # (N, 4, 4)
    q0: Array  # (n,) [rad]


@experiment(
    "singular_crossings",
    vary={"recipe": tuple(RECIPES), "path": tuple(PATHS)},
    quick={"path": ("puma560, 2 mm", "ur5, 20 mm")},
)
def singular_crossings(case: CrossingCase) -> CrossingRow:
    """Passes one path by one recipe."""
    crossing = crossing_of(case.path, case.speed * case.period, case.reach)
    path = RecipePath(
        poses=crossing.path, q0=crossing.q0, period=case.period, speed_limit=case.speed_limit
    )
    run = tracked(crossing.arm, path, case.recipe, "hybrid")
    errors = tip_errors(crossing.arm, run, crossing.path)
    return CrossingRow(
        arm=PATHS[case.path][0],
        position_error=float(errors.position.max()),
        orientation_error=float(errors.orientation.max()),
        share_off=errors.share_off,
        joint_speed=float(np.abs(run.qd).max()),
    )


@lru_cache(maxsize=len(PATHS))  # by all recipes
def crossing_of(name: str, step: float, reach: float) -> Crossing:
    """A path, and first joint values that are found by tracking back from the middle.

    Args:
        name: Of PATHS.
        step: [m] between poses.
        reach: [m] before and after the singularity.

    Raises:
        ConfigurationError: The arm does not reach the beginning.
    """
    arm_name, beside = PATHS[name]
    arm = published_arms.load(arm_name)
    chain = Chain.from_arm(arm)

    if arm_name == ERA:
        q, reach = lock(arm), REACH_ERA
        along = np.array([0.0, 1.0, 0.0])
        across = np.array([0.0, 0.0, 1.0])
    else:
        q, first, second = WRISTS[arm_name]
        ways = fast_first(chain, q)
        along = ways[first]
        across = ways[second]

    # The line, and the way back from its middle: through the singularity, or from beside it
    path = line(chain.forward(q), along, reach, step, beside * across)
    back = path[: len(path) // 2 + 1][::-1]
    if arm_name == ERA:
        q0 = begun(chain, back, q, BACK, speed_limits=SLOW_ERA)
    else:
        q0 = begun(chain, back, q + NEAR, BACK, passing="off")
    return Crossing(arm=arm, path=path[1:], q0=q0)


def fast_first(chain: Chain, q: Array) -> Array:
    """Directions of the tool, rows of (3, 3), from the one that needs the fastest joints beside the
    singular `q`.
    """
    return np.linalg.svd(np.linalg.pinv(chain.jacobian(q + NEAR))[:, :3])[2]


def default_over_least(rows: Sequence[Row]) -> float | None:
    """Mean share of the path off by the default recipe, less the least one of those that pass."""
    means = {
        recipe: float(np.mean([row["share_off"] for row in rows if row["recipe"] == recipe]))
        for recipe in dict.fromkeys(row["recipe"] for row in rows)
        if recipe != WITHOUT
    }
    return means[DEFAULT] - min(means.values()) if DEFAULT in means else None


def paths(rows: list[Row]) -> dict[str, dict[str, int]]:
    """Number of paths by arm."""
    arms = {row["path"]: row["arm"] for row in rows}
    return {"paths": dict(Counter(arms.values()))}


def _over_limit(row: Row) -> float:
    return row["joint_speed"] / row["speed_limit"]


def _worst_and_mean(name: str, label: str) -> list[Statistic]:
    return [stat("largest", name, f"{label}, largest"), stat("mean", name, f"{label}, mean")]


singular_crossings.page = (
    Page()
    .table(
        "Crossings by arm and recipe",
        by=("arm", "recipe"),
        columns=[
            *_worst_and_mean("position_error", "tool off"),
            *_worst_and_mean("orientation_error", "turned off"),
            *_worst_and_mean("share_off", "of the path off"),
            *_worst_and_mean("joint_speed", "joint speed"),
        ],
    )
    .table(
        "Position error of each crossing [mm]",
        by="path",
        across="recipe",
        columns=["position_error"],
    )
    .accept(
        stat("largest", _over_limit, "joint speed over the limit"),
        most=1.0 + 1e-9,
        where=lambda row: row["recipe"] != WITHOUT,
    )
    .accept(
        stat("group", default_over_least, "share off by the default recipe, over the least"),
        most=0.0,
    )
    .add(paths)
)

if __name__ == "__main__":
    run_scenario(singular_crossings.main)

"""Inverse kinematics at the edge of reach: nearly straight targets, beside installed peers.

A UR10e with its elbow within 2 deg of straight, its tip moved outwards by up to 0.09 mm and turned
by up to 0.9 mrad. A posture within 0.1 mm and 1 mrad exists for each, in many cases none that meets
the target.

    ./uvw run --with pin --with mink --with daqp scripts/experiments/kinematics/ik_straight.py
"""

from uuv.start import run_scenario  # isort: skip

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.kinematics.ik_bench import HOME, SLACK
from experiments.kinematics.ik_parts import ANGLE, POSITION, errors, forward
from experiments.kinematics.ik_peers import Solver, SolverTask, peers
from uuv.controllers.mkps import Chain, solve
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams

ELBOW = math.radians(2.0)  # [rad] of a nearly straight arm
# largest share of each tolerance that the displacement of a nearly straight target uses
USED_UP = 0.9


@dataclass(frozen=True, kw_only=True)
class StraightCase:
    """Nearly straight targets of one arm."""

    arm: str = "ur10e"
    """Published arm with its elbow at the third joint."""
    targets: int = 800
    """Number of nearly straight targets."""
    seed: int = 0
    """Seed of the targets."""

    def __post_init__(self) -> None:
        at_least(self, targets=1)


@dataclass(frozen=True, kw_only=True)
class StraightRow:
    """Targets solved, by method and installed peer."""

    solved: Mapping[str, int] = column("solved", by="solver")
    spent: Mapping[str, float] = column(
        "a target", "µs", digits=0, factor=1e6, by="solver", tolerance=None
    )


@experiment("ik_straight", quick={"targets": StraightCase.targets})
def ik_straight(case: StraightCase) -> StraightRow:
    """Solves all targets by each method and peer."""
    arm = published_arms.load(case.arm)
    chain = Chain.from_arm(arm)
    targets = straight_targets(chain, case.targets, Streams(case.seed)["nearly straight"])
    task = SolverTask(arm=arm, limits=chain.limits, bar=(POSITION, ANGLE))
    solvers: dict[str, Solver] = {
        "hybrid": lambda X, q0: solve(chain, X, q0).q,
        "jacobian_free": lambda X, q0: solve(chain, X, q0, method="jacobian_free").q,
    }

    start = np.resize(HOME, chain.n)
    solved = {}
    spent = {}
    for name, solver in (solvers | peers(task)).items():
        solver(targets[0], start)  # loads its code
        began = time.perf_counter()
        q = np.array([solver(X, start) for X in targets])
        spent[name] = (time.perf_counter() - began) / case.targets

        answered = np.asarray(np.isfinite(q).all(axis=1))
        error = errors(forward(chain, np.where(answered[:, None], q, 0.0)), targets)
        good = answered & (error["position_tolerance"] <= SLACK * POSITION)
        good &= error["orientation_tolerance"] <= SLACK * ANGLE
        solved[name] = int(np.count_nonzero(good))
    return StraightRow(solved=solved, spent=spent)


def straight_targets(chain: Chain, count: int, rng: np.random.Generator) -> Array:
    """Targets (count, 4, 4) of a nearly straight arm, displaced by less than the tolerances."""
    q = rng.uniform(-math.pi, math.pi, (count, chain.n))
    q[:, 2] = rng.uniform(-ELBOW, ELBOW, count)
    targets = forward(chain, q)
    away = targets[:, :3, 3] - chain.points[1]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    targets[:, :3, 3] += rng.uniform(0.0, USED_UP * POSITION, (count, 1)) * away
    turn = rng.normal(size=(count, 3))
    turn *= rng.uniform(0.0, USED_UP * ANGLE, (count, 1)) / np.linalg.norm(
        turn, axis=1, keepdims=True
    )
    targets[:, :3, :3] = targets[:, :3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    return targets


ik_straight.page = Page().table(
    "Nearly straight targets",
    by="solver",
    columns=[stat("share", "solved", among="targets"), "spent"],
)

if __name__ == "__main__":
    run_scenario(ik_straight.main)

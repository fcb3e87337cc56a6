"""Hull and arm as one chain, by priorities: random tool poses before each vehicle.

A target is the tool pose of a random posture, with the hull up to 1 m and 1 rad away from where it
starts. Start: the hull at the origin, the arm in `ready`. Limits are those of the joints; the hull
stays level.
"""

from uuv.start import run_scenario  # isort: skip

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuv import models
from uuv.controllers.mkps import IkOptions, solve
from uuv.controllers.planning.carried_arm import HULL_JOINTS, with_hull
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.own_vehicle import OwnVehicle
from uuv.sim.interfaces.spatial import Array, inverse, log_so3
from uuv.sim.interfaces.streams import Streams

VEHICLES = ("bluerov2_heavy_alpha5", "uuv_puma", "uuv_puma_side", "rexrov2_arm7", "phoenix_smart3s")
AWAY = 1.0  # [m], [rad] of the hull from its start
INSIDE = 0.1  # share of a joint's range at either end that targets keep clear of
MET = 1e-5, 1e-3  # [m], [rad] within which a pose counts as met
SPARES = ("pad", "camera", "thrusters", "home", "ready")


@dataclass(frozen=True, kw_only=True)
class ChainCase:
    """One vehicle."""

    vehicle: str
    poses: int = 100
    """Tool poses for each vehicle."""
    seed: int = 0
    """Seed of the poses."""

    def __post_init__(self) -> None:
        at_least(self, poses=1)


@dataclass(frozen=True, kw_only=True)
class ChainRow:
    """Answers for all poses of a vehicle."""

    joints: int = column("joints")
    axis: Sequence[bool] = column("position and axis")
    whole: Sequence[bool] = column("whole pose")
    within: Sequence[bool] = column("in limits")
    moved: Sequence[float] = column("hull", "m", digits=2)
    turned: Sequence[float] = column("yaw", "rad", digits=2)
    spent: float = column("time", "ms", digits=2, factor=1e3, tolerance=None)


@experiment("hull_arm", vary={"vehicle": VEHICLES}, quick={"poses": ChainCase.poses})
def hull_arm(case: ChainCase) -> ChainRow:
    """Solves all poses of one vehicle."""
    setup = OwnVehicle.of(models.load(case.vehicle), SPARES)
    chain = setup.chain()
    whole = with_hull(chain, setup.vehicle.X_BA)
    low, high = setup.vehicle.q_limits.T
    start = np.concatenate([np.zeros(HULL_JOINTS), setup.vehicle.q_ready])
    streams = Streams(case.seed)
    options = IkOptions(max_iterations=400)

    answers = []
    spent = 0.0
    for _ in range(case.poses):
        # a pose that hull and arm can reach
        share = INSIDE + (1.0 - 2.0 * INSIDE) * streams["arm"].random(chain.n)
        hull = streams["hull"].uniform(-AWAY, AWAY, HULL_JOINTS)
        X = whole.forward(np.concatenate([hull, low + share * (high - low)]))

        began = time.perf_counter()
        answer = solve(whole, X, start, *MET, "priority", options=options)
        spent += time.perf_counter() - began
        answers.append((X, answer))

    errors = [_errors(whole.forward(answer.q), X) for X, answer in answers]
    arm = [answer.q[HULL_JOINTS:] for _, answer in answers]
    return ChainRow(
        joints=chain.n,
        axis=[bool(answer.converged) for _, answer in answers],
        whole=[distance <= MET[0] and angle <= MET[1] for distance, angle in errors],
        within=[bool(np.all((q >= low) & (q <= high))) for q in arm],
        moved=[float(np.linalg.norm(answer.q[:3])) for _, answer in answers],
        turned=[abs(float(answer.q[3])) for _, answer in answers],
        spent=spent / case.poses,
    )


def _errors(X: Array, target: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] of two poses."""
    D = inverse(X) @ target
    return float(np.linalg.norm(D[:3, 3])), float(np.linalg.norm(log_so3(D[:3, :3])))


hull_arm.page = Page().table(
    "Tool poses met by hull and arm as one chain",
    by="vehicle",
    columns=[
        "joints",
        "poses",
        stat("count", "axis"),
        stat("count", "whole"),
        stat("count", "within"),
        stat("median", "moved"),
        stat("median", "turned"),
        "spent",
    ],
)

if __name__ == "__main__":
    run_scenario(hull_arm.main)

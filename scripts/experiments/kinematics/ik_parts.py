"""Inverse kinematics of parts of a pose: targets solved, false claims, and time.

Arms of three to eight joints: one from a URDF, published ones, and chains drawn by the seed.
Reachable targets are the poses of joint values within the limits, with what does not count drawn at
random. Other targets are drawn from the ball that the stretched arm reaches; of these, only what is
called solved is judged. Every answer is judged by a product of exponentials, apart from the
solver's kinematics.
"""

from uuv.start import run_scenario  # isort: skip

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.kinematics.ik_bench import HOME
from uuv.controllers.mkps import Chain, IkOptions, solve_many
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.interfaces.streams import Streams

POSITION, ANGLE = 1e-4, 1e-3  # [m], [rad] tolerances of what counts
KINDS: dict[str, dict[str, Any]] = {
    "position": {"orientation_tolerance": math.inf},
    "tool axis": {
        "position_tolerance": math.inf,
        "axis_tolerance": ANGLE,
        "turn_tolerance": math.inf,
    },
    "position and axis": {"axis_tolerance": ANGLE, "turn_tolerance": math.inf},
    "whole pose": {},
}
FOUND_GOAL = 0.999  # least share of the reachable targets of a kind
ROUNDING = 1e-9  # [m], [rad] by which two kinematics may differ
PUBLISHED = ("puma560", "ur5", "general6r", "stanford", "panda", "iiwa7", "gen3")
REACHER = """
<robot name="reacher">
  <link name="base"/> <link name="turret"/> <link name="boom"/> <link name="stick"/>
    <link name="tip"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="turret"/>
    <origin xyz="0.02 0 0.07" rpy="0 0 -0.9"/><axis xyz="0 0 -1"/><limit lower="-1.6" upper="0.2"/>
      </joint>
  <joint name="lift" type="revolute"><parent link="turret"/><child link="boom"/>
    <origin xyz="0 0.01 0.04"/><axis xyz="0 1 0"/><limit lower="0" upper="1.5"/></joint>
  <joint name="bend" type="revolute"><parent link="boom"/><child link="stick"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5"/></joint>
  <joint name="end" type="fixed"><parent link="stick"/><child link="tip"/>
    <origin xyz="0 0.02 0.09" rpy="0.3 0 0"/></joint>
</robot>
"""


@dataclass(frozen=True, kw_only=True)
class PartsCase:
    """One arm."""

    arm: str
    targets: int = 1000
    """Number of reachable targets of each kind, and as many that may be out of reach."""
    seed: int = 0
    """Seed of arms and targets."""

    def __post_init__(self) -> None:
        at_least(self, targets=1)


@dataclass(frozen=True, kw_only=True)
class PartsRow:
    """Answers by kind: by what counts of a pose."""

    solved: Mapping[str, int] = column("solved", by="kind")
    claimed: Mapping[str, int] = column("targets anywhere called solved", by="kind")
    false: Mapping[str, int] = column("false claims", by="kind")
    spent: Mapping[str, float] = column(
        "a target", "µs", digits=1, factor=1e6, by="kind", tolerance=None
    )


def arms(streams: Streams) -> dict[str, Chain]:
    """Fourteen arms of three to eight joints."""
    h = math.pi
    scara = [[0.0, 0.4, 0.3, 0.0], [0.0, 0.0, 0.25, h], [0.0, 0.1, 0.0, 0.0], [0.0, 0.05, 0.0, 0.0]]
    limits = [[-2.3, 2.3], [-2.6, 2.6], [0.0, 0.2], [-h, h]]
    chains = {
        "URDF, 3 joints": Chain.from_urdf(REACHER, "base", "tip"),
        "drawn, 3 joints": drawn(3, 2.6, streams["arm of 3 joints"]),
        "SCARA, 4 joints": Chain.from_dh(scara, "rrpr", limits=limits),
        "drawn, 4 joints": drawn(4, 2.6, streams["arm of 4 joints"]),
        "drawn, 5 joints": drawn(5, 2.6, streams["arm of 5 joints"]),
        "5 joints of +-69 deg": drawn(5, 1.2, streams["arm of 5 joints and less range"]),
    }
    chains |= {name: Chain.from_arm(published_arms.load(name)) for name in PUBLISHED}
    return chains | {"drawn, 8 joints": drawn(8, 2.6, streams["arm of 8 joints"])}


def drawn(n: int, limit: float, rng: np.random.Generator) -> Chain:
    """A chain of `n` hinges within +- `limit` [rad], with offsets and an oblique tool."""
    twist = rng.choice([-1.0, 1.0], n) * rng.uniform(0.3, 1.6, n)
    dh = np.column_stack(
        [rng.uniform(-3.0, 3.0, n), rng.uniform(-0.3, 0.3, n), rng.uniform(0.1, 0.6, n), twist]
    )

    tool = pose(exp_so3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.1, 0.1, 3))
    return Chain.from_dh(dh, limits=np.tile([-limit, limit], (n, 1)), tool=tool)


def forward(chain: Chain, q: Array) -> Array:
    """Tip poses (N, 4, 4) at joint values (N, n): the product of exponentials of their twists."""
    X = np.broadcast_to(np.eye(4), (len(q), 4, 4))

    for kind, axis, point, coordinate in zip(
        chain.joint_types, chain.axes, chain.points, q.T, strict=True
    ):
        step = np.zeros((len(q), 4, 4))
        step[:, 3, 3] = 1.0
        step[:, :3, :3] = Rotation.from_rotvec(
            np.outer(0.0 * coordinate if kind == "p" else coordinate, axis)
        ).as_matrix()

        step[:, :3, 3] = (
            np.outer(coordinate, axis) if kind == "p" else point - step[:, :3, :3] @ point
        )
        X = X @ step
    return X @ chain.X_base_tip0


def errors(X: Array, target: Array) -> dict[str, Array]:
    """Distance [m], whole angle and angle between the tool axes [rad] of poses (N, 4, 4), by name
    of the tolerance.
    """
    off = X[:, :3, 3] - target[:, :3, 3]

    R = np.swapaxes(X[:, :3, :3], 1, 2) @ target[:, :3, :3]
    return {
        "position_tolerance": np.linalg.norm(off, axis=1),
        "orientation_tolerance": Rotation.from_matrix(R).magnitude(),
        "axis_tolerance": np.arctan2(np.hypot(R[:, 0, 2], R[:, 1, 2]), R[:, 2, 2]),
    }


def met(chain: Chain, kind: str, q: Array, targets: Array) -> np.ndarray:
    """(N,) bool: joint values (N, n) keep the limits, and every error that counts its tolerance."""
    tolerances = {"position_tolerance": POSITION, "orientation_tolerance": ANGLE} | KINDS[kind]
    if "axis_tolerance" in tolerances:
        del tolerances["orientation_tolerance"]

    deviations = errors(forward(chain, q), targets)
    within = np.all((q >= chain.limits[:, 0]) & (q <= chain.limits[:, 1]), axis=1)

    for name, error in deviations.items():
        within &= error <= tolerances.get(name, math.inf) + ROUNDING
    return within


def reachable(chain: Chain, kind: str, count: int, rng: np.random.Generator) -> Array:
    """Targets (count, 4, 4) of joint values within the limits; what does not count is drawn."""
    bounds = np.clip(chain.limits, -math.pi, math.pi)

    targets = forward(chain, rng.uniform(bounds[:, 0], bounds[:, 1], (count, chain.n)))
    if kind == "position":
        targets[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()

    if "axis" in kind:
        turns = Rotation.from_euler("z", rng.uniform(-math.pi, math.pi, (count, 1))).as_matrix()
        targets[:, :3, :3] = targets[:, :3, :3] @ turns

    if kind == "tool axis":
        targets[:, :3, 3] = rng.uniform(-9.0, 9.0, (count, 3))

    return targets


def anywhere(chain: Chain, count: int, rng: np.random.Generator) -> Array:
    """Targets (count, 4, 4) of any attitude in the ball that the stretched arm reaches."""
    path = np.vstack([chain.points, chain.X_base_tip0[:3, 3]])
    reach = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())

    targets = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    targets[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()

    # Uniform in the ball: a direction, and the cube root of a uniform share.
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    targets[:, :3, 3] = chain.points[0] + reach * np.cbrt(rng.random((count, 1))) * way
    return targets


NAMES = tuple(arms(Streams(0)))


@experiment("ik_parts", vary={"arm": NAMES}, quick={"arm": ("SCARA, 4 joints", "puma560")})
def ik_parts(case: PartsCase) -> PartsRow:
    """Solves and judges all targets of one arm."""
    streams = Streams(case.seed)
    chain = arms(streams)[case.arm]
    start = np.clip(np.resize(HOME, chain.n), chain.limits[:, 0], chain.limits[:, 1])
    solved: dict[str, int] = {}
    claimed: dict[str, int] = {}
    false: dict[str, int] = {}
    spent: dict[str, float] = {}

    for kind, parts in KINDS.items():
        tolerances: dict[str, Any] = {
            "position_tolerance": POSITION,
            "orientation_tolerance": ANGLE,
        } | parts

        # reachable targets
        targets = reachable(chain, kind, case.targets, streams[f"{case.arm}: {kind}"])
        solve_many(chain, targets[:1], start, **tolerances)  # loads the kernel
        began = time.perf_counter()
        answer = solve_many(chain, targets, start, **tolerances, options=IkOptions(threads=1))
        spent[kind] = (time.perf_counter() - began) / case.targets
        good = met(chain, kind, answer.q, targets)
        solved[kind] = int(np.count_nonzero(good & answer.converged))
        false[kind] = int(np.count_nonzero(answer.converged & ~good))

        # targets anywhere
        others = anywhere(chain, case.targets, streams[f"{case.arm}: {kind}, anywhere"])
        answer = solve_many(chain, others, start, **tolerances)
        good = met(chain, kind, answer.q, others)
        claimed[kind] = int(np.count_nonzero(answer.converged))
        false[kind] += int(np.count_nonzero(answer.converged & ~good))

    return PartsRow(solved=solved, claimed=claimed, false=false, spent=spent)


ik_parts.page = (
    Page()
    .table(
        "Parts of a pose: reachable targets solved, and false claims",
        by="kind",
        columns=[
            stat("total", "targets", "targets"),
            stat("share", "solved", among="targets", digits=3),
            stat("total", "false", "false claims"),
            stat("median", "spent", "a target, median over arms"),
        ],
    )
    .table(
        "The same by arm",
        by="arm",
        across="kind",
        columns=[
            stat(
                "value",
                lambda row: 100 * row["solved"] / row["targets"],
                "solved",
                unit="%",
                digits=2,
            ),
            "spent",
        ],
    )
    .table("Targets anywhere that are called solved", by="arm", across="kind", columns=["claimed"])
    .accept(stat("total", lambda row: sum(row["false"].values()), "false claims"), most=0)
)
for name in KINDS:
    ik_parts.page.accept(
        stat("mean", lambda row, name=name: row["solved"][name] / row["targets"], f"{name} solved"),
        least=FOUND_GOAL,
    )

if __name__ == "__main__":
    run_scenario(ik_parts.main)

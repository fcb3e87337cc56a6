"""Inverse kinematics of parts of a pose, and at the edge of reach: solved, false claims and time.

    BENCHMARK=scripts/experiments/kinematics/ik_parts.py
    ./uvw run $BENCHMARK

    # beside two peers
    ./uvw run --with pin --with mink --with daqp $BENCHMARK --straight 200

Arms of three to eight joints: one from a URDF, published ones, and chains drawn by the seed.
Reachable targets are the poses of joint values within the limits, with what does not count drawn at
random. Other targets are drawn from the ball that the stretched arm reaches; of these, only what is
called solved is judged. Every answer is judged by a product of exponentials, apart from the
solver's kinematics.

Nearly straight targets: a UR10e with its elbow within 2 deg of straight, its tip moved outwards by
up to 0.09 mm and turned by up to 0.9 mrad. A posture within 0.1 mm and 1 mrad exists for each, in
many cases none that meets the target.

Writes metrics.json. Exit code 0: 99.9 % of the reachable targets of each kind are found, and no
claim is false.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from experiments.kinematics.ik import HOME, SLACK
from experiments.kinematics.ik_peers import SolverTask, peers
from uuv.controllers.mkps import Chain, IkOptions, solve, solve_many
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.interfaces.streams import Streams
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse, run_scenario

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
ELBOW = math.radians(2.0)  # [rad] of a nearly straight arm
# largest share of each tolerance that the displacement of a nearly straight target uses
USED_UP = 0.9
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


@dataclass
class Options:
    """Parts of poses, and poses at the edge of reach."""

    targets: int = 1000
    """Number of reachable targets of each kind for each arm, and as many that may be out of
    reach.
    """
    straight: int = 800
    """Number of nearly straight targets."""
    seed: int = 0
    """Seed of arms and targets."""
    out: Path | None = None
    """Folder for metrics.json; default: a new one in runs/ik_parts."""


def arms(streams: Streams) -> dict[str, Chain]:
    """Fourteen arms of three to eight joints."""
    h = math.pi
    scara = [[0.0, 0.4, 0.3, 0.0], [0.0, 0.0, 0.25, h], [0.0, 0.1, 0.0, 0.0], [0.0, 0.05, 0.0, 0.0]]
    limits = [[-2.3, 2.3], [-2.6, 2.6], [0.0, 0.2], [-h, h]]
    found = {
        "URDF, 3 joints": Chain.from_urdf(REACHER, "base", "tip"),
        "drawn, 3 joints": drawn(3, 2.6, streams["arm of 3 joints"]),
    }
    found |= {
        "SCARA, 4 joints": Chain.from_dh(scara, "rrpr", limits=limits),
        "drawn, 4 joints": drawn(4, 2.6, streams["arm of 4 joints"]),
    }
    found |= {
        "drawn, 5 joints": drawn(5, 2.6, streams["arm of 5 joints"]),
        "5 joints of +-69 deg": drawn(5, 1.2, streams["arm of 5 joints and less range"]),
    }
    found |= {name: Chain.from_arm(published_arms.load(name)) for name in PUBLISHED}
    return found | {"drawn, 8 joints": drawn(8, 2.6, streams["arm of 8 joints"])}


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
    for kind, axis, point, value in zip(
        chain.joint_types, chain.axes, chain.points, q.T, strict=True
    ):
        step = np.zeros((len(q), 4, 4))
        step[:, 3, 3] = 1.0
        step[:, :3, :3] = Rotation.from_rotvec(
            np.outer(0.0 * value if kind == "p" else value, axis)
        ).as_matrix()
        step[:, :3, 3] = np.outer(value, axis) if kind == "p" else point - step[:, :3, :3] @ point
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
    """(N,) bool: joint values (N, n) are within the limits, and every error that counts within its
    tolerance.
    """
    tolerances = {"position_tolerance": POSITION, "orientation_tolerance": ANGLE} | KINDS[kind]
    if "axis_tolerance" in tolerances:
        del tolerances["orientation_tolerance"]
    found = errors(forward(chain, q), targets)
    within = np.all((q >= chain.limits[:, 0]) & (q <= chain.limits[:, 1]), axis=1)
    for name, error in found.items():
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
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    targets[:, :3, 3] = chain.points[0] + reach * np.cbrt(rng.random((count, 1))) * way
    return targets


def of_arm(name: str, chain: Chain, count: int, streams: Streams) -> list[dict[str, Any]]:
    """A row for each kind: share found, false claims among all targets, and time of a target."""
    start = np.clip(np.resize(HOME, chain.n), chain.limits[:, 0], chain.limits[:, 1])
    rows = []
    for kind, tolerances in KINDS.items():
        targets = reachable(chain, kind, count, streams[f"{name}: {kind}"])
        given: dict[str, Any] = {
            "position_tolerance": POSITION,
            "orientation_tolerance": ANGLE,
        } | tolerances
        solve_many(chain, targets[:1], start, **given)  # loads the kernel
        began = time.perf_counter()
        found = solve_many(chain, targets, start, **given, options=IkOptions(threads=1))
        spent = time.perf_counter() - began
        good = met(chain, kind, found.q, targets)
        false = int(np.count_nonzero(found.converged & ~good))

        others = anywhere(chain, count, streams[f"{name}: {kind}, anywhere"])
        tried = solve_many(chain, others, start, **given)
        false += int(np.count_nonzero(tried.converged & ~met(chain, kind, tried.q, others)))
        share, claimed = float(np.mean(good & found.converged)), float(np.mean(tried.converged))
        rows.append(
            {
                "arm": name,
                "kind": kind,
                "found": share,
                "of_others": claimed,
                "false": false,
                "us": 1e6 * spent / count,
            }
        )
    return rows


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


def straight(count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """A row for each method and installed peer: share of the nearly straight targets that it
    finds.
    """
    arm = published_arms.load("ur10e")
    chain = Chain.from_arm(arm)
    targets = straight_targets(chain, count, rng)
    task = SolverTask(arm=arm, limits=chain.limits, bar=(POSITION, ANGLE))
    solvers: dict[str, Callable[[Array, Array], Array]] = {
        "hybrid": lambda X, q0: solve(chain, X, q0).q,
        "jacobian_free": lambda X, q0: solve(chain, X, q0, method="jacobian_free").q,
    }
    rows = []
    for name, solver in (solvers | peers(task)).items():
        solver(targets[0], HOME[:6])
        began = time.perf_counter()
        q = np.array([solver(X, HOME[:6]) for X in targets])
        spent = time.perf_counter() - began
        answered = np.asarray(np.isfinite(q).all(axis=1))
        error = errors(forward(chain, np.where(answered[:, None], q, 0.0)), targets)
        good = answered & (error["position_tolerance"] <= SLACK * POSITION)
        good &= error["orientation_tolerance"] <= SLACK * ANGLE
        rows.append({"solver": name, "found": float(np.mean(good)), "us": 1e6 * spent / count})
    return rows


def main() -> int:
    """Solves and judges all targets; 1 if a kind is found too rarely or a claim is false."""
    options, console = parse(Options), Console()
    folder = new_folder("ik_parts", options.out, options.seed)
    streams = Streams(options.seed)
    rows = [
        row
        for name, chain in arms(streams).items()
        for row in of_arm(name, chain, options.targets, streams)
    ]
    table = Table(title=f"Found of {options.targets} reachable targets, and time of one [us]")
    table.add_column("arm", no_wrap=True)
    for kind in KINDS:
        table.add_column(kind, justify="right")
    for name in dict.fromkeys(row["arm"] for row in rows):
        mine = [row for row in rows if row["arm"] == name]
        table.add_row(name, *(f"{row['found']:.2%}  {row['us']:.1f}" for row in mine))
    console.print(table)
    false, judged = sum(row["false"] for row in rows), 2 * options.targets * len(rows)
    console.print(f"false claims: {false} of {judged} answers", highlight=False)
    found = {
        kind: float(np.mean([row["found"] for row in rows if row["kind"] == kind]))
        for kind in KINDS
    }

    edge = straight(options.straight, streams["nearly straight"])
    table = Table(
        "solver", "found", "us", title=f"{options.straight} nearly straight targets of a UR10e"
    )
    for row in edge:
        table.add_row(row["solver"], f"{row['found']:.2%}", f"{row['us']:.0f}")
    console.print(table)
    content = {"found": found, "false": false, "rows": rows, "straight": edge}
    write_json(folder / "metrics.json", content | {"provenance": provenance("ik_parts", options)})
    console.print(f"written to {folder}/", highlight=False)
    return int(false > 0 or min(found.values()) < FOUND_GOAL)


if __name__ == "__main__":
    run_scenario(main)

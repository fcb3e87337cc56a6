"""How often each method of inverse kinematics solves a pose that the arm can reach [Danilov 2021].

    ./uvw run scripts/experiments/kinematics/ik_success.py

Arms: those of `uuv.models.arms.published_arms` with limits of +-180 and +-150 deg, and five of them
with uneven limits,
drawn by the seed. Targets: joint values within the limits, with one to three joints on a limit, and
with all of them on limits. All starts are the same cold one. A solution is one within 0.1 mm and 1
mrad, checked by another forward kinematics, and within the limits.

Writes metrics.json. Exit code 0: the default method missed none.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from experiments.kinematics.ik import HOME, dh_forward
from uuv.controllers.mkps import Chain, IkOptions, Method, solve_many
from uuv.models.arms import published_arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse, run_scenario

WITHIN, SOME, ALL = "within limits", "1 to 3 on limits", "all on limits"
RANGES = (180, 150)  # [deg]
UNEVEN = ("puma560", "ur5", "general6r", "panda", "era")
POSITION, ANGLE = 1e-4, 1e-3  # [m], [rad]
VERSIONS: dict[str, tuple[Method, IkOptions]] = {
    "hybrid": ("hybrid", IkOptions()),
    "jacobian_free": ("jacobian_free", IkOptions()),
    "plain": ("plain", IkOptions(stage_axes="tip")),
    "plain, by joint": ("plain", IkOptions(stage_axes="joint")),
}


@dataclass
class Options:
    """Success of the three methods of inverse kinematics."""

    targets: int = 10_000
    """Number of targets of each kind for each arm, for the default method."""
    others: int = 300
    """The same for the other methods, within the limits only."""
    seed: int = 0
    """Seed of limits and targets."""
    out: Path | None = None
    """Folder for metrics.json; default: a new one in runs/ik_success."""


def arms(streams: Streams) -> Iterator[tuple[str, PublishedArm]]:
    """Arms with the limits of their hinges: even ones, then uneven ones of 90 to 300 deg that are
    drawn.
    """
    for name in published_arms.available():
        arm = published_arms.load(name)
        for degrees in RANGES:
            yield f"{name}, +-{degrees} deg", limited(arm, np.radians([-degrees, degrees]))
    for name in UNEVEN:
        arm = published_arms.load(name)
        n = len(arm.joint_types)
        middle = streams[f"{name}: middle"].uniform(-1.0, 1.0, n)
        half = streams[f"{name}: half"].uniform(0.8, 2.6, n)
        yield f"{name}, uneven", limited(arm, np.column_stack([middle - half, middle + half]))


def limited(arm: PublishedArm, limits: Array) -> PublishedArm:
    """`arm` with `limits` (2,) or (n, 2) [rad] of its hinges; slides keep theirs."""
    hinge = np.array([kind != "p" for kind in arm.joint_types])
    return replace(arm, limits=np.where(hinge[:, None], limits, arm.limits))


def joint_values(limits: Array, kind: str, count: int, rng: np.random.Generator) -> Array:
    """Joint values (count, n) within `limits` (n, 2), as `kind` says."""
    n = len(limits)
    within = rng.uniform(limits[:, 0], limits[:, 1], (count, n))
    ends = limits[np.arange(n), rng.integers(0, 2, (count, n))]
    on_limit = {WITHIN: np.zeros(count), SOME: rng.integers(1, 4, count), ALL: np.full(count, n)}[
        kind
    ]
    return np.where(rng.random((count, n)).argsort(axis=1) < on_limit[:, None], ends, within)


def misses(arm: PublishedArm, targets: Array, version: str) -> int:
    """Number of `targets` (N, 4, 4) that a version of VERSIONS does not solve from the cold
    start.
    """
    method, options = VERSIONS[version]
    start = np.clip(np.resize(HOME, len(arm.limits)), arm.limits[:, 0], arm.limits[:, 1])
    starts = np.tile(start, (len(targets), 1))
    q = solve_many(
        Chain.from_arm(arm), targets, starts, POSITION, ANGLE, method=method, options=options
    ).q
    X = dh_forward(arm, q)
    chord = np.linalg.norm(X[:, :3, :3] - targets[:, :3, :3], axis=(1, 2)) / math.sqrt(2.0)
    solved = np.linalg.norm(X[:, :3, 3] - targets[:, :3, 3], axis=1) <= 1.01 * POSITION
    solved &= 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) <= 1.01 * ANGLE
    solved &= np.all((q >= arm.limits[:, 0] - 1e-9) & (q <= arm.limits[:, 1] + 1e-9), axis=1)
    return int(np.count_nonzero(~solved))


def main() -> int:
    """Counts the misses and shows them; 1 if the default method missed a target."""
    options, console = parse(Options), Console()
    folder = new_folder("ik_success", options.out, options.seed)
    streams = Streams(options.seed)
    rows: list[dict[str, Any]] = []
    for name, arm in arms(streams):
        row: dict[str, Any] = {"arm": name}
        for kind in (WITHIN, SOME, ALL):
            rng = streams[f"{name}: {kind}"]
            X = dh_forward(arm, joint_values(arm.limits, kind, options.targets, rng))
            row[kind] = misses(arm, X, "hybrid")
        rng = streams[f"{name}: others"]
        few = dh_forward(arm, joint_values(arm.limits, WITHIN, options.others, rng))
        row |= {version: misses(arm, few, version) for version in list(VERSIONS)[1:]}
        rows.append(row)
    columns = [WITHIN, SOME, ALL, *list(VERSIONS)[1:]]
    count = dict.fromkeys((WITHIN, SOME, ALL), options.targets) | dict.fromkeys(
        list(VERSIONS)[1:], options.others
    )
    share = {
        column: sum(row[column] for row in rows) / (len(rows) * count[column]) for column in columns
    }
    table = Table(
        title=f"Misses of hybrid among {options.targets}; of the other methods, within limits, "
        f"among {options.others}"
    )
    table.add_column("arm and limits", no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(row["arm"], *(str(row[column]) for column in columns))
    table.add_row(
        "all, solved", *(f"{1.0 - share[column]:.2%}" for column in columns), style="bold"
    )
    console.print(table)
    solved = {column.replace(" ", "_"): 1.0 - share[column] for column in columns}
    write_json(
        folder / "metrics.json",
        {"solved": solved, "rows": rows, "provenance": provenance("ik_success", options)},
    )
    console.print(f"written to {folder}/", highlight=False)
    return int(any(share[kind] > 0.0 for kind in (WITHIN, SOME, ALL)))


if __name__ == "__main__":
    run_scenario(main)

"""How often each method of inverse kinematics solves a pose that the arm can reach [Danilov 2021].

Arms: those of `uuv.models.arms.published_arms` with limits of +-180 and +-150 deg, and five of them
with uneven limits, drawn by the seed. Targets: joint values within the limits, with one to three
joints on a limit, and with all of them on limits; the methods beside the default one, hybrid, get
targets within the limits. All starts are the same cold one. A solution is one within 0.1 mm and
1 mrad, checked by another forward kinematics, and within the limits.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from experiments.kinematics.ik_bench import HOME, dh_forward
from uuv.controllers.mkps import Chain, IkOptions, Method, solve_many
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms import published_arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams

WITHIN = "within limits"
SOME = "1 to 3 on limits"
ALL = "all on limits"
KINDS = (WITHIN, SOME, ALL)  # of targets
RANGES = (180, 150)  # [deg]
UNEVEN = ("puma560", "ur5", "general6r", "panda", "era")
POSITION, ANGLE = 1e-4, 1e-3  # [m], [rad]
VERSIONS: dict[str, tuple[Method, IkOptions]] = {
    "hybrid": ("hybrid", IkOptions()),
    "jacobian_free": ("jacobian_free", IkOptions()),
    "plain": ("plain", IkOptions(stage_axes="tip")),
    "plain, by joint": ("plain", IkOptions(stage_axes="joint")),
}


@dataclass(frozen=True, kw_only=True)
class ArmCase:
    """One arm with its limits."""

    arm: str
    """Name of the arm, and its limits."""
    targets: int = 10_000
    """Number of targets of each kind, for the default method."""
    others: int = 300
    """The same for the other methods, within the limits only."""
    seed: int = 0
    """Seed of limits and targets."""

    def __post_init__(self) -> None:
        at_least(self, targets=1, others=1)


@dataclass(frozen=True, kw_only=True)
class ArmRow:
    """Targets and misses, by method and kind of target."""

    tried: Mapping[str, int] = column("targets", by="method")
    missed: Mapping[str, int] = column("missed", by="method")


def arms(streams: Streams) -> Iterator[tuple[str, PublishedArm]]:
    """Arms with limits of their hinges: even ones, then uneven ones, drawn from 90 to 300 deg."""
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
    """Number of `targets` (N, 4, 4) that a version of VERSIONS misses from the cold start."""
    method, options = VERSIONS[version]
    start = np.clip(np.resize(HOME, len(arm.limits)), arm.limits[:, 0], arm.limits[:, 1])
    starts = np.tile(start, (len(targets), 1))
    q = solve_many(
        Chain.from_arm(arm), targets, starts, POSITION, ANGLE, method=method, options=options
    ).q

    # Checked by textbook DH matrices, apart from the solver's kinematics.
    X = dh_forward(arm, q)
    chord = np.linalg.norm(X[:, :3, :3] - targets[:, :3, :3], axis=(1, 2)) / math.sqrt(2.0)
    solved = np.linalg.norm(X[:, :3, 3] - targets[:, :3, 3], axis=1) <= 1.01 * POSITION
    solved &= 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) <= 1.01 * ANGLE
    solved &= np.all((q >= arm.limits[:, 0] - 1e-9) & (q <= arm.limits[:, 1] + 1e-9), axis=1)

    return int(np.count_nonzero(~solved))


NAMES = tuple(name for name, _ in arms(Streams(0)))


@experiment(
    "ik_success", vary={"arm": NAMES}, quick={"arm": ("puma560, +-150 deg", "panda, uneven")}
)
def ik_success(case: ArmCase) -> ArmRow:
    """Counts the targets that each method misses."""
    streams = Streams(case.seed)
    arm = dict(arms(streams)).get(case.arm)
    if arm is None:
        raise ConfigurationError(f"no arm {case.arm!r}; there are {', '.join(NAMES)}")

    drawn = {
        kind: joint_values(arm.limits, kind, case.targets, streams[f"{case.arm}: {kind}"])
        for kind in KINDS
    }
    few = joint_values(arm.limits, WITHIN, case.others, streams[f"{case.arm}: others"])

    missed = {kind: misses(arm, dh_forward(arm, q), "hybrid") for kind, q in drawn.items()}
    others = list(VERSIONS)[1:]
    missed |= {version: misses(arm, dh_forward(arm, few), version) for version in others}
    tried = dict.fromkeys(KINDS, case.targets) | dict.fromkeys(others, case.others)
    return ArmRow(tried=tried, missed=missed)


def _solved(row: Mapping[str, int]) -> int:
    return row["tried"] - row["missed"]


ik_success.page = (
    Page()
    .table(
        "Targets solved; of hybrid by kind of target",
        by="method",
        columns=[
            stat("total", "tried"),
            stat("total", "missed"),
            stat("share", _solved, "solved", among="tried", digits=4),
        ],
    )
    .table("Targets missed", by="arm", across="method", columns=[stat("total", "missed")])
    .accept(
        stat("total", lambda row: sum(row["missed"][kind] for kind in KINDS), "hybrid missed"),
        most=0,
    )
)

if __name__ == "__main__":
    run_scenario(ik_success.main)

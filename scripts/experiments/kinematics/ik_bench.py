"""Bench of inverse kinematics: targets, solvers, an independent check, and times in turns."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from experiments.kinematics.damped_least_squares import arguments, baseline, solve_all
from experiments.kinematics.ik_peers import Solver, SolverTask, peers
from uuv.controllers.ik.chain_kernels import HYBRID, Settings
from uuv.controllers.ik.entries import entry
from uuv.controllers.mkps import Chain, IkOptions, Method, solve
from uuv.models.arms import published_arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.spatial import Array, readonly
from uuv.sim.interfaces.streams import Streams

# [m], [rad] accuracies; the last is that of the experiment in [Danilov 2021, table 1]
BARS = {"A": (1e-4, 1e-3), "B": (1e-6, 1e-5), "stated": (1e-3, 1e-2)}
METHODS: tuple[Method, ...] = ("hybrid", "jacobian_free", "plain")
BY_JOINT = IkOptions(stage_axes="joint")
OBLIQUE = "plain, joint's axes"  # for tools oblique to the last joint's axis
BASELINE = "compiled DLS"
COLD, WARM = "cold", "warm"  # starts
OWN_LIMITS = 0  # in place of degrees: the arm's own limits, asymmetric ones included
REACH = math.radians(150.0)  # [rad] targets come from joint values within this
NEARBY = math.radians(5.0)  # [rad] a warm start is within this of a solution
HOME = np.array([0.1, -0.6, 0.7, 0.3, 0.6, 0.2, 0.1])  # [rad] cold starts
SLACK = 1.01  # times the bar: peers measure their errors differently
BLOCK = 25  # targets that a solver takes in one turn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IkTargets:
    """Targets that an arm can reach within its limits, and a start for each."""

    arm: PublishedArm
    bar: str
    limits: Array  # (n, 2) [rad] or [m]
    targets: Array  # (N, 4, 4)
    starts: Array  # (N, n) [rad] or [m]

    @property
    def task(self) -> SolverTask:
        """The arm, its limits and the accuracy, for the peers."""
        return SolverTask(arm=self.arm, limits=self.limits, bar=BARS[self.bar])

    @property
    def chain(self) -> Chain:
        """The arm for our own solver."""
        return Chain.from_arm(replace(self.arm, limits=self.limits))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolverTimes:
    """What a solver does with all targets."""

    good: np.ndarray  # (N,) bool: solved
    call: Array  # (N,) [s]

    @property
    def solved(self) -> int:
        """Number of targets solved."""
        return int(np.count_nonzero(self.good))


def dh_forward(arm: SerialArm, q: Array) -> Array:
    """Tip poses (N, 4, 4) at joint values (N, n): the product of textbook DH matrices."""
    X = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for (theta, d, a, alpha), kind, coordinate in zip(arm.dh, arm.joint_types, q.T, strict=True):
        turn, lift = (
            (theta + 0.0 * coordinate, d + coordinate)
            if kind == "p"
            else (theta + coordinate, d + 0.0 * coordinate)
        )

        c = np.cos(turn)
        s = np.sin(turn)
        ca = math.cos(alpha)
        sa = math.sin(alpha)
        zero = 0.0 * coordinate

        rows = [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [zero, zero + sa, zero + ca, lift],
        ]
        step = np.concatenate(
            [np.moveaxis(np.array(rows), 2, 0), np.broadcast_to([0, 0, 0, 1.0], (len(q), 1, 4))],
            axis=1,
        )
        X = X @ step
    return X @ arm.X_n_flange


def reached(drawn: IkTargets, q: Array) -> np.ndarray:
    """(N,) bool: joint values (N, n) bring the tip within the bar and the limits; False for NaN."""
    X = dh_forward(drawn.arm, q)
    bar = BARS[drawn.bar]
    D = np.swapaxes(X[:, :3, :3], 1, 2) @ drawn.targets[:, :3, :3]
    twice = np.stack(
        [D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=1
    )

    angle = np.arctan2(np.linalg.norm(twice, axis=1), np.trace(D, axis1=1, axis2=2) - 1.0)
    distance = np.linalg.norm(X[:, :3, 3] - drawn.targets[:, :3, 3], axis=1)

    within = np.all((q >= drawn.limits[:, 0] - 1e-9) & (q <= drawn.limits[:, 1] + 1e-9), axis=1)
    return (distance <= SLACK * bar[0]) & (angle <= SLACK * bar[1]) & within


def targets_of(
    name: str, *, degrees: int, start: str, bar: str, count: int, seed: int
) -> IkTargets:
    """Targets of an arm; those of all starts and bars are the same.

    Args:
        name: Of the published arm.
        degrees: Limits of every hinge, both ways [deg]; slides keep their own. OWN_LIMITS: each
            joint's own.
        start: COLD, one posture for all targets, or WARM, near a solution.
        bar: Of BARS.
        count: Number of targets.
        seed: Of targets and starts.
    """
    arm = published_arms.load(name)
    streams = Streams(seed)
    slides = np.array([kind == "p" for kind in arm.joint_types])

    # limits, and the range of the joint values to be found
    if degrees == OWN_LIMITS:
        limits = np.where(np.isfinite(arm.limits), arm.limits, [-np.pi, np.pi])
        bounds = limits
        of_targets = f"{name}: targets within"
        of_starts = f"{name}: starts within"
    else:
        limits = np.where(slides[:, None], arm.limits, np.radians([-degrees, degrees]))
        bounds = np.where(slides[:, None], arm.limits, [-REACH, REACH])
        of_targets = f"{name}: targets"
        of_starts = f"{name}: starts"

    # targets, and starts that are within the limits too
    q = streams[of_targets].uniform(*bounds.T, size=(count, arm.n))
    reach = np.where(slides, 0.05 * np.diff(bounds)[:, 0], NEARBY)
    near = np.clip(q + streams[of_starts].uniform(-reach, reach, q.shape), *bounds.T)
    home = np.clip(np.where(slides, bounds.mean(axis=1), HOME[: arm.n]), *bounds.T)
    return IkTargets(
        arm=arm,
        bar=bar,
        limits=readonly(limits),
        targets=dh_forward(arm, q),
        starts=near if start == WARM else np.tile(home, (count, 1)),
    )


def contenders(drawn: IkTargets, *, with_peers: bool) -> dict[str, Solver]:
    """All solvers, hybrid first.

    Args:
        drawn: Arm, limits and accuracy.
        with_peers: The installed ones too.
    """
    chain = drawn.chain
    bar = BARS[drawn.bar]
    solvers: dict[str, Solver] = {
        method: partial(_own_solver, chain, method, bar) for method in METHODS
    }
    solvers[OBLIQUE] = lambda target, q0: (
        solve(chain, target, q0, *bar, method="plain", options=BY_JOINT).q
    )
    solvers[BASELINE] = baseline(drawn.task)
    return solvers | (peers(drawn.task) if with_peers else {})


def _own_solver(
    chain: Chain, method: Method, bar: tuple[float, float], target: Array, q0: Array
) -> Array:
    return solve(chain, target, q0, *bar, method=method).q


def race(drawn: IkTargets, solvers: Mapping[str, Solver], repeats: int) -> dict[str, SolverTimes]:
    """Runs all solvers in turns, a few targets at a time, so that a slow moment of the machine
    affects all alike.

    Args:
        drawn: Targets and starts.
        solvers: Solvers by name.
        repeats: Number of times that hybrid and the baseline solve each target; the median counts.
    """
    count = len(drawn.targets)
    lanes = list(solvers) + ["hybrid", BASELINE] * (repeats - 1)
    times = {name: [np.empty(count) for _ in range(lanes.count(name))] for name in solvers}
    answers = {name: np.empty((count, drawn.arm.n)) for name in solvers}
    clock = time.perf_counter_ns
    for solver in solvers.values():
        solver(drawn.targets[0], drawn.starts[0].copy())  # loads its code

    for first in range(0, count, BLOCK):
        # another solver begins each turn
        turn = first // BLOCK % len(lanes)
        taken = dict.fromkeys(solvers, 0)
        for name in lanes[turn:] + lanes[:turn]:
            solver = solvers[name]
            lane = times[name][taken[name]]
            answer = answers[name]
            taken[name] += 1
            for i in range(first, min(first + BLOCK, count)):
                target = drawn.targets[i]
                start = drawn.starts[i].copy()
                begin = clock()
                answer[i] = solver(target, start)
                lane[i] = 1e-9 * (clock() - begin)

    return {
        name: SolverTimes(good=reached(drawn, answers[name]), call=np.median(times[name], axis=0))
        for name in solvers
    }


def kernel_times(drawn: IkTargets, rounds: int) -> tuple[Array, Array]:
    """Mean times of a target [s] by round (rounds,), of hybrid and of the baseline, without Python
    between targets.

    Processor time of this thread, in the loop that `solve_many` gives to its threads.
    """
    chain = drawn.chain
    bar = BARS[drawn.bar]
    count = len(drawn.targets)
    dh, slides, limits, tool, J, A, X = arguments(drawn.task)
    many = entry("many")
    memory = chain._memory.copy()
    settings = Settings(HYBRID, *bar, *bar, 4000, 200, False, False)
    q = np.empty((count, chain.n))
    out = np.empty((count, 5))
    clock = time.thread_time

    pairs = []
    for _ in range(rounds + 1):
        begin = clock()
        many(memory, drawn.targets, drawn.starts, settings, 0, count, q, out)
        middle = clock()
        starts = drawn.starts.copy()
        solve_all(dh, slides, limits, tool, drawn.targets, starts, *bar, J, A, X)
        pairs.append((middle - begin, clock() - middle))

    ours, theirs = np.array(pairs[1:]).T / count  # the first round warms up
    return ours, theirs

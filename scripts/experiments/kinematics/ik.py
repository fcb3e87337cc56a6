"""Benchmark: inverse kinematics against its goals, a compiled baseline and installed peers.

    ./uvw run scripts/experiments/kinematics/ik.py

With the peers, on top of the project's environment (uv.lock and .venv stay as they are):

    PEERS=scripts/experiments/kinematics/ik_requirements.txt
    ./uvw run --with-requirements $PEERS scripts/experiments/kinematics/ik.py

KDL has no wheel: it takes part if PYTHONPATH has a folder with your distribution's PyKDL. Every
answer is checked by a forward kinematics of this file. In each case all solvers take turns, a few
targets at a time, so that a slow moment of the machine affects all alike. Compare times within one
run only. Exit code 0: the solve rates reach their goals.
"""

import json
import math
import os
import platform
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from experiments.kinematics.damped_least_squares import arguments, baseline, solve_all
from experiments.kinematics.ik_peers import Solver, SolverTask, peers, present
from experiments.kinematics.ik_tables import draw, tables
from uuv.controllers.ik.chain_kernels import HYBRID, Settings
from uuv.controllers.ik.entries import entry
from uuv.controllers.mkps import Chain, IkOptions, Method, solve, solve_many
from uuv.models.arms import published_arms as arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.evaluation.intervals import bootstrap_interval, middle, ratio_interval
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, readonly
from uuv.sim.interfaces.streams import Streams
from uuv.sim.runs.saving import write_whole
from uuv.start import new_folder, parse, run_scenario

BARS = {"A": (1e-4, 1e-3), "B": (1e-6, 1e-5)}  # [m], [rad] accuracies
METHODS: tuple[Method, ...] = ("hybrid", "jacobian_free", "plain")
BY_JOINT = IkOptions(stage_axes="joint")
OBLIQUE = "plain, joint's axes"  # for tools oblique to the last joint's axis
BASELINE = "compiled DLS"
GOAL_ARMS = ("puma560", "puma560_tool", "ur5", "iiwa7", "general6r")  # of the mean ratios
RATE_GOALS = {"hybrid": 0.999, "jacobian_free": 0.995}
OWN_LIMITS = 0  # as --limits: the arm's own limits, asymmetric ones included
REACH = math.radians(150.0)  # [rad] targets come from joint values within this
NEARBY = math.radians(5.0)  # [rad] a warm start is within this of a solution
HOME = np.array([0.1, -0.6, 0.7, 0.3, 0.6, 0.2, 0.1])  # [rad] cold starts
SLACK = 1.01  # times the bar: peers measure their errors differently
BLOCK = 25  # targets that a solver takes in one turn
RESAMPLES = 400  # of the bootstrap


@dataclass
class Options:
    """Solve rates and times of inverse kinematics."""

    out: Path | None = None
    """Folder for bench_ik.json, bench_ik.md and bench_ik.png."""
    arms: tuple[str, ...] = arms.available()
    """Names of the arms."""
    targets: int = 1000
    """Number of targets of a case in which all solvers take part."""
    rates: int = 10000
    """Number of targets of a case for the solve rates of our own methods."""
    limits: tuple[int, ...] = (180, 150)
    """Joint limits [deg], the same for every hinge; slides keep their own. 0: each arm's own
    limits.
    """
    links: tuple[int, ...] = (6, 12, 24, 60, 120, 240)
    """Number of links of the growing chain."""
    repeats: int = 3
    """Number of times that hybrid and the baseline solve each target; the median counts."""
    peers: bool = True
    """Include the installed peers (--no-peers)."""
    seed: int = 0
    """Seed of targets and starts."""
    quick: bool = False
    """The first three arms and few targets, to see the tables."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IkCase:
    """Targets that an arm can reach within its limits, and a start for each."""

    arm: PublishedArm
    degrees: int
    warm: bool
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

    def told(self) -> dict[str, Any]:
        """Entries that identify this case in the results."""
        start = "warm" if self.warm else "cold"
        return {"arm": self.arm.title, "limits_deg": self.degrees, "start": start, "bar": self.bar}


@dataclass(slots=True)
class Results:
    """All measurements, as in bench_ik.json."""

    machine: dict[str, Any]
    rates: list[dict[str, Any]] = field(default_factory=list)  # our methods, many targets
    race: list[dict[str, Any]] = field(default_factory=list)  # every solver, every case
    # geometric means over arms, relative to hybrid
    ratios: list[dict[str, Any]] = field(default_factory=list)
    kernel: list[dict[str, Any]] = field(default_factory=list)  # without Python
    growth: dict[str, Any] = field(default_factory=dict)  # by the number of links


def dh_forward(arm: SerialArm, q: Array) -> Array:
    """Tip poses (N, 4, 4) at joint values (N, n): the product of textbook DH matrices."""
    X = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for (theta, d, a, alpha), kind, value in zip(arm.dh, arm.joint_types, q.T, strict=True):
        turn, lift = (
            (theta + 0.0 * value, d + value) if kind == "p" else (theta + value, d + 0.0 * value)
        )
        c, s, ca, sa, zero = (
            np.cos(turn),
            np.sin(turn),
            math.cos(alpha),
            math.sin(alpha),
            0.0 * value,
        )
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


def reached(case: IkCase, q: Array) -> np.ndarray:
    """(N,) bool: joint values (N, n) bring the tip within the bar and keep the limits; False for
    NaN.
    """
    X, bar = dh_forward(case.arm, q), BARS[case.bar]
    D = np.swapaxes(X[:, :3, :3], 1, 2) @ case.targets[:, :3, :3]
    twice = np.stack(
        [D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=1
    )
    angle = np.arctan2(np.linalg.norm(twice, axis=1), np.trace(D, axis1=1, axis2=2) - 1.0)
    distance = np.linalg.norm(X[:, :3, 3] - case.targets[:, :3, 3], axis=1)
    kept = np.all((q >= case.limits[:, 0] - 1e-9) & (q <= case.limits[:, 1] + 1e-9), axis=1)
    return (distance <= SLACK * bar[0]) & (angle <= SLACK * bar[1]) & kept


def cases(options: Options, name: str, count: int) -> Iterator[IkCase]:
    """Yields every combination of limits, start and bar for an arm, all with the same joint values
    to be found.

    Args:
        options: Options of the benchmark.
        name: Name of the arm.
        count: Number of targets.
    """
    arm = arms.load(name)
    streams = Streams(options.seed)
    slides = np.array([kind == "p" for kind in arm.joint_types])
    bounds = np.where(slides[:, None], arm.limits, [-REACH, REACH])
    q = streams[f"{name}: targets"].uniform(*bounds.T, size=(count, arm.n))
    reach = np.where(slides, 0.05 * np.diff(bounds)[:, 0], NEARBY)
    near = np.clip(q + streams[f"{name}: starts"].uniform(-reach, reach, q.shape), *bounds.T)
    home = np.where(slides, bounds.mean(axis=1), HOME[: arm.n])
    targets = dh_forward(arm, q)
    for degrees in options.limits:
        limits = np.where(slides[:, None], arm.limits, np.radians([-degrees, degrees]))
        if degrees == OWN_LIMITS:
            limits = np.where(np.isfinite(arm.limits), arm.limits, [-np.pi, np.pi])
            q = streams[f"{name}: targets within"].uniform(*limits.T, size=(count, arm.n))
            off = streams[f"{name}: starts within"].uniform(-reach, reach, q.shape)
            near = np.clip(q + off, *limits.T)
            home, targets = np.clip(home, *limits.T), dh_forward(arm, q)
        for warm in (False, True):
            for bar in BARS:
                yield IkCase(
                    arm=arm,
                    degrees=degrees,
                    warm=warm,
                    bar=bar,
                    limits=readonly(limits),
                    targets=targets,
                    starts=near if warm else np.tile(home, (count, 1)),
                )


def own(chain: Chain, method: Method, bar: tuple[float, float], target: Array, q0: Array) -> Array:
    """Joint values (n,) from one call of our solver.

    Args:
        chain: The arm.
        method: Method of the solver.
        bar: [m], [rad] accuracy.
        target: (4, 4) tip pose.
        q0: (n,) start.
    """
    return solve(chain, target, q0, *bar, method=method).q


def rate(case: IkCase, method: Method) -> dict[str, Any]:
    """Row of the solve rate of one of our methods."""
    found = solve_many(case.chain, case.targets, case.starts, *BARS[case.bar], method=method)
    good = reached(case, found.q)
    return case.told() | {
        "method": method,
        "rate": float(np.mean(good)),
        "said": float(np.mean(found.converged)),
    }


def contenders(case: IkCase, options: Options) -> dict[str, Solver]:
    """All solvers for this case, hybrid first."""
    chain, bar = case.chain, BARS[case.bar]
    found: dict[str, Solver] = {method: partial(own, chain, method, bar) for method in METHODS}
    found[OBLIQUE] = lambda target, q0: (
        solve(chain, target, q0, *bar, method="plain", options=BY_JOINT).q
    )
    found[BASELINE] = baseline(case.task)
    return found | (peers(case.task) if options.peers else {})


def race(case: IkCase, solvers: dict[str, Solver], repeats: int) -> dict[str, tuple[float, Array]]:
    """Runs all solvers on a case in turns.

    Args:
        case: Targets and starts.
        solvers: Solvers by name.
        repeats: Number of times that hybrid and the baseline solve each target.

    Returns:
        By solver: share of targets reached, time of each call (N,) [us].
    """
    count = len(case.targets)
    lanes = list(solvers) + ["hybrid", BASELINE] * (repeats - 1)
    times = {name: [np.empty(count) for _ in range(lanes.count(name))] for name in solvers}
    answers = {name: np.empty((count, case.arm.n)) for name in solvers}
    clock = time.perf_counter_ns
    for solver in solvers.values():
        solver(case.targets[0], case.starts[0].copy())
    for first in range(0, count, BLOCK):
        turn = first // BLOCK % len(lanes)
        took = dict.fromkeys(solvers, 0)
        for name in lanes[turn:] + lanes[:turn]:
            solver, lane, answer = solvers[name], times[name][took[name]], answers[name]
            took[name] += 1
            for i in range(first, min(first + BLOCK, count)):
                target, start = case.targets[i], case.starts[i].copy()
                begin = clock()
                answer[i] = solver(target, start)
                lane[i] = 1e-3 * (clock() - begin)
    return {
        name: (float(np.mean(reached(case, answers[name]))), np.median(times[name], axis=0))
        for name in solvers
    }


def race_all(options: Options, results: Results, progress: Progress) -> None:
    """Runs every case of every arm, then computes ratios to hybrid with intervals.

    Args:
        options: Options of the benchmark.
        results: Filled in.
        progress: Progress display.
    """
    rng = np.random.default_rng(options.seed)
    # log ratio and its resamples, by case and arm
    logs: dict[tuple[str, ...], dict[str, tuple[float, Array]]] = {}
    bar = progress.add_task("race", total=len(options.arms) * len(options.limits) * 2 * len(BARS))
    for name in options.arms:
        for case in cases(options, name, options.targets):
            found = race(case, contenders(case, options), options.repeats)
            hybrid = found["hybrid"][1]

            # All solvers of a case are compared over the same resamples of its targets.
            seed = rng.integers(2**32)
            for method, (share, times) in found.items():
                interval = ratio_interval(times, hybrid, np.random.default_rng(seed), RESAMPLES)
                ratio = float(np.median(times) / np.median(hybrid))
                row = {"method": method, "rate": share, "median_us": float(np.median(times))}
                row |= {
                    "p95_us": float(np.quantile(times, 0.95)),
                    "ratio": ratio,
                    "ratio_95": [interval.low, interval.high],
                }
                results.race.append(case.told() | row)
                key = (str(case.degrees), "warm" if case.warm else "cold", case.bar, method)
                logs.setdefault(key, {})[name] = math.log(ratio), np.log(interval.resampled)
            progress.advance(bar)

    for (degrees, start, accuracy, method), by_arm in logs.items():
        for scope, wanted in (("goal arms", GOAL_ARMS), ("all arms", options.arms)):
            chosen = [by_arm[name] for name in wanted if name in by_arm]
            if chosen:
                row = {
                    "scope": scope,
                    "limits_deg": int(degrees),
                    "start": start,
                    "bar": accuracy,
                    "method": method,
                }
                row |= {
                    "arms": len(chosen),
                    "ratio": math.exp(float(np.mean([log for log, _ in chosen]))),
                }
                means = np.exp(np.mean([logs for _, logs in chosen], axis=0))
                row["ratio_95"] = [float(end) for end in middle(means)]
                results.ratios.append(row)


def kernel(case: IkCase, rounds: int) -> dict[str, Any]:
    """Mean time for a target [us] without Python between targets: hybrid, the baseline, their
    ratio.

    Medians over the rounds, with the middle 95 % of the ratio's median by bootstrap. Processor time
    of this thread, in the loop that `solve_many` gives to its threads.
    """
    chain, bar, count = case.chain, BARS[case.bar], len(case.targets)
    dh, slides, limits, tool, J, A, X = arguments(case.task)
    many, memory, settings = (
        entry("many"),
        chain._memory.copy(),
        Settings(HYBRID, *bar, *bar, 4000, 200, False, False),
    )
    q, out, clock = np.empty((count, chain.n)), np.empty((count, 5)), time.thread_time
    pairs = []
    for _ in range(rounds + 1):
        begin = clock()
        many(memory, case.targets, case.starts, settings, 0, count, q, out)
        between = clock()
        solve_all(dh, slides, limits, tool, case.targets, case.starts.copy(), *bar, J, A, X)
        pairs.append((between - begin, clock() - between))
    ours, theirs = 1e6 / count * np.array(pairs[1:]).T  # the first round warms up
    draws = np.random.default_rng(0)
    interval = bootstrap_interval(np.median, theirs / ours, rng=draws, resamples=RESAMPLES)
    return case.told() | {
        "hybrid_us": float(np.median(ours)),
        "baseline_us": float(np.median(theirs)),
        "hybrid_best_us": float(ours.min()),
        "baseline_best_us": float(theirs.min()),
        "ratio": float(np.median(theirs / ours)),
        "ratio_95": [interval.low, interval.high],
    }


def snake(links: int) -> PublishedArm:
    """A chain of 3 m with `links` links, its axes perpendicular in turn."""
    alpha = np.where(np.arange(links) % 2, 0.5 * math.pi, -0.5 * math.pi)
    rows = np.column_stack([np.zeros(links), np.zeros(links), np.full(links, 3.0 / links), alpha])
    limits = np.tile([-math.pi, math.pi], (links, 1))
    return replace(
        PublishedArm.from_dh(rows), title=f"{links} links", limits=limits, source="made up"
    )


def growth(options: Options, progress: Progress) -> dict[str, Any]:
    """Median time [us] of a solve at bar A by the number of links, with fitted exponents; targets
    are random bends.
    """
    times: dict[str, list[float]] = {}
    shares: dict[str, list[float]] = {}
    for n in progress.track(options.links, description="growth"):
        streams, arm = Streams(options.seed, n), snake(n)
        bend = min(1.0, 2.4 / math.sqrt(n))
        count = min(options.targets, 50)
        targets = dh_forward(arm, streams["targets"].uniform(-bend, bend, (count, n)))
        case = IkCase(
            arm=arm,
            degrees=180,
            warm=False,
            bar="A",
            limits=arm.limits,
            targets=targets,
            starts=streams["starts"].uniform(-0.1, 0.1, (count, n)),
        )
        solvers = contenders(case, Options(peers=False))
        del solvers[OBLIQUE]
        for method, (share, each) in race(case, solvers, options.repeats).items():
            times.setdefault(method, []).append(float(np.median(each)))
            shares.setdefault(method, []).append(share)
    found: dict[str, Any] = {"links": list(options.links), "median_us": times, "rate": shares}
    found["exponent"] = {}
    long = [i for i, n in enumerate(options.links) if n >= 24]
    for method, values in times.items():
        if len(long) > 1:
            slope = np.polyfit(
                np.log([options.links[i] for i in long]), np.log([values[i] for i in long]), 1
            )[0]
            found["exponent"][method] = float(slope)
    return found


def machine() -> dict[str, Any]:
    """Processor, load and versions of the packages."""
    packages = {}
    for name in (
        "numpy",
        "numba",
        "mujoco",
        "pytracik",
        "eaik",
        "ikdh",
        "optik-py",
        "pin",
        "mink",
        "pin-pink",
        "roboticstoolbox-python",
    ):
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            continue
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load_at_start": load,
        "python": platform.python_version(),
        "packages": packages,
    }


def main() -> int:
    """Runs the benchmark and writes its files; exit code 0 if the solve rates reach their goals."""
    options = parse(Options)
    if options.quick:
        options.arms, options.targets, options.rates = options.arms[:3], 25, 250
        options.limits, options.links, options.repeats = options.limits[:1], (6, 24, 60), 1
    for name in ("rates", "targets", "repeats"):
        if getattr(options, name) < 1:
            raise ConfigurationError(f"--{name}: must be at least 1, got {getattr(options, name)}")
    if not options.limits or not all(
        value == OWN_LIMITS or 0 < value <= 360 for value in options.limits
    ):
        raise ConfigurationError(
            f"--limits: 1 to 360 deg, or {OWN_LIMITS} for the arm's own, got {options.limits}"
        )
    if not options.links or min(options.links) < 1:
        raise ConfigurationError(f"--links: every chain needs at least one, got {options.links}")
    for name in options.arms:
        arms.load(name)
    folder = new_folder("bench_ik", options.out, options.seed)
    console = Console(width=None if sys.stdout.isatty() else 160)
    results = Results(machine())
    columns = (
        TextColumn("{task.description:<8}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task(
            "rates", total=len(options.arms) * len(options.limits) * 4 * len(METHODS)
        )
        for name in options.arms:
            for case in cases(options, name, options.rates):
                for method in METHODS:
                    results.rates.append(rate(case, method))
                    progress.advance(bar)
        race_all(options, results, progress)
        for name in progress.track(options.arms, description="kernel"):
            for case in cases(options, name, options.targets):
                if case.bar == "A" and case.degrees == options.limits[0]:
                    results.kernel.append(kernel(case, 5 * options.repeats))
        results.growth = growth(options, progress)
    write_whole(folder / "bench_ik.json", json.dumps(vars_of(results), indent=1))
    missing = [] if not options.peers else [name for name, here in present().items() if not here]
    shown = tables(vars_of(results), options.limits[0])
    text = []
    for table in shown:
        console.print(table.printed())
        text.append(table.markdown())
    if missing:
        console.print(f"not in this Python: {', '.join(missing)}")
    (folder / "bench_ik.md").write_text("\n\n".join(text) + "\n")
    draw(vars_of(results), options.limits[0], folder / "bench_ik.png")
    console.print(f"written to {folder}/", highlight=False)
    worst = {m: min(row["rate"] for row in results.rates if row["method"] == m) for m in RATE_GOALS}
    return 0 if all(worst[m] >= goal for m, goal in RATE_GOALS.items()) else 1


def vars_of(results: Results) -> dict[str, Any]:
    """Fields of `results` as a dictionary."""
    return {name: getattr(results, name) for name in Results.__slots__}


if __name__ == "__main__":
    run_scenario(main)

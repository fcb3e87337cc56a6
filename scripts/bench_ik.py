"""Inverse kinematics against its goals: solve rates and times a call, growth with the number of links.

`./uvw run scripts/bench_ik.py` prints tables and draws `ik.png`; only ratios inside one run compare. Peers take part if
they can be imported (pytracik; EAIK; ikdh), which means an environment of their own.
"""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from _start import parse, run_scenario
from matplotlib.figure import Figure
from numba import njit
from rich.console import Console
from rich.table import Table

from controllers.mkps import Chain, Method, solve, solve_many
from sim.interfaces.spatial import Array, exp_so3, log_so3, pose, quat_wxyz_from_rotation

H = math.pi / 2
PUMA = [(0, 0, 0, H), (0, 0, 0.4318, 0), (0, 0.15005, 0.0203, -H), (0, 0.4318, 0, H), (0, 0, 0, -H), (0, 0, 0, 0)]
ARMS = {  # standard DH [rad, m]; the five of the goals, then arms that nothing was tuned on
    "PUMA": PUMA,
    "PUMA, tool": PUMA,
    "UR5": [
        (0, 0.089159, 0, H),
        (0, 0, -0.425, 0),
        (0, 0, -0.39225, 0),
        (0, 0.10915, 0, H),
        (0, 0.09465, 0, -H),
        (0, 0.0823, 0, 0),
    ],
    "iiwa": [
        (0, 0.34, 0, -H),
        (0, 0, 0, H),
        (0, 0.4, 0, H),
        (0, 0, 0, -H),
        (0, 0.4, 0, -H),
        (0, 0, 0, H),
        (0, 0.126, 0, 0),
    ],
    "general 6R": [
        (0.1, 0.3, 0.1, 1.2),
        (0.2, 0.1, 0.4, -0.4),
        (0.3, 0.15, 0.35, 1.0),
        (-0.2, 0.2, 0.1, -1.3),
        (0.4, 0.1, 0.15, 1.1),
        (0.1, 0.12, 0.05, 0),
    ],
    "Panda": [
        (0, 0.333, 0, -H),
        (0, 0, 0, H),
        (0, 0.316, 0.0825, H),
        (0, 0, -0.0825, -H),
        (0, 0.384, 0, H),
        (0, 0, 0.088, H),
        (0, 0.107, 0, 0),
    ],
    "xArm7": [
        (0, 0.267, 0, -H),
        (0, 0, 0, H),
        (0, 0.293, 0.0525, H),
        (0, 0, 0.0775, H),
        (0, 0.3425, 0, H),
        (0, 0, 0.076, -H),
        (0, 0.097, 0, 0),
    ],
    "UR10e": [
        (0, 0.1807, 0, H),
        (0, 0, -0.6127, 0),
        (0, 0, -0.57155, 0),
        (0, 0.17415, 0, H),
        (0, 0.11985, 0, -H),
        (0, 0.11655, 0, 0),
    ],
}
TOOL = pose(p=[0.05, 0.03, 0.2])
HOME = np.array([0.1, -0.6, 0.7, 0.3, 0.6, 0.2, 0.1])  # [rad] cold starts
BARS = {"A": (1e-4, 1e-3), "B": (1e-6, 1e-5)}  # [m], [rad]
METHODS: tuple[Method, ...] = ("hybrid", "jacobian_free", "plain")
REACH = math.radians(150)  # targets come from joint values within this
Solver = Callable[[Array, Array], Array]


@dataclass
class Options:
    """Solve rates and times of inverse kinematics."""

    out: Path = Path("runs/bench_ik")  # where the picture goes
    targets: int = 200  # a case
    rates: int = 2000  # targets a case of the solve-rate table
    links: tuple[int, ...] = (6, 12, 24, 60, 120, 240)  # of the growing chain
    seed: int = 0


@njit(cache=True, nogil=True, error_model="numpy")
def damped_least_squares(dh, tool, target, q, tol_p, tol_r, trials, A, X, axes, points):
    """The baseline: textbook DLS on a hinge chain, lambda^2 = 0.1 |e|^2, 60 steps a start, restarts; True if solved."""
    n = dh.shape[0]
    e = np.empty(6)
    for trial in range(trials):
        for i in range(n if trial else 0):
            q[i] = 2.0 * math.pi * (math.sin(12.9898 * (trial * n + i)) * 43758.5453 % 1.0) - math.pi
        for _ in range(60):
            X[:] = 0.0
            for r in range(4):
                X[r, r] = 1.0
            for i in range(n + 1):
                c, s, ca, sa = 1.0, 0.0, 1.0, 0.0
                if i < n:
                    axes[i], points[i] = X[:3, 2], X[:3, 3]
                    c, s = math.cos(dh[i, 0] + q[i]), math.sin(dh[i, 0] + q[i])
                    ca, sa = math.cos(dh[i, 3]), math.sin(dh[i, 3])
                for r in range(3):
                    x, y, z, p = X[r, 0], X[r, 1], X[r, 2], X[r, 3]
                    if i < n:
                        X[r, 0], v = c * x + s * y, c * y - s * x
                        X[r, 1], X[r, 2] = ca * v + sa * z, ca * z - sa * v
                        X[r, 3] = p + dh[i, 2] * X[r, 0] + dh[i, 1] * z
                    else:
                        for k in range(3):
                            X[r, k] = x * tool[0, k] + y * tool[1, k] + z * tool[2, k]
                        X[r, 3] = x * tool[0, 3] + y * tool[1, 3] + z * tool[2, 3] + p
            for k in range(3):
                e[k], e[3 + k] = target[k, 3] - X[k, 3], 0.0
                a, b = (k + 1) % 3, (k + 2) % 3
                for m in range(3):
                    e[3 + k] += 0.5 * (X[a, m] * target[b, m] - X[b, m] * target[a, m])
            cosine = -0.5
            for k in range(3):
                for m in range(3):
                    cosine += 0.5 * X[k, m] * target[k, m]
            sine = math.sqrt(e[3] ** 2 + e[4] ** 2 + e[5] ** 2)
            angle = math.atan2(sine, cosine)
            if sine > 1e-9:
                e[3:] *= angle / sine
            square = e[0] ** 2 + e[1] ** 2 + e[2] ** 2
            if square <= tol_p**2 and angle <= tol_r:
                return True
            A[:] = 0.0
            for k in range(6):
                A[k, k] = 0.1 * (square + angle * angle) + 1e-12
                A[k, 6] = e[k]
            for i in range(n):
                for k in range(3):
                    a, b = (k + 1) % 3, (k + 2) % 3
                    A[6, k] = axes[i, a] * (X[b, 3] - points[i, b]) - axes[i, b] * (X[a, 3] - points[i, a])
                    A[6, 3 + k] = axes[i, k]
                for k in range(6):
                    for m in range(6):
                        A[k, m] += A[6, k] * A[6, m]
            for k in range(6):
                for r in range(k + 1, 6):
                    f = A[r, k] / A[k, k]
                    for m in range(k, 7):
                        A[r, m] -= f * A[k, m]
            for k in range(5, -1, -1):
                for m in range(k + 1, 6):
                    A[k, 6] -= A[k, m] * A[m, 6]
                A[k, 6] /= A[k, k]
            for i in range(n):
                for k in range(3):
                    a, b = (k + 1) % 3, (k + 2) % 3
                    linear = axes[i, a] * (X[b, 3] - points[i, b]) - axes[i, b] * (X[a, 3] - points[i, a])
                    q[i] += linear * A[k, 6] + axes[i, k] * A[3 + k, 6]
    return False


def baseline(dh: Array, tool: Array, bar: tuple[float, float]) -> Solver:
    """`damped_least_squares` behind the same kind of call as `solve`."""
    n = len(dh)
    scratch = np.empty((7, 7)), np.empty((4, 4)), np.empty((n, 3)), np.empty((n, 3))

    def call(target: Array, q0: Array) -> Array:
        q = q0.copy()
        damped_least_squares(dh, tool, target, q, *bar, 100, *scratch)
        return q

    return call


def own(chain: Chain, method: Method, bar: tuple[float, float], target: Array, q0: Array) -> Array:
    return solve(chain, target, q0, *bar, method=method).q


def urdf(dh: Array, tool: Array) -> str:
    """The hinge chain as TRAC-IK wants it; the tool without rotation."""
    parts, xyz, rpy = ['<robot name="arm"><link name="link0"/>'], np.zeros(3), np.zeros(3)
    for i, (theta, d, a, alpha) in enumerate([*dh, (0.0, 0.0, 0.0, 0.0)]):
        kind = "revolute" if i < len(dh) else "fixed"
        parts.append(
            f'<link name="link{i + 1}"/><joint name="joint{i + 1}" type="{kind}"><parent link="link{i}"/>'
            f'<child link="link{i + 1}"/><origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/>'
            f'<axis xyz="0 0 1"/><limit lower="{-math.pi}" upper="{math.pi}" effort="1" velocity="1"/></joint>'
        )
        xyz, rpy = np.array([a * math.cos(theta), a * math.sin(theta), d]), np.array([alpha, 0.0, theta])
        if i == len(dh) - 1:
            xyz += exp_so3([0.0, 0.0, theta]) @ exp_so3([alpha, 0.0, 0.0]) @ tool[:3, 3]
    return "".join(parts) + "</robot>"


def peers(dh: Array, tool: Array, bar: tuple[float, float]) -> dict[str, Solver]:
    """The peers that this Python has and that take this arm; a failed search gives NaN."""
    found: dict[str, Solver] = {}
    n = len(dh)
    to_flange = np.linalg.inv(tool)
    if n == 6 and find_spec("eaik"):
        robot = import_module("eaik.IK_DH").DhRobot(dh[:, 3], dh[:, 2], dh[:, 1])

        def analytic(target: Array, q0: Array) -> Array:
            all_branches = robot.IK(target @ to_flange)
            answers = np.asarray(all_branches.Q)
            if answers.size:
                answers = answers[~np.asarray(all_branches.is_LS, dtype=bool)]  # least squares: not quite there
            if answers.size == 0:
                return np.full(n, np.nan)
            turns = (answers - dh[:, 0] - q0 + math.pi) % (2.0 * math.pi) - math.pi
            return q0 + turns[int(np.argmin(np.abs(turns).max(axis=1)))]

        if robot.hasKnownDecomposition():
            found["EAIK"] = analytic
    if n == 6 and find_spec("ikdh"):
        ikdh = import_module("ikdh")
        table = ikdh.DHTable(*(list(dh[:, k]) for k in (2, 1, 3, 0)))
        solver = ikdh.Solver(table)

        def seeded(target: Array, q0: Array) -> Array:
            answers = solver.solve_from_seed(target @ to_flange, np.degrees(q0))
            return np.radians(answers[0]) if answers else np.full(n, np.nan)

        found["ikdh_seed"] = seeded
    if find_spec("pytracik"):
        trac = import_module("pytracik")
        chain = trac.TRAC_IK("link0", f"link{n + 1}", urdf(dh, tool), 0.005, bar[0], trac.SolveType.Speed)

        def timed(target: Array, q0: Array) -> Array:
            w, x, y, z = quat_wxyz_from_rotation(target[:3, :3])
            answer = trac.ik(chain, q0, *target[:3, 3], x, y, z, w)
            return answer[1:] if answer[0] >= 0.0 else np.full(n, np.nan)  # it leads with how many it found

        found["TRAC-IK 5 ms"] = timed
    return found


def case(name: str, warm: bool, count: int, degrees: float | None, seed: int) -> tuple[Chain, Array, Array, Array]:
    """A chain, `count` targets that it can reach, a start for each, and the tool."""
    rng = np.random.default_rng(seed)
    dh, tool = np.array(ARMS[name], dtype=float), TOOL if "tool" in name else np.eye(4)
    n = len(dh)
    limits = None if degrees is None else np.tile([-math.radians(degrees), math.radians(degrees)], (n, 1))
    chain = Chain.from_dh(dh, limits=limits, tool=tool)
    q = rng.uniform(-REACH, REACH, (count, n))
    near = np.clip(q + rng.uniform(-math.radians(5), math.radians(5), q.shape), -REACH, REACH)
    return chain, np.array([chain.forward(v) for v in q]), near if warm else np.tile(HOME[:n], (count, 1)), tool


def judged(
    chain: Chain, solver: Solver, targets: Array, starts: Array, bar: tuple[float, float]
) -> tuple[float, Array]:
    """Rate of answers within the bar, by forward kinematics, and the time of each call [us], a first one apart."""
    solved, times = 0, np.empty(len(targets))
    solver(targets[0], starts[0])
    for i, (target, start) in enumerate(zip(targets, starts, strict=True)):
        begin = time.perf_counter_ns()
        q = solver(target, start)
        times[i] = (time.perf_counter_ns() - begin) * 1e-3
        if np.all(np.isfinite(q)):
            X = chain.forward(q)
            turn = float(np.linalg.norm(log_so3(X[:3, :3].T @ target[:3, :3])))
            solved += bool(np.linalg.norm(X[:3, 3] - target[:3, 3]) <= 1.01 * bar[0] and turn <= 1.01 * bar[1])
    return solved / len(targets), times


def compare(options: Options) -> Table:
    """Our methods, the baseline and the peers, without limits, bar A: rate and median time over the five arms."""
    rows: dict[str, dict[bool, list[tuple[float, float]]]] = {}
    for name in list(ARMS)[:5]:
        for warm in (False, True):
            chain, targets, starts, tool = case(name, warm, options.targets, None, options.seed)
            dh = np.array(ARMS[name], dtype=float)
            solvers: dict[str, Solver] = {method: partial(own, chain, method, BARS["A"]) for method in METHODS}
            solvers |= {"compiled DLS": baseline(dh, tool, BARS["A"])} | peers(dh, tool, BARS["A"])
            for method, solver in solvers.items():
                rate, times = judged(chain, solver, targets, starts, BARS["A"])
                rows.setdefault(method, {False: [], True: []})[warm].append((rate, float(np.median(times))))
    table = Table(title="Five arms, no limits, bar A: worst rate, geometric mean of medians a Python call")
    for column in ("method", "arms", "cold %", "cold [us]", "warm %", "warm [us]"):
        table.add_column(column, justify="right")
    for method, by_start in rows.items():
        cells = []
        for warm in (False, True):
            rates, medians = zip(*by_start[warm], strict=True)
            cells += [f"{100 * min(rates):.1f}", f"{math.exp(np.mean(np.log(medians))):.1f}"]
        table.add_row(method, str(len(by_start[False])), *cells)
    return table


def rates(options: Options) -> tuple[Table, bool]:
    """Solve rates of the default method, every arm, bar, limit and start; whether all reach the goal of 99.9 %."""
    table = Table(title="hybrid: solve rate %, targets within 150 deg, the worse of bars A and B")
    table.add_column("arm", no_wrap=True)
    cases = [(degrees, warm) for degrees in (None, 180.0, 150.0) for warm in (False, True)]
    for degrees, warm in cases:
        table.add_column(
            f"{'no limit' if degrees is None else f'{degrees:.0f} deg'}\n{'warm' if warm else 'cold'}", justify="right"
        )
    good = True
    for name in ARMS:
        found = []
        for degrees, warm in cases:
            chain, targets, starts, _ = case(name, warm, options.rates, degrees, options.seed)
            found.append(min(float(np.mean(solve_many(chain, targets, starts, *b).converged)) for b in BARS.values()))
        good &= min(found) >= 0.999
        table.add_row(name, *(f"{100 * rate:.2f}" for rate in found))
    return table, good


def growth(options: Options) -> dict[str, list[float]]:
    """Median time [us] of a solve, bar A, by the number of links of a 3 m chain bent at random."""
    found: dict[str, list[float]] = {}
    for n in options.links:
        rng = np.random.default_rng(options.seed)
        dh = np.column_stack([np.zeros(n), np.zeros(n), np.full(n, 3.0 / n), np.where(np.arange(n) % 2, H, -H)])
        chain, bend = Chain.from_dh(dh), min(1.0, 2.4 / math.sqrt(n))
        targets = np.array([chain.forward(rng.uniform(-bend, bend, n)) for _ in range(20)])
        starts = np.tile(rng.uniform(-0.1, 0.1, n), (20, 1))
        solvers: dict[str, Solver] = {method: partial(own, chain, method, BARS["A"]) for method in METHODS[:2]}
        solvers["compiled DLS"] = baseline(dh, np.eye(4), BARS["A"])
        for method, solver in solvers.items():
            times = judged(chain, solver, targets, starts, BARS["A"])[1]
            found.setdefault(method, []).append(float(np.median(times)))
    return found


def draw(links: tuple[int, ...], times: dict[str, list[float]], path: Path) -> None:
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    for method, values in times.items():
        axes.loglog(links, values, marker="o", label=method)
    axes.set(xlabel="links", ylabel="median time of a solve [us]", title="Growth with the number of links, bar A")
    axes.grid(alpha=0.3)
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def main() -> int:
    options = parse(Options)
    console = Console()
    console.print("The solvers are compiled on first use (about 20 s)")
    table, good = rates(options)
    console.print(table)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core for the times
    console.print(compare(options))
    times = growth(options)
    table = Table("links", *times, title="Growth with the number of links: median time of a solve [us]")
    for i, n in enumerate(options.links):
        table.add_row(str(n), *(f"{values[i]:.1f}" for values in times.values()))
    console.print(table)
    draw(options.links, times, options.out / "ik.png")
    console.print(f"picture: {options.out / 'ik.png'}")
    return 0 if good else 1


if __name__ == "__main__":
    run_scenario(main)

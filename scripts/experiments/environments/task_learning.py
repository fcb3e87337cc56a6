"""Benchmark: a linear policy learns a task by the cross-entropy method, on all cores.

    LEARN=scripts/experiments/environments/task_learning.py
    ./uvw run $LEARN --task water/hover --actions hull_wrench
    ./uvw run $LEARN --task water/reach

The action is a matrix times what is observed: the goal and the velocities in the vehicle's own
axes, in SI units. A generation draws matrices from a normal distribution, lets each act in the same
episode, and moves the distribution towards the best quarter. At the end its mean and the policy of
the start, which does nothing, act in the same fresh episodes. Writes learning.json and the curve,
learning.png.
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from uuv import environments as composer
from uuv.environments.episodes import run_episode
from uuv.experiment.options import at_least
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import Array, finite_number
from uuv.sim.runs.saving import write_json

FRESH = 20  # episodes of the comparison
# beside the goals
SEEN = ("vehicle/velocity", "vehicle/angular_velocity", "vehicle/arm/joint_velocity")
BEST = 0.25  # share of a generation that the distribution moves towards
SMOOTH = 0.7  # share of that move
LEAST = 0.1  # share of its first standard deviation that a parameter keeps


@dataclass(kw_only=True)
class Options:
    """Learning a task by the cross-entropy method."""

    task: str = "water/hover"
    """Task as DOMAIN/TASK."""
    actions: str | None = None
    """Kind of action; default: the task's usual one."""
    minutes: float = 2.5
    """Time to learn for."""
    population: int = 32
    """Policies of a generation."""
    spread: float = 0.7
    """Standard deviation of a parameter at the start."""
    time_limit: float = 7.0
    """Seconds of an episode, simulated."""
    seed: int = 0
    """Seed of the draws and episodes."""
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        at_least(self, population=8)
        for name in ("minutes", "spread", "time_limit"):
            finite_number(getattr(self, name), f"--{name.replace('_', '-')}", above=0.0)


@dataclass(frozen=True)
class Setting:
    """What the episodes have in common."""

    task: str
    actions: str | None
    time_limit: float  # [s]

    def environment(self) -> Any:
        """The environment, made once in a process."""
        return _loaded(self)


@cache
def _loaded(setting: Setting) -> Any:
    domain, _, name = setting.task.partition("/")
    return composer.load(domain, name, actions=setting.actions, time_limit=setting.time_limit)


def observed(observation: dict[str, Array]) -> Array:
    """Goal and velocities, in the vehicle's own axes."""
    return np.concatenate(
        [entry for name, entry in observation.items() if "goal" in name or name in SEEN]
    )


def act(setting: Setting, parameters: Array, seed: int) -> float:
    """Return of a linear policy in one episode."""
    environment = setting.environment()
    environment.random_state.seed(seed)

    gain = parameters.reshape(environment.action_spec().shape[0], -1)
    return run_episode(
        environment, lambda moment: np.clip(gain @ observed(moment.observation), -1.0, 1.0)
    ).total


def main() -> int:
    """Learns, and returns 0 if the learnt policy is better than that of the start by three standard
    errors.
    """
    options = parse(Options)
    console = Console()
    folder = new_folder("task_learning", options.out, options.seed)

    setting = Setting(options.task, options.actions, options.time_limit)
    rng = np.random.default_rng(options.seed)

    environment = setting.environment()
    pool = ProcessPoolExecutor(os.cpu_count())
    size = environment.action_spec().shape[0] * len(observed(environment.reset().observation))

    def totals(policies: Array, seeds: np.ndarray) -> Array:
        return np.array(list(pool.map(act, [setting] * len(policies), policies, seeds.tolist())))

    mean = np.zeros(size)
    deviation = np.full(size, options.spread)
    curve = []
    begin = time.perf_counter()

    while (spent := time.perf_counter() - begin) < 60.0 * options.minutes:
        drawn = mean + deviation * rng.standard_normal((options.population, size))
        returns = totals(drawn, np.full(options.population, rng.integers(2**31)))

        # The distribution moves towards the best quarter.
        best = drawn[np.argsort(returns)[-max(2, round(BEST * options.population)) :]]
        mean = mean + SMOOTH * (best.mean(axis=0) - mean)
        deviation = np.sqrt((1.0 - SMOOTH) * deviation**2 + SMOOTH * best.var(axis=0))
        deviation = np.maximum(deviation, LEAST * options.spread)

        curve.append({"time_s": spent, "mean": float(returns.mean()), "best": float(returns.max())})
        if len(curve) % 5 == 0:
            console.print(
                f"generation {len(curve):3d}, {spent:4.0f} s: mean return {returns.mean():6.1f}"
            )

    # The mean and the policy of the start, in the same fresh episodes.
    fresh = rng.integers(2**31, size=FRESH)
    before = totals(np.zeros((FRESH, size)), fresh)
    after = totals(np.tile(mean, (FRESH, 1)), fresh)
    error = float(np.hypot(before.std(ddof=1), after.std(ddof=1)) / np.sqrt(FRESH))
    gain = float(after.mean() - before.mean())

    verdict = (
        f"return {before.mean():.1f} before, {after.mean():.1f} after, {gain / error:.1f} "
        "standard errors more"
    )
    console.print(f"{options.task}, {FRESH} fresh episodes: {verdict}")

    figures = {
        "before": before.tolist(),
        "after": after.tolist(),
        "standard_errors": gain / error,
        "curve": curve,
    }
    learnt = {"task": options.task, "actions": options.actions, "parameters": mean.tolist()}

    write_json(folder / "learning.json", {**learnt, **figures})
    _draw(folder / "learning.png", curve, options.task)
    console.print(f"in {folder}")
    return 0 if gain > 3.0 * error else 1


def _draw(file: Path, curve: list[dict[str, float]], task: str) -> None:
    with wanted():
        from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()

    times = [generation["time_s"] for generation in curve]
    axes.plot(
        times,
        [generation["best"] for generation in curve],
        linewidth=0.8,
        alpha=0.6,
        label="best of a generation",
    )
    axes.plot(times, [generation["mean"] for generation in curve], label="mean of a generation")
    axes.set(xlabel="time [s]", ylabel="return of an episode", title=task)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    run_scenario(main)

"""Benchmark: a linear policy learns a task by random search, on all cores.

    ./uvw run scripts/benchmarks/task_learning.py --task water/hover --actions hull_wrench --minutes 4
    ./uvw run scripts/benchmarks/task_learning.py --task water/reach --minutes 4

Augmented random search [Mania 2018]: pairs of policies, each a step to either side of the present one, act in the same
episode. The present policy moves along the directions that made the most difference. At the end it and the policy of
the start, which does nothing, act in the same fresh episodes. Writes learning.json and the curve, learning.png.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from scenarios import composer
from scenarios.composer.episodes import run_episode
from scenarios.study.options import at_least
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.extras import wanted
from sim.interfaces.spatial import Array, finite_number
from sim.runs.saving import write_json

FRESH = 20  # episodes of the comparison
FIRST = 3  # episodes of random actions that tell how large the observed numbers are


@dataclass(kw_only=True)
class Options:
    """Learning a task by random search."""

    task: str = "water/hover"
    """Task as DOMAIN/TASK."""
    actions: str | None = None
    """Kind of action; default: the task's usual one."""
    minutes: float = 4.0
    """Time to learn for."""
    directions: int = 8
    """Pairs of policies in a round."""
    best: int = 4
    """Pairs that count."""
    spread: float = 0.3
    """Step of a parameter to either side."""
    rate: float = 0.4
    """Step of the present policy, in standard deviations of the return."""
    time_limit: float = 6.0
    """Seconds of an episode, simulated."""
    seed: int = 0
    """Seed of the draws and episodes."""
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        at_least(self, directions=1, best=1)
        for name in ("minutes", "spread", "rate", "time_limit"):
            finite_number(getattr(self, name), f"--{name.replace('_', '-')}", above=0.0)
        if self.best > self.directions:
            raise ConfigurationError(f"--best {self.best}: at most the {self.directions} of --directions")


@dataclass(frozen=True)
class Setting:
    """What the episodes have in common."""

    task: str
    actions: str | None
    time_limit: float  # [s]

    def environment(self) -> Any:
        """The environment, made once in a process."""
        return _made(self)


@cache
def _made(setting: Setting) -> Any:
    domain, _, name = setting.task.partition("/")
    return composer.load(domain, name, actions=setting.actions, time_limit=setting.time_limit)


def observed(observation: dict[str, Array]) -> Array:
    """Goal and velocities, in the vehicle's own axes."""
    return np.concatenate([value for name, value in observation.items() if "goal" in name or "velocity" in name])


def act(setting: Setting, parameters: Array, scale: Array, seed: int) -> float:
    """Return of a linear policy in one episode; `scale` divides what it observes."""
    environment = setting.environment()
    environment.random_state.seed(seed)
    gain = parameters.reshape(environment.action_spec().shape[0], -1)
    return run_episode(
        environment, lambda moment: np.clip(gain @ np.append(observed(moment.observation) / scale, 1.0), -1.0, 1.0)
    ).total


def scale_of(setting: Setting, rng: np.random.Generator) -> Array:
    """Root mean squares of the observed numbers under random actions."""
    environment, rows = setting.environment(), []
    for _ in range(FIRST):
        action = rng.uniform(-0.3, 0.3, environment.action_spec().shape)

        def policy(moment: Any, action: Array = action) -> Array:
            rows.append(observed(moment.observation))
            return action

        environment.random_state.seed(int(rng.integers(2**31)))
        run_episode(environment, policy)
    return np.sqrt(np.mean(np.square(rows), axis=0)) + 1e-6


def main() -> int:
    """Learns, and returns 0 if the learnt policy is better than that of the start by three standard errors."""
    options, console = parse(Options), Console()
    folder = new_folder("task_learning", options.out, options.seed)
    setting, rng = Setting(options.task, options.actions, options.time_limit), np.random.default_rng(options.seed)
    scale, pool = scale_of(setting, rng), ProcessPoolExecutor(os.cpu_count())
    size = setting.environment().action_spec().shape[0] * (len(scale) + 1)

    def totals(policies: Array, seeds: np.ndarray) -> Array:
        count = len(policies)
        return np.array(list(pool.map(act, [setting] * count, policies, [scale] * count, seeds.tolist())))

    now, curve, begin = np.zeros(size), [], time.perf_counter()
    while (spent := time.perf_counter() - begin) < 60.0 * options.minutes:
        ways = rng.standard_normal((options.directions, size))
        seeds = rng.integers(2**31, size=options.directions)
        step = options.spread * ways
        up, down = np.split(totals(np.vstack([now + step, now - step]), np.tile(seeds, 2)), 2)
        best = np.argsort(np.maximum(up, down))[-options.best :]
        deviation = float(np.concatenate([up[best], down[best]]).std()) + 1e-9
        now = now + options.rate / (options.best * deviation) * (up - down)[best] @ ways[best]
        mean = float(np.mean([up, down]))
        curve.append({"time_s": spent, "mean": mean, "best": float(max(up.max(), down.max()))})
        if len(curve) % 10 == 0:
            recent = np.mean([each["mean"] for each in curve[-10:]])
            console.print(f"round {len(curve):4d}, {spent:4.0f} s: mean return of ten rounds {recent:7.1f}")
    fresh = rng.integers(2**31, size=FRESH)
    before, after = totals(np.zeros((FRESH, size)), fresh), totals(np.tile(now, (FRESH, 1)), fresh)
    error = float(np.hypot(before.std(ddof=1), after.std(ddof=1)) / np.sqrt(FRESH))
    gain = float(after.mean() - before.mean())
    console.print(
        f"{options.task}: return {before.mean():.1f} before, {after.mean():.1f} after, in {FRESH} fresh episodes: "
        f"{gain / error:.1f} standard errors more"
    )
    figures = {"before": before.tolist(), "after": after.tolist(), "standard_errors": gain / error, "curve": curve}
    learnt = {"task": options.task, "actions": options.actions, "parameters": now.tolist(), "scale": scale.tolist()}
    write_json(folder / "learning.json", {**learnt, **figures})
    _draw(folder / "learning.png", curve, options.task)
    console.print(f"in {folder}")
    return 0 if gain > 3.0 * error else 1


def _draw(file: Path, curve: list[dict[str, float]], task: str) -> None:
    with wanted():
        from matplotlib.figure import Figure
    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    times = [each["time_s"] for each in curve]
    axes.plot(times, [each["best"] for each in curve], linewidth=0.8, alpha=0.6, label="best of a round")
    axes.plot(times, [each["mean"] for each in curve], label="mean of a round")
    axes.set(xlabel="time [s]", ylabel="return of an episode", title=task)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    run_scenario(main)

"""Example: a linear policy learns a task by the cross-entropy method, on all cores.

    ./uvw run scripts/studies/learning.py --task water/hover --minutes 2
    ./uvw run scripts/studies/learning.py --task water/reach --minutes 2

A generation draws parameters of a policy from a normal distribution, lets each act for one episode, and fits the
distribution to the best quarter. At the end the mean policy and the policy of the start act in the same fresh episodes.
Writes learning.json and the curve, learning.png.
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
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.extras import wanted
from sim.interfaces.spatial import Array
from sim.runs.saving import write_json

BEST = 0.25  # share of a generation that the next one is fitted to
FRESH = 20  # episodes of the comparison
LEAST = 0.02  # standard deviation that every parameter keeps


@dataclass(kw_only=True)
class Options:
    """Learning a task by the cross-entropy method."""

    task: str = "water/hover"
    """Task as DOMAIN/TASK."""
    minutes: float = 2.0
    """Time to learn for."""
    population: int = 32
    """Policies of a generation."""
    spread: float = 0.5
    """Standard deviation of the parameters at the start."""
    time_limit: float = 10.0
    """Seconds of an episode, simulated."""
    seed: int = 0
    """Seed of the draws and episodes."""
    out: Path | None = None
    """Folder for the results."""


@cache
def environment_of(task: str, time_limit: float) -> Any:
    """Environment of a task, made once in a process."""
    domain, _, name = task.partition("/")
    return composer.load(domain, name, time_limit=time_limit)


def features(observation: dict[str, Array]) -> Array:
    """Goal and velocities, in the vehicle's own axes, and a constant."""
    chosen = [value for name, value in observation.items() if "goal" in name or "velocity" in name]
    return np.append(np.concatenate(chosen), 0.1)


def act(task: str, time_limit: float, parameters: Array, seed: int) -> float:
    """Return of a linear policy in one episode."""
    environment = environment_of(task, time_limit)
    environment.random_state.seed(seed)
    size = environment.action_spec().shape[0]
    gain = parameters.reshape(size, -1)
    return run_episode(environment, lambda moment: np.clip(gain @ features(moment.observation), -1.0, 1.0)).total


def main() -> int:
    """Learns, and returns 0 if the learnt policy is better than that of the start by three standard errors."""
    options, console = parse(Options), Console()
    if not 0.0 < options.minutes < np.inf or options.population < 8:
        raise ConfigurationError("--minutes must be above 0, --population at least 8")
    folder = new_folder("learning", options.out)
    environment = environment_of(options.task, options.time_limit)
    size = environment.action_spec().shape[0] * len(features(environment.reset().observation))
    rng, pool = np.random.default_rng(options.seed), ProcessPoolExecutor(os.cpu_count())
    mean, deviation, curve = np.zeros(size), np.full(size, options.spread), []

    def totals(policies: Array, seeds: Array) -> Array:
        count = len(seeds)
        given = ([options.task] * count, [options.time_limit] * count, list(policies), seeds.tolist())
        return np.array(list(pool.map(act, *given)))

    begin, generation = time.perf_counter(), 0
    while time.perf_counter() - begin < 60.0 * options.minutes:
        drawn = mean + deviation * rng.standard_normal((options.population, size))
        seeds = np.full(options.population, rng.integers(2**31))  # one episode for all: its luck is the same
        found = totals(drawn, seeds)
        elite = drawn[np.argsort(found)[-max(2, round(BEST * options.population)) :]]
        mean, deviation = elite.mean(axis=0), np.maximum(elite.std(axis=0), LEAST)
        curve.append({"time_s": time.perf_counter() - begin, "mean": found.mean(), "best": found.max()})
        generation += 1
        console.print(f"generation {generation:3d}: mean {found.mean():7.1f}, best {found.max():7.1f}")
    fresh = rng.integers(2**31, size=FRESH)
    before, after = totals(np.zeros((FRESH, size)), fresh), totals(np.tile(mean, (FRESH, 1)), fresh)
    error = float(np.hypot(before.std(ddof=1), after.std(ddof=1)) / np.sqrt(FRESH))
    gain = float(after.mean() - before.mean())
    console.print(
        f"{options.task}: {before.mean():.1f} before, {after.mean():.1f} after, {gain / error:.1f} standard errors more"
    )
    figures = {"before": before.tolist(), "after": after.tolist(), "errors": gain / error, "curve": curve}
    write_json(folder / "learning.json", {"task": options.task, "parameters": mean.tolist(), **figures})
    _draw(folder / "learning.png", curve, options.task)
    console.print(f"in {folder}")
    return 0 if gain > 3.0 * error else 1


def _draw(file: Path, curve: list[dict[str, float]], task: str) -> None:
    with wanted():
        from matplotlib.figure import Figure
    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    times = [each["time_s"] for each in curve]
    axes.plot(times, [each["mean"] for each in curve], label="mean of a generation")
    axes.plot(times, [each["best"] for each in curve], label="best of a generation")
    axes.set(xlabel="time [s]", ylabel="return of an episode", title=task)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    run_scenario(main)

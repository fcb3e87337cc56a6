"""Episodes of a policy: scores, and records in Parquet with observations, actions and rewards."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from dm_control import composer

from scenarios.composer.experts import Policy
from sim.interfaces.extras import wanted

SUCCESS, TASK = "is_success", "task"


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One episode of a policy."""

    total: float  # sum of rewards
    steps: int
    success: bool
    ended: str  # damage, what spoiled the work, or empty


def run_episode(
    environment: composer.Environment,
    policy: Policy,
    *,
    stop_when_done: bool = False,
    observe: Callable[[Mapping[str, Any], np.ndarray, float], None] | None = None,
) -> Episode:
    """Run one episode.

    Args:
        environment: Of the suite.
        policy: Gives the actions.
        stop_when_done: End it when the work is done; its rewards then lack the rest.
        observe: Called with observation, action and the reward that followed.
    """
    moment, total, steps = environment.reset(), 0.0, 0
    task: Any = environment.task
    while not moment.last() and not (stop_when_done and task.is_success):
        action = policy(moment)
        before = moment.observation
        moment = environment.step(action)
        reward = float(moment.reward or 0.0)
        total, steps = total + reward, steps + 1
        if observe is not None:
            observe(before, action, reward)
    return Episode(total=total, steps=steps, success=bool(task.is_success), ended=task.damage or task.judge.failed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Episodes of one policy on one task."""

    episodes: tuple[Episode, ...]

    @property
    def solved(self) -> float:
        """Share of the episodes in which the work was done."""
        return float(np.mean([episode.success for episode in self.episodes]))

    @property
    def mean(self) -> float:
        """Mean sum of rewards."""
        return float(np.mean([episode.total for episode in self.episodes]))

    @property
    def error(self) -> float:
        """Standard error of the mean."""
        totals = [episode.total for episode in self.episodes]
        return float(np.std(totals, ddof=1) / np.sqrt(len(totals))) if len(totals) > 1 else float("nan")

    def __str__(self) -> str:
        """In words."""
        return f"{self.solved:.0%} solved, return {self.mean:.1f} +- {self.error:.1f} ({len(self.episodes)} episodes)"


def score(environment: composer.Environment, policy: Policy, episodes: int = 20) -> Score:
    """Score of a policy over whole episodes."""
    return Score(episodes=tuple(run_episode(environment, policy) for _ in range(episodes)))


def record_episodes(
    environment: composer.Environment, policy: Policy, file: str | Path, *, episodes: int = 1, task: str = ""
) -> Score:
    """Record episodes: one row per action with "episode", "step", each observation, "action" and "reward".

    Arrays are lists of numbers. Each episode is a row group of its own, written when it ends: a run that dies leaves
    the episodes before.

    Args:
        environment: Of the suite.
        policy: Gives the actions.
        file: Parquet file to write.
        episodes: Number of episodes.
        task: Name to write into the file's metadata, beside the names of the actions' numbers.

    Returns:
        The score.

    Raises:
        MissingLibraryError: pyarrow is missing.
    """
    with wanted():
        import pyarrow as pa
        import pyarrow.parquet as pq

    done: list[Episode] = []
    writer: Any = None
    names = environment.action_spec().name or ""
    try:
        for number in range(episodes):
            rows: dict[str, list[Any]] = {}

            def observe(before: Mapping[str, Any], action: np.ndarray, reward: float, rows: Any = rows) -> None:
                for name, value in (*before.items(), ("action", action)):
                    rows.setdefault(name, []).append(np.ravel(value).tolist())
                rows.setdefault("reward", []).append(reward)

            episode = run_episode(environment, policy, observe=observe)
            done.append(episode)
            columns = {"episode": [number] * episode.steps, "step": list(range(episode.steps)), **rows}
            table = pa.table(columns)
            if writer is None:
                told = {TASK: task, "actions": names.replace("\t", ",")}
                writer = pq.ParquetWriter(str(file), table.schema.with_metadata(told))
            writer.write_table(table.replace_schema_metadata(writer.schema.metadata))
    finally:
        if writer is not None:
            writer.close()
    return Score(episodes=tuple(done))

"""Episodes of a policy: scores, and records in Parquet with observations, actions and rewards."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from dm_control import composer

from uuv.environments.experts import Policy
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import shown, whole_number


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One episode of a policy."""

    total: float  # sum of rewards
    steps: int
    success: bool
    ended: str  # damage, reason of a failure, or empty
    last: Mapping[str, Any]  # observation at the end
    discount: float  # discount at the end: 0 after damage


def run_episode(
    environment: composer.Environment,
    policy: Policy,
    *,
    stop_when_done: bool = False,
    observe: Callable[[Mapping[str, Any], np.ndarray, float], None] | None = None,
) -> Episode:
    """Run one episode.

    Args:
        environment: Environment of the suite.
        policy: Policy that returns the actions.
        stop_when_done: Whether to end the episode when the work is done; rewards after that are
            then missing.
        observe: Function that is called with observation, action and the following reward.
    """
    moment = environment.reset()
    total = 0.0
    steps = 0
    task: Any = environment.task

    while not moment.last() and not (stop_when_done and getattr(task, "is_success", False)):
        action = policy(moment)
        before = moment.observation
        moment = environment.step(action)
        reward = float(moment.reward or 0.0)
        total += reward
        steps += 1

        if observe is not None:
            observe(before, action, reward)

    return Episode(
        total=total,
        steps=steps,
        success=bool(getattr(task, "is_success", False)),
        ended=getattr(task, "damage", "") or getattr(getattr(task, "judge", None), "failed", ""),
        last=moment.observation,
        discount=1.0 if moment.discount is None else float(moment.discount),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Result of episodes of one policy on one task."""

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
        return (
            float(np.std(totals, ddof=1) / np.sqrt(len(totals)))
            if len(totals) > 1
            else float("nan")
        )

    def __str__(self) -> str:
        """The score in words."""
        return (
            f"{self.solved:.0%} solved, return {self.mean:.1f} +- {self.error:.1f} "
            f"({len(self.episodes)} episodes)"
        )


def score(environment: composer.Environment, policy: Policy, episodes: int = 20) -> Score:
    """Success rate and mean return of a policy over whole episodes.

    Raises:
        ConfigurationError: Fewer than one episode is requested.
    """
    whole_number(episodes, "episodes", least=1)
    return Score(episodes=tuple(run_episode(environment, policy) for _ in range(episodes)))


def record_episodes(
    environment: composer.Environment,
    policy: Policy,
    file: str | Path,
    *,
    episodes: int = 1,
    task: str = "",
) -> Score:
    """Record episodes in a Parquet file.

    Each row is one time step: "episode", "step", each observation, "discount", the "action" that
    was taken, and the following "reward". The last time step of an episode has no action. "success"
    refers to the whole episode. Arrays are lists of fixed length. Each episode is a row group,
    written when the episode ends, so that a run that dies leaves the earlier episodes. The metadata
    contain the task, the names of the actions' numbers, the period and the vehicle.

    Args:
        environment: Environment of the suite.
        policy: Policy that returns the actions.
        file: Parquet file to write, in an existing folder; an older one is replaced.
        episodes: Number of episodes.
        task: Name to write into the metadata.

    Returns:
        The score.

    Raises:
        ConfigurationError: The folder does not exist, or fewer than one episode is requested.
        MissingLibraryError: pyarrow is missing.
    """
    with wanted():
        import pyarrow.parquet as pq

    whole_number(episodes, "episodes", least=1)
    if not Path(file).resolve().parent.is_dir():
        raise ConfigurationError(f"file {shown(str(file))}: its folder does not exist")

    done: list[Episode] = []
    writer: Any = None

    # Metadata of the file; the first episode determines its columns.
    names = (environment.action_spec().name or "").replace("\t", ",")
    metadata = {"task": task, "actions": names, "period_s": str(environment.control_timestep())}
    task_object: Any = environment.task
    metadata |= {"vehicle": getattr(getattr(task_object, "vehicle", None), "kind", "")}

    try:
        for number in range(episodes):
            moments: list[tuple[Mapping[str, Any], np.ndarray, float]] = []
            episode = run_episode(
                environment, policy, observe=lambda *moment, to=moments: to.append(moment)
            )
            done.append(episode)

            table = _table(number, episode, moments)
            if writer is None:
                writer = pq.ParquetWriter(str(file), table.schema.with_metadata(metadata))
            writer.write_table(table.replace_schema_metadata(writer.schema.metadata))
    finally:
        if writer is not None:
            writer.close()
    return Score(episodes=tuple(done))


def _table(
    number: int, episode: Episode, moments: Sequence[tuple[Mapping[str, Any], np.ndarray, float]]
) -> Any:
    """Rows of one episode."""
    import pyarrow as pa

    observations = [*(before for before, _, _ in moments), episode.last]
    count = len(observations)

    def lists(values: Sequence[Any], size: int) -> Any:
        kind = pa.list_(pa.float64(), size)
        return pa.array(
            [None if value is None else np.ravel(value).tolist() for value in values], kind
        )

    columns: dict[str, Any] = {"episode": [number] * count, "step": list(range(count))}
    for name, sample in episode.last.items():
        columns[name] = lists(
            [observation[name] for observation in observations], int(np.size(sample))
        )
    columns["action"] = lists(
        [*(action for _, action, _ in moments), None], int(np.size(moments[0][1]))
    )
    columns["reward"] = pa.array([*(reward for _, _, reward in moments), None], pa.float64())
    columns["discount"] = [1.0] * (count - 1) + [episode.discount]
    columns["success"] = [episode.success] * count
    return pa.table(columns)

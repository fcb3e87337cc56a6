"""Scores of the expert, of random actions and of no action on each task of the dm_control suite.

Each episode has its own seed: current, gusts, start and goal. A task counts as solved by the bounds
of the jobs.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.sim.interfaces.spatial import one_of

POLICIES = ("expert", "random", "zero")


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """Which episodes."""

    tasks: tuple[str, ...] = ()
    """Tasks as DOMAIN/TASK; default: all."""
    policies: tuple[str, ...] = POLICIES
    """Policies: expert, random, zero."""
    episodes: int = 20
    """Episodes of each policy on each task; their seeds are --seed and those that follow."""
    seed: int = 0
    """Seed of the first episode."""

    def __post_init__(self) -> None:
        at_least(self, episodes=1)


@dataclass(frozen=True, kw_only=True)
class EpisodeCase:
    """One episode of one policy."""

    task: str
    policy: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """What the policy achieves in the episode."""

    solved: bool = column("solved")
    total: float = column("return", digits=1)
    steps: int = column("steps")
    ended: str = column("ended by")


def cases(episodes: Episodes) -> Iterator[EpisodeCase]:
    """Each policy on each task, with the same seeds."""
    from uuv.environments.suite import ALL_TASKS  # dm_control, which not every Python has

    known = tuple("/".join(names) for names in ALL_TASKS)
    for task in episodes.tasks or known:
        one_of(task, known, "--tasks")
        for policy in episodes.policies:
            one_of(policy, POLICIES, "--policies")
            for k in range(episodes.episodes):
                yield EpisodeCase(task=task, policy=policy, seed=episodes.seed + k)


@experiment("task_scores", cases=cases, quick={"episodes": 1})
def task_scores(case: EpisodeCase) -> EpisodeRow:
    """Runs one episode."""
    from uuv.environments import experts
    from uuv.environments.episodes import run_episode

    environment = _environment_of(case.task)
    environment.random_state.seed(case.seed)
    policy = {
        "expert": experts.expert,
        "random": lambda entry: experts.at_random(entry, np.random.default_rng([case.seed, 5])),
        "zero": experts.zero,
    }[case.policy]

    episode = run_episode(environment, policy(environment))
    return EpisodeRow(
        solved=episode.success, total=episode.total, steps=episode.steps, ended=episode.ended
    )


@cache
def _environment_of(task: str) -> Any:
    """Environment of a task, made once in a process; its random numbers are seeded by each case."""
    from uuv.environments import suite

    return suite.load(*task.split("/"))


def expert_failures(rows: list[Row]) -> list[str]:
    """Episodes that the expert did not solve."""
    return [
        f"not solved: {row['task']}, seed {row['seed']}: {row['ended'] or 'time over'}"
        for row in rows
        if row["policy"] == "expert" and not row["solved"]
    ]


task_scores.page = (
    Page()
    .table("Return", by="task", across="policy", columns=[stat("mean", "total")])
    .table(
        "Policies on the tasks",
        by=("task", "policy"),
        columns=[
            stat("share", "solved"),
            stat("mean", "total"),
            stat("sem", "total"),
            stat("count", "ended", "spoiled"),
        ],
    )
    .add(expert_failures)
)

if __name__ == "__main__":
    run_scenario(task_scores.main)

"""Study of policies on the tasks: one episode of one policy on one task, and the table of many."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from dm_control.composer import Environment

from uuv.environments import suite
from uuv.environments.episodes import run_episode
from uuv.environments.experts import Policy, at_random, expert, zero
from uuv.experiment import Row, Summary, Table
from uuv.sim.evaluation.intervals import share_interval

POLICIES: dict[str, Callable[[Environment, int], Policy]] = {
    "expert": lambda environment, _: expert(environment),
    "random": lambda environment, seed: at_random(environment, np.random.default_rng([seed, 5])),
    "zero": lambda environment, _: zero(environment),
}


@dataclass(frozen=True)
class ScoreCase:
    """One episode; a case of the study."""

    domain: str
    task: str
    policy: str
    seed: int


@cache
def environment_of(domain: str, task: str) -> Environment:
    """Environment of a task, made once in a process; its random numbers are seeded by each case."""
    return suite.load(domain, task)


def run(case: ScoreCase) -> dict[str, Any]:
    """Row of one episode."""
    environment = environment_of(case.domain, case.task)
    environment.random_state.seed(case.seed)
    episode = run_episode(environment, POLICIES[case.policy](environment, case.seed))
    return {
        "task": f"{case.domain}/{case.task}",
        "policy": case.policy,
        "seed": case.seed,
        "solved": episode.success,
        "total": episode.total,
        "steps": episode.steps,
        "ended": episode.ended,
    }


def summarise(rows: list[Row]) -> Summary:
    """Table by task and policy, and the expert's failures."""
    rows.sort(key=lambda row: (row["task"], row["policy"], row["seed"]))
    failed = [row for row in rows if row["policy"] == "expert" and not row["solved"]]
    return Summary(
        metrics={"episodes": len(rows), "expert_failed": len(failed)},
        tables=[_table_of(rows)],
        lines=[
            f"not solved: {row['task']}, seed {row['seed']}: {row['ended'] or 'time over'}"
            for row in failed
        ],
    )


def _table_of(rows: Sequence[Row]) -> Table:
    cells = []
    for task, policy in dict.fromkeys((row["task"], row["policy"]) for row in rows):
        of = [row for row in rows if (row["task"], row["policy"]) == (task, policy)]
        totals = np.array([row["total"] for row in of])
        solved = sum(row["solved"] for row in of)
        low, high = share_interval(solved, len(of))
        damaged = sum(bool(row["ended"]) for row in of)
        cells.append(
            (
                task,
                policy,
                str(len(of)),
                f"{solved / len(of):.0%} ({low:.0%} to {high:.0%})",
                f"{totals.mean():.1f}",
                f"{totals.std(ddof=1) / np.sqrt(len(of)):.1f}" if len(of) > 1 else "-",
                str(damaged),
            )
        )
    return Table(
        title="Policies on the tasks",
        columns=(
            "task",
            "policy",
            "episodes",
            "solved (95 %)",
            "mean return",
            "standard error",
            "spoiled",
        ),
        rows=cells,
        labels=2,
    )

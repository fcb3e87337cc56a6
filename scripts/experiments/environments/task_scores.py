"""Benchmark: the expert, random actions and no action on each task of the dm_control suite.

    ./uvw run scripts/experiments/environments/task_scores.py --episodes 20

Each episode has its own seed: current, gusts, start and goal. A task counts as solved by the bounds
of the jobs.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from experiments.environments.score_study import POLICIES, ScoreCase, run, summarise
from uuv.environments.suite import ALL_TASKS
from uuv.experiment import Study, StudyOptions
from uuv.experiment.options import at_least
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Scores of policies on the tasks."""

    episodes: int = 20
    """Episodes of each policy on each task; their seeds are --seed and those that follow."""
    tasks: tuple[str, ...] = tuple("/".join(name) for name in ALL_TASKS)
    """Tasks as DOMAIN/TASK."""
    policies: tuple[str, ...] = tuple(POLICIES)
    """Policies: expert, random, zero."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, episodes=1)
        for word, names, known in (
            ("--tasks", self.tasks, ["/".join(name) for name in ALL_TASKS]),
            ("--policies", self.policies, list(POLICIES)),
        ):
            for name in names:
                if name not in known:
                    raise ConfigurationError(f"{word} {name!r}: allowed {', '.join(known)}")


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    cases = [
        ScoreCase(domain, task, policy, options.seed + k)
        for domain, task in (name.split("/") for name in options.tasks)
        for policy in options.policies
        for k in range(options.episodes)
    ]
    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out(
        "task_scores", options, "Expert, random and no actions on the dm_control tasks"
    )


if __name__ == "__main__":
    run_scenario(main)

"""A linear policy learns tasks of the dm_control suite by the cross-entropy method.

The action is a matrix times what is observed: the goal and the velocities in the vehicle's own
axes, in SI units. A generation draws matrices from a normal distribution, lets each act in the same
episode, and moves the distribution towards the best quarter. At the end its mean and the policy of
the start, which does nothing, act in the same fresh episodes. Accepted: the learnt policy is better
by three standard errors.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.sim.interfaces.spatial import Array, finite_number, one_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRESH = 20  # episodes of the comparison
# beside the goals
SEEN = ("vehicle/velocity", "vehicle/angular_velocity", "vehicle/arm/joint_velocity")
BEST = 0.25  # share of a generation that the distribution moves towards
SMOOTH = 0.7  # share of that move
LEAST = 0.1  # share of its first standard deviation that a parameter keeps
CLEAR = 3.0  # standard errors by which the learnt policy has to be better
USUAL = "usual"  # kind of action of a task
ACTIONS = {"water/hover": "hull_wrench"}  # kinds of action in place of the usual one


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How the tasks are learnt."""

    tasks: tuple[str, ...] = ("water/hover", "water/reach")
    """Tasks as DOMAIN/TASK."""
    actions: str | None = None
    """Kind of action; default: hull_wrench of water/hover, else the task's usual one."""
    generations: int = 16
    """Number of generations."""
    population: int = 32
    """Policies of a generation."""
    spread: float = 0.7
    """Standard deviation of a parameter at the start."""
    time_limit: float = 7.0
    """Duration of an episode [s], simulated."""
    seed: int = 0
    """Seed of the draws and episodes."""

    def __post_init__(self) -> None:
        at_least(self, generations=1, population=8)
        for name in ("spread", "time_limit"):
            finite_number(getattr(self, name), f"--{name.replace('_', '-')}", above=0.0)


@dataclass(frozen=True, kw_only=True)
class LearningCase:
    """One task that is learnt."""

    task: str
    actions: str
    generations: int
    population: int
    spread: float
    time_limit: float
    """Duration of an episode [s], simulated."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class LearningRow:
    """Returns before and after, of each generation, and the learnt policy."""

    before: Sequence[float] = column("return before", digits=0)
    after: Sequence[float] = column("return after", digits=0)
    # None: all returns are the same
    standard_errors: float | None = column("standard errors more", digits=1)
    means: Sequence[float] = column("mean of a generation", digits=1)
    bests: Sequence[float] = column("best of a generation", digits=1)
    parameters: Sequence[float] = column("policy")


def cases(learning: Learning) -> Iterator[LearningCase]:
    """The tasks."""
    from uuv.environments.suite import ALL_TASKS  # dm_control, which not every Python has

    known = tuple("/".join(names) for names in ALL_TASKS)
    for task in learning.tasks:
        yield LearningCase(
            task=one_of(task, known, "--tasks"),
            actions=learning.actions or ACTIONS.get(task, USUAL),
            generations=learning.generations,
            population=learning.population,
            spread=learning.spread,
            time_limit=learning.time_limit,
            seed=learning.seed,
        )


@experiment("task_learning", cases=cases)
def task_learning(case: LearningCase) -> LearningRow:
    """Learns a task."""
    rng = np.random.default_rng(case.seed)
    environment = _environment_of(case.task, case.actions, case.time_limit)
    size = environment.action_spec().shape[0] * len(observed(environment.reset().observation))

    mean, deviation = np.zeros(size), np.full(size, case.spread)
    means, bests = [], []
    for _ in range(case.generations):
        policies = mean + deviation * rng.standard_normal((case.population, size))
        seeds = np.full(case.population, rng.integers(2**31))
        totals = returns(environment, policies, seeds)

        # The distribution moves towards the best quarter.
        best = policies[np.argsort(totals)[-max(2, round(BEST * case.population)) :]]
        mean = mean + SMOOTH * (best.mean(axis=0) - mean)
        deviation = np.sqrt((1.0 - SMOOTH) * deviation**2 + SMOOTH * best.var(axis=0))
        deviation = np.maximum(deviation, LEAST * case.spread)
        means.append(float(totals.mean()))
        bests.append(float(totals.max()))

    # The mean and the policy of the start, in the same fresh episodes.
    fresh = rng.integers(2**31, size=FRESH)
    before = returns(environment, np.zeros((FRESH, size)), fresh)
    after = returns(environment, np.tile(mean, (FRESH, 1)), fresh)
    error = float(np.hypot(before.std(ddof=1), after.std(ddof=1)) / np.sqrt(FRESH))

    return LearningRow(
        before=before.tolist(),
        after=after.tolist(),
        standard_errors=float(after.mean() - before.mean()) / error if error else None,
        means=means,
        bests=bests,
        parameters=mean.tolist(),
    )


def observed(observation: dict[str, Array]) -> Array:
    """Goal and velocities, in the vehicle's own axes."""
    return np.concatenate(
        [value for name, value in observation.items() if "goal" in name or name in SEEN]
    )


def returns(environment: Any, policies: Array, seeds: np.ndarray) -> Array:
    """Return (N,) of linear policies (N, n), each in the episode of its seed (N,)."""
    from uuv.environments.episodes import run_episode

    def total(parameters: Array, seed: int) -> float:
        environment.random_state.seed(seed)
        gain = parameters.reshape(environment.action_spec().shape[0], -1)
        return run_episode(
            environment, lambda moment: np.clip(gain @ observed(moment.observation), -1.0, 1.0)
        ).total

    return np.array([total(*pair) for pair in zip(policies, seeds.tolist(), strict=True)])


@cache
def _environment_of(task: str, actions: str, time_limit: float) -> Any:
    """The environment, made once in a process; its random numbers are seeded by each episode."""
    from uuv import environments as composer

    domain, _, name = task.partition("/")
    kind = None if actions == USUAL else actions
    return composer.load(domain, name, actions=kind, time_limit=time_limit)


def picture(rows: list[Row]) -> "Figure":
    """Returns over generations, a panel a task."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.5 * len(rows)), layout="constrained")
    panels = figure.subplots(len(rows), 1, squeeze=False)[:, 0]

    for axes, row in zip(panels, rows, strict=True):
        axes.plot(row["bests"], linewidth=0.8, alpha=0.6, label="best of a generation")
        axes.plot(row["means"], label="mean of a generation")
        axes.set(xlabel="generation", ylabel="return of an episode", title=row["task"])
        axes.grid(alpha=0.3)
        axes.legend()
    return figure


task_learning.page = (
    Page()
    .table(
        f"Return in {FRESH} fresh episodes before and after",
        by=("task", "actions"),
        columns=[stat("mean", "before"), stat("mean", "after"), "standard_errors"],
    )
    .accept(stat("least", "standard_errors"), least=CLEAR, by="task")
    .add(lambda rows: ("Learning", "Returns of each generation.", lambda: picture(rows)))
)

if __name__ == "__main__":
    run_scenario(task_learning.main)

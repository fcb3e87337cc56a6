"""Published method of inverse kinematics against the default one, on all arms [Danilov 2021].

Poses are those of random joint values, from one cold start, with even limits of the hinges. The
published method, `plain`, makes one iteration a sweep over the joints of one of its three stages,
up to a cap, without restarts. Both methods solve the same poses in turns in one process: a time
counts as a ratio only: of the poses that a method solves, of the median call, and of the mean call
with the failures, which run to the cap. Answers are checked by textbook matrices.

Accepted: the default method solves all poses.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.kinematics.ik_bench import COLD, IkTargets, race, targets_of
from experiments.kinematics.ik_peers import Solver
from experiments.kinematics.ik_success import RANGES
from uuv.controllers.mkps import IkOptions, Method, solve
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms import published_arms

DEFAULT: Method = "hybrid"
CAPS = (100, 1000, 4000)  # iterations; the last is the default of `plain`
BARS = ("stated", "A")  # accuracies of the bench: 1 mm and 0.01 rad, 0.1 mm and 1 mrad
BY_CAP = {f"plain, up to {cap}": cap for cap in CAPS}


@dataclass(frozen=True, kw_only=True)
class PublishedIkCase:
    """One arm."""

    arm: str
    """Name of the arm."""
    bar: str
    """Accuracy: that of the paper's experiment, or the finer one of the bench."""
    degrees: int
    """Limits of every hinge, both ways [deg]."""
    targets: int = 200
    """Number of poses."""
    seed: int = 0
    """Seed of the poses."""

    def __post_init__(self) -> None:
        at_least(self, targets=1, degrees=1)


@dataclass(frozen=True, kw_only=True)
class PublishedIkRow:
    """Poses solved, and times of a call against those of the default method."""

    solved: Mapping[str, int] = column("solved", by="method")
    solved_ratio: Mapping[str, float] = column(
        "median time over hybrid's, of poses that it solves", digits=1, by="method", tolerance=None
    )
    median_ratio: Mapping[str, float] = column(
        "median time over hybrid's", digits=1, by="method", tolerance=None
    )
    mean_ratio: Mapping[str, float] = column(
        "mean time over hybrid's", digits=1, by="method", tolerance=None
    )


@experiment(
    "ik_published",
    vary={"arm": published_arms.available(), "bar": BARS, "degrees": RANGES},
    quick={"arm": ("puma560", "panda"), "bar": ("stated",), "degrees": (150,)},
)
def ik_published(case: PublishedIkCase) -> PublishedIkRow:
    """Solves all poses by both methods."""
    drawn = targets_of(
        case.arm, degrees=case.degrees, start=COLD, bar=case.bar, count=case.targets, seed=case.seed
    )

    outcomes = race(drawn, _solvers(drawn), repeats=1)
    ours = outcomes[DEFAULT].call
    calls = {name: outcome.call for name, outcome in outcomes.items()}
    good = {name: outcome.good for name, outcome in outcomes.items()}
    return PublishedIkRow(
        solved={name: outcome.solved for name, outcome in outcomes.items()},
        solved_ratio={
            name: float(np.median(t[good[name]]) / np.median(ours[good[name]]))
            for name, t in calls.items()
        },
        median_ratio={name: float(np.median(t) / np.median(ours)) for name, t in calls.items()},
        mean_ratio={name: float(t.mean() / ours.mean()) for name, t in calls.items()},
    )


def _solvers(drawn: IkTargets) -> dict[str, Solver]:
    chain = drawn.chain
    bar = drawn.task.bar

    def by(method: Method, options: IkOptions) -> Solver:
        return lambda target, q0: solve(chain, target, q0, *bar, method=method, options=options).q

    capped = {name: by("plain", IkOptions(max_iterations=cap)) for name, cap in BY_CAP.items()}
    return {DEFAULT: by(DEFAULT, IkOptions()), **capped}


def _by_default(row: Row) -> bool:
    return row["solved"][DEFAULT] == row["targets"]


ik_published.page = (
    Page()
    .table(
        "Published method against the default one",
        by=("bar", "method"),
        columns=[
            stat("share", "solved", among="targets"),
            stat("median", "solved_ratio", "time over hybrid's of the poses it solves"),
            stat("median", "median_ratio", "median time over hybrid's, median of arms"),
            stat("largest", "median_ratio", "median time over hybrid's, largest of arms"),
            stat("median", "mean_ratio", "mean time over hybrid's, median of arms"),
        ],
    )
    .table(
        "Poses solved by arm [%]",
        by=("arm", "degrees"),
        across="method",
        columns=[stat("share", "solved", among="targets", digits=0)],
    )
    .accept(stat("share", _by_default, "arms of which the default method solves all"), least=1.0)
)

if __name__ == "__main__":
    run_scenario(ik_published.main)

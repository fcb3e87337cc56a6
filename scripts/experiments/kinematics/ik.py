"""Inverse kinematics: solved, and time of a call, beside a compiled baseline and installed peers.

Cases are all combinations of arm, joint limits, start and accuracy (bar A: 0.1 mm and 1 mrad, B:
1 um and 10 urad). Every answer is checked by another forward kinematics. In each case all solvers
take turns: compare times within one run only, of one process on an idle machine.

With the peers, on top of the project's environment (uv.lock and .venv stay as they are):

    PEERS=scripts/experiments/kinematics/ik_requirements.txt
    ./uvw run --with-requirements $PEERS scripts/experiments/kinematics/ik.py --workers 1

KDL has no wheel: it takes part if PYTHONPATH has a folder with your distribution's PyKDL.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.kinematics.ik_bench import (
    BARS,
    BASELINE,
    COLD,
    METHODS,
    OWN_LIMITS,
    WARM,
    contenders,
    kernel_times,
    race,
    reached,
    targets_of,
)
from experiments.kinematics.ik_pages import (
    arms_picture,
    kernel_goals,
    over_hybrid,
    rates_picture,
    ratios_picture,
)
from uuv.controllers.mkps import solve_many
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms import published_arms
from uuv.sim.evaluation.intervals import Bootstrap, bootstrap_interval, ratio_interval
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.streams import Streams

LIMITS = (180, 150)  # [deg]
LEAST_SOLVED = {"hybrid": 0.999, "jacobian_free": 0.995}  # goals
KERNEL_ROUNDS = 5  # for each repeat
RESAMPLES = 400  # of the bootstrap


@dataclass(frozen=True, kw_only=True)
class IkCase:
    """One arm with its limits, start and accuracy."""

    arm: str
    limits: int
    """Joint limits [deg], the same for every hinge; slides keep their own. 0: each arm's own."""
    start: str
    """cold: one posture; warm: near a solution."""
    bar: str
    """Accuracy, A or B."""
    targets: int = 1000
    """Number of targets for which all solvers are timed."""
    rates: int = 10000
    """Number of targets for the solve rates of our own methods."""
    repeats: int = 3
    """Number of times that hybrid and the baseline solve each target; the median counts."""
    peers: bool = True
    """Include the installed peers (--no-peers)."""
    seed: int = 0
    """Seed of targets and starts."""

    def __post_init__(self) -> None:
        at_least(self, targets=1, rates=1, repeats=1)
        if self.limits != OWN_LIMITS and not 0 < self.limits <= 360:
            raise ConfigurationError(
                f"--limits: 1 to 360 deg, or {OWN_LIMITS} for the arm's own, got {self.limits}"
            )


@dataclass(frozen=True, kw_only=True)
class IkRow:
    """Targets solved by our methods, times by solver, and times without Python."""

    # of `rates` targets
    reached: Mapping[str, int] = column("solved", by="method")
    converged: Mapping[str, int] = column("said to be solved", by="method")
    # of `targets` targets
    solved: Mapping[str, int] = column("solved", by="solver")
    median: Mapping[str, float] = column(
        "a call, median", "µs", digits=1, factor=1e6, by="solver", tolerance=None
    )
    p95: Mapping[str, float] = column(
        "a call, 95 %", "µs", digits=1, factor=1e6, by="solver", tolerance=None
    )
    ratio: Mapping[str, float] = column("over hybrid", digits=2, by="solver", tolerance=None)
    ratio_sigma: Mapping[str, float] = column(
        "standard deviation of its logarithm", by="solver", tolerance=None
    )
    # a mean target without Python; bar A alone
    kernel: Mapping[str, float] | None = column(
        "a target", "µs", digits=2, factor=1e6, by="kernel", tolerance=None
    )
    kernel_ratio: float | None = column("DLS / hybrid", digits=2, tolerance=None)
    kernel_sigma: float | None = column("standard deviation of its logarithm", tolerance=None)


@experiment(
    "ik",
    vary={
        "arm": published_arms.available(),
        "limits": LIMITS,
        "start": (COLD, WARM),
        "bar": ("A", "B"),
    },
    quick={"arm": ("puma560",), "limits": LIMITS[:1], "bar": ("A",)},
)
def ik(case: IkCase) -> IkRow:
    """Solves all targets of one case."""
    shared = {"degrees": case.limits, "start": case.start, "bar": case.bar, "seed": case.seed}

    # solve rates of our own methods
    many = targets_of(case.arm, count=case.rates, **shared)
    answers = {
        method: solve_many(many.chain, many.targets, many.starts, *BARS[case.bar], method=method)
        for method in METHODS
    }

    # times of all solvers
    few = targets_of(case.arm, count=case.targets, **shared)
    times = race(few, contenders(few, with_peers=case.peers), case.repeats)
    medians = {name: float(np.median(entry.call)) for name, entry in times.items()}
    streams = Streams(case.seed)
    sigmas = {
        name: _sigma(ratio_interval(entry.call, times["hybrid"].call, streams[name], RESAMPLES))
        for name, entry in times.items()
    }

    # times without Python
    kernel = kernel_times(few, KERNEL_ROUNDS * case.repeats) if case.bar == "A" else None
    return IkRow(
        reached={
            method: int(np.count_nonzero(reached(many, answer.q)))
            for method, answer in answers.items()
        },
        converged={
            method: int(np.count_nonzero(answer.converged)) for method, answer in answers.items()
        },
        # Times, and their ratios to those of hybrid.
        solved={name: entry.solved for name, entry in times.items()},
        median=medians,
        p95={name: float(np.quantile(entry.call, 0.95)) for name, entry in times.items()},
        ratio={name: duration / medians["hybrid"] for name, duration in medians.items()},
        ratio_sigma=sigmas,
        kernel=kernel
        and {
            name: float(np.median(rounds))
            for name, rounds in zip(("hybrid", BASELINE), kernel, strict=True)
        },
        kernel_ratio=kernel and float(np.median(kernel[1] / kernel[0])),
        kernel_sigma=kernel
        and _sigma(
            bootstrap_interval(
                np.median, kernel[1] / kernel[0], rng=streams["kernels"], resamples=RESAMPLES
            )
        ),
    )


def _sigma(bootstrap: Bootstrap) -> float:
    """Standard deviation of the logarithm of a ratio's median."""
    return float(np.std(np.log(bootstrap.resampled)))


def _share(row: Mapping[str, int]) -> float:
    """Share of the targets that a method solves [%]."""
    return 100.0 * row["reached"] / row["rates"]


ik.page = (
    Page()
    .table(
        "Targets solved by our methods, the least case and all",
        by="method",
        columns=[
            stat("least", _share, "least", unit="%", digits=2),
            stat("share", "reached", "all", among="rates", digits=3),
            stat("share", "converged", "said to be solved", among="rates", digits=3),
        ],
    )
    .table(
        "Solved by arm [%], the least case: starts, bars, limits",
        by="arm",
        across="method",
        columns=[stat("least", _share, "least", digits=2)],
    )
    .table(
        "Solved by limits and start [%], the worse of bars A and B",
        by=("arm", "limits", "start"),
        across="method",
        columns=[stat("least", _share, "least", digits=2)],
    )
    .add(over_hybrid)
    .table(
        "A Python call of each solver, by case",
        by=("arm", "limits", "start", "bar"),
        across="solver",
        columns=["median"],
    )
    .table(
        "hybrid a Python call; the compiled DLS over it checks nothing and gives q alone",
        by=("arm", "limits", "start", "bar"),
        columns=[
            stat("value", lambda row: 1e6 * row["median"]["hybrid"], "hybrid", unit="µs", digits=1),
            stat("value", lambda row: 1e6 * row["p95"]["hybrid"], "95 %", unit="µs", digits=1),
            stat("value", lambda row: row["ratio"][BASELINE], "DLS / hybrid", digits=2),
            stat("value", lambda row: row["ratio_sigma"][BASELINE], "sigma of its log", digits=3),
        ],
    )
    .table(
        "Kernel without Python, bar A: mean time of a target",
        by=("arm", "limits", "start"),
        columns=[
            stat("value", lambda row: 1e6 * row["kernel"]["hybrid"], "hybrid", unit="µs", digits=2),
            stat("value", lambda row: 1e6 * row["kernel"][BASELINE], "DLS", unit="µs", digits=2),
            "kernel_ratio",
            stat("value", "kernel_sigma", "sigma of its log", digits=3),
        ],
        where=lambda row: row["bar"] == "A",
    )
    .add(kernel_goals)
    .add(ratios_picture)
    .add(arms_picture)
    .add(rates_picture)
)
for name, least in LEAST_SOLVED.items():
    ik.page.accept(
        stat(
            "least",
            lambda row, name=name: row["reached"][name] / row["rates"],
            f"share solved by {name}, least",
        ),
        least=least,
    )

if __name__ == "__main__":
    run_scenario(ik.main)

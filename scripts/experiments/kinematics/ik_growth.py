"""Time of a solve of inverse kinematics by the number of links: chains of 3 m, random bends.

Accuracy is bar A, 0.1 mm and 1 mrad. All solvers of the project and the compiled baseline take
turns in each case.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from experiments.kinematics.ik_bench import OBLIQUE, IkTargets, contenders, dh_forward, race
from experiments.kinematics.ik_pages import COLORS
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.streams import Streams

LENGTH = 3.0  # [m] of a chain
LONG = 24  # links from which the exponent is fitted


@dataclass(frozen=True, kw_only=True)
class GrowthCase:
    """One chain."""

    links: int
    """Number of links of the chain."""
    targets: int = 50
    """Number of targets."""
    repeats: int = 3
    """Number of times that hybrid and the baseline solve each target; the median counts."""
    seed: int = 0
    """Seed of targets and starts."""

    def __post_init__(self) -> None:
        at_least(self, links=1, targets=1, repeats=1)


@dataclass(frozen=True, kw_only=True)
class GrowthRow:
    """Targets solved and times by solver."""

    solved: Mapping[str, int] = column("solved", by="solver")
    median: Mapping[str, float] = column(
        "a solve, median", "µs", digits=1, factor=1e6, by="solver", tolerance=None
    )


@experiment("ik_growth", vary={"links": (6, 12, 24, 60, 120, 240)}, quick={"links": (6, 12, 24)})
def ik_growth(case: GrowthCase) -> GrowthRow:
    """Solves all targets of one chain."""
    arm = snake(case.links)
    streams = Streams(case.seed, case.links)
    bend = min(1.0, 2.4 / math.sqrt(case.links))
    size = (case.targets, case.links)

    drawn = IkTargets(
        arm=arm,
        bar="A",
        limits=arm.limits,
        targets=dh_forward(arm, streams["targets"].uniform(-bend, bend, size)),
        starts=streams["starts"].uniform(-0.1, 0.1, size),
    )
    solvers = contenders(drawn, with_peers=False)
    del solvers[OBLIQUE]

    times = race(drawn, solvers, case.repeats)
    return GrowthRow(
        solved={name: entry.solved for name, entry in times.items()},
        median={name: float(np.median(entry.call)) for name, entry in times.items()},
    )


def snake(links: int) -> PublishedArm:
    """A chain with `links` links, its axes perpendicular in turn."""
    alpha = np.where(np.arange(links) % 2, 0.5 * math.pi, -0.5 * math.pi)
    rows = np.column_stack(
        [np.zeros(links), np.zeros(links), np.full(links, LENGTH / links), alpha]
    )

    limits = np.tile([-math.pi, math.pi], (links, 1))
    return replace(
        PublishedArm.from_dh(rows), title=f"{links} links", limits=limits, source="made up"
    )


def exponents(rows: list[Row]) -> dict[str, float]:
    """Exponent of the number of links in the time of each solver, from LONG links on."""
    rows = [row for row in rows if row["links"] >= LONG]
    if len(rows) < 2:
        return {}

    links = np.log([row["links"] for row in rows])
    return {
        name: float(np.polyfit(links, np.log([row["median"][name] for row in rows]), 1)[0])
        for name in rows[0]["median"]
    }


def growth(rows: list[Row]) -> list[str | dict | tuple[str, str, Figure]]:
    """Exponents, and the times as a picture."""
    exponent = exponents(rows)
    links = np.array([row["links"] for row in rows], dtype=float)

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots()

    for name in rows[0]["median"]:
        label = f"{name}: n^{exponent[name]:.2f} from {LONG}" if exponent else name
        times = [1e6 * row["median"][name] for row in rows]
        axes.loglog(links, times, marker="o", color=COLORS.get(name), label=label)

    first = 1e6 * rows[0]["median"]["hybrid"]
    axes.loglog(links, first * links / links[0], "--", color="0.6", lw=1.0, label="linear")

    axes.set_xticks(links, [f"{n:.0f}" for n in links])
    axes.minorticks_off()
    axes.set(xlabel="links", ylabel="median time of a solve [us]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left")

    lines = [f"{name}: exponent {power:.2f} from {LONG} links" for name, power in exponent.items()]
    return [*lines, {"exponent": exponent}, ("Growth with the number of links", "", figure)]


ik_growth.page = (
    Page()
    .table(
        "Time of a solve by the number of links", by="links", across="solver", columns=["median"]
    )
    .table(
        "Targets solved [%]",
        by="links",
        across="solver",
        columns=[
            stat("value", lambda row: 100.0 * row["solved"] / row["targets"], "solved", digits=0)
        ],
    )
    .add(growth)
)

if __name__ == "__main__":
    run_scenario(ik_growth.main)

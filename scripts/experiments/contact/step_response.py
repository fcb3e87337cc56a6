"""Step response of the force loop on soft, medium and hard surfaces with one tuning.

The tool moves along a barrel while the set force steps up and down several times. The mean response
on a surface is judged, so that sensor noise and gusts do not count as overshoot: it may overshoot
by 5 % of the step.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from experiments.contact.force_steps import figures, steps_of, times
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.sim.interfaces import palette
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OVERSHOOT = 0.05  # largest overshoot, share of the step
_CURVES = (palette.BLUE, palette.ORANGE, palette.GREEN, palette.PURPLE, palette.SKY)


@dataclass(frozen=True, kw_only=True)
class StepCase:
    """One run with several steps up, each followed by a step down."""

    stiffness: float
    """Stiffness of pad and surface in series [N/m]."""
    low: float = 60.0
    """Set force before a step [N]."""
    high: float = 90.0
    """Set force after a step [N]."""
    rate: float = 60.0
    """Rate of change of the set force [N/s], default as in the jobs; 1e6 is nearly a step."""
    steps: int = 6
    """Number of steps up in a run."""
    current: tuple[float, float, float] = (0.15, 0.0, 0.0)
    """Steady current in W [m/s]."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    seed: int

    def __post_init__(self) -> None:
        if not 0.0 < self.low < self.high:
            raise ConfigurationError(
                f"--low, --high: must rise from above zero, got {self.low}, {self.high} N"
            )
        if not (self.rate > 0.0 and 1 <= self.steps <= 6):
            raise ConfigurationError("--rate must be > 0 N/s, --steps from 1 to 6")


@dataclass(frozen=True, kw_only=True)
class StepRow:
    """Set and true normal force [N] at `times()` around each step up that was seen to its end."""

    set_force: Sequence[Sequence[float]] = column("set force", "N")
    true_force: Sequence[Sequence[float]] = column("normal force", "N")
    note: str = column("why the run ended early")


@experiment(
    "step_response",
    seeds=3,
    vary={"stiffness": (1e4, 3e4, 1e6)},
    paired=True,
    quick={"runs": 1},
    failed=lambda _, error: StepRow(set_force=[], true_force=[], note=error),
)
def step_response(case: StepCase) -> StepRow:
    """Runs the steps of a case."""
    set_force, true_force, note = steps_of(
        stiffness=case.stiffness,
        forces=(case.low, case.high) * case.steps,
        rate=case.rate,
        seed=case.seed,
        current=case.current,
        gust=case.gust,
    )
    return StepRow(set_force=set_force.tolist(), true_force=true_force.tolist(), note=note)


def responses(rows: Sequence[Row], name: str = "true_force") -> Array:
    """Responses (k, N) [N] of all rows."""
    return np.reshape([curve for row in rows for curve in row[name]], (-1, len(times())))


def _mean_figure(name: str) -> Callable[[Sequence[Row]], float | None]:
    """Function of rows: a figure of `force_steps.figures`, of their mean response."""

    def figure(rows: Sequence[Row]) -> float | None:
        curves = responses(rows)
        if not len(curves):
            return None
        return figures(curves.mean(axis=0), rows[0]["low"], rows[0]["high"])[name]

    return figure


def spread(rows: Sequence[Row]) -> float | None:
    """RMS [N] of the single responses about their mean."""
    curves = responses(rows)
    return float(np.sqrt(np.mean((curves - curves.mean(axis=0)) ** 2))) if len(curves) else None


def picture(rows: list[Row]) -> tuple[str, str, "Figure"]:
    """Responses over time, a panel for each stiffness."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(palette.WIDTH, 3.6), layout="constrained")
    surfaces = list(dict.fromkeys(row["stiffness"] for row in rows))
    all_axes = figure.subplots(1, len(surfaces), sharey=True, squeeze=False)[0]
    limit = rows[0]["high"] + OVERSHOOT * (rows[0]["high"] - rows[0]["low"])

    for i, (axes, stiffness) in enumerate(zip(all_axes, surfaces, strict=True)):
        group = [row for row in rows if row["stiffness"] == stiffness]
        curves = responses(group)
        color = _CURVES[i % len(_CURVES)]

        axes.plot(times(), curves.T, color=color, linewidth=0.4, alpha=0.35)
        if len(curves):
            set_force = responses(group, "set_force").mean(axis=0)
            axes.plot(times(), set_force, color=palette.INK, linewidth=1.0, linestyle="--")
            axes.plot(times(), curves.mean(axis=0), color=color, linewidth=2.0)

        axes.axhline(limit, color=palette.VERMILION, linewidth=0.9, linestyle="--")
        axes.set_title(f"{stiffness:.3g} N/m", fontsize=10)
        axes.set_xlabel("time from the step [s]")
        palette.plain_axes(axes, 9)

    all_axes[0].set_ylabel("normal force [N]")
    return (
        "Responses",
        "True normal force at the tool, moving along the path: each step thin, their mean thick; "
        "the set force dashed, and the bound of the overshoot.",
        figure,
    )


OF_MEAN = stat("group", _mean_figure("overshoot"), "overshoot", unit="%", digits=2, factor=100.0)

step_response.line = lambda row: (
    f"{row['stiffness']:g} N/m, seed {row['seed']}: {row['note']}" if row["note"] else ""
)
step_response.page = (
    Page()
    .table(
        "Mean response to a step of the set force",
        by="stiffness",
        columns=[
            stat("total", lambda row: len(row["true_force"]), "steps"),
            stat("group", _mean_figure("rise_s"), "rise, 10 to 90 %", unit="s", digits=2),
            OF_MEAN,
            stat("group", _mean_figure("settling_s"), "settling to 5 %", unit="s", digits=2),
            stat("group", spread, "spread of single responses", unit="N", digits=2),
        ],
    )
    .accept(OF_MEAN, most=OVERSHOOT, by="stiffness")
    .accept(stat("count", "note", "runs that ended early"), most=0)
    .add(lambda rows: [line for row in rows if (line := step_response.line(row))])
    .add(picture)
)

if __name__ == "__main__":
    run_scenario(step_response.main)

"""Figures of a valve's turn for its report: moment and angle over time."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from uuv.sim.evaluation.handling.turn_metrics import DEGREES, FeltHandle, TrueTurn, TurnBounds
from uuv.sim.interfaces.palette import BLUE, FAINT, ORANGE, VERMILION, WIDTH


def turn_figures(
    felt: FeltHandle, truth: TrueTurn, bounds: TurnBounds | None = None
) -> Iterator[tuple[str, str, Figure]]:
    """Draw the figure; none if the tool never turned the handle.

    Args:
        felt: What the vehicle felt, with the truth.
        truth: What was asked for.
        bounds: Bounds to draw; default: `TurnBounds()`.

    Yields:
        Title, caption and figure.
    """
    if not felt.work.any():
        return

    bounds = bounds or TurnBounds()
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    rows = np.flatnonzero(felt.work)
    shown = slice(rows[0], min(rows[-1] + 300, len(felt.time)))
    time = felt.time[shown]

    # Moment.
    upper.plot(time, felt.moment[shown], color=ORANGE, linewidth=0.8, label="felt")
    upper.plot(time, felt.true_moment[shown], color=BLUE, linewidth=0.8, label="true")
    upper.axhline(truth.moment, color=FAINT, linewidth=0.8)
    upper.axhline(bounds.peak * truth.moment, color=VERMILION, linewidth=0.8, linestyle="--")
    upper.set_ylabel("moment [N m]")
    upper.legend(frameon=False, fontsize=9, ncols=2)

    # Angle.
    lower.plot(time, DEGREES * felt.angle[shown], color=ORANGE, linewidth=0.8, label="felt")
    lower.plot(time, DEGREES * felt.true_angle[shown], color=BLUE, linewidth=0.8, label="true")
    lower.axhline(DEGREES * truth.angle, color=FAINT, linewidth=0.6)
    lower.set_ylabel("handle [deg]")
    lower.set_xlabel("time [s]")
    yield (
        "Turn of the handle",
        "Moment of the tool about the valve's axis, grey the set one, dashed the bound; and angle.",
        figure,
    )

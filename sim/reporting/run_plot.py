"""One figure of a run for a notebook: force, path error and hull over time, with the phases."""

import io
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import CONTACT
from uuv.sim.interfaces.palette import FAINT, INK, SKY, WIDTH, plain_axes
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import RecordedSeries
from uuv.sim.reporting.timelines import Panel, panels, thinned

TITLES = ("normal force [N]", "tip path error [mm]", "hull position error [mm]")
_HEIGHT = 2.0  # [in] of a panel
_NAMED = 0.06  # [-] share of the time from which a phase is wide enough for its name


class RunFigure(Figure):
    """Matplotlib figure that a notebook displays without a screen or pyplot."""

    def _repr_png_(self) -> bytes:
        """Picture for a notebook."""
        picture = io.BytesIO()
        self.savefig(picture, format="png", dpi=90)
        return picture.getvalue()


def plot_of(recorded: RecordedSeries, *, whole: bool = False) -> RunFigure:
    """Force, path error and hull position error over time, the phases shaded by turns.

    Args:
        recorded: Series of the run.
        whole: From its start; else from the approach on, where it has one.

    Raises:
        ConfigurationError: The run recorded none of the three.
    """
    drawn = [panel for panel in panels(recorded) if panel.title in TITLES]
    if not drawn:
        raise ConfigurationError(
            "plot: the run recorded no force, path or hull; a run of a job has them from its first "
            "contact on"
        )

    approach = next((e.time for e in recorded.events if e.state in CONTACT), 0.0)
    start = 0.0 if whole else approach

    figure = RunFigure(figsize=(WIDTH, _HEIGHT * len(drawn) + 0.5), layout="constrained")
    grid = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(grid, drawn, strict=True):
        _draw(axes, panel)
        _shade(axes, recorded)

    _name_phases(grid[0], recorded, start)
    grid[-1].set_xlim(start, recorded.duration)
    grid[-1].set_xlabel("time [s]")
    return figure


def _draw(axes: Any, panel: Panel) -> None:
    """Lines of a panel, with gaps where the run recorded nothing."""
    for line in panel.lines:
        time, value = _with_gaps(line.time, line.value)
        axes.plot(time, value, color=line.colour, linewidth=1.0, label=line.name)

    axes.set_ylabel(panel.title)
    axes.legend(fontsize=8, ncols=3, loc="upper left", frameon=False)
    plain_axes(axes, 9)


def _with_gaps(time: Array, value: Array) -> tuple[Array, Array]:
    """The thinned line, with NaN after each time step that is ten times as long as the median."""
    steps = np.diff(time)
    if not len(steps):
        return time, value
    gaps = np.flatnonzero(steps > 10.0 * np.median(steps)) + 1

    # Each part is thinned by itself, since a bin across a gap would close it.
    times: list[Array] = []
    values: list[Array] = []
    for part in zip(np.split(time, gaps), np.split(value, gaps), strict=True):
        few_times, few_values = thinned(*part)
        times += [few_times, few_times[-1:]]
        values += [few_values, np.array([np.nan])]
    return np.concatenate(times[:-1]), np.concatenate(values[:-1])


def _ends(recorded: RecordedSeries) -> list[float]:
    """End [s] of each phase, in the order of the events."""
    return [*(event.time for event in recorded.events[1:]), recorded.duration]


def _shade(axes: Any, recorded: RecordedSeries) -> None:
    """Shade the background of every other phase."""
    ends = _ends(recorded)
    for event, end in list(zip(recorded.events, ends, strict=True))[1::2]:
        axes.axvspan(event.time, end, color=SKY, alpha=0.12, linewidth=0)


def _name_phases(axes: Any, recorded: RecordedSeries, start: float) -> None:
    """Write the names of the phases that end after `start` above the figure, vertically for short
    phases.
    """
    for event, end in zip(recorded.events, _ends(recorded), strict=True):
        begin = max(event.time, start)
        if end <= start:
            continue

        wide = end - begin > _NAMED * (recorded.duration - start)
        axes.annotate(
            str(event.state),
            (0.5 * (begin + end), 1.02),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="bottom",
            fontsize=8,
            rotation=0 if wide else 90,
            color=INK if wide else FAINT,
        )

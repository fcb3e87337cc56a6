"""Plot of one fault case: force, hull, tilt, thrusters and states over time."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.faults.fault_cases import Trace
from uuv.sim.interfaces.palette import BLUE, CYCLE, FAINT, INK, ORANGE, VERMILION

_SHADES = ("0.97", "0.9")
_NARROW = 0.07  # share of the time axis: names of shorter states are drawn upright


def draw(trace: Trace, title: str, file: Path) -> None:
    """Plots a trace into a PNG file.

    Args:
        trace: Time series of the case.
        title: Title of the figure.
        file: PNG file.
    """
    figure = Figure(figsize=(10.0, 8.0), layout="constrained")
    force, hull, tilt, thrusters = panels = figure.subplots(
        4, sharex=True, height_ratios=(3, 3, 2, 3)
    )
    rows = trace.rows
    time = rows[:, 0]
    pressing = rows[:, 3] > 0.0
    force.plot(time, rows[:, 3], color=FAINT, drawstyle="steps-post", label="set")
    force.plot(
        time,
        np.where(pressing, rows[:, 2], np.nan),
        color=ORANGE,
        linewidth=0.8,
        label="felt, pressing",
    )
    force.plot(time, rows[:, 1], color=BLUE, label="true")
    force.set_ylabel("force on the object [N]")
    for i, axis in enumerate("xyz"):
        hull.plot(time, 1e3 * rows[:, 4 + i], color=CYCLE[i], label=axis)
    hull.set_ylabel("hull moved [mm]")
    tilt.plot(time, np.degrees(rows[:, 7]), color=INK, label="tilt")
    tilt.set_ylabel("hull tilted [deg]")
    for i, name in enumerate(trace.thruster_names):
        thrusters.plot(time, rows[:, 11 + i], color=CYCLE[i % len(CYCLE)], label=name)
    thrusters.set_ylabel("thrust [N]")
    thrusters.set_xlabel("time after the fault [s]")
    for axes in panels:
        axes.margins(x=0.0)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
        for when, _, _ in trace.found:
            axes.axvline(when, color=VERMILION, linewidth=0.8)
    _states(trace, panels)
    found = "; ".join(
        f"{kind} {part} found after {when:.2f} s".replace("  ", " ")
        for when, kind, part in trace.found
    )
    figure.suptitle(title)
    force.set_title(
        found or "no fault found", color=VERMILION if found else INK, fontsize=9, loc="left"
    )
    figure.savefig(file, dpi=120)


def _states(trace: Trace, panels: "np.ndarray[tuple[int], np.dtype[np.object_]]") -> None:
    """Shades the states of the work in all panels, and names them in the first."""
    whole = float(trace.rows[-1, 0])
    ends = [t for t, _, _ in trace.states[1:]] + [whole]
    first: Axes = panels[0]
    for i, ((start, state, _), end) in enumerate(zip(trace.states, ends, strict=True)):
        for axes in panels:
            axes.axvspan(start, end, color=_SHADES[i % 2], zorder=0, linewidth=0)
        upright = end - start < _NARROW * whole
        first.text(
            0.5 * (start + end),
            0.5,
            str(state),
            transform=first.get_xaxis_transform(),
            ha="center",
            va="center",
            fontsize=8,
            color=FAINT,
            rotation=90 if upright else 0,
            zorder=0.5,
        )

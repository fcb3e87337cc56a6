"""The picture of one fault: force, hull, thrusters and states over time."""

from pathlib import Path

import numpy as np
from _fault_cases import Trace
from matplotlib.figure import Figure

_SHADES = ("0.93", "0.85")


def draw(trace: Trace, title: str, file: Path) -> None:
    """Draw `trace` into `file` (PNG)."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    force, hull, thrusters = figure.subplots(3, sharex=True)
    rows = trace.rows
    time = rows[:, 0]
    force.plot(time, rows[:, 3], color="0.5", drawstyle="steps-post", label="set")
    force.plot(time, rows[:, 1], color="C0", label="true")
    force.plot(time, rows[:, 2], color="C1", linewidth=0.8, label="felt")
    force.set_ylabel("force on the object [N]")
    force.set_title(title)
    for i, axis in enumerate("xyz"):
        hull.plot(time, 1e3 * rows[:, 4 + i], label=axis)
    hull.set_ylabel("hull from where it was [mm]")
    tilt = hull.twinx()
    tilt.plot(time, np.degrees(rows[:, 7]), color="0.4", linestyle=":", label="tilt")
    tilt.set_ylabel("tilt (dotted) [deg]")
    for i, name in enumerate(trace.thruster_names):
        thrusters.plot(time, rows[:, 9 + i], label=name)
    thrusters.set_ylabel("thrust [N]")
    thrusters.set_xlabel("time after the fault [s]")
    ends = [t for t, _, _ in trace.states[1:]] + [float(time[-1])]
    for i, ((start, state, _), end) in enumerate(zip(trace.states, ends, strict=True)):
        for axes in (force, hull, thrusters):
            axes.axvspan(start, end, color=_SHADES[i % 2], zorder=0, linewidth=0)
        force.text(start, 1.0, f" {state}", transform=force.get_xaxis_transform(), va="top", fontsize=8)
    for when, kind, part in trace.found:
        force.axvline(when, color="C3", linewidth=0.8)
        force.text(when, 0.0, f" {kind} {part} found", transform=force.get_xaxis_transform(), color="C3", fontsize=8)
    for axes in (force, hull, thrusters):
        axes.legend(loc="center right", fontsize=8)
    figure.savefig(file, dpi=120)

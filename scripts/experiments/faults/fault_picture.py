"""Picture of one fault case: force, hull, tilt, thrusters and states over time.

    ./uvw run scripts/experiments/faults/fault_picture.py --fault "thruster sway dead"

Writes the picture, and the time series as compressed NumPy arrays.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.faults.fault_cases import AT_WORK, Branch, PathName, Trace
from experiments.faults.faults import FaultCase, scenario_of
from uuv.sim.interfaces.files import folder_given
from uuv.sim.interfaces.palette import BLUE, CYCLE, FAINT, INK, ORANGE, VERMILION
from uuv.sim.runs.run_folder import RUNS

_SHADES = ("0.97", "0.9")
_NARROW = 0.07  # share of the time axis: names of shorter states are drawn upright


@dataclass(kw_only=True)
class Options:
    """The case, and where its picture goes."""

    fault: str
    """Name of the fault, as in the table of the experiment."""
    path: PathName = "longitudinal"
    """Path of clean_barrel."""
    phase: str = AT_WORK
    """Phase in which the fault begins."""
    seed: int = 0
    """Seed of the run."""
    out: Path = RUNS / "faults"
    """Folder of picture and time series."""


def main() -> int:
    """Simulates one case and draws it."""
    options = parse(Options)
    folder = folder_given(options.out, "--out")
    case = FaultCase(path=options.path, seed=options.seed, phase=options.phase, fault=options.fault)
    trace = Branch(scenario_of(case.path, case.seed), case.phase).trace(case.fault)

    words = f"{case.path}_{case.seed}_{case.phase}_{case.fault}"
    file = folder / f"{words.replace(' ', '_').replace('/', '_')}.png"
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {**trace.series}
    np.savez_compressed(file.with_suffix(".npz"), **arrays)
    draw(trace, f"{case.fault}, {case.path} path, seed {case.seed}", file)
    print(f"written to {file}")
    return 0


def draw(trace: Trace, title: str, file: Path) -> None:
    """Plots a trace into a PNG file.

    Args:
        trace: Time series of the case.
        title: Title of the figure.
        file: PNG file.
    """
    figure = Figure(figsize=(10.0, 8.0), layout="constrained")
    panels = figure.subplots(4, sharex=True, height_ratios=(3, 3, 2, 3))
    _series(trace, panels)
    _states(trace, panels)

    # what was detected, and when
    reports = "; ".join(
        f"{kind} {part} found after {when:.2f} s".replace("  ", " ")
        for when, kind, part in trace.reports
    )
    color = VERMILION if reports else INK
    panels[0].set_title(reports or "no fault found", color=color, fontsize=9, loc="left")
    for axes in panels:
        axes.margins(x=0.0)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
        for when, _, _ in trace.reports:
            axes.axvline(when, color=VERMILION, linewidth=0.8)

    figure.suptitle(title)
    figure.savefig(file, dpi=120)


def _series(trace: Trace, panels: "np.ndarray[tuple[int], np.dtype[np.object_]]") -> None:
    """Plots the time series: force, hull, tilt, thrust."""
    force, hull, tilt, thrusters = panels
    series = trace.series
    time = series["time"]

    pressing = np.where(series["set_force"] > 0.0, series["felt"], np.nan)
    force.plot(time, series["set_force"], color=FAINT, drawstyle="steps-post", label="set")
    force.plot(time, pressing, color=ORANGE, linewidth=0.8, label="felt, pressing")
    force.plot(time, series["contact_normal"], color=BLUE, label="true")
    force.set_ylabel("force on the object [N]")

    for i, axis in enumerate("xyz"):
        hull.plot(time, 1e3 * series["moved"][:, i], color=CYCLE[i], label=axis)
    hull.set_ylabel("hull moved [mm]")
    tilt.plot(time, np.degrees(series["tilt"]), color=INK, label="tilt")
    tilt.set_ylabel("hull tilted [deg]")

    for i, name in enumerate(trace.thruster_names):
        thrusters.plot(time, series["thrust"][:, i], color=CYCLE[i % len(CYCLE)], label=name)
    thrusters.set_ylabel("thrust [N]")
    thrusters.set_xlabel("time after the fault [s]")


def _states(trace: Trace, panels: "np.ndarray[tuple[int], np.dtype[np.object_]]") -> None:
    """Shades the states of the work in all panels, and names them in the first."""
    whole = float(trace.series["time"][-1])
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


if __name__ == "__main__":
    run_scenario(main)

"""Figures of `report.html`, drawn from a recording."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sim.evaluation.metrics import SETTLING, Bounds, TrueObject, hull_motion, path_error, tangential
from sim.interfaces.messages import WorkState
from sim.interfaces.spatial import Array, inverse, transform_points
from sim.loop.recording import Recording

# Palette [Okabe 2008]: distinguishable for colour-blind readers and in print.
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
INK, FAINT = "#222222", "#888888"
CYCLE = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, INK, FAINT)
BINS = 900  # pixel columns of a line; in each its extremes are kept
CONTACT = (WorkState.APPROACH, WorkState.PRESS, WorkState.WORK, WorkState.RETREAT)
WIDTH = 10.0  # [in] width of a figure


def path_figures(
    recording: Recording, truth: TrueObject, bounds: Bounds | None = None
) -> Iterator[tuple[str, str, Figure]]:
    """Draw the figures of work along a path on an object; one that the run has no data for is left out.

    Args:
        recording: The run.
        truth: True object and work.
        bounds: Bounds to draw; default: `Bounds()`.

    Yields:
        Title, caption and figure.
    """
    bounds = bounds or Bounds()
    settled = (
        f"Force error counts in the work state, against the step set value, from {SETTLING:g} s after each change."
    )
    plots: tuple[tuple[str, str, Callable[[], Figure | None]], ...] = (
        ("Force at the tool, along and across it", settled, lambda: _force(recording, bounds)),
        (
            "Tip against the commanded path",
            "True tip minus the point commanded at that instant. Along the path, across it in the surface, and along "
            "the tool axis (positive is deeper).",
            lambda: _path(recording, bounds),
        ),
        (
            "Hull",
            "Displacement and turn of the hull since the tool first touched, in the work state.",
            lambda: _hull(recording, bounds),
        ),
        (
            "The arm's wrench on the hull",
            "Thin: what the arm puts on the hull, water and contact included, at the hull's origin in its axes. Thick "
            "and pale: what the controller believes of it and cancels by the thrusters.",
            lambda: _arm_wrench(recording),
        ),
        (
            "Thrusters",
            "Left: thrust over the whole run. Right: its range against the limits of each thruster.",
            lambda: _thrust(recording),
        ),
        (
            "Joint torques",
            "Left: torque of the drives over the whole run. Right: its range against the limits of each joint.",
            lambda: _torque(recording),
        ),
        (
            "Object, as found",
            "In the frame of the true object: its true shape in grey, the clouds of its identification, the path that "
            "was planned and the one that the tip took.",
            lambda: _object(recording, truth),
        ),
    )
    for title, caption, draw in plots:
        figure = draw()
        if figure is not None:
            yield title, caption, figure


def _force(recording: Recording, bounds: Bounds) -> Figure | None:
    contact = recording.within(*CONTACT)
    if not contact.any():
        return None
    time = recording["contact_normal"].time
    figure = Figure(figsize=(WIDTH, 5.8), layout="constrained")
    force, error, across = figure.subplots(3, 1, sharex=True, height_ratios=[2, 1, 1])
    lines = (
        ("set", "set_force", INK, 1.6),
        ("felt", "felt_normal", ORANGE, 0.8),
        ("true", "contact_normal", BLUE, 0.8),
    )
    for label, name, color, width in lines:
        _line(force, time[contact], recording[name].scalar[contact], label=label, color=color, linewidth=width)
    force.set_ylabel("normal force [N]")
    force.legend(loc="lower center", ncols=3, frameon=False, fontsize=9)  # under the curves
    work = recording.within(WorkState.WORK)
    if work.any():
        difference = recording["contact_normal"].scalar[work] - recording["set_force"].scalar[work]
        _line(error, time[work], difference, color=BLUE, linewidth=0.8)
    _limits(error, bounds.force_error_max)
    error.set_ylabel("true − set [N]")
    for name, color in (("felt_force", ORANGE), ("contact_force", BLUE)):
        values = np.linalg.norm(tangential(recording, name), axis=1)
        _line(across, time[contact], values[contact], color=color, linewidth=0.8)
    across.set_ylabel("tangential [N]")
    across.set_ylim(bottom=0.0)
    _states(recording, (force, error, across), label=force)
    _time_axis(across, time[contact])
    return figure


def _path(recording: Recording, bounds: Bounds) -> Figure | None:
    error = path_error(recording)
    if error is None:
        return None
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    axes = figure.subplots()
    for label, values, color in (
        ("along", error.along, BLUE),
        ("across, in the surface", error.lateral, ORANGE),
        ("along the tool axis", error.normal, GREEN),
    ):
        _line(axes, error.time, 1e3 * values, label=label, color=color, linewidth=1.0)
    _limits(axes, 1e3 * bounds.path_deviation)
    axes.set_ylabel("deviation [mm]")
    _legend(axes)
    _time_axis(axes, error.time)
    return figure


def _hull(recording: Recording, bounds: Bounds) -> Figure | None:
    motion = hull_motion(recording)
    if motion is None:
        return None
    time, displacement, turn = motion
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    for i, (label, color) in enumerate((("x", BLUE), ("y", ORANGE), ("z", GREEN))):
        _line(upper, time, 1e3 * displacement[:, i], label=label, color=color, linewidth=1.0)
    _line(upper, time, 1e3 * np.linalg.norm(displacement, axis=1), label="distance", color=INK, linewidth=1.2)
    upper.set_ylabel("displacement [mm]")
    _legend(upper)
    _line(lower, time, np.degrees(turn), color=BLUE, linewidth=1.0)
    _limits(lower, float(np.degrees(bounds.tilt)), both=False)
    lower.set_ylabel("turn [deg]")
    lower.set_ylim(bottom=0.0)
    _time_axis(lower, time)
    return figure


def _arm_wrench(recording: Recording) -> Figure | None:
    if "arm_wrench" not in recording or "believed.arm_wrench_B" not in recording:
        return None
    measured, believed = recording["arm_wrench"], recording["believed.arm_wrench_B"]
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    both = figure.subplots(2, 1, sharex=True)
    for first, axes, label in ((0, both[0], "force [N]"), (3, both[1], "moment [N m]")):
        for i, (name, color) in enumerate((("x", BLUE), ("y", ORANGE), ("z", GREEN))):
            _line(axes, believed.time, believed.value[:, first + i], color=color, linewidth=3.0, alpha=0.3)
            _line(axes, measured.time, measured.value[:, first + i], color=color, linewidth=0.8, label=name)
        axes.set_ylabel(label)
    _legend(both[0])
    _time_axis(both[1], measured.time)
    _states(recording, tuple(both), label=None)
    return figure


def _thrust(recording: Recording) -> Figure | None:
    if "thrust" not in recording or not recording.vehicle.thruster_names:
        return None
    forward, reverse = np.asarray(recording.vehicle.thruster_table)[:, :2].T
    return _against_limits(recording, "thrust", "thrust [N]", -reverse, forward)


def _torque(recording: Recording) -> Figure | None:
    if "tau_drive" not in recording:
        return None
    limits = np.asarray(recording.vehicle.torque_limits)
    return _against_limits(recording, "tau_drive", "torque [N m]", -limits, limits)


def _against_limits(recording: Recording, name: str, label: str, low: Array, high: Array) -> Figure:
    """Draw lines over time on the left; on the right the range of each line as bars, in per cent of its limits."""
    series = recording[name]
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    over_time, ranges = figure.subplots(1, 2, width_ratios=[5, 3])
    for i in range(len(series.labels)):
        color = CYCLE[i % len(CYCLE)]
        value = series.value[:, i]
        _line(over_time, series.time, value, color=color, linewidth=0.8)
        used = 100.0 * np.where(value > 0.0, value / high[i], -value / low[i])
        ranges.barh(i, np.ptp(used), left=used.min(), color=color, height=0.6)
        ranges.text(used.max() + 3.0, i, f"{np.abs(used).max():.0f} %", va="center", fontsize=8, color=INK)
    over_time.set_ylabel(label)
    _time_axis(over_time, series.time)
    _states(recording, (over_time,), label=None)
    for limit in (-100.0, 100.0):
        ranges.axvline(limit, color=VERMILION, linewidth=1.0)
    ranges.axvline(0.0, color=FAINT, linewidth=0.6)
    ranges.set_xlim(-102.0, 102.0)
    ranges.set_yticks(range(len(series.labels)), [item.replace("_", " ") for item in series.labels])
    ranges.invert_yaxis()
    ranges.set_xlabel("share of the limit [%]")
    _bare(ranges)
    ranges.grid(visible=False, axis="y")
    ranges.tick_params(axis="y", length=0)
    return figure


def _object(recording: Recording, truth: TrueObject) -> Figure | None:
    if not recording.targets:
        return None
    X_TW = inverse(truth.X_WT)
    vertices = np.asarray(truth.model.vertices)
    work = recording.within(WorkState.WORK)
    done = transform_points(X_TW, recording["p_pad"].value[work])
    path = recording.targets[-1].path
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    for axes, (across, up) in zip(figure.subplots(1, 2), ((0, 2), (1, 2)), strict=True):
        view = [across, up]
        faces = PolyCollection(list(vertices[truth.model.triangles][:, :, view]), facecolor="#dddddd", edgecolor="none")
        faces.set_rasterized(True)
        axes.add_collection(faces)
        for (name, points), color in zip(
            _thinned(recording.clouds, X_TW).items(), (SKY, PURPLE, GREEN, BLUE), strict=False
        ):
            axes.scatter(
                *points[:, view].T, s=1.0, color=color, linewidths=0, label=name.replace("_", " "), rasterized=True
            )
        if path is not None:
            planned = transform_points(X_TW, path.p)[:, view]
            axes.plot(*planned.T, color=INK, linewidth=3.0, label="path planned", solid_capstyle="butt")
        if work.any():
            axes.plot(*done[:: max(1, len(done) // BINS), view].T, color=ORANGE, linewidth=1.2, label="path done")
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[across]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        axes.margins(0.05)
        _bare(axes)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False, fontsize=9, markerscale=5)
    return figure


def _thinned(clouds: Mapping[str, Array], X_TW: Array, most: int = 6000) -> dict[str, Array]:
    return {name: transform_points(X_TW, p[:: max(1, len(p) // most)]) for name, p in clouds.items()}


def _line(axes: Axes, time: Array, value: Array, **style: object) -> None:
    """Plot the minimum and maximum of each bin, which keeps every peak and a small file."""
    size = -(-len(time) // BINS)
    if size > 2:
        count = len(time) // size
        bins = value[: count * size].reshape(count, size)
        finite = np.isfinite(bins).all(axis=1)
        first, last = np.argmin(bins, axis=1), np.argmax(bins, axis=1)
        rows = np.sort(np.stack([first, last], axis=1), axis=1) + size * np.arange(count).reshape(-1, 1)
        time, value = time[rows].ravel(), np.where(finite.reshape(-1, 1), value[rows], np.nan).ravel()
    axes.plot(time, value, **style)  # pyright: ignore[reportArgumentType]


def _states(recording: Recording, all_axes: tuple[Axes, ...], label: Axes | None) -> None:
    """Shade the work state; write the names of all states along the upper edge of `label`."""
    ends = [event.time for event in recording.events[1:]] + [recording.duration]
    low, high = all_axes[0].get_xlim()
    for event, end in zip(recording.events, ends, strict=True):
        for axes in all_axes:
            if event.state is WorkState.WORK:
                axes.axvspan(event.time, end, color=SKY, alpha=0.12, linewidth=0)
            elif label is not None:
                axes.axvline(end, color=FAINT, linewidth=0.5, linestyle=":")
        if label is not None and event.state in CONTACT:
            middle = 0.5 * (max(event.time, low) + min(end, high))
            label.text(
                middle,
                1.01,
                event.state.value,
                transform=label.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=8,
                color=FAINT,
            )


def _limits(axes: Axes, limit: float, both: bool = True) -> None:
    for value in (limit, -limit) if both else (limit,):
        axes.axhline(value, color=VERMILION, linewidth=0.9, linestyle="--")
    axes.text(1.005, limit, "bound", transform=axes.get_yaxis_transform(), color=VERMILION, fontsize=8, va="center")


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, frameon=False, fontsize=9, borderaxespad=0.2)


def _time_axis(axes: Axes, time: Array) -> None:
    axes.set_xlabel("time [s]")
    axes.set_xlim(float(time[0]), float(time[-1]))
    axes.xaxis.set_major_locator(MaxNLocator(12))
    for each in axes.figure.axes:
        _bare(each)


def _bare(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9)

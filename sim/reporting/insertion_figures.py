"""Figures of an insertion's report: forces, tip motion, and a section of the bore."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from uuv.sim.evaluation.insertion_metrics import AT_THE_HOLE, InsertionBounds, TrueHole
from uuv.sim.interfaces.palette import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION, WIDTH
from uuv.sim.interfaces.spatial import Array, inverse, transform_points
from uuv.sim.loop.recording import Recording

_THIN = 5  # one of so many steps is drawn


def insertion_figures(
    recording: Recording, truth: TrueHole, bounds: InsertionBounds | None = None
) -> Iterator[tuple[str, str, Figure]]:
    """Draw the figures; none if the tool never left its stand-off.

    Args:
        recording: The run.
        truth: True hole.
        bounds: Bounds to draw; default: `InsertionBounds()`.

    Yields:
        Title, caption and figure.
    """
    bounds = bounds or InsertionBounds()
    rows = np.flatnonzero(recording.within(*AT_THE_HOLE))[::_THIN]
    if not len(rows):
        return

    tip = _TipRun.of(recording, truth, rows)
    yield (
        "Forces at the hole",
        "Across the true axis of the hole and against the advance; dashed the bound.",
        _forces(tip, bounds.side_force),
    )
    yield (
        "Path of the tip",
        "In the frame of the true hole; shaded the radial clearance.",
        _way(tip, truth),
    )
    yield (
        "The hole, and the path of the tip",
        "Left a section without the chamfer, right a plan; the tool's radius fits within the "
        "bore for a tip within the dashed circle.",
        _section_and_plan(tip, truth),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _TipRun:
    """Series of the tip at the hole, in the hole's true frame H."""

    time: Array  # (N,) [s]
    true_H: Array  # (N, 3) [N] contact force
    felt_H: Array  # (N, 3) [N] the same as estimated
    tip_H: Array  # (N, 3) [m]
    asked_H: Array  # (N, 3) [m] the reference
    begins: list[tuple[float, str]]  # [s] and state

    @classmethod
    def of(cls, recording: Recording, truth: TrueHole, rows: np.ndarray) -> "_TipRun":
        """At `rows` (N,) of the recording's series."""
        time = recording["p_pad"].time[rows]
        R_WH = truth.X_WH[:3, :3]
        X_HW = inverse(truth.X_WH)
        return cls(
            time=time,
            true_H=recording["contact_force"].value[rows] @ R_WH,
            felt_H=recording["felt_force"].value[rows] @ R_WH,
            tip_H=transform_points(X_HW, recording["p_pad"].value[rows]),
            asked_H=transform_points(X_HW, recording["p_command"].value[rows]),
            begins=[
                (event.time, event.state.value)
                for event in recording.events
                if event.time >= time[0] - 1e-9
            ],
        )


def _forces(tip: _TipRun, bound: float) -> Figure:
    """Side and axial force over time, with the bound [N] of the side force."""
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for label, force_H, color in (("felt", tip.felt_H, ORANGE), ("true", tip.true_H, BLUE)):
        upper.plot(
            tip.time,
            np.linalg.norm(force_H[:, :2], axis=1),
            color=color,
            linewidth=0.8,
            label=label,
        )
        lower.plot(tip.time, -force_H[:, 2], color=color, linewidth=0.8, label=label)

    upper.axhline(bound, color=VERMILION, linewidth=0.8, linestyle="--")
    upper.set_ylabel("side force [N]")
    lower.set_ylabel("axial force [N]")
    lower.set_xlabel("time [s]")
    upper.legend(frameon=False, fontsize=9, ncols=2)

    for start, name in tip.begins:
        for axes in (upper, lower):
            axes.axvline(start, color=FAINT, linewidth=0.6)
        upper.text(
            start, 1.01, f" {name}", transform=upper.get_xaxis_transform(), fontsize=8, rotation=30
        )

    return figure


def _way(tip: _TipRun, truth: TrueHole) -> Figure:
    """Coordinates of tip and reference over time."""
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(tip.time, 1e3 * tip.tip_H[:, 2], color=BLUE, linewidth=1.0, label="tip")
    upper.plot(
        tip.time,
        1e3 * tip.asked_H[:, 2],
        color=ORANGE,
        linewidth=0.8,
        linestyle="--",
        label="reference",
    )

    upper.axhline(1e3 * truth.depth, color=FAINT, linewidth=0.6)
    upper.set_ylabel("below the mouth [mm]")
    upper.legend(frameon=False, fontsize=9)
    for label, coordinate, color in (
        ("tip, x", tip.tip_H[:, 0], BLUE),
        ("tip, y", tip.tip_H[:, 1], GREEN),
    ):
        lower.plot(tip.time, 1e3 * coordinate, color=color, linewidth=1.0, label=label)
    for label, coordinate in (
        ("reference, x", tip.asked_H[:, 0]),
        ("reference, y", tip.asked_H[:, 1]),
    ):
        lower.plot(
            tip.time, 1e3 * coordinate, color=INK, linewidth=0.6, linestyle="--", label=label
        )

    clearance = 1e3 * (truth.radius - truth.tool_radius)
    lower.axhspan(-clearance, clearance, color=FAINT, alpha=0.15)
    lower.set_ylabel("distance from the axis [mm]")
    lower.set_xlabel("time [s]")
    lower.legend(frameon=False, fontsize=9, ncols=4)

    return figure


def _section_and_plan(tip: _TipRun, truth: TrueHole) -> Figure:
    """The hole with the path of the tip: in a plane through its axis, and along the axis."""
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    section, plan = figure.subplots(1, 2)
    r = 1e3 * truth.radius
    clearance = 1e3 * (truth.radius - truth.tool_radius)
    section.plot(
        [-2 * r, -r, -r, r, r, 2 * r],
        1e3 * truth.depth * np.array([0, 0, 1.3, 1.3, 0, 0]),
        color=INK,
    )
    section.plot(1e3 * tip.tip_H[:, 0], 1e3 * tip.tip_H[:, 2], color=BLUE, linewidth=1.0)
    section.invert_yaxis()
    section.set_aspect("equal")
    section.set_xlabel("x [mm]")
    section.set_ylabel("below the mouth [mm]")

    inside = tip.tip_H[:, 2] > 0.0
    plan.add_patch(Circle((0.0, 0.0), r, fill=False, color=INK))
    plan.add_patch(Circle((0.0, 0.0), clearance, fill=False, color=FAINT, linestyle="--"))
    plan.plot(
        1e3 * tip.tip_H[~inside, 0],
        1e3 * tip.tip_H[~inside, 1],
        color=ORANGE,
        linewidth=0.8,
        label="before the mouth",
    )
    plan.plot(
        1e3 * tip.tip_H[inside, 0],
        1e3 * tip.tip_H[inside, 1],
        color=BLUE,
        linewidth=0.8,
        label="in the bore",
    )

    plan.set_aspect("equal")
    plan.set_xlabel("x [mm]")
    plan.set_ylabel("y [mm]")
    plan.legend(frameon=False, fontsize=9)

    return figure

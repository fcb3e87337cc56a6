"""Figures of an insertion's report: forces, tip motion, and a section of the bore."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from uuv.sim.evaluation.insertion_metrics import AT_THE_HOLE, InsertionBounds, TrueHole
from uuv.sim.interfaces.palette import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION, WIDTH
from uuv.sim.interfaces.spatial import inverse, transform_points
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

    time = recording["p_pad"].time[rows]
    R, X_HW = truth.X_WH[:3, :3], inverse(truth.X_WH)
    true_H = recording["contact_force"].value[rows] @ R
    felt_H = recording["felt_force"].value[rows] @ R
    tip_H, asked_H = (
        transform_points(X_HW, recording[name].value[rows]) for name in ("p_pad", "p_command")
    )

    begins = [
        (event.time, event.state.value)
        for event in recording.events
        if event.time >= time[0] - 1e-9
    ]

    # Forces.
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for label, force_H, color in (("felt", felt_H, ORANGE), ("true", true_H, BLUE)):
        upper.plot(
            time, np.linalg.norm(force_H[:, :2], axis=1), color=color, linewidth=0.8, label=label
        )
        lower.plot(time, -force_H[:, 2], color=color, linewidth=0.8, label=label)

    upper.axhline(bounds.side_force, color=VERMILION, linewidth=0.8, linestyle="--")
    upper.set_ylabel("side force [N]")
    lower.set_ylabel("axial force [N]")
    lower.set_xlabel("time [s]")
    upper.legend(frameon=False, fontsize=9, ncols=2)

    for start, name in begins:
        for axes in (upper, lower):
            axes.axvline(start, color=FAINT, linewidth=0.6)
        upper.text(
            start, 1.01, f" {name}", transform=upper.get_xaxis_transform(), fontsize=8, rotation=30
        )

    yield (
        "Forces at the hole",
        ("Across the true axis of the hole and against the advance; dashed the bound."),
        figure,
    )

    # Way of the tip, in the frame of the hole.
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(time, 1e3 * tip_H[:, 2], color=BLUE, linewidth=1.0, label="tip")
    upper.plot(
        time, 1e3 * asked_H[:, 2], color=ORANGE, linewidth=0.8, linestyle="--", label="reference"
    )

    upper.axhline(1e3 * truth.depth, color=FAINT, linewidth=0.6)
    upper.set_ylabel("below the mouth [mm]")
    upper.legend(frameon=False, fontsize=9)
    for label, coordinate, color in (("tip, x", tip_H[:, 0], BLUE), ("tip, y", tip_H[:, 1], GREEN)):
        lower.plot(time, 1e3 * coordinate, color=color, linewidth=1.0, label=label)
    for label, coordinate in (("reference, x", asked_H[:, 0]), ("reference, y", asked_H[:, 1])):
        lower.plot(time, 1e3 * coordinate, color=INK, linewidth=0.6, linestyle="--", label=label)

    clearance = 1e3 * (truth.radius - truth.tool_radius)
    lower.axhspan(-clearance, clearance, color=FAINT, alpha=0.15)
    lower.set_ylabel("distance from the axis [mm]")
    lower.set_xlabel("time [s]")
    lower.legend(frameon=False, fontsize=9, ncols=4)

    yield "Path of the tip", "In the frame of the true hole; shaded the radial clearance.", figure

    # Section and plan of the hole.
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    section, plan = figure.subplots(1, 2)
    r = 1e3 * truth.radius
    section.plot(
        [-2 * r, -r, -r, r, r, 2 * r],
        1e3 * truth.depth * np.array([0, 0, 1.3, 1.3, 0, 0]),
        color=INK,
    )
    section.plot(1e3 * tip_H[:, 0], 1e3 * tip_H[:, 2], color=BLUE, linewidth=1.0)
    section.invert_yaxis()
    section.set_aspect("equal")
    section.set_xlabel("x [mm]")
    section.set_ylabel("below the mouth [mm]")

    inside = tip_H[:, 2] > 0.0
    plan.add_patch(Circle((0.0, 0.0), r, fill=False, color=INK))
    plan.add_patch(Circle((0.0, 0.0), clearance, fill=False, color=FAINT, linestyle="--"))
    plan.plot(
        1e3 * tip_H[~inside, 0],
        1e3 * tip_H[~inside, 1],
        color=ORANGE,
        linewidth=0.8,
        label="before the mouth",
    )
    plan.plot(
        1e3 * tip_H[inside, 0],
        1e3 * tip_H[inside, 1],
        color=BLUE,
        linewidth=0.8,
        label="in the bore",
    )

    plan.set_aspect("equal")
    plan.set_xlabel("x [mm]")
    plan.set_ylabel("y [mm]")
    plan.legend(frameon=False, fontsize=9)

    yield (
        "The hole, and the path of the tip",
        "Left a section without the chamfer, right a plan; the tool's radius fits within the "
        "bore for a tip within the dashed circle.",
        figure,
    )

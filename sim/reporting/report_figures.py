"""Figures of `report.html` that are no time series, drawn from a recording."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from uuv.sim.evaluation.surface.force_levels import ForceSteps
from uuv.sim.evaluation.surface.tool_errors import TrueObject
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.palette import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, WIDTH, plain_axes
from uuv.sim.interfaces.spatial import Array, inverse, transform_points
from uuv.sim.loop.recording import Recording

_POINTS = 900  # of a line
UNJUDGED = "#9aa7ab"  # colour of a path where the force error is not judged


def object_as_found(recording: Recording, truth: TrueObject) -> Iterator[tuple[str, str, Figure]]:
    """Title, caption and figure of the object as found, in its frame; nothing without a find."""
    if not recording.targets:
        return

    X_TW = inverse(truth.X_WT)
    vertices = np.asarray(truth.model.vertices)
    work = recording.within(WorkState.WORK)
    done = transform_points(X_TW, recording["p_pad"].value[work])
    path = recording.targets[-1].path

    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    for axes, (across, up) in zip(figure.subplots(1, 2), ((0, 2), (1, 2)), strict=True):
        view = [across, up]
        faces = PolyCollection(
            list(vertices[truth.model.triangles][:, :, view]), facecolor="#dddddd", edgecolor="none"
        )
        faces.set_rasterized(True)
        axes.add_collection(faces)

        # Clouds of the identification.
        for (name, points), color in zip(
            _thinned(recording.clouds, X_TW).items(), (SKY, PURPLE, GREEN, BLUE), strict=False
        ):
            axes.scatter(
                *points[:, view].T,
                s=1.0,
                color=color,
                linewidths=0,
                label=name.replace("_", " "),
                rasterized=True,
            )

        # Path as planned and as done.
        if path is not None:
            planned = transform_points(X_TW, path.p)[:, view]
            axes.plot(
                *planned.T, color=INK, linewidth=3.0, label="planned path", solid_capstyle="butt"
            )
        if work.any():
            axes.plot(
                *done[:: max(1, len(done) // _POINTS), view].T,
                color=ORANGE,
                linewidth=1.2,
                label="path of the tip",
            )

        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[across]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        axes.margins(0.05)
        plain_axes(axes, 9)

    # One legend for both views.
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=5,
        frameon=False,
        fontsize=9,
        markerscale=5,
    )

    yield (
        "Object, as identified",
        "In the frame of the true object: its true shape in grey, the point clouds of its "
        "identification, the planned path and the path of the tip.",
        figure,
    )


def path_by_force_error(recording: Recording) -> Iterator[tuple[str, str, Figure]]:
    """Title, caption and figure of the worked path by the force error; nothing without a force."""
    steps = ForceSteps.of(recording)
    judged = steps.settled & (steps.force > 0.0)
    if not judged.any():
        return

    # The path in the plane in which it is widest, and the error there.
    rows = np.flatnonzero(recording.within(WorkState.WORK))
    rows = rows[:: max(1, len(rows) // _POINTS)]
    points = recording["p_pad"].value[rows]
    plane = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][:2]
    across, up = plane @ (points - points.mean(axis=0)).T
    error = np.where(judged, recording["contact_normal"].scalar - steps.force, np.nan)
    most = float(np.nanmax(abs(error)))

    # Coloured pieces, grey where the set force changes.
    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    axes = figure.subplots()
    pieces = np.stack([np.column_stack([across, up])[:-1], np.column_stack([across, up])[1:]], 1)
    colours = colormaps["RdBu_r"].with_extremes(bad=UNJUDGED)
    drawn = LineCollection(list(pieces), cmap=colours, linewidths=7.0, capstyle="butt")
    drawn.set_array(np.ma.masked_invalid(error[rows][:-1]))
    drawn.set_clim(-most, most)
    axes.add_collection(drawn)

    axes.plot(*np.array([across[0], up[0]])[:, None], "o", color=INK, markersize=5)
    axes.annotate("start", (across[0], up[0]), (0, 9), textcoords="offset points", fontsize=9)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08, 0.3)
    axes.set_xlabel("along the path's longest side [m]")
    axes.set_ylabel("across [m]")
    plain_axes(axes, 9)
    figure.colorbar(drawn, ax=axes, label="true less set force [N]", pad=0.01)

    rms = float(np.sqrt(np.nanmean(error**2)))
    yield (
        "Path by force error",
        f"The path of the tip by the error of the true normal force: RMS {rms:.2f} N, means over "
        "the loop's steps. Grey: the set force changes, and the error is not judged.",
        figure,
    )


def _thinned(clouds: Mapping[str, Array], X_TW: Array, most: int = 6000) -> dict[str, Array]:
    return {
        name: transform_points(X_TW, p[:: max(1, len(p) // most)]) for name, p in clouds.items()
    }

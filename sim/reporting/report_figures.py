"""Figures of `report.html` that are no time series, drawn from a recording."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from uuv.sim.evaluation.metrics import TrueObject
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.palette import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, WIDTH, plain_axes
from uuv.sim.interfaces.spatial import Array, inverse, transform_points
from uuv.sim.loop.recording import Recording

_POINTS = 900  # of a line


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


def _thinned(clouds: Mapping[str, Array], X_TW: Array, most: int = 6000) -> dict[str, Array]:
    return {
        name: transform_points(X_TW, p[:: max(1, len(p) // most)]) for name, p in clouds.items()
    }

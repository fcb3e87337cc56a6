"""Figures of a calibration report: [Yukhimets 2023, fig. 4-8], and intervals of parameters."""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

from uuv.calib.identification import Calibration
from uuv.calib.touches import first_tcp
from uuv.calib.verification import Cloud, pair_distances
from uuv.sim.interfaces.palette import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION, WIDTH, plain_axes
from uuv.sim.interfaces.spatial import Array

# As in the paper: nominal grey, controller orange, identified blue, tracker red.
_LOOKS = {
    "nominal": (FAINT, "o"),
    "controller": (ORANGE, "+"),
    "identified": (BLUE, "x"),
    "tracker": (VERMILION, "."),
}
_PLANES = ((0, 1), (0, 2))


def figures(
    calibration: Calibration,
    series: Sequence[Array],
    point_names: Sequence[str],
    clouds: Mapping[str, Cloud],
) -> Iterator[tuple[str, str, Figure]]:
    """Generate title, caption and figure of each picture, in order of reading.

    Args:
        calibration: result to show.
        series: touches (m_i, n) used for the identification.
        point_names: names of the touched points.
        clouds: point clouds of `uuv.calib.verification.compare`; their figures are left out where
            it is empty.

    Returns:
        Iterator over (title, caption, figure).
    """
    yield (
        "Distances between the touches of a point",
        "Every pair of touches of one point, by the nominal arm (grey) and by the identified one "
        "(blue), point after point [Yukhimets 2023, fig. 4].",
        _pairs(calibration, series, point_names),
    )

    # The comparison with a tracker, if there is one.
    if clouds:
        raw = (
            "Flange points at constant orientation: as the tracker measures them in its own frame, "
            "and as each model "
        )
        stages: tuple[tuple[str, str, Callable[[Cloud], Array]], ...] = (
            (
                "Clouds as measured and computed",
                raw + "computes them in the arm's (figure 5).",
                lambda c: c.raw,
            ),
            (
                "Clouds, centred",
                "The same points minus their means; the frames differ in orientation (figure 6).",
                lambda c: c.centred,
            ),
            (
                "Clouds, aligned",
                "Each model's cloud turned onto the tracker's (figure 7).",
                lambda c: c.aligned,
            ),
        )

        for title, caption, stage in stages:
            yield title, caption, _clouds({name: stage(cloud) for name, cloud in clouds.items()})

        yield (
            "Residuals between model and tracker",
            "Distance of every flange point from the tracker's, after alignment (figure 8)."
            + (
                " The controller's table is that of a simulated maker."
                if "controller" in clouds
                else ""
            ),
            _deviations(clouds),
        )

    yield (
        "Touches about their points",
        "Distance of every touch from its point under the identified arm; crosses are outliers, "
        "open circles have a reduced weight.",
        _residuals(calibration, point_names),
    )

    yield (
        "Changes of the parameters",
        "Identified minus nominal in deviations of the prior, with 95 % intervals: a bar as wide "
        "as the band: no information from the touches; a short bar: an identified parameter.",
        _changes(calibration),
    )


def _pairs(calibration: Calibration, series: Sequence[Array], names: Sequence[str]) -> Figure:
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    axes = figure.subplots()
    tcp = first_tcp(calibration.nominal, list(series))
    before = pair_distances([calibration.nominal.tips(q, tcp) for q in series])
    after = pair_distances(calibration.touched_tips(series))

    axes.plot(
        1e3 * before,
        color=FAINT,
        linewidth=0.7,
        label=f"nominal, mean {1e3 * before.mean():.3g} mm",
    )
    axes.plot(
        1e3 * after,
        color=BLUE,
        linewidth=0.7,
        label=f"identified, mean {1e3 * after.mean():.3g} mm",
    )

    # A line between points; their names are shown only if there is room.
    start = 0
    for name, q in zip(names, series, strict=True):
        count = len(q) * (len(q) - 1) // 2
        if start:
            axes.axvline(start, color=INK, linewidth=0.4)
        if len(names) <= 12:
            _above(axes, start + 0.5 * count, name)
        start += count

    axes.set_yscale("log")
    axes.set_xlim(0, max(start - 1, 1))
    axes.set_xlabel("pair")
    axes.set_ylabel("distance [mm]")
    axes.legend(loc="lower center", ncols=2, frameon=False, fontsize=9)
    plain_axes(axes)
    return figure


def _clouds(clouds: Mapping[str, Array]) -> Figure:
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    for axes, (i, j) in zip(figure.subplots(1, 2), _PLANES, strict=True):
        for name, points in clouds.items():
            color, marker = _LOOKS.get(name, (GREEN, "s"))
            axes.plot(
                points[:, i],
                points[:, j],
                marker,
                color=color,
                label=name,
                markersize=8 if marker == "o" else 6,
                fillstyle="none",
            )

        axes.set_xlabel(f"{'xyz'[i]} [m]")
        axes.set_ylabel(f"{'xyz'[j]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
        plain_axes(axes)

    figure.axes[0].legend(frameon=False, fontsize=9)
    return figure


def _deviations(clouds: Mapping[str, Cloud]) -> Figure:
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    axes = figure.subplots()

    for name, cloud in clouds.items():
        if name == "tracker":
            continue
        color, marker = _LOOKS.get(name, (GREEN, "s"))
        numbers = np.arange(1, len(cloud.deviations) + 1)
        axes.plot(
            numbers,
            1e3 * cloud.deviations,
            marker=marker,
            color=color,
            label=f"{name}, RMS {1e3 * cloud.rms:.3f} mm",
        )

    axes.set_xlabel("flange point")
    axes.set_ylabel("deviation [mm]")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    plain_axes(axes)
    return figure


def _residuals(calibration: Calibration, names: Sequence[str]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.8), layout="constrained")
    axes = figure.subplots()
    out = {(outlier.series, outlier.touch) for outlier in calibration.outliers}

    start = 0
    for i, residuals in enumerate(calibration.residuals):
        places = start + np.arange(len(residuals))
        left_out = np.array([(i, j) in out for j in range(len(residuals))], dtype=bool)
        color = (BLUE, GREEN, ORANGE)[i % 3]
        axes.plot(places[~left_out], 1e3 * residuals[~left_out], ".", color=color)
        axes.plot(places[left_out], 1e3 * residuals[left_out], "x", color=VERMILION)
        reduced = (calibration.weights[i] < 1.0) & ~left_out
        axes.plot(
            places[reduced],
            1e3 * residuals[reduced],
            "o",
            color=color,
            markersize=9,
            fillstyle="none",
        )

        if len(names) <= 12:
            _above(axes, float(places.mean()), names[i])
        start += len(residuals)

    # On a linear axis outliers would hide the other touches.
    if out:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)

    axes.set_xlabel("touch")
    axes.set_ylabel("distance [mm]")
    plain_axes(axes)
    return figure


def _changes(calibration: Calibration) -> Figure:
    of_arm = np.array(
        [i for i, group in enumerate(calibration.estimate.parameters.groups) if group != "tcp"],
        dtype=int,
    )

    figure = Figure(figsize=(WIDTH, 0.6 + 0.19 * len(of_arm)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(of_arm))
    scale = calibration.estimate.prior[of_arm]

    # Band of the prior, and intervals of the fit.
    axes.axvspan(*norm.interval(0.95), color="#eeeeee")
    axes.errorbar(
        calibration.estimate.changes[of_arm] / scale,
        places,
        fmt="o",
        markersize=3,
        color=BLUE,
        linewidth=1.4,
        xerr=calibration.quantile() * calibration.sigma[of_arm] / scale,
    )

    axes.set_yticks(places, [calibration.names[i] for i in of_arm], fontsize=7)
    axes.invert_yaxis()
    axes.set_xlabel("change over the prior's deviation")
    plain_axes(axes)
    return figure


def _above(axes: Axes, x: float, name: str) -> None:
    axes.text(
        x, 1.0, name, ha="center", va="bottom", fontsize=8, transform=axes.get_xaxis_transform()
    )

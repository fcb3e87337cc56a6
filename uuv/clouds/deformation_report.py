"""Reports of a deformation map: table of regions, image, coloured point cloud, figures for JSON."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from uuv.models.meshes.ply_files import write_ply
from uuv.perception.toolpath.deformation import DeformationMap
from uuv.sim.interfaces.spatial import Array

_COLOURS = matplotlib.colormaps["RdBu_r"]  # red: fouling, blue: dents
_MARGIN = 10  # [px] margin around the compared area


def table(deformation: DeformationMap) -> Table:
    """Table of the regions, largest first."""
    rows = Table(
        title=f"Deviation from the model above {1e3 * deformation.size_m:.1f} mm",
        caption="middle in the object's own frame; growth positive, dents negative",
    )
    for column in ("", "middle [m]", "extent [mm]", "area [cm2]", "mean [mm]", "largest [mm]"):
        rows.add_column(column, justify="right", no_wrap=True)

    for k, region in enumerate(deformation.regions, start=1):
        middle = ", ".join(f"{value:.3f}" for value in region.p_T)
        extent = f"{1e3 * region.length_m:.0f} x {1e3 * region.width_m:.0f}"
        deviations = (f"{1e3 * value:+.1f}" for value in (region.mean_m, region.largest_m))
        rows.add_row(str(k), middle, extent, f"{1e4 * region.area_m2:.0f}", *deviations)
    return rows


def figures(deformation: DeformationMap) -> dict[str, Any]:
    """The regions and the noise of the map for a JSON file, with all digits."""
    return {
        "size_m": deformation.size_m,
        "noise_m": deformation.noise_m,
        "compared": deformation.compared,
        "regions": [
            {
                "p_T_m": region.p_T.tolist(),
                "p_sensor_m": region.p_S.tolist(),
                "length_m": region.length_m,
                "width_m": region.width_m,
                "area_m2": region.area_m2,
                "mean_m": region.mean_m,
                "largest_m": region.largest_m,
            }
            for region in deformation.regions
        ],
    }


def picture_of_deviations(deformation: DeformationMap, title: str) -> Figure:
    """Image of the deviations in the sensor's view, with numbered regions; pixels without
    comparison are grey.
    """
    rows, columns = np.nonzero(np.isfinite(deformation.deviation))
    window = tuple(
        slice(max(0, int(at.min()) - _MARGIN), int(at.max()) + _MARGIN + 1)
        for at in (rows, columns)
    )
    off = 1e3 * deformation.deviation[window]
    label = deformation.label[window]
    depth = deformation.points_S[window][..., 2]

    # Grey for pixels with a range, and colours for those that were compared.
    figure = Figure(figsize=(9, 7), layout="constrained")
    axes = figure.subplots()
    grey = np.full((*off.shape, 4), 1.0)
    grey[np.isfinite(depth)] = (0.8, 0.8, 0.8, 1.0)
    axes.imshow(grey)

    most = _most(deformation)
    shown = axes.imshow(off, cmap=_COLOURS, vmin=-1e3 * most, vmax=1e3 * most, interpolation="none")

    for k, region in enumerate(deformation.regions, start=1):
        inside = label == k
        axes.contour(inside, levels=[0.5], colors="k", linewidths=0.8)
        row, column = (float(np.mean(at)) for at in np.nonzero(inside))
        axes.annotate(
            f"{k}: {1e3 * region.largest_m:+.0f} mm",
            (column, row),
            ha="center",
            va="center",
            fontsize="small",
            bbox={"boxstyle": "round", "facecolor": "w", "alpha": 0.8, "linewidth": 0.0},
        )

    figure.colorbar(
        shown, ax=axes, label="deviation from the model, growth positive [mm]", shrink=0.8
    )
    axes.set(xticks=[], yticks=[], xlabel="as the sensor sees it; grey: not compared")
    figure.suptitle(title, fontsize="medium")
    return figure


def save_cloud(deformation: DeformationMap, file: Path) -> None:
    """Write the compared points, in the sensor frame, to a PLY file in the colours of the image."""
    points, off = deformation.cloud_S
    write_ply(
        file, points, colours=np.asarray(_COLOURS(0.5 + 0.5 * off / _most(deformation)))[:, :3]
    )


def _most(deformation: DeformationMap) -> float:
    """Deviation [m] at the ends of the colour scale."""
    sizes: Array = np.array([abs(region.largest_m) for region in deformation.regions])
    return float(sizes.max(initial=deformation.size_m))

"""Pictures of the study of unseen objects: what became of the scenes, and some of the scenes
themselves.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.identification.unseen.scenes import HIDDEN, UnseenCase, build
from uuv.clouds.frames import pinhole
from uuv.experiment import Row
from uuv.perception.registration.pose_check import Decision
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LIGHT = np.array([-0.4, -0.5, -0.77])  # direction towards the light, in C
_TINT = np.array([1.0, 0.72, 0.45])  # of the object's pixels
_DEPTHS = 0.7  # [m] range of colours before and behind the object

# name: colour, whether a row belongs to it
OUTCOMES: Mapping[str, tuple[str, Callable[[Row], bool]]] = {
    "found, accepted": ("C2", lambda row: row["found"] and row["decision"] == Decision.ACCEPT),
    "found, not accepted": ("C1", lambda row: row["found"] and row["decision"] != Decision.ACCEPT),
    "not found": ("0.75", lambda row: not row["found"] and row["decision"] != Decision.ACCEPT),
    "wrong, accepted": ("C3", lambda row: not row["found"] and row["decision"] == Decision.ACCEPT),
}


def recall_chart(rows: Sequence[Row]) -> "Figure":
    """Bar chart of what became of the scenes with the object, by class of shape and occlusion."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    axes = figure.subplots(1, 2, width_ratios=(10, 3))
    for panel, key, label in zip(axes, ("shape", "hidden"), ("shape", "hidden"), strict=True):
        kinds = {row[key] for row in rows}
        names = [name for name in HIDDEN if name in kinds] if key == "hidden" else sorted(kinds)

        # Bars of the outcomes, one on top of the other.
        low = np.zeros(len(names))
        for outcome, (colour, belongs) in OUTCOMES.items():
            count = np.array(
                [sum(belongs(row) for row in rows if row[key] == name) for name in names]
            )
            panel.bar(names, count, bottom=low, color=colour, label=outcome)
            low += count

        panel.tick_params(axis="x", rotation=30)
        panel.set_xlabel(label)
        panel.yaxis.set_major_locator(MaxNLocator(integer=True))

    axes[0].set_ylabel("scenes")
    axes[0].legend(fontsize="small", ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def gallery(cases: Sequence[UnseenCase]) -> "Figure":
    """Scenes as an ideal camera sees them, the object in colour, each beside the depth that its
    sensor reads.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    columns = 2
    lines = -(-len(cases) // columns)

    figure = Figure(figsize=(11.0, 2.15 * lines), layout="constrained")
    axes = figure.subplots(lines, 2 * columns, squeeze=False)
    colours = colormaps["viridis"].with_extremes(bad="0.85")

    for panel in axes.ravel():
        panel.set_axis_off()

    for k, case in enumerate(cases):
        scene = build(case)

        # Left: the true depth, shaded.
        left, right = axes[k // columns, 2 * (k % columns) : 2 * (k % columns) + 2]
        grey = np.repeat(shaded(scene.exact)[..., None], 3, axis=2)
        left.imshow(np.where(scene.seen[..., None], grey * _TINT, grey))
        left.set_title(
            f"{scene.shape.kind}, {case.around}, {100 * scene.hidden:.0f} % hidden", fontsize=8
        )

        # Right: what the sensor reads, about the object's distance.
        z = float(scene.X_CT[2, 3])
        right.imshow(
            scene.scan.depth,
            cmap=colours,
            vmin=z - _DEPTHS,
            vmax=z + _DEPTHS,
            interpolation="nearest",
        )
        right.set_title(case.sensor, fontsize=8)

    return figure


def shaded(depth: np.ndarray) -> Array:
    """Brightness (h, w) of a depth image (h, w) [m] under a lamp; 1 where there is nothing."""
    step = 640 // depth.shape[1]
    with np.errstate(invalid="ignore"):
        points = pinhole(step) * depth[..., None]
        normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        light = np.clip(0.25 + 0.75 * normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.15, 1.0)

    return np.where(np.isfinite(light), light, np.where(np.isfinite(depth), 0.15, 1.0))

"""Deviation of tool paths from the true surface of fouled and dented objects.

For each seed an object is drawn and seen by the depth camera in a few frames from nearly one
position. It is identified in the last frame, and a path is planned on the median of all. Distances
to the true surface are taken along the tool's axis, from the path and from the undeformed model.
The tool's tilt is relative to the true normal at its tip. Beside it stands the change of that
normal within the pad. Seen and unseen parts of the path are listed separately. Exit code 0 if all
seen parts of all paths are within the bound.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.toolpath.path_deviation import (
    BOUND,
    SCENES,
    PathFigures,
    PathScene,
    TrueSurface,
    identified,
    path_figures,
)
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.perception.finding.target_finder import with_fused_frames
from uuv.sim.interfaces.spatial import inverse
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.depth_camera import NOISE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEGREES = math.degrees(1.0)


@dataclass(frozen=True, kw_only=True)
class PathCase:
    """One object with one seed."""

    object: str
    """Name of the object, and how it is deformed."""
    looks: int = 1
    """Depth frames whose median the path is planned on; jobs with possible growth or dents take
    16.
    """
    exact: bool = False
    """Exact depth: shows the errors due to the camera's resolution and the path's smoothing
    alone.
    """
    judged: bool = True
    """Plan only on accepted identifications (--no-judged: on the best pose in any case)."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, looks=1)


def _by_path(label: str, unit: str = "", factor: float = 1.0, digits: int = 1) -> Any:
    """Column with a value for each path of the object."""
    return column(label, unit, factor=factor, digits=digits, by="path")


@dataclass(frozen=True, kw_only=True)
class PathRow:
    """Error of the identification, and the figures of each path: `PathFigures`."""

    accepted: bool = column("accepted")
    reason: str = column("reason")
    position_error: float = column("position error", "mm", digits=1, factor=1e3)
    angle_error: float = column("orientation error", "deg", digits=1, factor=DEGREES)

    refused: Mapping[str, str] = _by_path("refused")
    seen: Mapping[str, float | None] = _by_path("seen", "%", 100.0, 0)
    model_rms: Mapping[str, float | None] = _by_path("model", "mm", 1e3)
    model_largest: Mapping[str, float | None] = _by_path("model", "mm", 1e3)
    path_rms: Mapping[str, float | None] = _by_path("path", "mm", 1e3)
    path_largest: Mapping[str, float | None] = _by_path("path", "mm", 1e3)
    within: Mapping[str, float | None] = _by_path("path within 3 mm", "%", 100.0)
    unseen_largest: Mapping[str, float | None] = _by_path("unseen path", "mm", 1e3)
    tilt_rms: Mapping[str, float | None] = _by_path("tilt", "deg", DEGREES)
    tilt_largest: Mapping[str, float | None] = _by_path("tilt", "deg", DEGREES)
    turn_rms: Mapping[str, float | None] = _by_path("turn of the normal", "deg", DEGREES)
    profile: Mapping[str, Mapping[str, list[float]] | None] = column("profile", by="path")


@experiment(
    "paths",
    seeds=10,
    vary={"object": tuple(SCENES)},
    paired=True,
    quick={"runs": 1, "object": ("fouled barrel", "dented pile")},
)
def paths(case: PathCase) -> PathRow:
    """Identifies a deformed object, and plans its paths."""
    return path_row(SCENES[case.object], case)


def path_row(scene: PathScene, case: PathCase) -> PathRow:
    """Row of a case with a scene."""
    streams = Streams(case.seed)
    true, frames = scene.seen(streams, case.looks, None if case.exact else NOISE)
    X_CT = inverse(frames[-1].X_WS)
    identification = identified(scene.known, frames[-1], streams)
    position, angle = scene.known.symmetry.error(identification.X_sensor_target, X_CT)

    if case.judged and not identification.accepted:
        refusal = PathFigures(refused=f"not accepted: {identification.reason}")
        figures = dict.fromkeys(scene.paths, refusal)
    else:
        fused = with_fused_frames(replace(identification, accepted=True), frames)
        surface = TrueSurface(true.target)
        figures = {
            name: path_figures(fused, path, surface, inverse(X_CT))
            for name, path in scene.paths.items()
        }
    return PathRow(
        accepted=identification.accepted,
        reason=identification.reason,
        position_error=position,
        angle_error=angle,
        **{
            entry.name: {name: getattr(figures[name], entry.name) for name in figures}
            for entry in fields(PathFigures)
        },
    )


def distances(row: Mapping[str, Any]) -> list[float | None]:
    """Largest distance of each path of a row from the true surface."""
    return [*row["path_largest"].values()]


def pictures(rows: list[Row]) -> "list[tuple[str, str, Figure]]":
    """Distance of every planned path from the true surface, an object a panel."""
    from matplotlib.figure import Figure

    if not rows:
        return []
    objects = list(dict.fromkeys(row["object"] for row in rows))
    figure = Figure(figsize=(9, 2.4 * len(objects)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(objects)))

    for axes, name in zip(panels, objects, strict=True):
        profiles = [row["profile"] for row in rows if row["object"] == name]
        for profile in profiles:
            for k, line in enumerate(profile.values()):
                if line is not None:
                    shown = np.where(line["seen"], line["distance"], np.nan)
                    axes.plot(line["s"], 1e3 * shown, color=f"C{k}", linewidth=0.8)

        # the bound, and which colour is which path
        axes.axhspan(-1e3 * BOUND, 1e3 * BOUND, color="0.9")
        axes.set(title=f"{name}; grey: the bound", ylabel="off the true surface [mm]")
        for k, path in enumerate(profiles[0]):
            axes.plot([], [], color=f"C{k}", label=path)
        axes.legend(fontsize="small", loc="upper right")

    figure.supxlabel("along the path [m], where seen; a line a seed")
    caption = "Distance of every path from the true surface, where seen; grey: the bound."
    return [("Paths", caption, figure)]


paths.page = (
    Page()
    .table(
        "Paths off the true surface, and tilt of the tool, where seen",
        by=("object", "looks", "path"),
        columns=[
            stat("share", lambda row: bool(row["refused"]), "refused"),
            stat("mean", "seen", "seen"),
            *(stat(kind, f"model_{kind}") for kind in ("rms", "largest")),
            *(stat(kind, f"path_{kind}") for kind in ("rms", "largest")),
            stat("mean", "within", "path within 3 mm"),
            stat("largest", "unseen_largest"),
            *(stat(kind, f"tilt_{kind}") for kind in ("rms", "largest")),
            stat("rms", "turn_rms"),
        ],
    )
    .accept(stat("largest", distances, "off the true surface", unit="m"), most=BOUND)
    .add(pictures)
)

if __name__ == "__main__":
    run_scenario(paths.main)

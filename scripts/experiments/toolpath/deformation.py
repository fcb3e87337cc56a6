"""Deformation maps against the truth, on fouled and dented objects and on undeformed ones.

Objects and views are those of scripts/experiments/toolpath/paths.py. A pixel of the true surface
counts as deformed where its deviation exceeds a size, and as mapped where it is in a region of the
map of that size. Overlap is intersection over union, over the pixels that the map compares.
Undeformed objects are those of the library in random scenes: there every region is false. Exit code
0 if overlaps reach the bound and no region is false.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.toolpath.path_deviation import SCENES, identified
from uuv.clouds.object_scenes import object_scene, target_of
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.objects import targets
from uuv.perception.finding.target_finder import with_fused_frames
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.toolpath.deformation import map_deformation
from uuv.sim.interfaces.spatial import Array, inverse, transform_points
from uuv.sim.interfaces.streams import Streams

BOUND = 0.8  # least overlap that is accepted
SIZES = (0.005, 0.01, 0.015)  # [m] sizes asked for, besides the size that follows from the noise


@dataclass(frozen=True, kw_only=True)
class DeformationCase:
    """One object with one seed."""

    object: str
    """Name of the object: one of those that are deformed, or of an undeformed one."""
    looks: int = 16
    """Depth frames whose median is compared; a single frame is compared too. An undeformed object
    is seen in one.
    """
    seed: int

    def __post_init__(self) -> None:
        at_least(self, looks=3)


@dataclass(frozen=True, kw_only=True)
class DeformationRow:
    """Figures of the maps, an entry for each size: that which follows from the noise, then SIZES.

    None of an undeformed object that was not accepted; that has the first size alone.
    """

    deformed: bool = column("deformed")
    accepted: bool = column("accepted")
    reason: str = column("reason")

    size: Mapping[str, Sequence[float]] | None = column("size", by="frames", default=None)
    noise: Mapping[str, Sequence[float]] | None = column("noise", by="frames", default=None)
    regions: Mapping[str, Sequence[int]] | None = column("regions", by="frames", default=None)
    error: Mapping[str, Sequence[float | None]] | None = column("error", by="frames", default=None)
    both: Mapping[str, Sequence[int]] | None = column("pixels in both", by="frames", default=None)
    either: Mapping[str, Sequence[int]] | None = column("in either", by="frames", default=None)


@experiment(
    "deformation",
    seeds=5,
    vary={"object": (*SCENES, *targets.available())},
    paired=True,
    quick={"runs": 1, "object": ("dented pile", "anode")},
)
def deformation(case: DeformationCase) -> DeformationRow:
    """Maps the deformation of one object."""
    return _deformed(case) if case.object in SCENES else _undeformed(case)


def _deformed(case: DeformationCase) -> DeformationRow:
    """Maps of one frame and of several, and the decision of PoseCheck."""
    streams = Streams(case.seed)
    scene = SCENES[case.object]
    true, frames = scene.seen(streams, case.looks)
    identification = identified(scene.known, frames[-1], streams)

    # The true deviation of each pixel.
    X_CT = inverse(frames[-1].X_WS)
    surface, _ = ModelSurface.of(true.target).seen(X_CT, frames[-1].scan)
    measured = np.isfinite(surface.depth)
    offset = np.full(surface.depth.shape, np.nan)
    offset[measured] = true.offset_at(transform_points(inverse(X_CT), surface.points[measured]))

    single = replace(identification, accepted=True)
    fused = with_fused_frames(single, frames)
    maps = {"1": figures(single, offset), str(case.looks): figures(fused, offset)}

    return DeformationRow(
        deformed=True,
        accepted=identification.accepted,
        reason=identification.reason,
        **{name: {frames: maps[frames][name] for frames in maps} for name in maps["1"]},
    )


def _undeformed(case: DeformationCase) -> DeformationRow:
    """Figures of the map of an undeformed library object, where every region is false."""
    scene = object_scene(case.object, case.seed)
    surface = ModelSurface.of(target_of(case.object))
    identification = identify(
        scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    reason = identification.reason
    if not identification.accepted:
        return DeformationRow(deformed=False, accepted=False, reason=reason)

    mapped = map_deformation(identification)
    error = mapped.deviation[np.isfinite(mapped.deviation)]
    return DeformationRow(
        deformed=False,
        accepted=True,
        reason=reason,
        size={"1": [mapped.size_m]},
        noise={"1": [mapped.noise_m]},
        regions={"1": [len(mapped.regions)]},
        error={"1": [float(np.std(error)) if len(error) else None]},
    )


def figures(identification: Identification, offset: Array) -> dict[str, list[Any]]:
    """Figures of the maps of default size and of SIZES, by the columns of `DeformationRow`.

    Args:
        identification: With the frames that are mapped.
        offset: (H, W) [m] true deviation of each pixel, NaN off the object.
    """
    maps = [map_deformation(identification, size) for size in (None, *SIZES)]
    known = [np.isfinite(mapped.deviation) & np.isfinite(offset) for mapped in maps]

    columns: dict[str, list[Any]] = {
        "size": [mapped.size_m for mapped in maps],
        "noise": [mapped.noise_m for mapped in maps],
        "regions": [len(mapped.regions) for mapped in maps],
        "error": [],
        "both": [],
        "either": [],
    }
    for mapped, pixels in zip(maps, known, strict=True):
        truth = pixels & (np.abs(offset) > mapped.size_m)
        labelled = pixels & (mapped.label > 0)
        columns["error"].append(float(np.std((mapped.deviation - offset)[pixels])))
        columns["both"].append(int((truth & labelled).sum()))
        columns["either"].append(int((truth | labelled).sum()))

    return columns


def _of_default(name: str) -> Callable[[Mapping[str, Any]], float]:
    """A length of the map of default size in mm."""
    return lambda row: 1e3 * row[name][0]


def overlap(index: int) -> Callable[[Mapping[str, Any]], float]:
    """Overlap of the map with the truth at the size of an index."""
    return lambda row: row["both"][index] / max(1, row["either"][index])


def least_overlap(row: Mapping[str, Any]) -> float | None:
    """Overlap of the map of the most frames at the default size; None of an undeformed object."""
    if not row["deformed"]:
        return None
    frames = str(row["looks"])
    return overlap(0)({name: row[name][frames] for name in ("both", "either")})


def false_region(row: Mapping[str, Any]) -> bool | None:
    """Whether an undeformed object has a region; None: it was not accepted, or is deformed."""
    return None if row["deformed"] or not row["accepted"] else row["regions"]["1"][0] > 0


def false_regions(rows: list[Row]) -> list[str]:
    """Lines that name the undeformed objects with a region."""
    return [
        f"region on an undeformed object: {row['object']} of seed {row['seed']}"
        for row in rows
        if false_region(row)
    ]


deformation.page = (
    Page()
    .table(
        "Maps of deformation: noise that the sensor explains, error against the truth, overlap "
        "with it",
        by=("object", "frames"),
        columns=[
            stat("share", "accepted"),
            stat("mean", _of_default("noise"), "noise", unit="mm", digits=1),
            stat("mean", _of_default("error"), "error", unit="mm", digits=1),
            stat("mean", _of_default("size"), "size", unit="mm", digits=1),
            stat("mean", overlap(0), "overlap at that size", digits=2),
            stat("least", overlap(0), "worst", digits=2),
            *(
                entry
                for k, size in enumerate(SIZES, start=1)
                for entry in (
                    stat("mean", overlap(k), f"at {1e3 * size:.0f} mm", digits=2),
                    stat("least", overlap(k), f"at {1e3 * size:.0f} mm, worst", digits=2),
                )
            ),
        ],
        where=lambda row: row["deformed"],
    )
    .share(false_region, "accepted undeformed objects with a region")
    .add(false_regions)
    .accept(stat("least", least_overlap, "overlap with the truth"), least=BOUND)
    .accept(stat("count", false_region, "undeformed objects with a region"), most=0)
)

if __name__ == "__main__":
    run_scenario(deformation.main)

"""Deformation maps of fouled, dented and undeformed objects against the truth: one scene, and the
table of many.
"""

from dataclasses import dataclass, replace

import numpy as np

from experiments.toolpath.path_deviation import SCENES
from uuv.clouds.object_scenes import object_scene, target_of
from uuv.experiment import Row, Summary, Table
from uuv.perception.finding.target_finder import with_fused_frames
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.toolpath.deformation import map_deformation
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.interfaces.spatial import Array, inverse, transform_points
from uuv.sim.interfaces.streams import Streams

BOUND = 0.8  # least overlap that is accepted
SIZES = (0.005, 0.01, 0.015)  # [m] sizes asked for, besides the size that follows from the noise


@dataclass(frozen=True)
class DeformationCase:
    """One object with one seed; a case of the study."""

    object: str  # of SCENES, or the name of an undeformed library object
    seed: int
    # depth frames whose median is compared, besides a single one; 0: an undeformed object
    looks: int


def run(case: DeformationCase) -> Row:
    """Figures of the maps of one object."""
    made = _undeformed(case) if case.looks == 0 else _deformed(case)
    return {"object": case.object, "deformed": case.looks > 0, "seed": case.seed, **made}


def _deformed(case: DeformationCase) -> Row:
    """Maps of one frame and of several, and the decision of PoseCheck."""
    streams, scene = Streams(case.seed), SCENES[case.object]
    true, looks = scene.seen(streams, case.looks)
    X_CT = inverse(looks[-1].X_WS)
    approach, orientation = coarse_detection(X_CT, streams["detection"])
    found = identify(looks[-1].scan, ModelSurface.of(scene.known), approach, orientation)
    surface, _ = ModelSurface.of(true.target).seen(X_CT, looks[-1].scan)
    offset = np.full(surface.depth.shape, np.nan)
    seen = np.isfinite(surface.depth)
    offset[seen] = true.offset_at(transform_points(inverse(X_CT), surface.points[seen]))
    single = replace(found, accepted=True)
    return {
        "accepted": found.accepted,
        "reason": found.reason,
        "maps": {
            "1": maps(single, offset),
            str(case.looks): maps(with_fused_frames(single, looks), offset),
        },
    }


def _undeformed(case: DeformationCase) -> Row:
    """Figures of the map of an undeformed library object, where every region is false."""
    scene = object_scene(case.object, case.seed)
    surface = ModelSurface.of(target_of(case.object))
    found = identify(
        scene.scan, surface, scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    if not found.accepted:
        return {"accepted": False}
    made = map_deformation(found)
    error = made.deviation[np.isfinite(made.deviation)]
    return {
        "accepted": True,
        "regions": len(made.regions),
        "noise_m": made.noise_m,
        "error_m": float(np.std(error)) if len(error) else None,
    }


def maps(found: Identification, offset: Array) -> list[Row]:
    """Figures of the maps of default size and of SIZES; true `offset` (H, W) [m] of each pixel, NaN
    off the object.
    """
    rows = []
    for size in (None, *SIZES):
        made = map_deformation(found, size)
        known = np.isfinite(made.deviation) & np.isfinite(offset)
        truth, said = known & (np.abs(offset) > made.size_m), known & (made.label > 0)
        rows.append(
            {
                "size_m": made.size_m,
                "noise_m": made.noise_m,
                "regions": len(made.regions),
                "both": int((truth & said).sum()),
                "either": int((truth | said).sum()),
                "error_m": float(np.std((made.deviation - offset)[known])),
            }
        )
    return rows


def overlap(rows: list[Row]) -> str:
    """Overlap over all of `rows`, and in brackets the worst of them."""
    total = sum(row["both"] for row in rows) / max(1, sum(row["either"] for row in rows))
    return f"{total:.2f} ({min(row['both'] / max(1, row['either']) for row in rows):.2f})"


def summarise(rows: list[Row]) -> Summary:
    """Table of the deformed objects and the false regions of the others."""
    deformed, clean = ([row for row in rows if row["deformed"] is kind] for kind in (True, False))
    results = {name: [row for row in deformed if row["object"] == name] for name in SCENES}
    seeds = len(deformed) // len(SCENES)
    looks = [*deformed[0]["maps"]]
    cells = []
    for name, found in results.items():
        for count in looks:
            by_size = list(zip(*(each["maps"][count] for each in found), strict=True))
            means = [
                1e3 * float(np.mean([row[key] for row in by_size[0]]))
                for key in ("noise_m", "error_m", "size_m")
            ]
            accepted = f"{sum(each['accepted'] for each in found)} of {seeds}"
            cells.append(
                (
                    name,
                    accepted,
                    count,
                    *(f"{mean:.1f}" for mean in means),
                    *(overlap([*rows]) for rows in by_size),
                )
            )
    compared = [row for row in clean if row["accepted"]]
    false = [f"{row['object']} of seed {row['seed']}" for row in compared if row["regions"]]
    worst = min(
        row["both"] / max(1, row["either"])
        for each in deformed
        for row in each["maps"][looks[-1]][:1]
    )
    return Summary(
        metrics={"worst_overlap": worst, "compared": len(compared), "false_regions": false},
        tables=[
            Table(
                title=f"Maps of deformation, {seeds} seeds from {rows[0]['seed']}",
                caption="noise: what the sensor explains, and what the map is off the truth, in "
                "mm; size: in mm, of "
                "the map; overlap of all seeds with the truth, of the worst in brackets, at that "
                "size and at those "
                "asked for",
                columns=(
                    *("object", "accepted", "looks", "noise", "error", "size", "overlap"),
                    *(f"at {1e3 * size:.0f} mm" for size in SIZES),
                ),
                rows=cells,
            )
        ],
        lines=[
            f"undeformed: regions on {len(false)} of {len(compared)} accepted objects {false or ''}"
        ],
        failed=[
            *(
                []
                if worst >= BOUND
                else [f"overlap with the truth: {worst:.2f}, wanted {BOUND:.2f}"]
            ),
            *(f"region on an undeformed object: {name}" for name in false),
        ],
    )

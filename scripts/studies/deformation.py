"""Study: deformation maps against the truth, on fouled and dented objects and on undeformed ones.

Objects and views are those of scripts/studies/paths.py. A pixel of the true surface counts as deformed where its
deviation exceeds a size, and as mapped where it is in a region of the map of that size. Overlap is intersection over
union, over the pixels that the map compares. Undeformed objects are those of the library in random scenes: there every
region is false.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from models.objects import targets
from perception.registration.fine_fit import ModelSurface
from perception.registration.identification import Identification, identify
from perception.registration.multi_frame import with_fused_frames
from perception.toolpath.deformation import map_deformation
from scenarios.object_scenes import object_scene, target_of
from scenarios.site import coarse_detection
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, inverse, transform_points
from sim.runs.saving import write_whole
from studies.paths import CASES, PathCase

BOUND = 0.8  # least overlap that is accepted
SIZES = (0.005, 0.01, 0.015)  # [m] sizes asked for, besides the size that follows from the noise


@dataclass(kw_only=True)
class Options:
    """Deformation maps of deformed and undeformed objects."""

    seed: int = 0
    """First seed."""
    trials: int = 5
    """Number of seeds for each deformed object, from --seed on."""
    looks: int = 16
    """Depth frames whose median is compared; a single frame is compared too."""
    clean: int = 5
    """Number of scenes of each undeformed object."""
    out: Path | None = None
    """Folder for deformation.json."""


def trial(case: PathCase, seed: int, count: int) -> dict[str, Any]:
    """Result of one deformed object: maps of one frame and of `count` frames, and the decision of PoseCheck.

    Args:
        case: Object and camera.
        seed: Seed.
        count: Number of frames.
    """
    rng = np.random.default_rng(seed)
    true, looks = case.seen(rng, count)
    X_CT = inverse(looks[-1].X_WS)
    approach, orientation = coarse_detection(X_CT, rng)
    found = identify(looks[-1].scan, ModelSurface.of(case.known), approach, orientation)
    surface, _ = ModelSurface.of(true.target).seen(X_CT, looks[-1].scan)
    offset = np.full(surface.depth.shape, np.nan)
    seen = np.isfinite(surface.depth)
    offset[seen] = true.offset_at(transform_points(inverse(X_CT), surface.points[seen]))
    single = replace(found, accepted=True)
    return {
        "seed": seed,
        "accepted": found.accepted,
        "reason": found.reason,
        "maps": {1: maps(single, offset), count: maps(with_fused_frames(single, looks), offset)},
    }


def maps(found: Identification, offset: Array) -> list[dict[str, float]]:
    """Figures of the maps of default size and of SIZES; true `offset` (H, W) [m] of each pixel, NaN off the object."""
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


def overlap(rows: list[dict[str, float]]) -> str:
    """Overlap over all of `rows`, and in brackets the worst of them."""
    total = sum(row["both"] for row in rows) / max(1, sum(row["either"] for row in rows))
    return f"{total:.2f} ({min(row['both'] / max(1, row['either']) for row in rows):.2f})"


def undeformed(name: str, seed: int) -> dict[str, Any] | None:
    """Figures of the map of an undeformed library object; None if the object is not accepted."""
    scene = object_scene(name, seed)
    found = identify(
        scene.scan, ModelSurface.of(target_of(name)), scene.approach, scene.orientation, sensor=scene.sensor.model
    )
    if not found.accepted:
        return None
    made = map_deformation(found)
    error = made.deviation[np.isfinite(made.deviation)]
    return {
        "object": name,
        "seed": seed,
        "regions": len(made.regions),
        "noise_m": made.noise_m,
        "error_m": float(np.std(error)) if len(error) else None,
    }


def main() -> int:
    """Runs the study and writes its file; exit code 0 if overlaps reach BOUND and no region is false."""
    options = parse(Options)
    if options.trials < 1 or options.looks < 3 or options.clean < 0:
        raise ConfigurationError("--trials must be at least 1, --looks at least 3, --clean at least 0")
    if options.seed < 0:
        raise ConfigurationError(f"--seed: must not be negative, got {options.seed}")
    folder = new_folder("study_deformation", options.out, options.seed)
    console = Console()
    console.width = max(console.width, 125)  # the table is wider than a usual terminal
    seeds = range(options.seed, options.seed + options.trials)
    results = {name: [trial(case, seed, options.looks) for seed in seeds] for name, case in CASES.items()}
    table = Table(
        title=f"Maps of deformation, {options.trials} seeds from {options.seed}",
        caption="noise: what the sensor explains, and what the map is off the truth, in mm; size: in mm, of the map; "
        "overlap of all seeds with the truth, of the worst in brackets, at that size and at those asked for",
    )
    columns = ("object", "accepted", "looks", "noise", "error", "size", "overlap")
    for column in (*columns, *(f"at {1e3 * size:.0f} mm" for size in SIZES)):
        table.add_column(column, justify="left" if column == "object" else "right", no_wrap=True)
    for name, found in results.items():
        for count in (1, options.looks):
            by_size = list(zip(*(each["maps"][count] for each in found), strict=True))
            means = [1e3 * float(np.mean([row[key] for row in by_size[0]])) for key in ("noise_m", "error_m", "size_m")]
            accepted = f"{sum(each['accepted'] for each in found)} of {options.trials}"
            table.add_row(
                name, accepted, str(count), *(f"{mean:.1f}" for mean in means), *(overlap([*rows]) for rows in by_size)
            )
    console.print(table)
    clean = [undeformed(name, options.seed + i) for name in targets.available() for i in range(options.clean)]
    compared = [row for row in clean if row is not None]
    false = [f"{row['object']} of seed {row['seed']}" for row in compared if row["regions"]]
    console.print(f"undeformed: regions on {len(false)} of {len(compared)} accepted objects {false or ''}")
    text = json.dumps({"deformed": results, "undeformed": clean}, indent=1)
    write_whole(folder / "deformation.json", text)
    console.print(f"written to {folder}/", highlight=False)
    worst = min(
        row["both"] / max(1, row["either"])
        for found in results.values()
        for each in found
        for row in each["maps"][options.looks][:1]
    )
    return 0 if worst >= BOUND and not false else 1


if __name__ == "__main__":
    run_scenario(main)

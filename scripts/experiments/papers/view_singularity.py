"""Records ERA's way through gimbal lock, with and without passing, for the Rerun viewer.

    ./uvw run scripts/experiments/papers/view_singularity.py --recipe limit --speed 0.05 --view

The runs are those of track_singularity.py beside this file; writes run.rrd.
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun.blueprint as rrb
from rich.console import Console

from experiments.papers.recipes import DEFAULT, RECIPES, WITHOUT
from experiments.papers.track_singularity import ARM, TrackCase, passed_lock
from uuv.arm_identification.arm_log import ArmLog
from uuv.controllers.mkps import Track
from uuv.models.arms import published_arms
from uuv.sim.interfaces.palette import BLUE, ORANGE, rgb
from uuv.sim.interfaces.spatial import Array, one_of


@dataclass
class Options:
    """Motion of the arm along a path through the gimbal lock."""

    recipe: str = DEFAULT
    """How the lock is passed, in the run with passing: default, limit, hold, auto, or one of the
    paper."""
    reach: float = TrackCase.reach
    """Length of the path before and after the lock [m]."""
    speed: float = TrackCase.speed
    """Speed of the wrist [m/s]."""
    out: Path | None = None
    """Folder for run.rrd; default: a new one in runs/view_singularity."""
    view: bool = False
    """Open the Rerun viewer."""


def main() -> int:
    """Tracks the path twice, and records both."""
    options = parse(Options)
    one_of(options.recipe, tuple(name for name in RECIPES if name != WITHOUT), "--recipe")

    recipes = {"without": WITHOUT, "with": options.recipe}
    cases = {
        name: TrackCase(recipe=recipe, reach=options.reach, speed=options.speed)
        for name, recipe in recipes.items()
    }
    tracked = {name: passed_lock(case) for name, case in cases.items()}

    folder = new_folder("view_singularity", options.out)
    path = tracked["with"][0]
    runs = {name: run for name, (_, run) in tracked.items()}
    write_log(folder / "run.rrd", runs, path, options.view)
    Console().print(f"written to {folder}/", highlight=False)
    return 0


def write_log(file: Path, runs: Mapping[str, Track], path: Array, view: bool) -> None:
    """Writes the runs, by name, along a path (N, 4, 4); `view` shows them in the Rerun viewer."""
    arm = published_arms.load(ARM)
    speeds = [
        rrb.TimeSeriesView(
            name=f"joint speeds {name} passing [rad/s]", origin=f"series/speed_{name}"
        )
        for name in runs
    ]
    blueprint = rrb.Horizontal(
        rrb.Spatial3DView(name="arm", origin="world"),
        rrb.Vertical(
            *speeds,
            rrb.TimeSeriesView(name="tool error [mm]", origin="series/error"),
            rrb.TimeSeriesView(name="nearness to the lock", origin="series/nearness"),
        ),
        column_shares=[3, 2],
    )

    errors = np.column_stack([1e3 * run.position_error for run in runs.values()])
    nearness = np.column_stack([run.nearness for run in runs.values()])
    with ArmLog(file, f"{arm.title}: gimbal lock", blueprint, view=view) as log:
        log.line("path", path[:, :3, 3], (240, 228, 66), 0.02)

        time = next(iter(runs.values())).time
        for (name, run), color in zip(runs.items(), (rgb(ORANGE), rgb(BLUE)), strict=True):
            log.arm(name, arm, time, run.q, color, stride=2)
            log.series(f"speed_{name}", [f"joint {i + 1}" for i in range(arm.n)], time, run.qd)
        log.series("error", list(runs), time, errors)
        log.series("nearness", list(runs), time, nearness)


if __name__ == "__main__":
    run_scenario(main)

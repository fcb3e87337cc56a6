"""Sampling of an unknown seabed: sonar scan, choice of the working height, and force-controlled work in the soil.

The vehicle approaches over the plane that its Doppler velocity log (DVL) measures, and reconstructs the ground from
sonar scans. It projects the targets onto the ground, judges the relief and chooses a pose for station keeping. It
pushes a core tube into the soil with a set force, or drags a box along the profile between two targets at a set depth.
Then it withdraws the tool. If the cloud is no ground, or the ground is unsuitable, the vehicle stays where it is: one
line with the reason, exit code 2.
"""

from scenarios.start import ScenarioOptions, parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.console import Console

from controllers.tasks.seabed_work import SeabedJob
from controllers.work_controller import Method
from models.site.seabed import Kind
from scenarios.runner import Evaluation, run_with_report
from scenarios.seabed_work import SeabedRecorder, SeabedSetting, prepare, run_trials
from scenarios.study.options import at_least
from sim.evaluation.seabed_metrics import assess_seabed_work
from sim.interfaces.messages import WorkState
from sim.reporting.seabed_figures import seabed_figures


@dataclass(kw_only=True)
class Options(ScenarioOptions):
    """Take a sample of the seabed."""

    terrain: Kind | Literal["any"] = "ripples"
    """Kind of terrain, drawn from the seed; any: the kinds in turn."""
    soil: str = "sand"
    """Kind of soil (models/site/soil.py)."""
    work: Literal["core", "drag"] = "core"
    """core: push a tube in and withdraw it; drag: drag a box along the profile between the targets."""
    push: float = 50.0
    """Set force on the core tube [N]; at most 40 with --quick."""
    depth: float | None = None
    """drag: depth of the box [mm], default 30; core: depth at which the tube is full [mm], default 180."""
    targets: Path | None = None
    """Text file: points B_i over the seabed and a line `z X Y Z`, in the axes of a level hull 2.5 m above the terrain's
    middle; default: ahead of the hull."""
    cloud: Path | None = None
    """Text, PLY or PCD, in the same axes: replaces the scan, and is judged before the vehicle approaches."""
    dead_beams: tuple[int, ...] = ()
    """Beams of the Doppler log, 1 to 4, that return no echo."""
    without: tuple[Method, ...] = ()
    """Controller methods to leave out, e.g. compensation (ablation)."""
    vehicle: str = "uuv_puma"
    """uuv_puma, which then carries a core tube or a box in place of its pad; or an MJCF file with the named parts
    (docs/concepts.md)."""
    trials: int = 0
    """Number of seeds to run, without recording; 0: one run with recording."""
    workers: int = 0
    """Processes for the trials; 0: one for each core, 1: this one."""
    anew: bool = False
    """Delete the trials in the folder of an earlier command; without it they are resumed."""
    controller: str = "work"
    """Controller: work, a registered name, or MODULE:CLASS."""

    def __post_init__(self) -> None:
        at_least(self, trials=0, workers=0)


def main() -> int:
    """Runs one job or many trials and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    drag = options.work == "drag"
    depth = options.depth if options.depth is not None else 30.0 if drag else 180.0
    push = min(options.push, 40.0) if options.quick else options.push
    scans = 3 if options.cloud is None else 1
    setting = SeabedSetting(
        kind=options.terrain,
        soil=options.soil,
        job=SeabedJob(push=push, depth=1e-3 * depth, drag=drag, scans=scans),
        cloud=options.cloud,
        targets=options.targets,
        dead_beams=options.dead_beams,
        current=options.current,
        gust=options.gust,
        without=frozenset(options.without),
        vehicle=options.vehicle,
        controller=options.controller,
    )
    if options.trials:
        return run_trials(setting, range(options.seed, options.seed + options.trials), options)
    console, folder = Console(), options.folder("sample_seabed")
    work = prepare(setting, options.seed, record=options.record)
    title = (
        f"{'Dragged along' if drag else 'A core of'} a seabed of {options.soil}, {options.terrain}, seed {options.seed}"
    )
    judging = Evaluation(
        assess=lambda ran: assess_seabed_work(ran.recording, work.truth, seed=options.seed, wall_s=ran.wall_s),
        pictures=lambda ran: seabed_figures(ran.recording, work.truth),
        begun=(WorkState.APPROACH,),
    )
    return run_with_report(
        "sample_seabed", work.ready, judging, title, options, folder, console, started, SeabedRecorder
    )


if __name__ == "__main__":
    run_scenario(main)

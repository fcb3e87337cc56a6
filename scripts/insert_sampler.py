"""Insertion of a sampler into a hole of a subsea manifold, and its withdrawal.

The vehicle knows the manifold's shape and roughly where it is. It keeps station, takes a depth frame, identifies the
manifold and moves the sampler before the hole. The insertion is force-controlled along the axis and compliant across
it. With --trials N, the N seeds from --seed on run on all cores, and a table gives the success rate.
"""

from scenarios.start import ScenarioOptions, parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass
from typing import Literal

from rich.console import Console

from scenarios.insertion import InsertionSetting, run_and_write, run_trials
from scenarios.study.options import at_least


@dataclass(kw_only=True)
class Options(ScenarioOptions):
    """Insert a sampler into a hole."""

    hole: Literal["a", "b"] = "a"
    """Hole of the manifold."""
    clearance: float = 2.0
    """Radial clearance between sampler and hole [mm]."""
    depth: float = 60.0
    """Depth to reach below the mouth [mm]; the hole is 20 mm deeper."""
    chamfer: float = 2.0
    """Chamfer of the hole's mouth [mm]."""
    error: tuple[float, float] = (0.0, 0.0)
    """Error added to the identified hole position along the hole's x and y [mm]; search and compliance must correct
    it."""
    compliance: bool = True
    """Compliance to side forces (--no-compliance: none, for ablation)."""
    range: float = 1.25
    """Range from camera to manifold at the scan [m]."""
    trials: int = 0
    """Number of seeds to run, without recording; 0: one run with recording."""
    workers: int = 0
    """Processes for the trials; 0: one for each core, 1: this one."""
    anew: bool = False
    """Delete the trials in the folder of an earlier command; without it they are resumed."""
    vehicle: str = "uuv_puma"
    """uuv_puma, which then carries the sampler in place of its pad; or an MJCF file with the named parts
    (docs/concepts.md), its geom `pad` a capsule."""
    controller: str = "work"
    """Controller: work, a registered name, or MODULE:CLASS."""

    def __post_init__(self) -> None:
        at_least(self, trials=0, workers=0)


def main() -> int:
    """Runs one insertion or many trials and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    setting = InsertionSetting(
        hole=options.hole,
        clearance=1e-3 * options.clearance,
        depth=1e-3 * (30.0 if options.quick else options.depth),
        chamfer=1e-3 * options.chamfer,
        error=(1e-3 * options.error[0], 1e-3 * options.error[1]),
        compliance=options.compliance,
        scan_range=options.range,
        current=options.current,
        gust=options.gust,
        vehicle=options.vehicle,
        controller=options.controller,
    )
    if options.trials:
        return run_trials(setting, range(options.seed, options.seed + options.trials), options)
    return run_and_write(setting, options, options.folder("insert_sampler"), Console(), started)


if __name__ == "__main__":
    run_scenario(main)

"""Benchmark: identified water against the truth of simulated vehicles, planned intervals against
found ones, the pool.

    ./uvw run scripts/experiments/water/identified_water.py --draws 100
    ./uvw run scripts/experiments/water/identified_water.py --draws 0 --plans 5
    ./uvw run scripts/experiments/water/identified_water.py --draws 0 --pool FOLDER

Each draw is a vehicle from the prior, a survey of 30 s in gusts of 5 mm/s, and a fit. FOLDER holds
the pool trials (docs/pool.md). Writes coverage.json, and prints tables.
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from experiments.water.coverage import VEHICLES, Draw, KeptWord, coverage, draw, kept_word
from experiments.water.pool.pool_vehicle import FRESH_WATER
from experiments.water.pool.trials import read_trials
from experiments.water.pool_logs import logs_of_trials
from uuv.calib.water.findings import findings, together
from uuv.experiment.options import at_least
from uuv.models.vehicles import published_hulls
from uuv.own_vehicle import vehicle_spec
from uuv.sim.evaluation.intervals import SIGMAS
from uuv.sim.runs.saving import write_json
from uuv.sim.runs.terminal import console
from uuv.water_identification.command import table_of, words
from uuv.water_identification.log_residuals import identify
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

POOL_NOISE = {"attitude": 0.005, "depth": 0.005}  # [rad], [m]


@dataclass(kw_only=True)
class Options:
    """Identified water against the truth."""

    vehicles: tuple[str, ...] = VEHICLES
    """Vehicles to draw."""
    draws: int = 100
    """Draws of each vehicle."""
    seed: int = 0
    """Seed of the first draw; the others follow."""
    plans: int = 0
    """Plans of each vehicle that are flown."""
    pool: Path | None = None
    """Folder of the pool trials."""
    workers: int = 1
    """Processes."""
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        at_least(self, draws=0, seed=0, plans=0, workers=1)


def main() -> int:
    """Draws, plans and reads the pool's trials; returns 0."""
    options, screen = parse(Options), console()
    folder = new_folder("water_identification", options.out)

    def seeds(count: int) -> range:
        return range(options.seed, options.seed + count)

    cases = [(vehicle, seed) for seed in seeds(options.draws) for vehicle in options.vehicles]
    flown = [(vehicle, seed) for vehicle in options.vehicles for seed in seeds(options.plans)]
    drawn: list[Draw] = []
    kept: list[KeptWord] = []

    def write() -> None:
        rows = [
            {**asdict(each), "errors": each.errors.tolist(), "told": each.told.tolist()}
            for each in drawn
        ]
        write_json(
            folder / "coverage.json", {"draws": rows, "plans": [asdict(each) for each in kept]}
        )

    with ProcessPoolExecutor(options.workers) as pool:
        try:
            for one in pool.map(draw, *zip(*cases, strict=True)) if cases else ():
                drawn.append(one)
                write()  # a long study that is interrupted leaves what it has
            for word in pool.map(kept_word, *zip(*flown, strict=True)) if flown else ():
                kept.append(word)
                write()
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            screen.print(f"interrupted after {len(drawn)} draws and {len(kept)} plans")

    if drawn:
        screen.print(coverage_table(drawn))
        screen.print(single_table(drawn))
    if kept:
        screen.print(plan_table(kept))

    if options.pool is not None:
        read_pool(options.pool, screen)
    screen.print(f"in {folder}")
    return 0


def coverage_table(drawn: list[Draw]) -> Table:
    """Share of 95 % intervals that cover, by vehicle and group of parameters."""
    table = Table(
        title="95 % intervals that cover the truth; in brackets the share told",
        title_justify="left",
    )

    names = list(dict.fromkeys(each.vehicle for each in drawn))
    groups = list(
        dict.fromkeys(
            group for name in names for group in coverage([d for d in drawn if d.vehicle == name])
        )
    )

    for column in ("vehicle", "draws", *groups, "fit [s]"):
        table.add_column(column, justify="left" if column == "vehicle" else "right")

    for name in names:
        own = [each for each in drawn if each.vehicle == name]
        found = coverage(own)

        cells = [
            f"{100 * found[g][0]:.1f} % ({100 * found[g][2]:.0f})" if g in found else ""
            for g in groups
        ]

        table.add_row(
            name, str(len(own)), *cells, f"{np.median([each.seconds for each in own]):.1f}"
        )

    return table


def single_table(drawn: list[Draw]) -> Table:
    """Parameters whose intervals cover least, the worst draw, and normal intervals, by vehicle."""
    table = Table(title="intervals of single parameters that cover least", title_justify="left")
    for column in ("vehicle", "least", "worst draw", "all, by normal intervals", "slowest fit [s]"):
        table.add_column(column, justify="left" if column in ("vehicle", "least") else "right")

    for name in dict.fromkeys(each.vehicle for each in drawn):
        own = [each for each in drawn if each.vehicle == name]
        covered = np.array([np.abs(each.errors) < each.quantile for each in own])
        by_name = covered.mean(axis=0)

        least = "; ".join(
            f"{own[0].names[i]} {100 * by_name[i]:.0f} %" for i in np.argsort(by_name)[:4]
        )

        normal = np.mean([np.abs(each.errors) < SIGMAS for each in own])
        worst, slowest = covered.mean(axis=1).min(), max(each.seconds for each in own)
        table.add_row(
            name, least, f"{100 * worst:.0f} %", f"{100 * normal:.1f} %", f"{slowest:.1f}"
        )

    return table


def plan_table(kept: list[KeptWord]) -> Table:
    """What planned manoeuvres were expected to tell, and told."""
    table = Table(
        title="intervals sharper by the planned manoeuvre, mean factor", title_justify="left"
    )

    for column in ("vehicle", "manoeuvre", "predicted", "found", "last of the list"):
        table.add_column(column, justify="left" if column in ("vehicle", "manoeuvre") else "right")

    for each in kept:
        table.add_row(
            each.vehicle,
            each.manoeuvre,
            f"{each.predicted:.2f}",
            f"{each.found:.2f}",
            f"{each.worst:.2f}",
        )

    return table


def read_pool(folder: Path, screen: Console) -> None:
    """Identify the pool's vehicle from its trials and print what they tell."""
    spec = vehicle_spec("bluerov2_heavy_alpha5")
    published_hulls.ballast(spec, FRESH_WATER)
    own = ReplayVehicle(spec)

    logs = logs_of_trials(read_trials(folder))
    settings = FitSettings(noise={**FitSettings().noise, **POOL_NOISE}, rate=10.0, window=10.0)
    fit, _ = identify(own, logs, settings)

    n = len(own.water.parameters)
    found, combined = findings(fit.named, n, fit.quantile), together(fit.named, n)
    screen.print(table_of(found))
    for line in words(found, combined, fit, logs[:1], own):  # of one log: the same holds for all
        screen.print(line, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    run_scenario(main)

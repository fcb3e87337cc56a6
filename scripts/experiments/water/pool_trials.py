"""Benchmark: our simulation beside pool trials of a BlueROV2 whose arm moves it [Kolano 2022].

    ./uvw run scripts/experiments/water/pool_trials.py --data FOLDER --workers 2

FOLDER holds the trials (traj*_joint_states.csv.gz and so on); they are no part of this project. One
parameter set is fitted to all trajectory numbers but one and judged on the one left out, each in
turn. Writes pool.json, pool.md and pool.png into --out. With --fitted nothing is fitted: other
trials are judged by parameters that are there already.

    FITTED=scripts/experiments/water/pool/wu2018.json
    ./uvw run scripts/experiments/water/pool_trials.py --data FOLDER --fitted $FITTED
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from experiments.water.pool.pool_report import (
    buoyancy_table,
    draw,
    numbers_of,
    parameter_table,
    score_table,
    trial_table,
)
from experiments.water.pool.pool_vehicle import HULLS, NOMINAL
from experiments.water.pool.trials import read_trials
from experiments.water.pool.validation import (
    buoyancy_by_group,
    read_fitted,
    scores,
    validate,
    with_own_buoyancy,
)
from uuv.experiment.options import at_least
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.saving import write_json, write_whole


@dataclass(kw_only=True)
class Options:
    """Our simulation beside pool trials."""

    data: Path
    """Folder of the trials."""
    hull: str = "wu2018"
    """Published hull to begin with: benzon2022, wu2018 or kolano2022."""
    workers: int = 1
    """Processes."""
    leave_out: bool = True
    """Fit again without each trajectory number; --no-leave-out: one fit, judged on what it has
    seen.
    """
    fitted: Path | None = None
    """Judge by the parameters of this file, a pool.json or the one of the package; nothing is
    fitted.
    """
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        at_least(self, workers=1)
        if self.hull not in HULLS:
            raise ConfigurationError(f"--hull {self.hull!r}: allowed {', '.join(HULLS)}")
        if not self.data.is_dir():
            raise ConfigurationError(
                f"--data {str(self.data)!r}: there is no such folder; the trials are not part of "
                "this"
            )


def main() -> int:
    """Fits, judges and reports; returns 0."""
    options, console = parse(Options), Console()

    trials = read_trials(options.data)
    folder = new_folder("pool", options.out)
    console.print(f"{len(trials)} trials, {sum(trial.duration for trial in trials):.0f} s")

    # Other trials, judged by parameters that are there already.
    if options.fitted is not None:
        hull, values = read_fitted(options.fitted)
        scored = scores(hull, trials, values)
        tables = [
            score_table("Simulation beside the pool: medians", {f"{hull}, as fitted": scored}),
            trial_table(scored),
        ]

        for table in tables:
            console.print(table.printed())
        write_whole(folder / "pool.md", "\n\n".join(table.markdown() for table in tables))
        console.print(f"in {folder}")
        return 0

    result = validate(options.hull, trials, workers=options.workers, leave_out=options.leave_out)
    values = result.fit.values
    buoyancies = buoyancy_by_group(options.hull, trials, values)
    adjusted = with_own_buoyancy(options.hull, trials, values, buoyancies)

    tables = [
        score_table(
            "Simulation beside the pool: medians over the trials",
            {
                **{f"{name}, untuned": scores(name, trials, NOMINAL) for name in HULLS},
                f"{options.hull}, {'left out' if options.leave_out else 'fitted'}": result.left_out,
                f"{options.hull}, fitted, one buoyancy a trajectory number": adjusted,
            },
        ),
        buoyancy_table(buoyancies),
        parameter_table(result),
        trial_table(result.left_out),
    ]

    for table in tables:
        console.print(table.printed())

    write_json(folder / "pool.json", numbers_of(result))
    write_whole(folder / "pool.md", "\n\n".join(table.markdown() for table in tables))
    draw(folder / "pool.png", result, trials)
    console.print(f"in {folder}")
    return 0


if __name__ == "__main__":
    run_scenario(main)

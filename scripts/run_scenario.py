"""Runs a scenario from its file, such as the scenario.toml that every run leaves in its folder.

./uvw run scripts/run_scenario.py runs/clean_barrel/latest/scenario.toml
./uvw run scripts/run_scenario.py scenario.toml --set task.speed=0.03 "site.current=[0, 0.2, 0]"
"""

from uuv.start import parse, run_scenario  # isort: skip

import itertools
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction

from uuv.cli.carry_out import run_job
from uuv.sim.runs.command_line import RunOptions


@dataclass(kw_only=True)
class Options(RunOptions):
    """Run a scenario from its file."""

    file: Positional[Path]
    """Scenario file (TOML)."""
    seed: int | None = None
    """Seed instead of that in the file."""
    trust: bool = False
    """Run the code, MODULE:ATTRIBUTE, that the file names too; what is typed here needs no leave."""
    set: Annotated[tuple[tuple[str, ...], ...], UseAppendAction] = ()
    """Values instead of those in the file, by its keys and in its units: KEY=VALUE, such as task.speed=0.03."""


def main() -> int:
    """Runs the scenario and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    from uuv.scenario_file import read_scenario, with_values

    scenario = with_values(read_scenario(options.file, trust=options.trust), tuple(itertools.chain(*options.set)))
    if options.seed is not None:
        scenario = replace(scenario, seed=options.seed)
    return run_job(scenario, options, started)


if __name__ == "__main__":
    run_scenario(main)

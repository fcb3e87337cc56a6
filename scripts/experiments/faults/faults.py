"""Study: behaviour of contact work under sensor and thruster faults, for every fault on both paths
of the barrel.

Each run presses with 90 N when the fault begins, or it begins in another phase (--phases). A case
does damage if the true force on the object exceeds 1.5 times the set force, during the retreat too,
or anything but the tool touches the object. A case fails too if the tool touches the object later
than 2 s after the work was left.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from uuv.experiment.options import StudyOptions
from uuv.jobs import clean_barrel
from uuv.sim.runs.run_folder import RUNS

NAME = "study_faults"
PathName = Literal["longitudinal", "transverse"]


PhaseName = Literal["scan", "close-in", "approach", "press", "work", "unload", "retreat", "ascent"]


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Faults in contact work."""

    runs: int = 1
    """Number of runs on each path, with seeds from --seed on; each is branched into all cases."""
    paths: tuple[PathName, ...] = get_args(PathName)
    """Paths of clean_barrel."""
    only: tuple[str, ...] = ()
    """Run only cases whose names contain one of these words."""
    phases: tuple[PhaseName, ...] = ("work",)
    """Phases in which the faults begin: at work at full push, else shortly after the phase has
    begun; unload: while the force is ramped down; ascent: off the object after the loss of a heave
    thruster at work.
    """
    picture: str = "dead"
    """Draw cases whose names contain this."""
    drawn: Path | None = None
    """Run the drawn cases in this file, such as drawn_cases.json here."""


def main() -> int:
    """Runs or resumes the study; exit code 1 if a case does damage or touches the object late."""
    options = parse(Options)
    from experiments.faults.fault_cases import chosen_cases
    from experiments.faults.fault_figures import BranchedCase, lines, run, summarise
    from uuv import models
    from uuv.experiment import Study
    from uuv.experiment.drawn_cases import made_cases
    from uuv.models.vehicle import Vehicle
    from uuv.sim import hydrodynamics

    if options.drawn is not None:
        cases = made_cases(options.drawn, "faults", BranchedCase)
    else:
        cases = [
            BranchedCase(path, options.seed + k, options.only, options.phases)
            for path in options.paths
            for k in range(options.runs)
        ]
    vehicle = Vehicle.of(models.load(clean_barrel().vehicle.vehicle).compile())
    for case in cases:
        chosen_cases(vehicle.thruster_names, case.only)  # refuses words that match no case
    hydrodynamics.install()  # compiled once here, else by every worker
    run_one = partial(run, folder=options.out or RUNS / NAME, picture=options.picture)
    study = Study(cases=cases, run_one=run_one, summarise=summarise, line=lines)
    return study.carry_out(NAME, options, "Faults in contact work")


if __name__ == "__main__":
    run_scenario(main)

"""Study: calibration of an arm by touching, as real arms are, under loads, with wild touches.

    STUDY=scripts/experiments/calibration/calibration.py
    ./uvw run $STUDY
    ./uvw run $STUDY --real data/panda_2 data/panda_3 --aside high

The simulated arm is the UR10e of [Yukhimets 2023]. With --real, touches of real arms are evaluated
as well: a folder an arm, in it a folder a position, in it a file for each socket. Each position is
left out once, and trained on alone once.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from uuv.experiment.options import StudyOptions, at_least
from uuv.sim.interfaces.spatial import finite_number


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Calibration by touching, over many draws."""

    runs: int = 20
    """Number of seeds for the effects of real arms."""
    wild_runs: int = 10
    """Number of seeds for wild touches and loads."""
    real: tuple[Path, ...] = ()
    """Folders of real arms' touches."""
    real_arm: str = "panda"
    """Published arm that touched."""
    socket_distance: float = 0.05
    """Distance of consecutive sockets of a position [m]."""
    aside: tuple[str, ...] = ()
    """Positions that are not tested where another one alone was trained on."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, wild_runs=1)
        finite_number(self.socket_distance, "--socket-distance [m]", above=0.0, most=10.0)


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.calibration.calibration_study import (
        real_cases,
        run,
        simulated_cases,
        summarise,
    )
    from uuv.experiment import Study

    cases = list(simulated_cases(options.seed, options.runs, options.wild_runs))
    for folder in options.real:
        cases += real_cases(folder, options.real_arm, options.socket_distance, options.aside)
    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out("study_calibration", options, "Calibration of an arm by touching")


if __name__ == "__main__":
    run_scenario(main)

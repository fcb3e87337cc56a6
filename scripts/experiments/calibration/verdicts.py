"""Study: wrong inputs of a calibration that are refused, and right ones that are accepted.

Each simulated arm has workshop errors and touches three points; each --real folder holds a folder a
position, in it a file for each socket. Every kind of wrong input is made of the touches of each
arm. A wrong input counts as accepted wrongly if it is accepted, the arm differs from that of the
right input, and no line of the verdict says that such touches cannot tell it.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from uuv.experiment.options import StudyOptions, at_least


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Arms whose touches are spoilt."""

    runs: int = 10
    """Number of simulated arms whose inputs are made wrong."""
    right_runs: int = 20
    """Number of simulated arms whose right inputs are judged."""
    real: tuple[Path, ...] = ()
    """Folders of real arms' touches."""
    real_arm: str = "panda"
    """Published arm that touched."""
    seed: int = 100
    """Seed of the first arm."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, right_runs=0)


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.calibration.verdict_study import cases, summarise, verdict_of
    from uuv.experiment import Study

    every = tuple(
        cases(options.runs, options.right_runs, options.seed, options.real, options.real_arm)
    )
    study = Study(cases=every, run_one=verdict_of, summarise=summarise)
    return study.carry_out("study_verdicts", options, "Verdicts on wrong and right calibrations")


if __name__ == "__main__":
    run_scenario(main)

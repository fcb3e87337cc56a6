"""Study: faults that are named while nothing fails, in drawn seas on several vehicles; the gyro
check off for pairs.

Exit code 1 if a gyro or an attitude is named.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from uuv.experiment.options import StudyOptions, at_least


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Number of runs, and of those that are repeated without the check of the gyro."""

    runs: int = 200
    """Number of drawn runs."""
    pairs: int = 5
    """So many of the first runs are repeated without the check, and each that names gyro or
    attitude.
    """
    drawn: Path | None = None
    """Run the drawn cases in this file, such as drawn_false_alarms.json here."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, pairs=0)


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.faults.quiet_runs import SoundCase, draw, line, sound_run, summarise
    from uuv.experiment import Study
    from uuv.experiment.drawn_cases import made_cases
    from uuv.sim import hydrodynamics

    if options.drawn is not None:
        cases = made_cases(options.drawn, "false alarms", SoundCase)
    else:
        numbers = range(options.runs)
        cases = [draw(options.seed, i, paired=i < options.pairs) for i in numbers]
    hydrodynamics.install()  # compiled once here, else by every worker
    study = Study(cases=cases, run_one=sound_run, summarise=summarise, line=line)
    return study.carry_out("study_false_alarms", options, "Faults named while nothing fails")


if __name__ == "__main__":
    run_scenario(main)

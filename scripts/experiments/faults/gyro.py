"""Study: steps of a gyro's bias, 3 s into the quick job at 90 N, on each axis and either way.

All cases of a path and a seed branch from one saved run. Each is simulated for 4 s from its onset.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from typing import Literal

from uuv.experiment.options import StudyOptions


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Paths, seeds and sizes of the steps."""

    runs: int = 3
    """Number of seeds, from --seed on."""
    paths: tuple[Literal["longitudinal", "transverse"], ...] = ("longitudinal", "transverse")
    """Paths on the barrel."""
    sizes: tuple[float, ...] = (0.003, 0.01, 0.03, 0.1, 0.3)
    """Sizes of the steps [rad/s]."""


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.faults.gyro_steps import cases, step_of, summarise
    from uuv.experiment import Study

    seeds = range(options.seed, options.seed + options.runs)
    study = Study(
        cases=cases(options.paths, seeds, options.sizes), run_one=step_of, summarise=summarise
    )
    return study.carry_out("study_gyro", options, "A gyro whose bias jumps at work")


if __name__ == "__main__":
    run_scenario(main)

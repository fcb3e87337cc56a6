"""Study: error of the tip force from joint torques, by estimator, source of torques and arm.

    ./uvw run scripts/experiments/contact/tip_force.py

Draws postures and forces for four arms, corrupts the torques with errors of sensors and gears, and
prints one table. It covers statics only; errors due to water and motion show in the closed loop.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from uuv.experiment.options import StudyOptions


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Errors of the estimated tip force."""

    runs: int = 3000
    """Number of postures drawn for each row."""
    noise: float = 0.01
    """Noise of the torque sensors, share of the reading."""
    bias: float = 0.5
    """Bias of the torque sensors [N m], uniform in +-, where no tare removes it; a tenth on the
    small arm.
    """


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.contact.tip_force_errors import cases, run, summarise
    from uuv.experiment import Study

    each = tuple(cases(options.seed, options.runs, options.noise, options.bias))
    study = Study(cases=each, run_one=run, summarise=summarise)
    return study.carry_out(
        "study_tip_force", options, f"Error of the felt force, {options.runs} postures a row"
    )


if __name__ == "__main__":
    run_scenario(main)

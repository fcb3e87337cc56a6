"""Study: errors of the camera on the arm, from rendered pictures of textured objects, and the model
fitted to them.

    ./uvw run scripts/experiments/navigation/fit_arm_camera.py --runs 700 --seed 1 --write

Each run is one key picture and three after it, over range, texture, turbidity, silt and motion.
Prints the fitted model and its check by groups; --write stores it in sim/sensors/arm_camera.toml,
from which the simulated sensor takes it.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from experiments.navigation.arm_camera_errors import KeyCase, run, summarise, to_toml
from uuv.experiment import Row, Study, StudyOptions, Summary
from uuv.sim.runs.saving import write_whole
from uuv.sim.sensors.arm_camera import TABLE, ErrorModel


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Errors of the camera on the arm."""

    runs: int = 700
    """Number of key pictures; each gives three pairs."""
    write: bool = False
    """Store the fitted model in the package."""


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)

    def told(rows: list[Row]) -> Summary:
        summary = summarise(rows)
        if options.write:
            write_whole(TABLE, to_toml(ErrorModel(**summary.metrics["model"])))
        return summary

    study = Study(
        cases=[KeyCase(options.seed, number) for number in range(options.runs)],
        run_one=run,
        summarise=told,
    )
    return study.carry_out(
        "fit_arm_camera", options, f"Camera on the arm: {options.runs} key pictures"
    )


if __name__ == "__main__":
    run_scenario(main)

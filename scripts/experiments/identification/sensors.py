"""Study: depth and identification errors of stereo cameras behind a flat port, by calibration, and
of a 3D sonar.

All sensors see the same scenes. Stereo is ideal without a port, or behind a flat port with three
calibrations. A figure shows the depth errors over the image.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial

from uuv.experiment.options import StudyOptions
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Compare sensors by depth and identification of a barrel on the seabed."""

    runs: int = 20
    """Number of scenes."""
    ranges: tuple[float, float] = (1.0, 2.0)
    """Distance from sensor to barrel [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.3 < self.ranges[0] <= self.ranges[1] < 10.0:
            raise ConfigurationError(f"--ranges: must rise within 0.3 and 10 m, got {self.ranges}")


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.identification.sensor_errors import SensorCase, run, summarise
    from uuv.experiment import Study

    cases = [SensorCase(k, options.seed, options.ranges) for k in range(options.runs)]
    summary = partial(summarise, seed=options.seed, ranges=options.ranges)
    study = Study(cases=cases, run_one=run, summarise=summary)
    return study.carry_out("study_sensors", options, "A barrel seen by cameras and a sonar")


if __name__ == "__main__":
    run_scenario(main)

"""Study: contact work on the barrel in regular waves, over frequency, direction and amplitude.

Each cell of the map is worked within the bounds of the job, outside of them, broken off or refused.
Exit code 1 if a thruster that is sound is called lost.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from typing import Literal

from experiments.contact.wave_map import DIRECTIONS, WaveTask, line, one_run, summarise
from uuv.campaigns.contact_study import PATHS, PathName
from uuv.experiment import Study, StudyOptions
from uuv.experiment.options import at_least
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Contact work in waves."""

    runs: int = 1
    """Number of runs of each wave on each path, with seeds from --seed on."""
    amplitudes: tuple[float, ...] = (0.03, 0.06, 0.1, 0.2)
    """Amplitudes of the water's velocity [m/s]."""
    frequencies: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.3)
    """Frequencies [Hz]."""
    directions: tuple[Literal["along", "across", "up", "oblique"], ...] = DIRECTIONS
    """Directions against the hull's heading at the scan."""
    paths: tuple[PathName, ...] = PATHS
    """Paths of clean_barrel."""
    quick: bool = False
    """A shorter job."""

    def __post_init__(self) -> None:
        at_least(self, runs=1)
        if not (
            self.amplitudes
            and min(self.amplitudes) >= 0.0
            and self.frequencies
            and min(self.frequencies) > 0.0
        ):
            raise ConfigurationError(
                "--amplitudes must not be negative [m/s], --frequencies must be > 0 Hz"
            )


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    tasks = [
        WaveTask(
            amplitude=amplitude,
            frequency=frequency,
            direction=direction,
            path=path,
            seed=options.seed + k,
            quick=options.quick,
        )
        for direction in options.directions
        for frequency in options.frequencies
        for amplitude in options.amplitudes
        for path in options.paths
        for k in range(options.runs)
    ]
    hydrodynamics.install()  # compiled once here, else by every worker
    study = Study(cases=tasks, run_one=one_run, summarise=summarise, line=line)
    return study.carry_out("study_waves", options, "Contact work in waves")


if __name__ == "__main__":
    run_scenario(main)

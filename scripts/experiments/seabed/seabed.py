"""Study: accuracy of the seabed's reconstruction and the choice of working height, over random
terrains.

Each terrain is scanned by a coarse 3D sonar under the hull (`uuv.sim.sensors.sonar`) from 2.5 m
above. Two targets are projected, the profile between them is cut, and the working height is chosen.
All is compared with the true terrain. A refusal is right where the exactly known ground is refused
as well; work is right where it is not.

With --speed, the study measures the time from cloud to path over the size of the cloud instead,
beside other triangulations.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from uuv.experiment.options import StudyOptions
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Study the reconstruction of the seabed and the choice of height."""

    runs: int = 100
    """Number of terrains, all kinds in turn; their seeds are --seed and those that follow."""
    beam: float = 1.0
    """Spacing of the sonar's beams [deg]."""
    noise: float = 0.3
    """Standard deviation along the beam [% of the range]."""
    vehicle: str = "uuv_puma"
    """A name of uuv.models.available(), or an MJCF file with the named parts
    (docs/own_vehicle.md).
    """
    speed: bool = False
    """Measure times over the size of the cloud instead."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.beam > 0.0 or not self.noise >= 0.0:
            raise ConfigurationError(
                f"--beam must be > 0, --noise >= 0: got {self.beam}, {self.noise}"
            )


def main() -> int:
    """Runs or resumes the study or the time measurement and returns the exit code."""
    options = parse(Options)
    from experiments.seabed import seabed_speed, seabed_terrains
    from experiments.seabed.seabed_terrains import TerrainCase, searched_with
    from uuv.experiment import Study

    if options.speed:
        speed = Study(
            cases=[options.seed], run_one=seabed_speed.run, summarise=seabed_speed.summarise
        )
        return speed.carry_out("study_seabed_speed", options, "Time from the cloud to the path")
    searched_with(options.vehicle)  # refuses a vehicle without the parts
    cases = [
        TerrainCase(options.seed + k, options.beam, options.noise, options.vehicle)
        for k in range(options.runs)
    ]
    study = Study(cases=cases, run_one=seabed_terrains.run, summarise=seabed_terrains.summarise)
    return study.carry_out("study_seabed", options, f"The seabed on {options.runs} terrains")


if __name__ == "__main__":
    run_scenario(main)

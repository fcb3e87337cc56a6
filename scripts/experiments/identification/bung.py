"""Study: how well a bung in a barrel's shell determines the barrel's rotation about its axis, over
random scenes.

The bung lies anywhere around the barrel. "Seen": the camera sees the middle of the bung's face.
"Hidden": it sees nothing of the bung. Otherwise it sees a part. Identification either determines
the rotation or reports it as unknown. A rotation determined with an error over 2 deg is a failure.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from experiments.identification.bung_rotation import BungCase, run, summarise
from uuv.clouds.frames import CAMERAS
from uuv.experiment import Study, StudyOptions


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Scenes of a barrel with a bung."""

    runs: int = 100
    """Number of scenes of each sensor; their seeds are --seed and those that follow."""
    sensors: tuple[str, ...] = CAMERAS
    """Names of sensors."""


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    cases = [
        BungCase(sensor, options.seed + k)
        for sensor in options.sensors
        for k in range(options.runs)
    ]
    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out("study_bung", options, "Rotation of a barrel resolved by a bung")


if __name__ == "__main__":
    run_scenario(main)

"""Study: how many looks an object needs that is mostly hidden, with views in a fixed order and with
chosen ones.

Spheres hide 20 to 45 %, or 72 to 85 %, of the object's image in the first view. If that look is not
accepted, further ones are taken from the six other views, 15, 30 and 45 deg aside to both sides,
until one is accepted.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from itertools import cycle, islice

from experiments.identification.looks_needed import KINDS, ViewCase, run, summarise
from uuv.clouds.object_scenes import CAMERAS
from uuv.clouds.scene_kinds import NAMES
from uuv.experiment import Study, StudyOptions


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Scenes to look at, spread evenly over kinds, objects and sensors."""

    runs: int = 200
    """Number of scenes, with seeds from --seed on."""
    objects: tuple[str, ...] = NAMES
    """Names of objects."""
    sensors: tuple[str, ...] = CAMERAS
    """Names of sensors."""


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    combined = [
        (kind, name, sensor)
        for sensor in options.sensors
        for name in options.objects
        for kind in KINDS
    ]
    cases = [
        ViewCase(name, kind, sensor, options.seed + i)
        for i, (kind, name, sensor) in enumerate(islice(cycle(combined), options.runs))
    ]
    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out("study_views", options, f"Looks needed in {options.runs} scenes")


if __name__ == "__main__":
    run_scenario(main)

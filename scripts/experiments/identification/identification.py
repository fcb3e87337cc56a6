"""Study: errors, decisions and computing time of identification over random scenes of each object
and sensor.

A pose counts as found if its centre is within 1 % of the range and its attitude within 5 deg,
modulo the object's declared symmetry. Errors are over all scenes, found or not, accepted or not.
Times are processor times of all threads. With --recognise the object is not told: which of
--objects it is must be found too. With --points the model is given as point clouds too, drawn from
its mesh.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial
from typing import Literal

from experiments.identification import cloud_models, recognition
from experiments.identification.pose_errors import SceneCase, Start, line, run, summarise
from uuv.clouds.frames import SENSORS
from uuv.clouds.object_scenes import target_of
from uuv.experiment import Study, StudyOptions
from uuv.models.objects import targets


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Random scenes for identification."""

    objects: tuple[str, ...] = targets.available()
    """Names of objects."""
    sensors: tuple[str, ...] = tuple(SENSORS)
    """Names of sensors."""
    runs: int = 50
    """Number of scenes of each object and sensor; their seeds are --seed and those that follow."""
    start: Literal["coarse", "place", "any"] = "coarse"
    """Prior knowledge: position and attitude within --start-error (coarse), position only (place),
    or none (any).
    """
    start_error: tuple[float, float] = (0.3, 45.0)
    """Largest error of the coarse start [m], [deg]."""
    ranges: tuple[float, float] = (1.0, 2.0)
    """Distance from camera to object [m]."""
    gap: tuple[float, float] = (0.05, 0.4)
    """Distance from the object down to the seabed [m]; 0 0: it lies on it."""
    recognise: bool = False
    """Find out which of --objects is in the scene."""
    points: tuple[int, ...] = ()
    """Give the model as clouds of so many points, with and without normals, and compare the pose
    with its mesh's.
    """
    workers: int = 1
    """Number of processes; 0: one for each core, 1: this one.

    Computing times are comparable with 1 only.
    """


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    for name in options.objects:
        target_of(name)  # refuses an unknown name

    start = Start(options.start, options.start_error, options.ranges, options.gap)
    cases = [
        SceneCase(name, sensor, options.seed + k, start)
        for name in options.objects
        for sensor in options.sensors
        for k in range(options.runs)
    ]

    # The object is not given: which of them it is must be found too.
    if options.recognise:
        asked = [
            recognition.RecognitionCase(c.name, options.objects, c.sensor, c.seed, c.start)
            for c in cases
        ]
        title = f"{start}: which of {len(options.objects)} objects is it?"
        study = Study(
            cases=asked,
            run_one=recognition.run,
            summarise=partial(recognition.summarise, title=title),
            line=recognition.line,
        )
        return study.carry_out("study_recognition", options, "Recognition on random scenes")

    # The model is given as point clouds too.
    if options.points:
        study = Study(
            cases=[
                cloud_models.CloudCase(c.name, options.points, c.sensor, c.seed, c.start)
                for c in cases
            ],
            run_one=cloud_models.run,
            summarise=partial(cloud_models.summarise, title=f"{start}: models as clouds"),
            line=cloud_models.line,
        )
        return study.carry_out("study_cloud_models", options, "Models given as clouds")

    study = Study(
        cases=cases, run_one=run, summarise=partial(summarise, title=str(start)), line=line
    )
    return study.carry_out("study_identification", options, "Identification on random scenes")


if __name__ == "__main__":
    run_scenario(main)

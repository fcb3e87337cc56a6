"""Study: rates of false accepts, false refusals and rescans of PoseCheck over scenes of known
truth.

Right scenes show the object clean, partly hidden, or fouled. Wrong ones show another object, none,
or less than 30 % of it. Besides, poses that are wrong by 3 cm, by 10 deg and, on a starfish of
uneven arms, by 72 deg are checked on the evidence of the right scenes.

A pose counts as found if its centre is within 1 % of the range and its attitude within 5 deg,
modulo declared symmetry. A false accept is an accepted pose that is not found, or any accepted pose
where the object is absent. A found pose that is refused is a false refusal; rescans of found poses
are counted separately.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from itertools import cycle, islice

from experiments.identification.decision_rates import DecisionCase, run, summarise
from uuv.clouds.frames import CAMERAS
from uuv.clouds.scene_kinds import NAMES
from uuv.experiment import Study, StudyOptions

KINDS = ("clean", "hidden", "fouled", "hidden_most", "other", "absent")


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Scenes to decide on, spread evenly over kinds, objects and sensors."""

    runs: int = 500
    """Number of scenes, with seeds from --seed on; poses forced wrong are added."""
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
        DecisionCase(name, kind, sensor, options.seed + i)
        for i, (kind, name, sensor) in enumerate(islice(cycle(combined), options.runs))
    ]

    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out("study_decisions", options, f"Decisions on {options.runs} scenes")


if __name__ == "__main__":
    run_scenario(main)

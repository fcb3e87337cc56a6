"""Study: recall, accepts and false accepts of identification on objects that no code was tuned on.

Shapes and scenes are drawn by a seeded grammar (`experiments.identification.unseen`): ten classes
of shape, three of occlusion, clutter, touching neighbours and piles, three kinds of depth noise and
a sonar. A pose is found within 5 mm plus 0.3 % of the range and 3 deg, modulo the geometric
symmetry of the shape. A false accept is an accepted pose that is not found, or any accepted pose
where the object is absent, another one, mirrored, or 5 % larger or smaller.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments.identification.unseen.scenes import PILE, piled, present, wrong
from experiments.identification.unseen.study import Known, UnseenTrial, line, run, summarise
from uuv.experiment import Study, StudyOptions
from uuv.experiment.drawn_cases import made_cases
from uuv.experiment.options import at_least
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Random scenes with unseen objects."""

    runs: int = 300
    """Number of scenes with the object present."""
    wrong: int = 100
    """Number of scenes where it is absent, another object of its class, mirrored or resized, in
    turn.
    """
    piles: int = 0
    """Number of piles of five touching objects, which are searched for together; of the start only
    the position.
    """
    sonar: int = 0
    """Number of scenes with the object present that a sonar sees."""
    start: Known = "place"
    """Prior knowledge: position within 0.3 m and attitude within 45 deg (coarse), position only
    (place), or none.
    """
    drawn: Path | None = None
    """Run the drawn scenes in this file, such as drawn_cases.json here."""
    workers: int = 1
    """Number of processes; 0: one for each core, 1: this one.

    Computing times are comparable with 1 only.
    """

    def __post_init__(self) -> None:
        at_least(self, runs=0, wrong=0, piles=0, sonar=0, workers=0)
        if not any((self.runs, self.wrong, self.piles, self.sonar)):
            raise ConfigurationError(
                "no scenes: one of --runs, --wrong, --piles and --sonar must be positive"
            )


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    seed = options.seed
    if options.drawn is not None:
        trials = made_cases(options.drawn, "unseen objects", UnseenTrial)
    else:
        scenes = [
            *(present(seed, k) for k in range(options.runs)),
            *(wrong(seed, k) for k in range(options.wrong)),
            *(piled(seed, k) for k in range(PILE * options.piles)),
            *(present(seed, k, "sonar") for k in range(options.sonar)),
        ]
        trials = [UnseenTrial(scene, options.start) for scene in scenes]

    title = {"coarse": "coarse pose known", "place": "position known", "any": "nothing known"}[
        options.start
    ]
    study = Study(cases=trials, run_one=run, summarise=partial(summarise, title=title), line=line)
    return study.carry_out("study_unseen", options, "Identification of unseen objects")


if __name__ == "__main__":
    run_scenario(main)

"""Study: deviation of tool paths from the true surface of fouled and dented objects.

For each seed an object is drawn and seen by the depth camera in a few frames from nearly one
position. It is identified in the last frame, and a path is planned on the median of all. Distances
to the true surface are taken along the tool's axis, from the path and from the undeformed model.
The tool's tilt is relative to the true normal at its tip. Beside it stands the change of that
normal within the pad. Seen and unseen parts of the path are listed separately.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial

from uuv.experiment.options import StudyOptions, at_least


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Tool paths on objects that deviate from their models."""

    runs: int = 10
    """Number of seeds for each object, from --seed on."""
    looks: int = 1
    """Depth frames whose median the path is planned on; jobs with possible growth or dents take
    16.
    """
    exact: bool = False
    """Exact depth: shows the errors due to the camera's resolution and the path's smoothing
    alone.
    """
    judged: bool = True
    """Plan only on accepted identifications (--no-judged: on the best pose in any case)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, looks=1)


def main() -> int:
    """Runs or resumes the study; exit code 0 if all seen parts of all paths are within the
    bound.
    """
    options = parse(Options)
    from experiments.toolpath.path_deviation import SCENES, PathCase, run, summarise
    from uuv.experiment import Study

    cases = [
        PathCase(name, options.seed + k, options.looks, options.exact, options.judged)
        for name in SCENES
        for k in range(options.runs)
    ]
    looks = f"{options.looks} {'exact ' * options.exact}looks"
    study = Study(cases=cases, run_one=run, summarise=partial(summarise, looks=looks))
    return study.carry_out("study_paths", options, "Tool paths on the true surface")


if __name__ == "__main__":
    run_scenario(main)

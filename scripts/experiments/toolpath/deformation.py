"""Study: deformation maps against the truth, on fouled and dented objects and on undeformed ones.

Objects and views are those of scripts/experiments/toolpath/paths.py. A pixel of the true surface
counts as deformed where its deviation exceeds a size, and as mapped where it is in a region of the
map of that size. Overlap is intersection over union, over the pixels that the map compares.
Undeformed objects are those of the library in random
scenes: there every region is false.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from uuv.experiment.options import StudyOptions, at_least


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Deformation maps of deformed and undeformed objects."""

    runs: int = 5
    """Number of seeds for each deformed object, from --seed on."""
    looks: int = 16
    """Depth frames whose median is compared; a single frame is compared too."""
    clean: int = 5
    """Number of scenes of each undeformed object."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, looks=3, clean=0)


def main() -> int:
    """Runs or resumes the study; exit code 0 if overlaps reach the bound and no region is false."""
    options = parse(Options)
    from experiments.toolpath.map_errors import DeformationCase, run, summarise
    from experiments.toolpath.path_deviation import SCENES
    from uuv.experiment import Study
    from uuv.models.objects import targets

    cases = [
        DeformationCase(name, options.seed + k, options.looks)
        for name in SCENES
        for k in range(options.runs)
    ]
    cases += [
        DeformationCase(name, options.seed + k, 0)
        for name in targets.available()
        for k in range(options.clean)
    ]
    study = Study(cases=cases, run_one=run, summarise=summarise)
    return study.carry_out("study_deformation", options, "Deformation maps")


if __name__ == "__main__":
    run_scenario(main)

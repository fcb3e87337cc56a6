"""Study: the main job by default methods, and by those of the papers in their place.

    # both paths, seeds 0 to 4
    ./uvw run scripts/experiments/contact/versions.py

    STUDY=scripts/experiments/contact/versions.py
    ./uvw run $STUDY --versions defaults "force law" --runs 1 --quick

The tables list the largest figure of all seeds. Runs that were not accepted are listed with their
reasons.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass

from experiments.contact.version_cases import PATHS, VERSIONS, VersionCase, run, summarise
from uuv.experiment import Study, StudyOptions
from uuv.sim.interfaces.spatial import one_of


@dataclass(kw_only=True)
class Options(StudyOptions):
    """The main job in several versions."""

    runs: int = 5
    """Number of seeds, from --seed on."""
    versions: tuple[str, ...] = tuple(VERSIONS)
    """Versions to run."""
    quick: bool = False
    """The short job."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for version in self.versions:
            one_of(version, tuple(VERSIONS), "--versions")


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    cases = [
        VersionCase(version=version, path=path, seed=options.seed + k, quick=options.quick)
        for version in options.versions
        for path in PATHS
        for k in range(options.runs)
    ]
    return Study(cases=cases, run_one=run, summarise=summarise).carry_out(
        "study_versions", options, "The main job by default and by published methods"
    )


if __name__ == "__main__":
    run_scenario(main)

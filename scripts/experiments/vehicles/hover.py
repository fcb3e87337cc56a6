"""Study: station keeping under pushes at the tool, at full reach and in many directions, with
ablations.

`envelope`: excursion of the hull with and without compensation, by current. `ablation`: errors of
lag, dead band and
coefficients, and the thruster lead. `lost`: each thruster stops during a push; two seconds later
the push ends, and the hull keeps station on the remaining thrusters. Pushes are external forces at
the tip; the drives are stiff.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial
from typing import Literal

from uuv.experiment.options import StudyOptions, at_least


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Pushes at full reach."""

    table: Literal["envelope", "ablation", "lost"] = "envelope"
    """Quantity that is varied."""
    directions: int = 14
    """Number of directions of the push, spread over the sphere, the six axes first."""
    force: float = 90.0
    """Force of the push [N]."""
    currents: tuple[float, ...] = (0.0, 0.2, 0.4)
    """Speeds of the current [m/s] in the envelope, at 30 degrees from ahead."""
    posture: Literal["ahead", "aside", "down"] = "ahead"
    """Posture of the arm, stretched out."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, directions=1)


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.vehicles import pushed_hover as hover
    from uuv.experiment import Study

    base = hover.push_case(
        options.directions, options.force, options.posture, options.gust, options.seed
    )
    cases = {
        "envelope": lambda: hover.envelope(base, options.currents),
        "ablation": lambda: hover.ablation(base),
        "lost": lambda: hover.lost(base),
    }[options.table]()
    title = (
        f"Push of {options.force:.0f} N in {len(base.directions_B)} directions, arm "
        f"{options.posture}"
    )
    more = [hover.authority_table()] if options.table == "lost" else []
    summary = partial(hover.summarise, title=title, more=more)
    study = Study(cases=tuple(cases), run_one=hover.run, summarise=summary, line=hover.line)
    return study.carry_out("study_hover", options, title)


if __name__ == "__main__":
    run_scenario(main)

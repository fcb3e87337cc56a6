"""Study: step response of the force loop on soft, medium and hard surfaces with one tuning, the
tool moving.

Each run steps the set force up and down several times. The mean response is judged, so that sensor
noise and gusts do
not count as overshoot. Exit code 0: the mean response overshoots by at most 5 % on each surface.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from functools import partial

from uuv.experiment.options import StudyOptions
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class Options(StudyOptions):
    """Steps of the set force on surfaces from soft to hard."""

    runs: int = 3
    """Number of runs on each surface; their seeds are --seed and those that follow."""
    stiffness: tuple[float, ...] = (1e4, 3e4, 1e6)
    """Stiffness of pad and surface in series [N/m]."""
    low: float = 60.0
    """Set force before a step [N]."""
    high: float = 90.0
    """Set force after a step [N]."""
    rate: float = 60.0
    """Rate of change of the set force [N/s], default as in the jobs; 1e6 is nearly a step."""
    steps: int = 6
    """Number of steps up in a run."""
    current: tuple[float, float, float] = (0.15, 0.0, 0.0)
    """Steady current in W [m/s]."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    quick: bool = False
    """One run on each surface."""

    def __post_init__(self) -> None:
        super().__post_init__()

        if not 0.0 < self.low < self.high:
            raise ConfigurationError(
                f"--low, --high: must rise from above zero, got {self.low}, {self.high} N"
            )

        if not (self.rate > 0.0 and 1 <= self.steps <= 6):
            raise ConfigurationError("--rate must be > 0 N/s, --steps from 1 to 6")


def main() -> int:
    """Runs or resumes the study and returns the exit code."""
    options = parse(Options)
    from experiments.contact.force_step_figures import line, summarise
    from experiments.contact.force_steps import StepTask, failed, responses
    from uuv.experiment import Study
    from uuv.sim import hydrodynamics

    tasks = [
        StepTask(
            stiffness=stiffness,
            seed=options.seed + run,
            low=options.low,
            high=options.high,
            steps=options.steps,
            rate=options.rate,
            current=options.current,
            gust=options.gust,
        )
        for stiffness in options.stiffness
        for run in range(1 if options.quick else options.runs)
    ]

    hydrodynamics.install()  # compiled once here, else by every worker
    summary = partial(summarise, low=options.low, high=options.high)

    study = Study(cases=tasks, run_one=responses, summarise=summary, failed=failed, line=line)
    return study.carry_out(
        "step_response", options, f"Force from {options.low:g} to {options.high:g} N"
    )


if __name__ == "__main__":
    run_scenario(main)

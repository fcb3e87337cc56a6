"""How strong a current the barrel can be cleaned in: force and hull by the speed of the current."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uuv import jobs, run
from uuv.experiment import Page, column, experiment, stat
from uuv.start import run_scenario


@dataclass(frozen=True, kw_only=True)
class CurrentCase:
    """A short path on the barrel in one current."""

    speed: float = 0.2
    """Speed of the current [m/s]."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class CurrentRow:
    """How the run ended, and what its checks measured."""

    accepted: bool = column("accepted")
    ended: str = column("ended")  # cause of an abort, else the last phase
    checked: Mapping[str, float | None] = column("value", by="check")
    failed: Sequence[str] = column("bounds missed")


@experiment(
    "my_current",
    seeds=2,
    vary={"speed": (0.1, 0.4)},
    paired=True,
    quick={"runs": 1, "speed": (0.1,)},
    failed=lambda _, error: CurrentRow(accepted=False, ended=error, checked={}, failed=[]),
)
def my_current(case: CurrentCase) -> CurrentRow:
    """Cleans a barrel in a current from a drawn side."""
    heading = np.random.default_rng(case.seed).uniform(-np.pi, np.pi)
    current = (case.speed * np.cos(heading), case.speed * np.sin(heading), 0.0)
    done = run(jobs.clean_barrel(quick=True, sensor="survey", current=current, seed=case.seed))

    metrics = done.assessment.metrics
    return CurrentRow(
        accepted=metrics["accepted"],
        ended=metrics["run"]["abort"] or metrics["run"]["state"],
        checked={check.name: check.value for check in done.assessment.checks},
        failed=list(done.assessment.failed),
    )


my_current.page = (
    Page()
    .share("accepted")
    .table("Cleaning a barrel in a current", by="speed", columns=[stat("share", "accepted")])
    .table(
        "Checks, largest in SI units",
        by="check",
        across="speed",
        columns=[stat("largest", "checked")],
    )
)

if __name__ == "__main__":
    run_scenario(my_current.main)

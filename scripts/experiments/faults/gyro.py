"""Steps of a gyro's bias, 3 s into the quick job at 90 N, on each axis and either way.

All cases of a path and a seed branch from one saved run. Each is simulated for 4 s from its onset.
A gyro counts as named if the first fault that is reported is that of the gyro of this axis.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from experiments.faults.fault_cases import PATHS, PathName
from uuv.experiment import Page, column, experiment, stat
from uuv.jobs import clean_barrel
from uuv.perturbations.loop import SensorFailure
from uuv.runner import run, saved
from uuv.saved_run import SavedRun
from uuv.sim.evaluation.surface.tool_errors import path_error
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind
from uuv.sim.loop.rollout import Moment

AXES = ("x", "y", "z")
ONSET = 3.0  # [s] into the work
AFTER = 4.0  # [s] simulated from the onset on


@dataclass(frozen=True, kw_only=True)
class GyroStep:
    """One step of the bias of one axis."""

    path: PathName
    """Path on the barrel."""
    axis: str
    """Axis of the gyro."""
    size: float
    """Size of the step [rad/s]."""
    sign: Literal[1, -1]
    """Its sign."""
    seed: int

    def __post_init__(self) -> None:
        if not 0.0 < self.size < math.inf:
            raise ConfigurationError(f"--size: must be positive and finite, got {self.size}")


@dataclass(frozen=True, kw_only=True)
class GyroRow:
    """The first fault that is reported, and what force and path do from the onset on."""

    kind: str = column("first fault")
    part: str = column("of part")
    delay: float | None = column("reported after", "s", digits=2)
    force: float = column("true force", "N", digits=0)
    deviation: float = column("path deviation", "mm", digits=1, factor=1e3)
    left: str = column("work left for")


@lru_cache(maxsize=1)
def _at_work(path: PathName, seed: int) -> SavedRun:
    """The job at the first step of its work, from which its cases branch."""
    return saved(clean_barrel(path=path, quick=True, seed=seed, forces=(90.0,)), "work")


class FirstFault:
    """Observer that keeps the first fault that is reported."""

    slow_ticks = ()

    def __init__(self) -> None:
        self.kind = ""
        self.part = ""
        self.time: float | None = None

    def observe(self, moment: Moment) -> None:
        """Keeps the fault, and when the command said it."""
        if not self.kind and moment.command.faults:
            fault = moment.command.faults[0]
            self.kind = fault.kind.value
            self.part = fault.part
            self.time = float(moment.truth.time)


@experiment(
    "gyro_steps",
    seeds=3,
    vary={"path": PATHS, "axis": AXES, "size": (0.003, 0.01, 0.03, 0.1, 0.3), "sign": (1, -1)},
    paired=True,
    quick={"runs": 1, "path": ("longitudinal",), "axis": ("x",), "size": (0.3,)},
)
def gyro_steps(case: GyroStep) -> GyroRow:
    """Simulates a step of the bias."""
    start = _at_work(case.path, case.seed)
    first = FirstFault()

    # the step
    onset = start.time + ONSET
    failure = SensorFailure(
        sensor="imu",
        effect="offset",
        field="w_WB_B",
        index=AXES.index(case.axis),
        value=case.sign * case.size,
        at=onset,
    )
    recording = run(
        start.with_failures(failure), observers=[first], longest=onset + AFTER
    ).recording

    # from the onset on
    force = recording["contact_most"]
    error = path_error(recording)
    assert error is not None
    abort = recording.final.abort
    return GyroRow(
        kind=first.kind,
        part=first.part,
        delay=None if first.time is None else first.time - onset,
        force=float(force.scalar[force.time >= onset].max()),
        deviation=float(error.deviation[error.time >= onset].max(initial=0.0)),
        left="" if abort is None else abort.value,
    )


def named(row: Mapping[str, Any]) -> bool:
    """Whether the gyro of this axis was the first fault."""
    return row["kind"] == FaultKind.GYRO.value and row["part"] == row["axis"]


gyro_steps.page = Page().table(
    "Steps of a gyro's bias",
    by="size",
    columns=[
        stat("share", named, "named"),
        stat(
            "largest",
            lambda row: row["delay"] if named(row) else None,
            "within",
            unit="s",
            digits=2,
        ),
        stat("largest", "force"),
        stat("largest", "deviation"),
        stat("count", "left", "work left"),
    ],
)

if __name__ == "__main__":
    run_scenario(gyro_steps.main)

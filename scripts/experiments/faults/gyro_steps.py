"""Steps of a gyro's bias while a barrel is cleaned: when each is found, as what, and what tool and
force do.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from uuv.experiment import Row, Summary, Table
from uuv.jobs import clean_barrel
from uuv.perturbations.loop import SensorFailure
from uuv.runner import run, saved
from uuv.saved_run import SavedRun
from uuv.sim.evaluation.metrics import path_error
from uuv.sim.interfaces.messages import FaultKind
from uuv.sim.loop.rollout import Moment

AXES = "xyz"
ONSET = 3.0  # [s] into the work
AFTER = 4.0  # [s] simulated from the onset on
COLUMNS = (
    "step [rad/s]",
    "cases",
    "named",
    "within [s]",
    "force, largest [N]",
    "path, largest [mm]",
    "left",
)

Path = Literal["longitudinal", "transverse"]


@dataclass(frozen=True, kw_only=True)
class GyroStep:
    """One step of the bias of one axis."""

    path: Path
    seed: int
    axis: int  # of the gyro, 0 to 2
    size: float  # [rad/s] with its sign


def cases(paths: Iterable[Path], seeds: Iterable[int], sizes: Iterable[float]) -> list[GyroStep]:
    """All axes, and both signs, of each size; those of one path and seed follow each other."""
    sizes = tuple(sizes)
    return [
        GyroStep(path=path, seed=seed, axis=axis, size=sign * size)
        for seed in seeds
        for path in paths
        for axis in range(len(AXES))
        for size in sizes
        for sign in (1.0, -1.0)
    ]


@lru_cache(maxsize=1)
def _at_work(path: Path, seed: int) -> SavedRun:
    """The job at the first step of its work, from which its cases branch."""
    return saved(clean_barrel(path=path, quick=True, seed=seed, forces=(90.0,)), "work")


class FirstFault:
    """Observer that keeps the first fault that is reported."""

    slow_ticks = ()

    def __init__(self) -> None:
        self.kind, self.part, self.time = "", "", np.nan

    def observe(self, moment: Moment) -> None:
        """Keeps the fault, and when the command said it."""
        if not self.kind and moment.command.faults:
            fault = moment.command.faults[0]
            self.kind, self.part, self.time = fault.kind.value, fault.part, float(moment.truth.time)


def step_of(case: GyroStep) -> dict[str, Any]:
    """Row of a case: the first fault, and the largest force and path deviation from the onset
    on.
    """
    start, first = _at_work(case.path, case.seed), FirstFault()
    onset = start.time + ONSET
    failure = SensorFailure(
        sensor="imu", effect="offset", field="w_WB_B", index=case.axis, value=case.size, at=onset
    )
    done = run(start.with_failures(failure), observers=[first], longest=onset + AFTER)

    recording = done.recording
    force, error = recording["contact_most"], path_error(recording)
    assert error is not None
    return {
        "path": case.path,
        "seed": case.seed,
        "axis": AXES[case.axis],
        "size_rad_s": case.size,
        "kind": first.kind,
        "part": first.part,
        "found_s": first.time - onset,
        "force_max_n": float(force.scalar[force.time >= onset].max()),
        "path_max_m": float(error.deviation[error.time >= onset].max(initial=0.0)),
        "left": "" if recording.final.abort is None else recording.final.abort.value,
    }


def summarise(rows: list[Row]) -> Summary:
    """Figures of each size."""
    table = []
    for size in dict.fromkeys(abs(row["size_rad_s"]) for row in rows):
        mine = [row for row in rows if abs(row["size_rad_s"]) == size]
        named = [
            row
            for row in mine
            if row["kind"] == FaultKind.GYRO.value and row["part"] == row["axis"]
        ]
        found = max((row["found_s"] for row in named), default=np.nan)
        force, path = (max(row[name] for row in mine) for name in ("force_max_n", "path_max_m"))
        left = sum(bool(row["left"]) for row in mine)
        figures = (
            f"{size:g}",
            len(mine),
            len(named),
            f"{found:.2f}",
            f"{force:.0f}",
            f"{1e3 * path:.1f}",
            left,
        )
        table.append([*map(str, figures)])
    return Summary(
        metrics={"sizes": [dict(zip(COLUMNS, row, strict=True)) for row in table]},
        tables=[Table(title="Steps of a gyro's bias", columns=COLUMNS, rows=table, labels=1)],
    )

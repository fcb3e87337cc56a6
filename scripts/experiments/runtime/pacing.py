"""Lateness of a run that keeps to a clock, in contact and with all sensors.

A run is saved at the approach, where scan, identification and placement are over. From there it is
continued again and again, in real time or at another factor of it, until the given time is over. A
tick is late by what it is ready after its time. On a machine with other work the figures are the
machine's; the load beside is in the row.

    ./uvw run scripts/experiments/runtime/pacing.py --seconds 600 --workers 1    # 10 minutes alone
"""

from uuv.start import run_scenario  # isort: skip

import math
import os
import time
from dataclasses import dataclass

import numpy as np

from uuv import jobs
from uuv.experiment import Page, column, experiment, stat
from uuv.pace import WallClock
from uuv.runner import run, saved
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import finite_number
from uuv.sim.loop.rollout import Moment

FACTORS = (1.0, 0.1, 5.0)  # of real time


@dataclass(frozen=True, kw_only=True)
class PaceCase:
    """One factor of real time."""

    factor: float
    """Simulated seconds a second."""
    seconds: float = 120.0
    """Time on the clock [s], at least."""

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a time that is none."""
        finite_number(self.seconds, "--seconds [s]", above=0.0)


@dataclass(frozen=True, kw_only=True)
class PaceRow:
    """How well the clock was kept."""

    simulated: float = column("simulated", "s", digits=1)
    contact: float = column("of it in contact", "s", digits=1)
    kept: float = column("factor kept", digits=4)
    median: float = column("late, median", "ms", digits=2, factor=1e3, tolerance=None)
    p99: float = column("late, 99 %", "ms", digits=2, factor=1e3, tolerance=None)
    worst: float = column("late at most", "ms", digits=1, factor=1e3, tolerance=None)
    paused: float = column("paused", "s", digits=1, tolerance=None)
    load: float = column("load beside", digits=1, tolerance=None)


@dataclass(slots=True)
class PaceWatch:
    """Observer that takes the time from the first step that waits to the last."""

    slow_ticks: tuple[int, ...] = (5,)  # as those of `WallClock`
    _first: tuple[float, float] | None = None  # [s] simulated, and on the clock
    _last: tuple[float, float] = (0.0, 0.0)

    def observe(self, moment: Moment) -> None:
        """Note the time."""
        self._last = float(moment.truth.time), time.perf_counter()
        self._first = self._first or self._last

    @property
    def simulated(self) -> float:
        """Simulated time [s] between them."""
        return self._last[0] - (self._first or self._last)[0]

    @property
    def wall(self) -> float:
        """Time [s] on the clock between them."""
        return self._last[1] - (self._first or self._last)[1]


@experiment("pacing", vary={"factor": FACTORS}, quick={"seconds": 5.0})
def pacing(case: PaceCase) -> PaceRow:
    """Keeps a run to a factor of real time."""
    start = saved(jobs.clean_barrel(), "approach")
    load = os.getloadavg()[0]
    late: list[float] = []
    simulated = wall = paused = contact = 0.0

    # Nothing before the first wait counts, nor what a continued run needs to be set up.
    while wall < case.seconds:
        clock = WallClock(case.factor)
        left = case.seconds - wall
        watch = PaceWatch()
        longest = math.ceil(start.time + max(left * case.factor, 1.0))
        done = run(start, observers=(clock, watch), longest=longest)
        report = clock.report()

        recording = done.recording
        simulated += watch.simulated
        wall += watch.wall
        paused += report["paused_s"]
        contact += float(recording.within(WorkState.WORK).sum() * recording.timestep)
        late += clock.late

    waits = np.array(late)
    return PaceRow(
        simulated=simulated,
        contact=contact,
        kept=simulated / (wall - paused) / case.factor,
        median=float(np.median(waits)),
        p99=float(np.percentile(waits, 99)),
        worst=float(waits.max()),
        paused=paused,
        load=load,
    )


pacing.page = Page().table(
    "Pacing",
    by="factor",
    columns=[
        stat("mean", name)
        for name in ("simulated", "contact", "kept", "median", "p99", "worst", "paused", "load")
    ],
)


if __name__ == "__main__":
    run_scenario(pacing.main)

"""Real-time pacing: keeps a run at a factor of real time and measures its lateness.

Nothing is skipped: a run that is late continues as fast as possible. Work during which the vehicle
waits (a scan, the identification after it, the placement of the hull) counts as a pause, not as
lateness. A run that was late before a pause is equally late after it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.rollout import Moment

SLOWEST = 0.01  # smallest factor of real time
FASTEST = 100.0  # largest factor of real time
_PAUSE = 0.05  # [s] wall time of a pause, at least


def check_pace(factor: float | None) -> None:
    """Refuse a factor of real time that is out of range; None: as fast as possible."""
    if factor is not None and not SLOWEST <= factor <= FASTEST:
        raise ConfigurationError(
            f"pace: must be {SLOWEST} to {FASTEST} times real time, got {factor}"
        )


@dataclass(slots=True)
class WallClock:
    """Real-time pacing of a run; an observer of `uuv.sim.loop.rollout`."""

    factor: float  # factor: simulated seconds per second
    clock: Callable[[], float] = time.perf_counter
    late: list[float] = field(default_factory=list)  # [s] lateness of the run at each wait
    # [s] time and duration of each pause
    pauses: list[tuple[float, float]] = field(default_factory=list)
    slow_ticks: tuple[int, ...] = (5,)  # computing times of the loop between two waits
    _origin: float | None = None  # [s] wall time that corresponds to simulated time 0
    _state: WorkState | None = None

    def __post_init__(self) -> None:
        check_pace(self.factor)

    def observe(self, moment: Moment) -> None:
        """Wait until the time of the moment."""
        self.arrive(float(moment.truth.time), moment.reference.state)
        while (wait := self.due(float(moment.truth.time)) - self.clock()) > 0.0:
            time.sleep(wait)

    def arrive(self, simulated: float, state: WorkState) -> None:
        """Record that a tick is ready to wait, with its lateness and the pause before it.

        Args:
            simulated: [s] time of the tick.
            state: State of the work; a scan and the tick after it may be a pause.
        """
        arrived = self.clock()
        if self._origin is None:
            self._origin = arrived - simulated / self.factor

        # Time since the last wait, beyond the scheduled time
        late = max(0.0, arrived - self.due(simulated))
        pause = late - (self.late[-1] if self.late else 0.0)
        may_pause = state is WorkState.SCAN or state is not self._state
        if pause > _PAUSE and may_pause:
            self.pauses.append((simulated, pause))
            self._origin += pause
            late -= pause

        self.late.append(late)
        self._state = state

    def due(self, simulated: float) -> float:
        """Wall time [s] at which a simulated time [s] is scheduled."""
        assert self._origin is not None
        return self._origin + simulated / self.factor

    def summary(self) -> str:
        """The report in one line."""
        report = self.report()
        return (
            f"pace {self.factor:g}: late by {1e3 * report['late_median_s']:.2f} ms (median), "
            f"{1e3 * report['late_p99_s']:.2f} (99 %), {1e3 * report['late_max_s']:.1f} at most; "
            f"{report['pauses']:.0f} pauses, {report['paused_s']:.1f} s"
        )

    def report(self) -> dict[str, float]:
        """Lateness at the waits and length of the pauses."""
        late = np.array(self.late or [0.0])
        return {
            "factor": self.factor,
            "waits": float(len(self.late)),
            "late_median_s": float(np.median(late)),
            "late_p99_s": float(np.percentile(late, 99)),
            "late_max_s": float(late.max()),
            "pauses": float(len(self.pauses)),
            "paused_s": float(sum(length for _, length in self.pauses)),
        }

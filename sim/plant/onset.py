"""Start and duration of a fault or motion, at a time or at an event that is observed in the
loop.
"""

from dataclasses import dataclass, field

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import number
from uuv.sim.loop.rollout import Moment


@dataclass(slots=True, eq=False)
class Onset:
    """Start and duration of a fault: at a given time, or at an event of the task.

    There are three ways to set the start: `at`; `state` (and `force`), with the onset passed to the
    rollout as an observer; or a call of `begin`.
    """

    at: float | None = None  # [s]
    state: WorkState | None = None  # event: the planner enters this state for the first time
    force: float = 0.0  # [N] smallest set force for the event
    after: float = 0.0  # [s] delay after time or event
    duration: float = np.inf  # [s]
    began: float = field(default=np.inf, init=False)  # [s]

    def __post_init__(self) -> None:
        for name in (
            ("force", "after", "duration") if self.at is None else ("at", "after", "duration")
        ):
            moment = number(getattr(self, name), f"onset {name}")
            if not moment >= 0.0:
                raise ConfigurationError(f"onset {name}: must be >= 0, got {moment}")

        if self.at is not None:
            if self.state is not None:
                raise ConfigurationError("onset: takes `at` or `state`, got both")
            self.began = self.at + self.after

    def begin(self, time: float) -> None:
        """Start the fault `after` seconds later than `time` [s]."""
        self.began = time + self.after

    def observe(self, moment: Moment) -> None:
        """Wait for the event; an observer of `uuv.sim.loop.rollout`."""
        self.notice(float(moment.truth.time), moment.reference.state, moment.reference.set_force)

    def notice(self, time: float, state: WorkState, set_force: float) -> None:
        """Start the fault if this is the first occurrence of its event.

        Args:
            time: [s]
            state: State of the planner at that time.
            set_force: [N] Set force at that time.
        """
        if not np.isfinite(self.began) and state is self.state and set_force >= self.force:
            self.begin(time)

    def save(self) -> float:
        """Time [s] at which the fault began or will begin; infinite if that is not known yet."""
        return self.began

    def resume(self, saved: float) -> None:
        """Continue from a result of `save` of an equal onset."""
        self.began = saved

    def elapsed(self, time: float) -> float:
        """Time [s] since the start; negative before it."""
        return time - self.began

    def active(self, time: float) -> bool:
        """Return True if the fault acts at `time` [s]."""
        return 0.0 <= self.elapsed(time) < self.duration

"""Short stops of a pressed tool on its path: while friction holds it, its joints tell how the hull moves.

A zero-velocity update [Foxlin 2005] by the tool in place of a foot. It needs a tool that does not slip at rest. The
force across it, left from sliding, is therefore let go first.
"""

import math
from dataclasses import dataclass

from controllers.tasks.phase import Context
from sim.interfaces.messages import Promise, ToolAtRest
from sim.interfaces.spatial import Array, finite_number


@dataclass(frozen=True, slots=True, kw_only=True)
class StopLimits:
    """When the tool stops on its path, and how well it then stands."""

    every: float = 3.0  # [s] of motion between two stops
    lasting: float = 0.5  # [s] that the tool stands
    settle: float = 0.3  # [s] from the end of the motion, after which it may count as standing
    hold: float = 0.15  # force across the tool, as a share of that along it, up to which friction holds it still
    patience: float = 1.5  # [s] from the end of the motion, after which a stop without that is given up
    creep: float = 1.5e-4  # [m/s] standard deviation of the speed at which it creeps all the same
    below: float = 0.98  # chance promised before contact, below which the tool stops; without a promise it does

    def __post_init__(self) -> None:
        finite_number(self.every, "stops: time of motion between two (--stop-every) [s]", least=0.5)
        finite_number(self.lasting, "stops: time that one lasts [s]", above=0.0, most=10.0)
        finite_number(self.settle, "stops: time to come to rest [s]", least=0.0, most=10.0)
        finite_number(self.hold, "stops: share of the force across", above=0.0, most=1.0)
        finite_number(self.patience, "stops: time to wait for rest [s]", least=self.settle, most=60.0)
        finite_number(self.creep, "stops: speed at which the tool creeps [m/s]", above=0.0)
        finite_number(self.below, "stops: chance below which the tool stops", above=0.0, most=1.0)

    def help(self, promise: Promise | None) -> bool:
        """True if navigation is poor enough for stops to be worth their time and their forces."""
        return promise is None or promise.chance < self.below


@dataclass(slots=True)
class Stops:
    """Stops of one stretch of a path."""

    limits: StopLimits
    moved: float = 0.0  # [s] of motion since the last stop
    still: float = 0.0  # [s] without motion since this one began
    since: float = math.inf  # [s] when the tool came to rest; inf: it has not
    said: ToolAtRest | None = None  # in this period

    @property
    def standing(self) -> bool:
        """True while the tool does not move along its path: it yields to what would push it over the surface."""
        return self.still > 0.0

    def end(self) -> None:
        """The tool is to move again, or the path is over."""
        self.moved, self.still, self.since, self.said = 0.0, 0.0, math.inf, None

    def step(self, pace: float, axis_W: Array, *, steady: bool, now: Context) -> bool:
        """Advance by one period; True while the tool is to stop.

        Args:
            pace: speed along the path, as a share of that planned.
            axis_W: (3,) unit tool axis, W.
            steady: the set force does not change.
            now: of this period.
        """
        limits = self.limits
        self.said = None
        if now.paused:  # its force is reduced, and nothing tells whether it holds
            self.end()
            return False
        if self.moved < limits.every:
            self.moved += now.period
            return False
        if pace > 0.0:
            return True
        self.still += now.period
        if not (steady and self._held(axis_W, now)):
            self.since = math.inf
        elif math.isinf(self.since):
            if self.still >= limits.settle:
                self.since = now.time
                self.said = self._message(now)
        elif now.time - self.since >= limits.lasting:
            said = self._message(now)
            self.end()
            self.said = said
            return False
        if math.isinf(self.since) and self.still > limits.patience:
            self.end()
            return False
        return True

    def _held(self, axis_W: Array, now: Context) -> bool:
        """True if the force across the tool is small enough for friction to hold it still."""
        along, across = now.contact_force(axis_W)
        return across <= self.limits.hold * along  # False where it is not known

    def _message(self, now: Context) -> ToolAtRest:
        return ToolAtRest(
            time=now.time,
            since=self.since,
            q=now.estimate.q,
            slip_sigma=self.limits.creep * max(now.time - self.since, self.limits.lasting),
        )

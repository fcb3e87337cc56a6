"""Short stops of a pressed tool on its path, in which the arm's joints measure the hull's motion.

A zero-velocity update [Foxlin 2005] by the tool in place of a foot. It needs a tool that does not
slip at rest. The force across it, left from sliding, is therefore let go first.
"""

import math
from dataclasses import dataclass

from uuv.controllers.planning.promise import StopLimits
from uuv.controllers.tasks.phase import Context
from uuv.sim.interfaces.messages import ToolAtRest
from uuv.sim.interfaces.spatial import Array


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
        """True while the tool stands on its path, and yields to a push across the surface."""
        return self.still > 0.0

    def end(self) -> None:
        """End a stop, since the tool moves again or the path is over."""
        self.moved = 0.0
        self.still = 0.0
        self.since = math.inf
        self.said = None

    def step(self, pace: float, axis_W: Array, *, steady: bool, context: Context) -> bool:
        """Advance by one period; returns True while the tool has to stop.

        Args:
            pace: speed along the path, as a share of that planned.
            axis_W: (3,) unit tool axis, W.
            steady: the set force does not change.
            context: of this period.
        """
        limits = self.limits
        self.said = None

        if context.paused:  # its force is reduced, and nothing tells whether it holds
            self.end()
            return False

        if self.moved < limits.every:
            self.moved += context.period
            return False

        # First brake, then stand
        if pace > 0.0:
            return True
        self.still += context.period

        # Count the time while friction holds the tool
        if not (steady and self._held(axis_W, context)):
            self.since = math.inf
        elif math.isinf(self.since):
            if self.still >= limits.settle:
                self.since = context.time
                self.said = self._message(context)
        elif context.time - self.since >= limits.lasting:
            message = self._message(context)
            self.end()
            self.said = message
            return False

        if math.isinf(self.since) and self.still > limits.patience:
            self.end()
            return False
        return True

    def _held(self, axis_W: Array, context: Context) -> bool:
        """True if the force across the tool is small enough for friction to hold it still."""
        along, across = context.contact_force(axis_W)
        return across <= self.limits.hold * along  # False where it is not known

    def _message(self, context: Context) -> ToolAtRest:
        return ToolAtRest(
            time=context.time,
            since=self.since,
            q=context.estimate.q,
            slip_sigma=self.limits.creep * max(context.time - self.since, self.limits.lasting),
        )

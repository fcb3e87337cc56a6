"""Time of work along a path, and whether every set force on it lasts long enough to be judged."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from uuv.controllers.planning.trajectories import SLOWEST, Progress
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.surface.force_levels import JUDGED, levels, long_enough, unsettled
from uuv.sim.evaluation.surface.tool_speed import AT_SPEED
from uuv.sim.interfaces.errors import ConfigurationError

_FARTHEST = 1e3  # [m] no longer path is proposed
_STEPS = 60  # of a bisection


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkTime:
    """Work along a path with set forces on consecutive, equally long parts of it."""

    length: float  # [m] of the path
    speed: float  # [m/s] along it
    forces: tuple[float, ...]  # [N]; none: without contact
    force_rate: float  # [N/s] at which the set force changes

    @property
    def seconds(self) -> float:
        """Time [s] from the first motion along the path to the last, if nothing slows the tool."""
        limits = FollowLimits()
        return Progress(self.length, self.speed, limits.ramp).duration + limits.linger

    def judged(self) -> tuple[float, ...]:
        """Time [s] for which the error of each level of force counts; negative: not settled."""
        limits = FollowLimits()
        force_levels = levels(self.forces)
        progress = Progress(self.length, self.speed, limits.ramp)
        passed = [
            progress.time(self.length * level.end / len(self.forces)) for level in force_levels
        ]
        passed[-1] += limits.linger

        # The first force has settled before the tool moves.
        changes = np.abs(np.diff([level.force for level in force_levels]))
        lost = [0.0, *(unsettled(change / self.force_rate) for change in changes.tolist())]
        return tuple(
            float(lasting - gone)
            for lasting, gone in zip(np.diff(passed, prepend=0.0), lost, strict=True)
        )

    def check(self) -> None:
        """Refuses work that is too short for its forces or its speed; the message states a remedy.

        Raises:
            ConfigurationError: Which force would not be judged, or that the speed is hardly
                reached.
        """
        if self._is_judged():
            return

        speed, length = self._slower(), self._longer()
        ways = [
            *([f"task.speed {speed:g}"] if speed else []),
            *([f"a path of {length:g} m"] if length else []),
            *(["fewer task.forces"] if len(self.forces) > 1 else []),
        ]

        raise ConfigurationError(
            f"task.speed {self.speed:g} over {self.length:.3g} m: {self._what_lacks()}; "
            f"{', or '.join(ways)} would suffice"
        )

    def _what_lacks(self) -> str:
        judged = self.judged() if self.forces else ()
        if not judged or long_enough(min(judged)):
            return "the tool barely reaches that speed"

        k = int(np.argmin(judged))
        return (
            f"the set force of {levels(self.forces)[k].force:g} N, {k + 1} of {len(judged)}, can "
            f"be judged for {max(judged[k], 0.0):.2f} s, at least {JUDGED:g} s are needed"
        )

    def _is_judged(self) -> bool:
        below = AT_SPEED**2 * self.speed * FollowLimits().ramp  # [m] of both ramps
        at_speed = below <= Bounds().off_speed * self.length
        return at_speed and (not self.forces or long_enough(min(self.judged())))

    def _slower(self) -> float:
        """A speed [m/s] of two digits that is slow enough; 0 if there is none."""
        slow, fast = SLOWEST, self.speed
        if not replace(self, speed=slow)._is_judged():
            return 0.0

        for _ in range(_STEPS):
            middle = 0.5 * (slow + fast)
            slow, fast = (
                (middle, fast) if replace(self, speed=middle)._is_judged() else (slow, middle)
            )
        digit = 10.0 ** (np.floor(np.log10(slow)) - 1)
        return float(np.floor(slow / digit + 1e-9) * digit)

    def _longer(self) -> float:
        """A path length [m] in whole centimetres that is long enough; 0 if there is none."""
        short, long = self.length, _FARTHEST
        if not replace(self, length=long)._is_judged():
            return 0.0

        for _ in range(_STEPS):
            middle = 0.5 * (short + long)
            short, long = (
                (short, middle) if replace(self, length=middle)._is_judged() else (middle, long)
            )
        return float(np.ceil(100.0 * long - 1e-9) / 100.0)

    def slowed(self, share: float) -> Self:
        """The same work at a share of its speed."""
        return replace(self, speed=share * self.speed)

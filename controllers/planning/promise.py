"""Promise before contact: probability that the tool stays within a tolerance of its path.

The tool's error across its axis has two parts. One is constant over the work: the error of the
object's pose. The other changes during it: the error of the hull's estimated position. The arm's
own part is an order of magnitude smaller. Both are stated as covariances, from which alone the
probability follows.
"""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Promise, StateEstimate, Target
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.spatial import Array, finite_number

WANTED = 0.98  # chance from which on there is nothing to wait for
# [s] correlation time of the error of the estimated position; measured 1.1 to 3.5 s
NAVIGATION_TIME = 2.4
_PEAKS = 2.0  # independent values in that time, as far as the largest one is concerned
MOST_THRUST = 0.95  # share of full thrust that push and steady current may take
_QUANTILES = 512  # of the normal distribution, at which the constant part is summed


@dataclass(frozen=True, slots=True, kw_only=True)
class StopLimits:
    """Stops of a pressed tool on its path (`uuv.controllers.tasks.stops`)."""

    every: float = option(
        3.0,
        "Seconds of motion [s] after which the pressed tool stops, so that its joint angles "
        "measure the hull motion for navigation; 0: it does not stop.",
        group="work",
        word="stop_every",
        closed=0.0,
    )
    lasting: float = 0.5  # [s] that the tool stands
    settle: float = 0.3  # [s] from the end of the motion, after which it may count as standing
    # force across the tool, as a share of that along it, up to which friction holds it still
    hold: float = 0.15
    # [s] from the end of the motion, after which a stop without that is given up
    patience: float = 1.5
    creep: float = 1.5e-4  # [m/s] standard deviation of the speed at which it creeps all the same
    # chance promised before contact, below which the tool stops; without a promise it does
    below: float = 0.98

    def __post_init__(self) -> None:
        finite_number(self.every, "task.promise.stops.every [s]", least=0.5)
        finite_number(self.lasting, "task.promise.stops.lasting [s]", above=0.0, most=10.0)
        finite_number(self.settle, "task.promise.stops.settle [s]", least=0.0, most=10.0)
        finite_number(self.hold, "task.promise.stops.hold, a share", above=0.0, most=1.0)
        finite_number(
            self.patience, "task.promise.stops.patience [s]", least=self.settle, most=60.0
        )
        finite_number(self.creep, "task.promise.stops.creep [m/s]", above=0.0)
        finite_number(self.below, "task.promise.stops.below, a probability", above=0.0, most=1.0)

    def help(self, promise: Promise | None) -> bool:
        """True if navigation is poor enough for stops to be worth their time and their forces."""
        return promise is None or promise.chance < self.below


@dataclass(frozen=True, slots=True, kw_only=True)
class PromiseLimits:
    """What is promised, from which chance on, and what is done for it."""

    tolerance: float = 0.003  # [m] from the path, along it and across it
    wanted: float = WANTED  # chance from which on the work begins at once; or `least`, if higher
    least: float = option(
        0.0,
        "Least probability of a path error below 3 mm; work with less is refused; 0: it is only "
        "reported.",
        group="work",
        word="least_chance",
    )
    patience: float = 15.0  # [s] of waiting for a better estimate, at most
    interval: float = 1.0  # [s] between two looks at the chance
    gain: float = 0.01  # rise of the chance in that time, from which on it is worthwhile to wait on
    # of the pressed tool on its path, for navigation; None: it does not stop
    stops: StopLimits | None = None
    # share of full thrust that push and steady current may take; beyond it: refused
    most_thrust: float = MOST_THRUST

    def __post_init__(self) -> None:
        finite_number(self.tolerance, "task.promise.tolerance [m]", above=0.0)
        finite_number(self.least, "task.promise.least, a probability", least=0.0, most=1.0)
        finite_number(self.wanted, "task.promise.wanted, a probability", least=0.0, most=1.0)
        finite_number(self.patience, "task.promise.patience [s]", least=0.0)
        finite_number(self.interval, "task.promise.interval [s]", above=0.0)
        finite_number(self.gain, "task.promise.gain", least=0.0)
        if not self.most_thrust > 0.0:
            text = f"task.promise.most_thrust: must be > 0, got {self.most_thrust}"
            raise ConfigurationError(text)


def promise(
    estimate: StateEstimate, target: Target, tolerance: float, duration: float
) -> Promise | None:
    """Chance that the tool stays within a tolerance of its path, along it and across it.

    A direction in which the object can slide or turn unseen is left out: nothing can be promised
    there.

    Args:
        estimate: State of the vehicle; its stated position error is taken to stay as it is.
        target: Identified object, with path and covariance.
        tolerance: [m] on each of the two axes.
        duration: [s] of the work.

    Returns:
        The promise; None if a covariance is not known.
    """
    of_path = target.path_sigma
    moving = float(np.sqrt(np.mean(np.square(estimate.position_sigma))))
    if of_path is None or not np.isfinite(moving):
        return None

    held = of_path[:, 1:].max(axis=0)
    held = held[np.isfinite(held)]
    looks = max(1.0, _PEAKS * duration / NAVIGATION_TIME)
    chance = float(np.prod([_chance(sigma, moving, tolerance, looks) for sigma in held]))

    return Promise(
        chance=chance,
        tolerance=tolerance,
        navigation_sigma=moving,
        object_sigma=float(held.max(initial=0.0)),
    )


def _chance(held: float, moving: float, tolerance: float, looks: float) -> float:
    """Probability that a constant error plus `looks` independent ones stay within tolerance [m].

    Args:
        held: [m] standard deviation of the constant error.
        moving: [m] of each of the others.
        tolerance: [m]
        looks: Number of the others.
    """
    from scipy.special import ndtr, ndtri

    constant: Array = held * ndtri((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
    moving = max(moving, 1e-9)
    inside = ndtr((tolerance - constant) / moving) - ndtr((-tolerance - constant) / moving)
    return float(np.mean(inside**looks))

"""Prediction ("promise") before contact: probability that the tool stays within a tolerance of its
path.

The tool's error perpendicular to its axis has two parts. The error of the object's pose is constant
during the work. The error of the hull's estimated position changes during the work. The arm's own
error is an order of magnitude smaller. Both parts are stated as covariances, which determine the
probability.
"""

from dataclasses import dataclass

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Promise, StateEstimate, Target
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.spatial import Array, finite_number

WANTED = 0.98  # probability from which on waiting does not help
# [s] correlation time of the error of the estimated position; measured: 1.1 to 3.5 s
NAVIGATION_TIME = 2.4
_PEAKS = 2.0  # number of independent values in that time, with respect to the largest one
MOST_THRUST = 0.95  # share of full thrust that set force and steady current may take
_QUANTILES = 512  # points of the normal distribution, over which the constant part is summed


@dataclass(frozen=True, slots=True, kw_only=True)
class StopLimits:
    """Limits of the stops of a pressed tool on its path (`uuv.controllers.tasks.stops`)."""

    every: float = option(
        3.0,
        "Seconds of motion [s] after which the pressed tool stops, so that its joint angles "
        "measure the hull motion for navigation; 0: it does not stop.",
        group="work",
        word="stop_every",
        closed=0.0,
    )
    lasting: float = 0.5  # [s] duration of a stop
    settle: float = 0.3  # [s] from the end of the motion, after which the tool may count as at rest
    # ratio of the force perpendicular to the tool axis to that along it, up to which friction holds
    # the tool
    hold: float = 0.15
    # [s] from the end of the motion, after which a stop is given up if that ratio is not reached
    patience: float = 1.5
    creep: float = 1.5e-4  # [m/s] standard deviation of the speed at which the tool still creeps
    # promised probability, below which the tool stops; without a promise it always stops
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
        """True if navigation is so poor that stops are worth their time and forces."""
        return promise is None or promise.chance < self.below


@dataclass(frozen=True, slots=True, kw_only=True)
class PromiseLimits:
    """Tolerance and probability of the promise, and the measures to reach it."""

    tolerance: float = 0.003  # [m] from the path, along it and perpendicular to it
    # probability from which on the work begins at once; or `least`, if that is higher
    wanted: float = WANTED
    least: float = option(
        0.0,
        "Least probability of a path error below 3 mm; work with a smaller probability is refused; "
        "0: the probability is only reported.",
        group="work",
        word="least_chance",
    )
    patience: float = 15.0  # [s] largest waiting time for a better estimate
    interval: float = 1.0  # [s] between two computations of the probability
    gain: float = 0.01  # rise of the probability in that time, from which on waiting continues
    # stops of the pressed tool on its path, for navigation; None: it does not stop
    stops: StopLimits | None = None
    # share of full thrust that set force and steady current may take; beyond it the work is refused
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
    """Probability that the tool stays within a tolerance of its path, along the path and
    perpendicular to it.

    Directions in which the object's pose is not observed are left out, since nothing can be
    promised there.

    Args:
        estimate: State of the vehicle; the stated position error is assumed to be constant.
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
    """Probability that the sum of a constant error and each of `looks` independent errors stays
    within tolerance [m].

    Args:
        held: [m] standard deviation of the constant error.
        moving: [m] standard deviation of each independent error.
        tolerance: [m] tolerance.
        looks: Number of independent errors.
    """
    from scipy.special import ndtr, ndtri

    constant: Array = held * ndtri((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
    moving = max(moving, 1e-9)
    inside = ndtr((tolerance - constant) / moving) - ndtr((-tolerance - constant) / moving)
    return float(np.mean(inside**looks))

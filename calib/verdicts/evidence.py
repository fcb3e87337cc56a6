"""Evidence of a calibration: how well an arm within manufacturing tolerances explains its
touches.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uuv.calib.identification import Calibration, MapFit
from uuv.calib.parameters import widest_prior
from uuv.calib.simulation import HAND_NOISE
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.spatial import Array

REFUSED = 100.0  # odds to 1, above which a wrong input is the better explanation
# number of steps within which the fit of a right reading converges
BRIEF = MapFit(max_iterations=20)
_MOST = 300.0 * np.log(10.0)  # logarithm of the largest odds that are printed
_SHUFFLES = 8  # number of draws of the motion

# (series, *, distances, method) -> `identify` with the same arm and options
Again = Callable[..., Calibration]


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """A possible wrong input that explains the touches better than the identified arm."""

    reason: str
    # natural logarithm of the odds, wrong input against the arm found; infinite: nothing can be
    # concluded
    log_odds: float = np.inf

    def __str__(self) -> str:
        if not np.isfinite(self.log_odds):
            return self.reason

        exponent = min(self.log_odds, _MOST) / np.log(10.0)
        odds = f"{10.0**exponent:.0f}" if exponent < 4.0 else f"1e{int(exponent)}"
        return f"{self.reason} ({odds} to 1)"

    @property
    def grave(self) -> bool:
        """True if the odds refuse a calibration."""
        return self.log_odds > np.log(REFUSED)


@dataclass(frozen=True, kw_only=True, eq=False)
class Told:
    """Information stated about the touches besides their joint values."""

    names: Sequence[str]  # names of the points
    # (series, series, length [m], deviation [m])
    distances: Sequence[tuple[int, int, float, float]] = ()
    # number of first joints that are the measured pose of a moving base, not of the arm
    base_joints: int = 0


def log_evidence(calibration: Calibration, series: Sequence[Array]) -> float:
    """Log evidence of all touches, for an arm within manufacturing tolerances and noise of at least
    an operator's.
    """
    square = np.concatenate(calibration.residuals) ** 2
    return freedom(series) * float(
        log_likely(square, motion_of(calibration.arm, calibration.tcp, series)).sum()
    ) + log_made(calibration)


def log_likely(square: Array, motion: float) -> Array:
    """Logarithm of the likelihood of touches at squared distances `square` [m^2] from their point.

    Args:
        square: array of any shape.
        motion: [m] as returned by `motion_of`.
    """
    return -2.0 * np.log((square + 3.0 * HAND_NOISE**2) / max(motion, 1e-12) ** 2)


def freedom(series: Sequence[Array]) -> float:
    """Share of the degrees of freedom that remains after one point per series is estimated."""
    return 1.0 - len(series) / sum(map(len, series))


def log_made(calibration: Calibration) -> float:
    """Log likelihood that the identified arm was manufactured with its deviations."""
    away = calibration.estimate.changes / as_made(calibration)

    bounded = np.isfinite(widest_prior(calibration.estimate.parameters, calibration.nominal.reach))
    return -0.5 * float((away[bounded] ** 2).sum())


def as_made(calibration: Calibration) -> Array:
    """Manufacturing deviations (P,), or the stated ones if they are larger."""
    bounds = widest_prior(calibration.estimate.parameters, calibration.nominal.reach)
    return np.where(
        np.isfinite(bounds),
        np.maximum(bounds, calibration.estimate.prior),
        calibration.estimate.prior,
    )


def motion_of(arm: SerialArm, tcp: Array, series: Sequence[Array]) -> float:
    """RMS distance [m] along each axis of the tips from their mean, with joint values in random
    order.

    The scatter of the touches of a point is compared with this distance: if the arm shrinks, or a
    unit makes the joint values small, both shrink by the same factor.
    """
    rng = np.random.default_rng(0)
    square = 0.0
    count = 0

    for q in series:
        for _ in range(_SHUFFLES if len(q) > 1 else 0):
            p = arm.tips(np.ascontiguousarray(rng.permuted(q, axis=0)), tcp)
            square += float(((p - p.mean(axis=0)) ** 2).sum())
            count += 3 * len(q)

    return float(np.sqrt(square / max(count, 1)))

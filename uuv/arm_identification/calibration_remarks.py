"""Remarks beside the verdict on a calibration: what its touches leave open, and what that costs."""

from collections.abc import Iterator

import numpy as np

from uuv.arm_identification.calibration_case import CalibrationCase
from uuv.arm_identification.calibration_outcome import CalibrationOutcome
from uuv.calib.identification import Calibration
from uuv.components.deck_calibration import LENGTH_ERROR

_TOUCHES = 20  # touches of each of two points between which a distance is known
# ratio of the RMS distances of held-out and fitted touches, from which on it is explained
_FARTHER = 2.0


def remarks(case: CalibrationCase, outcome: CalibrationOutcome) -> list[str]:
    """Sentences on what the touches of a calibration leave open; none refuses it."""
    return [*_scale(case, outcome.calibration), *_held_out(outcome)]


def _scale(case: CalibrationCase, calibration: Calibration) -> Iterator[str]:
    """Error of the arm's size without a known distance, and what a known distance leaves of it."""
    half = dict(zip(calibration.names, calibration.quantile() * calibration.sigma, strict=True))
    values = dict(zip(calibration.names, calibration.estimate.values, strict=True))

    # Each length has the error of the common factor, and more: the least one is that of the factor.
    lengths = [name for name in calibration.rank.scaled if abs(values.get(name, 0.0)) > 0.0]
    lengths = [name for name in lengths if not name.startswith("tcp")]
    if not lengths:
        return

    share = min(half[name] / abs(values[name]) for name in lengths)
    reach = case.source.arm.reach

    # A distance of two points: of those farthest apart, or to a second one.
    points = calibration.points
    between = float(np.linalg.norm(points[:, None] - points[None], axis=2).max())
    length = f"the distance of the farthest two, {between:.2g} m,"
    if len(points) == 1:
        between = 0.5 * reach
        length = f"the distance to a second point {between:.2g} m away"

    seat = np.sqrt(2.0 / _TOUCHES) * calibration.noise
    left = calibration.quantile() * float(np.hypot(LENGTH_ERROR, seat)) / max(between, 1e-9)
    count = "one point" if len(points) == 1 else f"{len(points)} points"

    yield (
        f"the size of the arm, from {count} without a known distance: its lengths may be wrong by "
        f"one factor, up to {100.0 * share:.2g} % (95 %, by manufacturing tolerances), at the tip "
        f"{1e3 * share * reach:.2g} mm over the reach of {reach:.2g} m; {length} known within "
        f"{1e3 * LENGTH_ERROR:.2g} mm would leave {1e3 * min(left, share) * reach:.2g} mm"
    )


def _held_out(outcome: CalibrationOutcome) -> Iterator[str]:
    """Held-out touches that scatter more than the fitted ones, and what the fit predicts."""
    calibration = outcome.calibration
    used = np.concatenate(calibration.weights) > 0.0
    fitted = float(np.sqrt(np.mean(np.concatenate(calibration.residuals)[used] ** 2)))

    for name, (rms, bound) in outcome.foretold.items():
        measured = outcome.held_out[name][1]
        about = (
            f"held-out {name}: {1e3 * measured:.3g} mm RMS against {1e3 * fitted:.3g} of the "
            f"fitted touches; the fit predicts {1e3 * rms:.3g}, at most {1e3 * bound:.3g} mm "
            "(95 %): "
        )

        if measured > bound:
            yield (
                f"{about}the arm has errors that its parameters do not express, or these touches "
                "are less accurate"
            )
        elif measured > _FARTHER * fitted:
            yield f"{about}the arm is determined no better in such postures; fit some of them too"

"""The simulated arm of the calibration experiments: a UR10e, touched as in [Yukhimets 2023]."""

from pathlib import Path

import numpy as np

from uuv.arm_identification.calibration_case import CalibrationCase, TrueArm, nominal
from uuv.arm_identification.simulated_touches import RealEffects, simulated
from uuv.calib import Calibration
from uuv.calib.simulation import HAND_NOISE
from uuv.models.arms.serial_arm import SerialArm

ARM, POINTS, TOUCHES = "ur10e", 3, 21  # as in [Yukhimets 2023]
FLANGE_POINTS = 40  # at which arms are compared


def nominal_arm() -> SerialArm:
    """The arm of the manufacturer's table."""
    return nominal(ARM, Path(), None, None).arm


def touched_arm(
    seed: int, real: RealEffects | None = None, pin: str = "off-axis"
) -> tuple[CalibrationCase, TrueArm]:
    """An arm with errors of manufacture, touched by hand: what was touched, and the truth.

    Args:
        seed: Of its errors and touches.
        real: What real arms have beside errors of their table; default: nothing.
        pin: Of TOOLS in `uuv.arm_identification.simulated_touches`.
    """
    case = simulated(
        nominal(ARM, Path(), None, None),
        points=POINTS,
        touches=TOUCHES,
        noise=HAND_NOISE,
        pin=pin,
        known=False,
        errors=seed,
        rng=np.random.default_rng(seed),
        real=real or RealEffects(),
    )

    assert case.truth is not None  # it is simulated
    return case, case.truth


def reduced_touches(calibration: Calibration) -> int:
    """Number of touches whose weight the robust fit reduced."""
    return sum(int((weights < 1.0).sum()) for weights in calibration.weights)

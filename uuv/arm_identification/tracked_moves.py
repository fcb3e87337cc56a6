"""Simulated tracker test of calibrated arms [Yukhimets 2023]: flange points of equal attitude."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from uuv.arm_identification.calibration_case import CalibrationCase
from uuv.calib import verification
from uuv.calib.identification import Calibration
from uuv.calib.simulation import reach, wrong_arm
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.spatial import Array

# Errors that remain after a manufacturer's own calibration, of the order of the 0.256 mm measured
# in [Yukhimets 2023] for its UR10e.
MAKERS = {
    "theta": np.deg2rad(0.02),
    "d": 2e-4,
    "a": 2e-4,
    "alpha": np.deg2rad(0.02),
    "beta": np.deg2rad(0.02),
}


def tracked(
    case: CalibrationCase, identified: SerialArm, calibration: Calibration, rng: np.random.Generator
) -> dict[str, verification.Cloud]:
    """Tracker test of each arm model [Yukhimets 2023]: 13 flange points of equal attitude.

    There is no payload. The tracker measures the true arm with its gear errors and sag. The models
    get the joint values that the arm's encoders read.
    """
    truth = case.truth
    assert truth is not None
    q = moves(case.source.arm, truth.arm.limits, truth.hangs, case.touches.series, rng)
    measured = verification.track(truth.arm, truth.stands_at(q), rng)
    none = np.zeros(3)

    bent = q if calibration.loads is None else calibration.deflected(q)
    clouds = {"nominal": case.source.arm.tips(q, none), "identified": identified.tips(bent, none)}
    if not truth.hangs:  # a commercial robot has the manufacturer's own table, with errors
        clouds["controller"] = wrong_arm(truth.arm, MAKERS, rng).tips(q, none)
    return verification.compare(measured, clouds)


def moves(
    arm: SerialArm,
    limits: Array,
    hangs: bool,
    touched: Sequence[Array],
    rng: np.random.Generator,
    count: int = 13,
    tries: int = 60,
) -> Array:
    """Joint values (count, n) for flange points of equal attitude in a box.

    The box is that of [Yukhimets 2023] with the flange down. If the arm does not reach it, the box
    is centred on a touched pose, with the attitude of that pose.

    Args:
        arm: Nominal arm.
        limits: (n, 2) [rad] or [m].
        hangs: Whether z of the arm's base points down; the box is then always centred on a touched
            pose.
        touched: Joint values (m_i, n) of touches.
        rng: Draws box and points.
        count: Number of points.
        tries: Draws for each box.

    Raises:
        ReachError: No box is found.
    """
    limits = np.clip(limits, -np.pi, np.pi)
    if not hangs:
        with suppress(ReachError):
            return verification.flange_poses(arm, rng, count, limits=limits)

    best: list[Array] = []
    for home in rng.permutation(np.vstack(touched))[:20]:
        X = arm.flange(home[None])[0]
        chosen = [home]
        R = np.ascontiguousarray(X[:3, :3])

        for _ in range(tries):
            q = home.copy()
            goal = X[:3, 3] + 0.15 * arm.reach * rng.uniform(-1.0, 1.0, 3)
            reached = reach(arm, np.zeros(3), goal, R, q)
            if (
                reached
                and np.all((q >= limits[:, 0]) & (q <= limits[:, 1]))
                and np.abs(q - home).max() < 0.5 * np.pi
            ):
                chosen.append(q)

        if len(chosen) >= count:
            return np.array(chosen[:count])
        best = max(best, chosen, key=len)

    if len(best) < 4:
        raise ReachError("tracker test: no box of flange points is within reach and joint limits")
    return np.array(best)

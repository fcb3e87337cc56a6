"""Arm calibration on deck before the dive: from simulated touches, or from a file."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from uuv.calib import Calibration, identify, simulation
from uuv.calib.arm_files import read_arm
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.spatial import Array

POINTS, TOUCHES = 4, 21  # number of points, and of touches of each
HAND = 1e-4  # [m] standard deviation of a touch along each axis
LENGTH_ERROR = 5e-5  # [m] standard deviation of the one known distance
CONE = np.deg2rad(60.0)  # [rad] half angle of the cone of the tool's directions about the vertical
PLACES_TRIED = 2000  # number of random postures tried before ReachError
OWN_TOOL = 0.03  # [m] distance from the nominal tip within which a tool counts as the vehicle's own
DOWN = (0.0, 0.0, 1.0)  # direction in the arm's base, whose z axis points away from the hull


def farthest(points: Array) -> tuple[int, int]:
    """Indices of the two of `points` (k, 3) that are farthest apart."""
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
    return int(min(i, j)), int(max(i, j))


def touched(
    arm: SerialArm,
    tcp: Array,
    limits: Array,
    rng: np.random.Generator,
    *,
    points: int = POINTS,
    touches: int = TOUCHES,
    noise: float = HAND,
    way: ArrayLike = DOWN,
) -> tuple[list[Array], Array]:
    """Simulate touches by the true arm.

    Points are drawn well apart, within reach of the arm with its flange close to the direction
    `way`.

    Args:
        arm: True kinematics.
        tcp: (3,) [m] true tool point in the flange.
        limits: (n, 2) [rad] or [m] joint limits.
        rng: Draws points, postures and noise.
        points: Number of points.
        touches: Touches of each point.
        noise: [m] standard deviation along each axis.
        way: (3,) direction of the tool in the arm's base.

    Returns:
        Joint values (m, n) [rad], one array for each point, and true points (k, 3) [m] in the arm's
        base.

    Raises:
        ReachError: Too few points are reached from enough directions.
    """
    bounds = np.clip(limits, -np.pi, np.pi)
    postures = simulation.Postures(approach=way, cone=CONE, limits=bounds)
    apart = 0.25 * (arm.reach + float(np.linalg.norm(tcp)))

    series: list[Array] = []
    places: list[Array] = []
    for _ in range(PLACES_TRIED):
        # A point well apart from the others, with the tool along `way`.
        q = rng.uniform(bounds[:, 0], bounds[:, 1])
        p = arm.tips(q[None], tcp)[0]
        if any(float(np.linalg.norm(p - other)) < apart for other in places):
            continue
        if arm.flange(q[None])[0, :3, 2] @ np.asarray(way) < np.cos(CONE):
            continue

        # Each touch has its own flange direction. A point reached in a posture far from the limits
        # allows many directions.
        try:
            series += simulation.touch(
                arm, tcp, rng, points=p[None], touches=touches, noise=noise, postures=postures
            )
        except ReachError:
            continue

        places.append(p)
        if len(places) == points:
            return series, np.array(places)

    raise ReachError(
        f"deck calibration: the arm must reach {points} positions from {touches} directions each, "
        f"it reaches {len(places)}"
    )


def calibrate_on_deck(
    believed: SerialArm, built: SerialArm, rng: np.random.Generator
) -> tuple[SerialArm, str]:
    """Calibrate the believed arm from simulated touches of the true one.

    Args:
        believed: Nominal arm.
        built: True arm.
        rng: Draws the touches and the error of the known distance.

    Returns:
        Identified arm with its tip as flange, and summary line for the terminal.
    """
    series, places = touched(built, np.zeros(3), built.limits, rng)
    i, j = farthest(places)
    length = float(np.linalg.norm(places[i] - places[j])) + LENGTH_ERROR * rng.standard_normal()
    calibration = identify(series, believed, distances=[(i, j, length, LENGTH_ERROR)])
    return calibration.arm.with_tip(calibration.tcp), summary_line(calibration, length)


def summary_line(calibration: Calibration, length: float) -> str:
    """Summary line of a calibration for the terminal; `length` [m] is the known distance."""
    touches = sum(len(residuals) for residuals in calibration.residuals)
    before, after = (
        1e3 * np.sqrt(cost / max(_pairs(calibration), 1))
        for cost in (calibration.cost_nominal, calibration.cost)
    )
    return (
        f"arm calibrated on deck: {touches} touches of {len(calibration.residuals)} points and one "
        f"length of {length:.2f} m; scatter of the touches {before:.2f} mm before, {after:.2f} "
        f"after; {calibration.rank.rank} of {calibration.rank.total} directions observable"
    )


def _pairs(calibration: Calibration) -> int:
    return sum(len(residuals) * (len(residuals) - 1) // 2 for residuals in calibration.residuals)


def from_file(file: Path, believed: SerialArm) -> tuple[SerialArm, str]:
    """Arm from a file that `uuv calibrate` wrote, for a vehicle whose arm is `believed`.

    Returns:
        Arm with its tip as flange, and summary line for the terminal.

    Raises:
        ConfigurationError: The file has other joints, or was calibrated with another tool.
    """
    source = read_arm(file)
    names = source.arm.joint_names
    if names != believed.joint_names:
        raise ConfigurationError(
            f"belief.arm {file}: must have the joints of the vehicle, "
            f"{', '.join(believed.joint_names)}, got {', '.join(names)}"
        )

    aside = float(np.linalg.norm(source.tcp))
    if aside > OWN_TOOL:
        raise ConfigurationError(
            f"belief.arm {file}: must be calibrated with the vehicle's tool, within "
            f"{1e3 * OWN_TOOL:.0f} mm of its tip; the tip in the file is {1e3 * aside:.0f} mm away"
        )
    return source.arm.with_tip(source.tcp), f"arm of {file}"

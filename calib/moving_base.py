"""Calibration of an arm on a moving base, whose measured pose becomes six joints ahead of the
arm's.

Touches made from a hovering vehicle are then touches of a longer arm that begins with three slides
and three hinges. The "encoders" of these six joints are the vehicle's navigation. Only the
parameters of the arm itself are estimated.
"""

from dataclasses import replace

import numpy as np

from uuv.calib.identification import Calibration
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, inverse, readonly

BASE_JOINTS = 6  # slides along x, y, z, then hinges about z, y, x
_LETTERS = "abcdefghijklmnopqrstuvwxyz"
_NAMES = ("theta", "d", "a", "alpha")


def on_moving_base(arm: SerialArm, X_BA: Array) -> SerialArm:
    """Extend `arm` by six base joints: slides along x, y, z and hinges about z, y, x of B.

    Args:
        arm: the arm alone.
        X_BA: (4, 4) pose of the arm's base in body B.

    Returns:
        The longer arm, with 6 + n joints.
    """
    axes, points, X_A_flange = arm.axes()
    R, p = X_BA[:3, :3], X_BA[:3, 3]
    unit = np.eye(3)

    longer = SerialArm.from_axes(
        np.vstack([unit, unit[::-1], axes @ R.T]),
        np.vstack([np.zeros((BASE_JOINTS, 3)), points @ R.T + p]),
        X_BA @ X_A_flange,
        "ppprrr" + arm.joint_types,
    )

    return replace(
        longer,
        limits=readonly(np.vstack([longer.limits[:BASE_JOINTS], arm.limits])),
        joint_names=(
            "base x",
            "base y",
            "base z",
            "base yaw",
            "base pitch",
            "base roll",
            *arm.joint_names,
        ),
    )


def with_base(series: Array, X_WB: Array) -> Array:
    """Joint values (m, 6 + n) of the longer arm from the arm's own and the base poses.

    Args:
        series: (m, n) joint values of the arm.
        X_WB: (m, 4, 4) base pose of each touch.

    Returns:
        Joint values with x, y, z [m] and yaw, pitch, roll [rad] first.

    Raises:
        ConfigurationError: the numbers of joint values and of base poses differ.
    """
    if len(series) != len(X_WB):
        raise ConfigurationError(
            f"touches: must have as many base poses as joint values, got {len(series)} joint "
            f"values and {len(X_WB)} base poses"
        )

    R = X_WB[:, :3, :3]
    pitch = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0]))
    yaw, roll = np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.arctan2(R[:, 2, 1], R[:, 2, 2])

    return np.column_stack([X_WB[:, :3, 3], yaw, pitch, roll, series])


def own_parameters(longer: SerialArm) -> list[str]:
    """Names, in the longer arm, of the free parameters: those of the arm itself and of the tool
    point.
    """
    first = BASE_JOINTS + 1
    names = [f"{name}{k}" for k in range(first, longer.n + 1) for name in _NAMES]
    return [*names, *(f"beta{k + 1}" for k in longer.near_parallel if k >= BASE_JOINTS), "tcp"]


def in_own_names(calibration: Calibration, alike: Calibration) -> Calibration:
    """The calibration of the longer arm, with the parameter names of the arm itself and the ranks
    of `alike`.

    `alike` is a calibration of the arm alone in the same poses. The base's small motion does not
    change which directions touching observes.
    """
    names = tuple(
        name
        if name.startswith("tcp")
        else f"{name.rstrip('0123456789')}{int(name.lstrip(_LETTERS)) - BASE_JOINTS}"
        for name in calibration.names
    )

    parameters = replace(calibration.estimate.parameters, names=names)
    return replace(
        calibration, estimate=replace(calibration.estimate, parameters=parameters), rank=alike.rank
    )


def own_arm(longer: SerialArm, X_BA: Array) -> SerialArm:
    """Extract the arm itself, from its base on, from an identified longer arm.

    Args:
        longer: identified arm with six base joints.
        X_BA: (4, 4) pose of the arm's base in body B.

    Returns:
        The arm without the base joints.
    """
    at_zero = np.zeros((1, BASE_JOINTS))
    head = SerialArm(
        table=readonly(longer.table[:BASE_JOINTS]),
        joint_types=longer.joint_types[:BASE_JOINTS],
        X_base_0=longer.X_base_0,
    )

    X_B0 = head.flange(at_zero)[0]

    return replace(
        longer,
        table=readonly(longer.table[BASE_JOINTS:]),
        joint_types=longer.joint_types[BASE_JOINTS:],
        X_base_0=readonly(inverse(X_BA) @ X_B0),
        limits=readonly(longer.limits[BASE_JOINTS:]),
        joint_names=longer.joint_names[BASE_JOINTS:],
    )

"""An arm on a base that moves: the base's measured pose becomes six joints before the arm's own.

Touches made from a hovering vehicle are then touches of a longer arm, three slides and three hinges first, whose
"encoders" are the vehicle's navigation; only the arm's own numbers are left free.
"""

from dataclasses import replace

import numpy as np

from calib.arm import Arm
from calib.identification import Calibration
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, inverse, readonly

BASE_JOINTS = 6
_LETTERS = "abcdefghijklmnopqrstuvwxyz"
_NAMES = ("theta", "d", "a", "alpha")


def on_moving_base(arm: Arm, X_BA: Array) -> Arm:
    """`arm`, whose base stands at `X_BA` (4, 4) in body B, behind slides along x, y, z and turns about z, y, x of B."""
    axes, points, X_A_flange = arm.axes()
    R, p = X_BA[:3, :3], X_BA[:3, 3]
    unit = np.eye(3)
    return Arm.from_axes(
        np.vstack([unit, unit[::-1], axes @ R.T]),
        np.vstack([np.zeros((BASE_JOINTS, 3)), points @ R.T + p]),
        X_BA @ X_A_flange,
        "ppprrr" + arm.joint_types,
    )


def with_base(series: Array, X_WB: Array) -> Array:
    """Joint values (m, 6 + n) of the longer arm, for the arm's own (m, n) and base poses `X_WB` (m, 4, 4)."""
    if len(series) != len(X_WB):
        raise ConfigurationError(f"touches: {len(series)} joint values and {len(X_WB)} base poses")
    R = X_WB[:, :3, :3]
    pitch = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0]))
    yaw, roll = np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.arctan2(R[:, 2, 1], R[:, 2, 2])
    return np.column_stack([X_WB[:, :3, 3], yaw, pitch, roll, series])


def own_parameters(longer: Arm) -> list[str]:
    """Names of the arm's own parameters in the longer arm, and the tool point's: what is to be left free."""
    first = BASE_JOINTS + 1
    names = [f"{name}{k}" for k in range(first, longer.n + 1) for name in _NAMES]
    return [*names, *(f"beta{k + 1}" for k in longer.near_parallel if k >= BASE_JOINTS), "tcp"]


def in_own_names(found: Calibration, alike: Calibration) -> Calibration:
    """`found` of the longer arm with its parameters called as the arm's own are; the rank report is that of `alike`.

    `alike` is of the arm alone and the same poses: what touching sees does not change with the base's small motion.
    """
    names = tuple(
        name if name.startswith("tcp") else f"{name.rstrip('0123456789')}{int(name.lstrip(_LETTERS)) - BASE_JOINTS}"
        for name in found.parameters.names
    )
    return replace(found, parameters=replace(found.parameters, names=names), rank=alike.rank)


def own_arm(longer: Arm, X_BA: Array) -> Arm:
    """The arm alone, from its base, out of a longer one as identified."""
    at_zero = np.zeros((1, BASE_JOINTS))
    head = replace(longer, table=readonly(longer.table[:BASE_JOINTS]), joint_types=longer.joint_types[:BASE_JOINTS])
    X_B0 = replace(head, X_n_flange=readonly(np.eye(4))).flange(at_zero)[0]
    return replace(
        longer,
        table=readonly(longer.table[BASE_JOINTS:]),
        joint_types=longer.joint_types[BASE_JOINTS:],
        X_base_0=readonly(inverse(X_BA) @ X_B0),
    )

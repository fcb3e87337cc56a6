"""Box around a hull, including links that are fixed to the hull, as a URDF has them."""

import mujoco
import numpy as np

from uuv.models.vehicle import body_in_body
from uuv.sim.interfaces.spatial import Array, pose


def hull_box(model: mujoco.MjModel, hull: int, arm_base: int = -1) -> Array:
    """Corners (2, 3) [m] in B of the box around the hull and all links fixed to it, except the arm.

    Args:
        model: Compiled model.
        hull: Index of the hull's body.
        arm_base: Index of the body that carries the arm; -1 or the hull's index if there is no such
            body.

    Returns:
        The corners; for a hull without any shape both are its origin.
    """
    corners = []
    for g in range(model.ngeom):
        body = int(model.geom_bodyid[g])
        if model.body_weldid[body] != hull or (
            arm_base != hull and _carries(model, arm_base, body)
        ):
            continue

        R = np.empty(9)
        mujoco.mju_quat2Mat(R, model.geom_quat[g])
        X_BG = body_in_body(model, body, hull) @ pose(R.reshape(3, 3), model.geom_pos[g])
        box = model.geom_aabb[g]
        centre = X_BG[:3, 3] + X_BG[:3, :3] @ box[:3]
        reach = np.abs(X_BG[:3, :3]) @ box[3:]
        corners += [centre - reach, centre + reach]

    return (
        np.array([np.min(corners, axis=0), np.max(corners, axis=0)])
        if corners
        else np.zeros((2, 3))
    )


def _carries(model: mujoco.MjModel, carrier: int, body: int) -> bool:
    """True if `carrier` is the body itself or one of its ancestors, and not the world."""
    while body > 0 and body != carrier:
        body = int(model.body_parentid[body])
    return body > 0

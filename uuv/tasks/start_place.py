"""Where a run begins: whether the vehicle there lies in something already."""

import mujoco
import numpy as np

from uuv.models.naming import of_geom
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation

_DEEP = 0.005  # [m] in something; contact of less is left to the physics


def folded_at(model: mujoco.MjModel, vehicle: Vehicle, X_WB: Array) -> mujoco.MjData:
    """State of a model, kinematics computed, with the hull at X_WB (4, 4) and the arm at home."""
    data = mujoco.MjData(model)
    data.qpos[vehicle.hull_qpos : vehicle.hull_qpos + 3] = X_WB[:3, 3]
    data.qpos[vehicle.hull_qpos + 3 : vehicle.hull_qpos + 7] = quat_wxyz_from_rotation(X_WB[:3, :3])
    data.qpos[vehicle.qpos] = vehicle.q_home
    mujoco.mj_kinematics(model, data)
    return data


def check_start(model: mujoco.MjModel, vehicle: Vehicle, X_WB: Array) -> None:
    """Refuse a start at which the vehicle, its arm at home, lies in something else.

    Args:
        model: Of the scene, with the vehicle.
        vehicle: The vehicle in it.
        X_WB: (4, 4) pose of the hull at the start.

    Raises:
        ConfigurationError: It does; the message says which parts, and how deep.
    """
    data = folded_at(model, vehicle, X_WB)
    mujoco.mj_collision(model, data)

    # The deepest contact of the vehicle with anything else.
    root = np.asarray(model.body_rootid)[np.asarray(model.geom_bodyid)]
    ours = root == model.body_rootid[vehicle.hull]
    deepest = min(
        (contact for contact in data.contact if ours[contact.geom[0]] != ours[contact.geom[1]]),
        key=lambda contact: contact.dist,
        default=None,
    )
    if deepest is None or deepest.dist > -_DEEP:
        return

    part, other = sorted(deepest.geom.tolist(), key=lambda geom: not ours[geom])
    inside = f"{-deepest.dist:.2f} m deep in {of_geom(model, other)} with {of_geom(model, part)}"
    raise ConfigurationError(
        f"the vehicle would start {inside}; its start follows from position and tilt of the "
        "camera and from task.range"
    )

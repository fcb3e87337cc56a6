"""Names of the parts of a vehicle that a log can move: its thrusters and its joints."""

import mujoco

from uuv.models.vehicle import Vehicle


def pushed_parts(model: mujoco.MjModel, vehicle: Vehicle) -> dict[int, str]:
    """Name of each actuator at a site of the vehicle, by its index, without "thruster_"."""
    named = {
        int(a): str(name)
        for a, name in zip(vehicle.thruster_actuators, vehicle.thruster_names, strict=True)
    }

    return {
        i: named.get(i, str(model.actuator(i).name).removeprefix("thruster_"))
        for i in range(model.nu)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_SITE
        and model.body_rootid[model.site_bodyid[model.actuator_trnid[i, 0]]]
        == model.body_rootid[vehicle.hull]
    }


def ranges_of(vehicle: Vehicle) -> dict[str, tuple[float, float]]:
    """Range [rad] of each joint by name."""
    limits = zip(vehicle.joint_names, vehicle.q_limits.tolist(), strict=True)
    return {name: (float(low), float(high)) for name, (low, high) in limits}

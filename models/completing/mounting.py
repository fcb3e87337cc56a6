"""Mounting of an arm from a URDF on the hull of another model."""

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.completing.actuators import add_motors, bound, joints_between
from uuv.models.files import urdf
from uuv.models.files.urdf_places import rotation_from_rpy
from uuv.models.files.urdf_vehicle import spec_of_urdf
from uuv.models.naming import ARM_BASE_BODY, HOME_KEY, HULL_BODY, READY_KEY, TIP_SITE
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    quat_wxyz_from_rotation,
    rotation_from_z,
    shown,
)

_PREFIX = "arm_"


def mount_arm(
    spec: mujoco.MjSpec,
    file: str | Path,
    *,
    p: ArrayLike,
    rpy: ArrayLike = (0.0, 0.0, 0.0),
    tip: str,
    tip_p: ArrayLike = (0.0, 0.0, 0.0),
    tip_z: ArrayLike = (0.0, 0.0, 1.0),
) -> list[str]:
    """Mount the arm of a URDF on the hull of `spec`, in place; the root of the URDF becomes body
    `arm_base`.

    Names of the other links and of the joints get the prefix `arm_`. The arm has no hydrodynamic
    coefficients: attach them to its links, then trim the hull. Keyframes `home` and `ready` of the
    hull without the arm are dropped.

    Args:
        spec: vehicle without an arm.
        file: URDF; its joints have limits and efforts.
        p: (3,) [m] position of its root link on the hull.
        rpy: (3,) [rad] roll, pitch, yaw of that link.
        tip: link that carries the tip.
        tip_p: (3,) [m] position of the tip in that link.
        tip_z: (3,) direction out of the tool in that link.

    Returns:
        Names of the arm's bodies, base first.

    Raises:
        ConfigurationError: `spec` has an arm already or has no hull, the file is no URDF, or a link
            or effort is missing.
    """
    bodies = {body.name: body for body in spec.bodies}
    if HULL_BODY not in bodies or ARM_BASE_BODY in bodies:
        raise ConfigurationError(
            f"mount_arm: the vehicle must have a body {HULL_BODY!r} and no body {ARM_BASE_BODY!r}"
        )
    name = f"arm {shown(str(file))}"
    arm, _ = spec_of_urdf(urdf.parse(file, name), Path(file).resolve().parent)
    root = arm.worldbody.bodies[0].name
    links = {body.name: body for body in arm.bodies if body.name != "world"}
    if tip not in links:
        raise ConfigurationError(
            f"{name}: tip: must be one of the links {', '.join(links)}, got {shown(tip)}"
        )

    tip_quat = _quat_along(checked(tip_z, (3,), "tip_z"))
    links[root].name = ARM_BASE_BODY.removeprefix(_PREFIX)
    quat = quat_wxyz_from_rotation(rotation_from_rpy(checked(rpy, (3,), "rpy")))

    # Keyframes of the hull without the arm lack the arm's joints.
    for key in [key for key in spec.keys if key.name in (HOME_KEY, READY_KEY)]:
        spec.delete(key)

    mount = bodies[HULL_BODY].add_frame(pos=checked(p, (3,), "p"), quat=quat)
    mount.attach_body(links[root], _PREFIX, "")
    names = {link: ARM_BASE_BODY if link == root else _PREFIX + link for link in links}
    spec.body(names[tip]).add_site(
        name=TIP_SITE, pos=checked(tip_p, (3,), "tip_p"), quat=tip_quat, group=4
    )
    joints = joints_between(spec)
    add_motors(spec, joints, name)
    bound(spec, joints, name)
    return list(names.values())


def _quat_along(z: Array) -> Array:
    """Quaternion wxyz of a frame whose z axis is along `z` (3,)."""
    return quat_wxyz_from_rotation(rotation_from_z(z, np.eye(3)[int(np.argmin(np.abs(z)))]))

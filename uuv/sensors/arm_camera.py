"""Camera on the arm: how a scenario asks for it, its simulated sensor, and the mount that
navigation believes in.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array
from uuv.sim.sensors.view_conditions import ViewConditions

if TYPE_CHECKING:
    import mujoco

    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.navigation.surface_track import TrackMount


@dataclass(frozen=True, kw_only=True)
class ArmCameraSetup(ViewConditions):
    """A stereo camera on the arm's last link, beside the tool, and what it sees."""

    # render and align every picture (slow); False: the error model fitted to such pictures
    rendered: bool = False


def arm_camera(setup: ArmCameraSetup, model: "mujoco.MjModel") -> Sensor:
    """The simulated sensor; it tracks the object of the site, which may move, or else the world."""
    import mujoco

    surface = (
        TARGET_BODY
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, TARGET_BODY) >= 0
        else "world"
    )
    if setup.rendered:
        from uuv.sensors.rendered_arm_camera import RenderedArmCamera  # kernels compile on import

        return RenderedArmCamera(model, TIP_SITE, surface, conditions=setup)
    from uuv.sim.sensors.arm_camera import ArmCamera

    return ArmCamera(model, TIP_SITE, surface, conditions=setup)


def believed_mount(believed: "OwnVehicle", X_GC: Array | None = None) -> "TrackMount":
    """Where the vehicle believes a camera at `X_GC` (4, 4) in tool axes to be; None: the tip of its
    tool.
    """
    from uuv.models.arms import dh_geometry
    from uuv.perception.navigation.surface_track import TrackMount

    arm = dh_geometry.read(believed.model, ARM_BASE_BODY, TIP_SITE, exclude=believed.passive_joints)
    return TrackMount(arm=arm, X_BA=believed.vehicle.X_BA, X_GC=np.eye(4) if X_GC is None else X_GC)

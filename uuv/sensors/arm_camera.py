"""Camera on the arm: its keys in a scenario, its simulated sensor, and the mount in the model of
navigation.
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
    """A stereo camera on the arm's last link next to the tool, and its view conditions."""

    # True: render and align every image (slow). False: the error model fitted to such images
    rendered: bool = False


def arm_camera(setup: ArmCameraSetup, model: "mujoco.MjModel") -> Sensor:
    """The simulated sensor, which tracks the site's object, which may move, or without one the
    world.
    """
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
    """Believed mount of a camera at `X_GC` (4, 4) in tool axes; None: the tip of the tool."""
    from uuv.models.arms import dh_geometry
    from uuv.perception.navigation.surface_track import TrackMount

    arm = dh_geometry.read(believed.model, ARM_BASE_BODY, TIP_SITE, exclude=believed.passive_joints)
    return TrackMount(arm=arm, X_BA=believed.vehicle.X_BA, X_GC=np.eye(4) if X_GC is None else X_GC)

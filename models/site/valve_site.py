"""Site of a valve whose handle turns on a hinge with stiction, viscous friction and stops."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uuv.models.naming import HANDLE
from uuv.models.site.scenes import seabed_height
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.models.site.turned_valve import QUARTER, TurnedValve
from uuv.sim.interfaces.spatial import Array, finite_number, quat_wxyz_from_rotation

if TYPE_CHECKING:
    import mujoco

STEEL = 7850.0  # [kg/m^3]
STRIBECK = 0.02  # [rad/s] speed over which stiction passes into sliding friction
SLIDING = 0.8  # sliding friction as a share of stiction
SEIZED = 1e3  # [N m] stiction of a valve that does not turn
_STOP = 0.004  # [s] time constant of the stops


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeFriction:
    """Resistance of the valve to the handle."""

    stiction: float  # [N m] moment at which it breaks away
    viscous: float  # [N m s/rad]

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        finite_number(self.stiction, "valve: torque [N m]", above=0.0, most=SEIZED)
        finite_number(self.viscous, "valve: viscous [N m s/rad]", least=0.0, most=SEIZED)


def add_valve(
    spec: "mujoco.MjSpec", valve: TurnedValve, X_WT: Array, friction: HingeFriction
) -> None:
    """Add a valve, fixed to the world, with its handle at the first of two stops.

    The handle is the body TARGET_BODY, in the valve's frame.

    Args:
        spec: scene, changed.
        valve: its shape.
        X_WT: (4, 4) its pose.
        friction: of the hinge.
    """
    import mujoco

    from uuv.models.arms import gear_friction

    place = {"pos": X_WT[:3, 3], "quat": quat_wxyz_from_rotation(X_WT[:3, :3])}
    fixed = spec.worldbody.add_body(name="valve", **place)
    for solid in valve.fixed:
        solid.add_to(fixed)

    handle = spec.worldbody.add_body(name=TARGET_BODY, **place)
    for solid in valve.turned:
        geom = solid.add_to(handle)
        geom.density = STEEL
    spec.add_exclude(name="valve_and_handle", bodyname1="valve", bodyname2=TARGET_BODY)

    # A spec that was read from a file may count in degrees.
    unit = 180.0 / np.pi if spec.compiler.degree else 1.0
    handle.add_joint(
        name=HANDLE,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, 1.0],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=[0.0, unit * QUARTER],
        damping=friction.viscous,
        solref_limit=[_STOP, 1.0],
    )
    curve = gear_friction.GearFriction(
        coulomb=SLIDING * friction.stiction, stiction=friction.stiction, stribeck_speed=STRIBECK
    )
    gear_friction.attach(spec, {HANDLE: curve})

    # What the contacts bring about the axis.
    handle.add_site(name=HANDLE, group=4)
    spec.add_sensor(
        name=HANDLE,
        type=mujoco.mjtSensor.mjSENS_TORQUE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=HANDLE,
    )


def valve_site(
    vehicle: "mujoco.MjSpec", valve: TurnedValve, X_WT: Array, friction: HingeFriction
) -> "mujoco.MjSpec":
    """Add a valve and flat seabed under it to the spec of a vehicle.

    Args:
        vehicle: spec, changed in place.
        valve: shape of the valve.
        X_WT: (4, 4) its pose.
        friction: of its hinge.

    Returns:
        The same spec.
    """
    import mujoco

    add_valve(vehicle, valve, X_WT, friction)
    seabed = vehicle.worldbody.add_geom()
    seabed.name = "seabed"
    seabed.type = mujoco.mjtGeom.mjGEOM_PLANE
    seabed.size = [8.0, 8.0, 0.1]
    seabed.pos = [X_WT[0, 3], X_WT[1, 3], seabed_height(valve.target, X_WT)]
    seabed.rgba = [0.55, 0.5, 0.4, 1.0]
    return vehicle
